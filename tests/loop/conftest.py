"""The generated folder, the built loop and the hand-written C as a library, once for all tests of this folder."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel._files import codegen_dir
from gtmodel.cgen import generate
from gtmodel.compiler.causal import CausalFunction
from gtmodel.loop import build
from tests.loop.bench import Bench
from tests.support.keeping_compiler import keeping_compiler

STRICT = ("-O2", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror", "-ffp-contract=off")


@pytest.fixture(scope="session")
def compiler(tmp_path_factory: pytest.TempPathFactory) -> str:
    return keeping_compiler(tmp_path_factory.mktemp("compiler"))


@pytest.fixture(scope="module", autouse=True)
def compiled_once(compiler: str) -> Iterator[None]:
    """The same loop is built in many folders."""
    with pytest.MonkeyPatch.context() as patch:
        if compiler:
            patch.setenv("CC", compiler)
        yield


@pytest.fixture(scope="session")
def functions() -> dict[str, CausalFunction]:
    robot = gt.robots.gantry_tau("l1_tape", inertia="model_2")
    carts = robot.causal("T", ["q", "der(q)"])
    return {"fk": robot.causal("q", "T"), "inverse_dynamics": robot.causal("T", "tau"), "carts": carts}


@pytest.fixture(scope="session")
def generated(functions: dict[str, CausalFunction], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("generated")
    generate(functions, folder, name="l1")
    return folder


@pytest.fixture(scope="session")
def bench(functions: dict[str, CausalFunction], generated: Path, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    place = tmp_path_factory.mktemp("loop")
    return Bench(build(generated, place, 3), place, functions)


EXPORTED = """
#include "gt_traj.h"

gt_status traj_at(const gt_traj *traj, uint64_t time_ms, double *row);
gt_status traj_at(const gt_traj *traj, uint64_t time_ms, double *row) { return gt_traj_at(traj, time_ms, row); }
"""


@pytest.fixture(scope="session")
def runtime(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The runtime and the loop's pure parts, compiled as strictly as they are delivered."""
    place = codegen_dir()
    files = [p for p in sorted((place / "runtime").glob("*.c")) if p.name != "gt_model_main.c"]
    files.append(place / "loop" / "gt_sequence.c")
    target = tmp_path_factory.mktemp("runtime") / "runtime.so"
    files.append(target.with_name("exported.c"))  # what lives in a header
    files[-1].write_text(EXPORTED)
    include = [f"-I{place / 'runtime'}", f"-I{place / 'loop'}"]
    command = ["cc", "-std=c99", *STRICT, *include, "-fPIC", "-shared", *map(str, files), "-o", str(target), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(target))
