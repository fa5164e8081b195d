"""Inverse kinematics, velocity map and inverse dynamics without run-time errors over a workspace box, by Frama-C's Eva,
which reads the C text; and Eva as the judge of the certificates, which read the operations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.certify.code import statements
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.manifest import read
from gtmodel.cgen.points import evaluate
from gtmodel.cgen.proof import ASSUMPTIONS, Proof, available, prove
from gtmodel.compiler.causal import CausalFunction
from gtmodel.results import Work
from tests.cgen.conftest import Functions, copy

# 1.0 x 0.5 x 0.5 m round the reference motion from [0, -0.9, 0.1] to [0.9, -0.9, 0.45] m
WORKSPACE = ((-0.05, 0.95), (-1.15, -0.65), (0.05, 0.55))
SPEED = ((-1.5, 1.5),) * 3  # m/s
ACCELERATION = ((-10.0, 10.0),) * 3  # m/s2
BOXES = {"ik": WORKSPACE, "velocity": WORKSPACE + SPEED, "inverse_dynamics": WORKSPACE + SPEED + ACCELERATION}
BEYOND = ((-0.05, 0.95), (-2.5, -0.65), (0.05, 0.55))  # link 3 of 1.81 m does not reach it
NAMED = {"T": WORKSPACE, "der(T)": SPEED, "der(T,2)": ACCELERATION}
DIGITS = 1e-11  # Eva prints twelve


@pytest.fixture(autouse=True)
def tool() -> None:
    lacking = available()
    if lacking:
        pytest.skip(lacking)


@pytest.fixture(scope="module")
def certified(l1: Functions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with certificates of all of its functions over the same boxes."""
    functions = {key: l1[key] for key in BOXES}
    proved = statements(functions, NAMED, "l1", "double", Work())
    assert set(proved.functions) == set(BOXES), proved.left_out
    return cgen.generate(
        functions, tmp_path_factory.mktemp("proved") / "l1", name="l1", box=NAMED, beside=proved.beside
    ).folder


def certificate(
    function: CausalFunction, box: Sequence[tuple[float, float]], max_boxes: int = 100
) -> gt.certify.BoxCertificate:
    intervals = {signal.name: box[3 * k : 3 * k + 3] for k, signal in enumerate(function.inputs)}
    return gt.certify.study(function, intervals, max_boxes=max_boxes)


def ranges_beyond_eva(proof: Proof, function: CausalFunction) -> list[str]:
    """Outputs whose range by certificates of Eva's own cells leaves Eva's. Eva evaluates the operations in order; the
    certificate also by mean value, so that on the same cells it must be as narrow."""
    found = [certificate(function, cell) for cell in proof.cells]
    assert all(s.proved == 1.0 for s in found)
    beyond = []
    for name, (low, high) in zip(found[0].ranges, proof.outputs, strict=False):
        room = DIGITS * max(abs(low), abs(high))
        spans = [s.ranges[name] for s in found]
        if not all(span is not None and low - room <= span[0] <= span[1] <= high + room for span in spans):
            beyond.append(name)
    return beyond


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
    assert ranges_beyond_eva(proof, l1["ik"]) == []


def test_one_digit_of_the_text_is_seen(l1: Functions, l1_folder: Path, tmp_path: Path) -> None:
    """The squared length of a link in the C code, but not in the operations: the cart of that link parts from Eva."""
    folder = copy(l1_folder, tmp_path)
    body = folder / "gt_l1_body.c"
    text, squared = body.read_text(), "3.2761000000000000e+00"
    assert squared in text
    body.write_text(text.replace(squared, "3.2761000010000000e+00"))
    assert ranges_beyond_eva(prove(folder, "ik", l1["ik"], WORKSPACE), l1["ik"]) == ["q[2]"]


def test_beyond_reach_alarms_stand_on_the_root(l1: Functions, l1_folder: Path) -> None:
    proof = prove(l1_folder, "ik", l1["ik"], BEYOND, depth=0)
    assert not proof.proved and len(proof.alarms) > 0
    assert {text for text in proof.alarms if not text.startswith("function sqrt: precondition")} == set()


@pytest.mark.proof
def test_no_cell_is_refuted_by_one_and_proved_by_the_other(l1: Functions, l1_folder: Path) -> None:
    proof = prove(l1_folder, "ik", l1["ik"], BEYOND, depth=2)
    whole = certificate(l1["ik"], BEYOND, max_boxes=2000)
    sizes = [np.prod(np.diff(cell, axis=1)) for cell in proof.cells]
    share = sum(sizes) / np.prod(np.diff(BEYOND, axis=1))
    print(f"proved by Eva {share:.4f}, by the certificate {whole.proved:.4f}, which refutes {whole.refuted:.4f}")
    assert proof.outputs[-1] == (Status.OK, Status.OK)
    assert whole.refuted > 0 and 0.25 < share <= 1.0 - whole.refuted
    assert all(certificate(l1["ik"], cell).proved == 1.0 for cell in proof.cells)
    for example in whole.counter_examples:
        point = list(example["point"].values())
        assert not any(all(a <= x <= b for x, (a, b) in zip(point, cell, strict=True)) for cell in proof.cells)


@pytest.mark.proof
@pytest.mark.parametrize("key", list(BOXES))
def test_every_statement_of_a_folder(key: str, l1: Functions, certified: Path) -> None:
    """That it returns GT_OK, and its ranges; also that nothing else goes wrong in C, which Eva alone proves."""
    proof = prove(certified, key, l1[key], BOXES[key])
    print(f"{key}: {proof.runs} runs, {len(proof.cells)} cells, outputs in {proof.outputs}; assuming {ASSUMPTIONS}")
    assert proof.proved and len(proof.unproved) == 0
    assert proof.outputs[-1] == (Status.OK, Status.OK)
    assert outside(proof, l1[key], BOXES[key]) == 0
    assert ranges_beyond_eva(proof, l1[key]) == []
    content = read(certified)
    assert content is not None
    stated = content["certificate"]["proved"][f"gt_l1_{key}"]
    assert len(stated["ranges"]) == len(proof.outputs) - 1
    for (a, b), (low, high) in zip(stated["ranges"], proof.outputs, strict=False):
        assert max(a, low) < min(b, high)


def test_what_cannot_be_proved_is_said(l1: Functions, l1_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(cgen.GenerationError, match="is no generated folder"):
        prove(tmp_path, "ik", l1["ik"], WORKSPACE)
    with pytest.raises(cgen.GenerationError, match="takes a box of 3 intervals"):
        prove(l1_folder, "ik", l1["ik"], WORKSPACE[:2])
