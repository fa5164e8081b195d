"""`gtmodel loop --law lead_through`: the C loop with a hand and a synthetic plate, and what is refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cli import main
from gtmodel.lang import Model
from gtmodel.loop import Guiding, SensorNumbers, SyntheticHand, SyntheticScene, study
from gtmodel.loop.lead_through.study import EXPECTED
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, generate
from gtmodel.results import ArgumentError, SolveStatus, Status

GUIDING = Guiding(tool=SensorNumbers(mass=0.8), handle=SensorNumbers(mass=0.4))
PLATE = GUIDING.scene.plate
SECONDS = 3.0


@pytest.fixture(scope="module")
def robot() -> Model:
    return gt.robots.gantry_tau("l1_tape", inertia="model_2")


@pytest.fixture(scope="module")
def built(robot: Model, generated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an earlier run, whose program all others use."""
    place = tmp_path_factory.mktemp("place") / "loop"
    s = _run(robot, generated, None, seconds=0.1)
    place.mkdir()
    for name, content in s.files.items():
        (place / name).write_bytes(content.encode() if isinstance(content, str) else content)
    (place / "gt_loop").chmod(0o700)
    return place


def _run(robot: Model, folder: Path, built: Path | None, guiding: Any = GUIDING, **given: Any) -> Any:
    asked: dict[str, Any] = {"peer": "egm", "seconds": SECONDS, "in_lockstep": True} | given
    return study(robot, folder, None, law="lead_through", lead_through=guiding, built=built, **asked)


def _in(**scene: Any) -> Guiding:
    return dataclasses.replace(GUIDING, scene=SyntheticScene(**scene))


@pytest.mark.parametrize(
    ("fault", "peer"),
    [
        *((fault, "egm") for fault in sorted(EXPECTED)),
        ("stale", "rsi"),  # which faults stop it by either protocol: test_lead_through.py
        *(pytest.param(fault, "rsi", marks=pytest.mark.proof) for fault in sorted(EXPECTED) if fault != "stale"),
    ],
)
def test_the_force_is_held_and_a_bad_sensor_stops_the_tool(
    robot: Model, generated: Path, built: Path, peer: str, fault: str
) -> None:
    s = _run(robot, generated, built, _in(fault=fault), peer=peer)
    assert s.status.ok, s.message
    assert abs(s.force_mean - 2.0) < 1e-3 and s.force_least > 1.99
    assert s.runs[1]["status"] == EXPECTED[fault] and s.braking <= 5.0 * (1 + 1e-6)
    assert 0 < s.braking_way < 1e-3 and "synthetic" in s.message
    assert {"loop_guided.csv", "loop_fault.csv", "gains.table", "gt_loop"} <= set(s.files)
    assert len(s.figure("guiding").axes) == 3


@pytest.mark.parametrize(
    ("plate", "held"),
    [
        # closed forms with the nominal normal, at a slow drag: w / K, and along a tilted plate v sin(psi) / K
        ({"rise": 0.002}, 2.0 + 0.002 / 0.01),
        ({"rise": -0.002}, 2.0 - 0.002 / 0.01),
    ],
)
def test_a_plate_that_moves_leaves_the_error_of_the_closed_form(
    robot: Model, generated: Path, built: Path, plate: dict[str, float], held: float
) -> None:
    moving = _in(plate=dataclasses.replace(PLATE, **plate), hand=SyntheticHand(drag=0.0))
    s = _run(robot, generated, built, moving, seconds=4.0)
    assert abs(s.force_mean - held) < 0.03 * abs(held - 2.0)
    assert s.status is SolveStatus.CHECK_FAILED and "force_error_N" in s.message


def test_a_gain_beyond_its_limit_is_said(robot: Model, generated: Path, built: Path) -> None:
    stiff = _in(plate=dataclasses.replace(PLATE, stiffness=15_000.0))
    s = _run(robot, generated, built, stiff)
    assert s.gain_share == pytest.approx(3 * 0.44593, rel=1e-4) and "gain_share" in s.message
    assert s.status is SolveStatus.CHECK_FAILED


def test_a_run_that_ends_before_the_touch_is_no_success(robot: Model, generated: Path, built: Path) -> None:
    s = _run(robot, generated, built, seconds=0.1)
    assert s.status is SolveStatus.CHECK_FAILED and s.force_mean is None and "force_least_N" in s.message
    assert s.rows


def test_same_seed_same_bytes(robot: Model, generated: Path, built: Path) -> None:
    noisy = _in(noise=0.1, noise_moment=0.005, seed=3)
    a, b = (_run(robot, generated, built, noisy, seconds=1.0) for _ in range(2))
    assert a.files["loop_guided.csv"] == b.files["loop_guided.csv"] and a.force_mean == b.force_mean
    assert a.files["loop_guided.csv"] != _run(robot, generated, built, seconds=1.0).files["loop_guided.csv"]


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: dataclasses.replace(GUIDING, normal=(0.0, 0.0, 1.1)), "normal"),
        (lambda: dataclasses.replace(GUIDING, gains=gt.control.lead_through.SurfaceGains(cycle=0.002)), "gains.cycle"),
        (lambda: SensorNumbers(mass=0.0), "mass"),
        (lambda: SyntheticScene(gap=0.0), "gap"),
        (lambda: SyntheticScene(fault="flood"), "fault"),  # type: ignore[arg-type]
    ],
)
def test_numbers_that_do_not_fit_are_refused_by_their_name(call: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument


def test_what_a_caller_gave_wrong_is_named(robot: Model, generated: Path, built: Path) -> None:
    for given, argument in (
        ({"guiding": None}, "law"),
        ({"guiding": _in(start=(9.0, 9.0, 9.0))}, "lead_through.scene.start"),
    ):
        with pytest.raises(ArgumentError) as caught:
            _run(robot, generated, built, **given)
        assert caught.value.argument == argument
    with pytest.raises(ArgumentError) as caught:
        study(robot, generated, None, peer="egm", seconds=1.0)
    assert caught.value.argument == "reference"


def test_a_folder_without_the_functions_never_moves(robot: Model, tmp_path: Path) -> None:
    gt.cgen.study({"fk": robot.causal(known="q", targets="T")}, tmp_path / "c", name="l1", check=None)
    s = _run(robot, tmp_path / "c", None, seconds=0.2)
    assert s.status is SolveStatus.CHECK_FAILED and s.greatest_speed == 0.0
    assert s.runs[0]["status"] == Status.OUT_OF_RANGE


def test_the_declared_problem_runs_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    loaded = load("l1_lead_through.toml")
    generate(loaded, context_of(loaded), tmp_path / "l1", verify=False)
    words = ["loop", str(tmp_path / "l1"), "--law", "lead_through", "--peer", "egm", "--seconds", "4", "--lockstep"]
    assert main([*words, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["status"] == "solved" and abs(printed["values"]["force_mean_N"] - 2.0) < 0.02
    written = {path.name for path in (tmp_path / "l1" / "loop").iterdir()}
    assert {"guiding.png", "loop_guided.csv", "loop.json"} <= written
    assert np.isfinite(printed["values"]["braking_way_m"])
