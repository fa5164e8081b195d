"""What --costs lists: machine code, stack, instructions, symbols; each number by a second road."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from gtmodel import Status, cgen
from gtmodel.cgen import measurement
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.points import draw, evaluate
from tests.bench.callgrind import FLAGS, Call, count
from tests.cgen.conftest import Functions, succeed


@pytest.mark.usefixtures("callgrind")
def test_costs_are_those_of_nm_and_of_a_caller_of_its_own(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    found = cgen.costs(small_folder, small)
    assert found.missing == "" and set(found.instructions) == set(found.text_bytes) == set(found.stack_bytes)
    sources = [small_folder / "gt_small.c", small_folder / "gt_small_body.c"]
    succeed("cc", *FLAGS, "-c", *sources, cwd=tmp_path)
    code = subprocess.run(["size", *tmp_path.glob("*.o")], capture_output=True, text=True, check=True).stdout
    whole = sum(int(line.split()[0]) for line in code.splitlines()[1:])
    assert 0.4 * whole < sum(found.text_bytes.values()) < whole  # the rest are constants and tables of unwinding
    assert set(found.symbols) == {f"gt_small_{key}{end}" for key in small for end in ("", "_body")}
    face = next(f for f in interfaces(small, "small") if f.key == "pendulum")
    rows = draw(face, 200, seed=2)
    rows = rows[evaluate(face, rows)[1] == Status.OK][:1]
    known = "(const gt_small_pendulum_in *)(const void *)in, (gt_small_pendulum_out *)(void *)out"
    call = Call(face.symbol, f"(void){face.symbol}({known});", np.array(rows), face.output_size, "gt_small.h")
    exact = count({"it": call}, sources)["it"].instructions
    assert exact < found.instructions[face.symbol] < exact + 15  # and the loop round the call


def test_without_valgrind_the_rest_is_measured(
    small: Functions, small_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measurement.shutil, "which", lambda tool: None if tool == "valgrind" else f"/usr/bin/{tool}")
    found = cgen.costs(small_folder, small)
    assert found.missing == "no instruction was counted: there is no valgrind on this machine"
    assert found.instructions == {} and min(found.stack_bytes.values()) > 0
