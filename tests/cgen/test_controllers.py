"""Issue 8, point 1, for every function of the problem files: --check, a sharp self-test, two instances mixed."""

from __future__ import annotations

import ctypes
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.points import draw
from gtmodel.cgen.real import real_of
from gtmodel.cgen.verification.comparison import call
from gtmodel.cli import main
from tests.cgen.calls import shared_library
from tests.cgen.conftest import c_files, copy, run, succeed

PROBLEMS = Path(__file__).parents[2] / "problems"
FILES = ("l1_controller", "l1_controller_float", "f1_controller", "d1_controller")
ROBOTS = {"l1_tape": lambda: gt.robots.gantry_tau("l1_tape"), "f1": gt.robots.f1_gantry_tau,
          "d1_six_link": gt.robots.six_link_gantry_tau}  # fmt: skip
CHANGED = 4  # constants of each part of a function
# A change that a person would not see. In float 1e-6 of an offset of 0.04 m is less than half a unit in the last place
# of a cart's position beyond 1 m: no result need change.
RELATIVE = {"double": 1e-9, "float": 1e-5}
MIXED = 40  # rows of each of two courses
NEWTON_TEXT = 12_000  # bytes of machine code of the Newton blocks of a function, loop and guards included

pytestmark = pytest.mark.proof


@pytest.fixture(scope="module", params=FILES)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """A problem and its generated folder, compared with Python at 10,000 random points of each function."""
    path, out = PROBLEMS / f"{request.param}.toml", tmp_path_factory.mktemp("controllers") / "out"
    problem = tomllib.loads(path.read_text())
    assert problem["check"]["points"] == 10_000
    assert main(["codegen", str(path), "-o", str(out), "--costs"]) == 0
    return problem, out


def faces_of(problem: dict[str, Any]) -> list[Interface]:
    robot = ROBOTS[problem["robot"]]()
    functions = {f["name"]: robot.causal(f["known"], f["targets"]) for f in problem["functions"]}
    return interfaces(functions, problem["name"], real=real_of(problem.get("real", "double")))


def test_every_part_of_every_function_is_under_self_test(made: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    problem, out = made
    folder = copy(out, tmp_path)
    name, relative = problem["name"], RELATIVE[problem.get("real", "double")]
    body = folder / f"gt_{name}_body.c"
    text = body.read_text()
    compiler = ("cc", "-O0", "-ffp-contract=off")
    succeed(*compiler, "-c", *[f for f in c_files(folder) if f != body.name], cwd=folder)
    tried: dict[str, int] = {}
    for part in re.finditer(r"^/\* (gt_\w+):\(.*?^}\n", text, re.M | re.S):
        constants = list(re.finditer(r"(?<=[= (])(-?\d+\.\d+(?:e[+-]\d+)?)(f?)(?=[;) ])", part[0]))
        constants = [c for c in constants if float(c[1])]  # zero stays what it is
        spread = np.linspace(0, len(constants) - 1, CHANGED).round().astype(int)
        for constant in [constants[k] for k in sorted(set(spread.tolist()))] if constants else []:
            first, last = part.start() + constant.start(), part.start() + constant.end()
            other = f"{float(constant[1]) * (1 + relative)!r}{constant[2]}"
            body.write_text(f"{text[:first]}{other}{text[last:]}")
            succeed("sh", "-c", f"{' '.join(compiler)} -c {body.name} && cc *.o -lm", cwd=folder)
            tried[part[1]] = tried.get(part[1], 0) + 1
            assert run("./a.out", cwd=folder).returncode == 1, (part[1], constant[0])
    print(f"{sum(tried.values())} constants changed")
    for f in problem["functions"]:
        assert sum(n for symbol, n in tried.items() if symbol.startswith(f"gt_{name}_{f['name']}_")) >= CHANGED


@pytest.mark.parametrize("flags", ["-O3 -march=native -ffp-contract=off", "-O2 -mavx2 -mfma", "-O3 -march=native"])
def test_fused_instructions_do_not_slip_in(flags: str, made: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    """gcc 12 vectorises a sum and a difference beside a product to fmaddsub, whatever -ffp-contract says."""
    folder = copy(made[1], tmp_path)
    if "__FP_FAST_FMA 1" not in run("cc", *flags.split(), "-dM", "-E", "-x", "c", "/dev/null", cwd=folder).stdout:
        pytest.skip("this processor or compiler has no fused multiply-add")
    succeed("cc", *flags.split(), *c_files(folder), "-lm", cwd=folder)
    assert run("./a.out", cwd=folder).returncode == 0  # the self-test, bit for bit


def test_two_instances_mixed_equal_two_apart(made: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    problem, folder = made
    library = shared_library(folder, tmp_path)
    for face in faces_of(problem):
        courses = [draw(face, MIXED, seed) for seed in (3, 4)]
        apart = [steps(library, face, course) for course in courses]
        state = [course[0, face.input_size :] for course in courses]
        mixed: list[list[np.ndarray]] = [[], []]
        for n in range(MIXED):
            for k, course in enumerate(courses):
                result, state[k] = step(library, face, course[n], state[k])
                mixed[k].append(result)
        np.testing.assert_array_equal(mixed, apart, err_msg=face.key)


def steps(library: ctypes.CDLL, face: Interface, course: np.ndarray) -> list[np.ndarray]:
    """What a course of inputs gives when each call starts where the last one ended."""
    state, results = course[0, face.input_size :], []
    for row in course:
        result, state = step(library, face, row, state)
        results.append(result)
    return results


def step(library: ctypes.CDLL, face: Interface, row: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    outputs, status = call(library, face, np.concatenate([row[: face.input_size], state])[None])
    after = outputs[0, face.output_size :]
    return np.append(outputs[0, : face.output_size], status), after if status[0] == 0 else state


def test_costs_and_boxes_are_recorded(made: tuple[dict[str, Any], Path]) -> None:
    problem, folder = made
    content = json.loads((folder / "manifest.json").read_text())
    costs = json.loads((folder / "costs.json").read_text())
    assert costs["body_sha256"] == content["body_sha256"]
    for f in content["functions"]:
        assert f["box"] is not None and f["operations"] > 20, f["name"]
        if not costs["missing"]:
            assert costs["instructions"][f["symbol"]] > f["operations"] / 2
    print(
        {
            f["symbol"]: (f["operations"], costs["text_bytes"][f["symbol"]], costs["newton_bytes"].get(f["symbol"]))
            for f in content["functions"]
        }
    )
    assert all(n <= NEWTON_TEXT for n in costs["newton_bytes"].values())
    assert len(costs["newton_bytes"]) == (0 if problem["robot"] == "l1_tape" else len(problem["functions"]))
