"""Issue 8, point 5: inverse kinematics, velocity map, inverse dynamics without run-time errors over a workspace box."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from gtmodel import Status, cgen
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.points import evaluate
from gtmodel.cgen.proof import ASSUMPTIONS, Proof, available, prove
from gtmodel.compiler.causal import CausalFunction
from tests.cgen.conftest import Functions

# 1.0 x 0.5 x 0.5 m round the reference motion from [0, -0.9, 0.1] to [0.9, -0.9, 0.45] m
WORKSPACE = ((-0.05, 0.95), (-1.15, -0.65), (0.05, 0.55))
SPEED = ((-1.5, 1.5),) * 3  # m/s
ACCELERATION = ((-10.0, 10.0),) * 3  # m/s2
BOXES = {"ik": WORKSPACE, "velocity": WORKSPACE + SPEED, "inverse_dynamics": WORKSPACE + SPEED + ACCELERATION}
BEYOND = ((-0.05, 0.95), (-2.5, -0.65), (0.05, 0.55))  # link 3 of 1.81 m does not reach it


@pytest.fixture(autouse=True)
def tool() -> None:
    lacking = available()
    if lacking:
        pytest.skip(lacking)


def outside(proof: Proof, function: CausalFunction, box: Sequence[tuple[float, float]]) -> int:
    """How many of 500 random points of the box leave the guaranteed intervals of outputs and status."""
    low, high = np.array(box).T
    inputs = low + (high - low) * np.random.default_rng(5).random((500, len(low)))
    (face,) = interfaces({"f": function}, "l1")
    values, status = evaluate(face, inputs)
    bounds = np.array(proof.outputs)
    slack = 1e-6 * np.max(np.abs(bounds), axis=1)  # Eva prints twelve digits
    found = np.column_stack([values, status])
    return int(np.sum(np.any((found < bounds[:, 0] - slack) | (found > bounds[:, 1] + slack), axis=1)))


def test_inverse_kinematics(l1: Functions, l1_folder: Path) -> None:
    proof = prove(l1_folder, "ik", l1["ik"], WORKSPACE)
    assert proof.proved and proof.alarms == ()
    assert proof.outputs[-1] == (Status.OK, Status.OK)  # everywhere, says Eva
    assert outside(proof, l1["ik"], WORKSPACE) == 0


def test_beyond_reach_alarms_stand_on_the_root(l1: Functions, l1_folder: Path) -> None:
    proof = prove(l1_folder, "ik", l1["ik"], BEYOND, depth=0)
    assert not proof.proved and len(proof.alarms) > 0
    assert {text for text in proof.alarms if not text.startswith("function sqrt: precondition")} == set()


@pytest.mark.proof
@pytest.mark.parametrize("key", ["velocity", "inverse_dynamics"])
def test_velocity_and_forces(key: str, l1: Functions, l1_folder: Path) -> None:
    proof = prove(l1_folder, key, l1[key], BOXES[key])
    print(f"{key}: {proof.runs} runs, {len(proof.cells)} cells, outputs in {proof.outputs}; assuming {ASSUMPTIONS}")
    assert proof.proved and len(proof.unproved) == 0
    assert proof.outputs[-1] == (Status.OK, Status.OK)
    assert outside(proof, l1[key], BOXES[key]) == 0


def test_what_cannot_be_proved_is_said(l1: Functions, l1_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(cgen.GenerationError, match="is no generated folder"):
        prove(tmp_path, "ik", l1["ik"], WORKSPACE)
    with pytest.raises(cgen.GenerationError, match="takes a box of 3 intervals"):
        prove(l1_folder, "ik", l1["ik"], WORKSPACE[:2])
