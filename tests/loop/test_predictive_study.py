"""`gtmodel.loop.study` with the law "predictive": beside computed torque on the same motion, with a heavier plate, two
cycles of delay, noise and motors that saturate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cgen import generate
from gtmodel.lang import Model
from gtmodel.loop import Disturbances, PredictiveLoop, study
from gtmodel.loop.build import manifest_of, plan_of
from gtmodel.loop.loop_study import there_and_back
from gtmodel.loop.predictive_result import goals_of
from gtmodel.predictive import AxisServo, ControlHorizon, Controller, Measurement
from gtmodel.results import ArgumentError, Trajectory
from tests.bench import bench_predictive_loop
from tests.loop.smooth import smooth

FORCE, MARGIN = 550.0, 100.0
HEAVIER = 0.2 * 9.13  # a fifth of the plate
OFFSET_M = 1e-4


def controller(stages: int = 20) -> Controller:
    return gt.predictive.controller(
        gt.robots.gantry_tau("l1_tape", inertia="model_2"),
        ControlHorizon(period=0.004, stages=stages, length=0.01, delay=2, preview=True),
        tolerances={"T": 0.001, "der(T)": 0.1, "der(T,2)": 10.0},
        targets={"T": [0.2, -0.95, 0.2]},
        references=["T", "der(T)", "der(T,2)"],
        limits={"tau": (-FORCE, FORCE)},
        measured={"q": Measurement(deviation=1e-5, jump=0.02)},
        disturbance={"tau": 100.0},
        servo=AxisServo(40_000.0, 1_500.0),
    )


@pytest.fixture(scope="module")
def folder(functions: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("predictive") / "generated"
    generate({**functions, "law": controller()}, place, name="l1")
    return place


@pytest.fixture(scope="module")
def heavier() -> Model:
    return gt.robots.gantry_tau("l1_tape", inertia="model_2", payload=HEAVIER)


def _studied(heavier: Model, folder: Path, motion: Trajectory, **keys: Any) -> PredictiveLoop:
    found = study(
        heavier, folder, motion, **({"peer": "egm", "seconds": 3.0, "law": "predictive", "in_lockstep": True} | keys)
    )
    assert isinstance(found, PredictiveLoop), found.message
    return found


def test_planned_forces_hold_and_no_offset_remains(heavier: Model, folder: Path, tmp_path: Path) -> None:
    disturbed = Disturbances(delay=2, noise=1e-5, seed=1, drift=20.0, force_limit=FORCE, force_margin=MARGIN)
    s = _studied(heavier, folder, smooth(), disturbances=disturbed)
    assert s.status.ok, s.message
    assert s.force_planned == FORCE, "the limit counts on this motion"
    assert FORCE < s.force_asked[1] < FORCE + MARGIN < s.force_asked[0]
    assert 0.0 < s.beyond[1] < 0.1
    before, after = s.offset
    assert before is not None and after is not None and after < 1e3 * OFFSET_M < before
    computed, optimal = s.runs
    assert optimal["tcp_rms_mm"] < 0.7 * computed["tcp_rms_mm"]
    assert (s.unsolved, s.unread, s.refused, s.skipped) == (0, 0, 0, 0)
    assert s.kkt_residual < 1e-4 and s.iterations_largest <= 25
    assert {name for name, share in s.active.items() if share > 0} <= {
        f"tau[{k}] {side}" for k in range(3) for side in ("low", "high")
    }
    assert s.force_limit == s.values["force_limit_N"] == FORCE
    (tmp_path / "log.csv").write_bytes(s.files["loop_on.csv"])  # type: ignore[arg-type]
    log = Trajectory.from_csv(tmp_path / "log.csv")
    assert np.array_equal(np.abs(log["force"]).max(), s.force_planned)
    assert np.mean(log["active_tau_0_high"][1:]) == pytest.approx(s.active["tau[0] high"], abs=0.01)
    assert log["iterations"].max() == s.iterations_largest


def test_limits_of_a_plant_without_a_servo_are_refused(heavier: Model, generated: Path) -> None:
    with pytest.raises(ArgumentError) as caught:
        study(
            heavier, generated, smooth(), peer="egm", seconds=0.1, in_lockstep=True,
            disturbances=Disturbances(force_limit=FORCE),
        )  # fmt: skip
    assert caught.value.argument == "disturbances.force_limit"


def test_goals_are_the_columns_of_the_reference(folder: Path, heavier: Model) -> None:
    plan = plan_of(manifest_of(folder), 3)
    assert plan is not None
    assert (plan.rows, plan.stage_ms, plan.delay, plan.columns) == (21, 10, 2, 9)
    table = there_and_back(heavier, smooth(), 100).rows
    assert np.array_equal(goals_of(plan, table, 3), table[:, 9:])


def test_a_folder_without_what_the_law_needs_is_refused(heavier: Model, generated: Path, folder: Path) -> None:
    with pytest.raises(ArgumentError) as caught:
        study(heavier, generated, smooth(), peer="egm", seconds=0.1, law="predictive", in_lockstep=True)
    assert caught.value.argument == "folder"
    content = manifest_of(folder)
    (step,) = content["steps"]
    for change in (
        {"outputs": [m for m in step["outputs"] if m["signal"] != "q.command"]},
        {"facts": {name: fact for name, fact in step["facts"].items() if name != "stiffness"}},
        {"facts": step["facts"] | {"delay": 17}},
        {"facts": step["facts"] | {"length_ms": 10.5}},
        {"inputs": [*step["inputs"], step["inputs"][0]]},
    ):
        assert plan_of(content | {"steps": [step | change]}, 3) is None


@pytest.mark.proof
def test_a_goal_a_wall_and_a_limit_change_on_the_way() -> None:
    assert bench_predictive_loop.main() == 0
