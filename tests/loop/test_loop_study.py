"""`gtmodel.loop.study`: both protocols and all laws against the simulated controllers, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.lang import Model
from gtmodel.loop import LoopStudy, one_run, study
from gtmodel.loop.loop_study import GAINS
from gtmodel.results import ArgumentError, SolveStatus, Trajectory
from tests.loop.smooth import smooth

SECONDS = 2.0


@pytest.fixture(scope="module")
def robot() -> Model:
    return gt.robots.gantry_tau("l1_tape", inertia="model_2")


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    return smooth()


@pytest.fixture(scope="module")
def built(robot: Model, generated: Path, motion: Trajectory, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an earlier run, whose program all others use."""
    place = tmp_path_factory.mktemp("place") / "loop"
    s = study(robot, generated, motion, peer="egm", seconds=0.2, in_lockstep=True)
    place.mkdir()
    for name, content in s.files.items():
        (place / name).write_bytes(content.encode() if isinstance(content, str) else content)
    (place / "gt_loop").chmod(0o700)
    return place


@pytest.mark.parametrize(("peer", "law"), [("egm", "dynamics"), ("rsi", "replay"), ("egm", "path")])
def test_law_tracks_better_than_the_reference_alone(
    robot: Model, generated: Path, motion: Trajectory, built: Path, tmp_path: Path, peer: str, law: str
) -> None:
    s = study(robot, generated, motion, peer=peer, seconds=SECONDS, law=law, in_lockstep=True, built=built)
    assert s.status.ok, s.message
    off, on = s.runs
    assert on["tcp_rms_mm"] < GAINS[law] * off["tcp_rms_mm"]
    assert off["tcp_rms_mm"] > 1.0, "there is something to gain"
    assert all(run["late"] == run["lost"] == run["garbage"] == 0 for run in (off, on))
    assert "simulators only" in s.message
    assert {"loop_on.csv", "loop_off.csv", "gt_loop", "gt_loop_model.c", "reference.table"} <= set(s.files)
    assert ("rsi_configuration.xml" in s.files) == (peer == "rsi")
    content = s.files["loop_on.csv"]
    assert isinstance(content, bytes)
    (tmp_path / "loop_on.csv").write_bytes(content)
    log = Trajectory.from_csv(tmp_path / "loop_on.csv")
    assert len(log) == SECONDS / 0.004 and log["state"][-1] == 1
    drawn = s.figure("tracking").axes
    assert drawn and any(len(line.get_xdata()) == s.cycles for axes in drawn for line in axes.get_lines())


@pytest.mark.parametrize(
    ("keys", "argument"),
    [
        ({"peer": "abb"}, "peer"),
        ({"seconds": 0.0}, "seconds"),
        ({"seconds": float("nan")}, "seconds"),
        ({"elastic": 0.0}, "elastic"),
        ({"elastic": float("nan")}, "elastic"),
        ({"deceleration": 0.0}, "deceleration"),
        ({"law": "guess"}, "law"),
        ({"reference": smooth(0.008)}, "reference"),
        ({"reference": Trajectory([0.0, 0.004], {"T": np.zeros((2, 3))}, {"T": "m"})}, "reference"),
    ],
)
def test_what_a_caller_gave_wrong_is_named(
    robot: Model, generated: Path, motion: Trajectory, built: Path, keys: dict[str, Any], argument: str
) -> None:
    given = {"peer": "egm", "seconds": 1.0, "in_lockstep": True, "built": built, "reference": motion} | keys
    with pytest.raises(ArgumentError) as caught:
        study(robot, generated, given.pop("reference"), **given)
    assert caught.value.argument == argument and "\n" not in caught.value.message


def test_a_reference_beyond_reach_is_refused(robot: Model, generated: Path, motion: Trajectory, built: Path) -> None:
    values = {name: motion[name] for name in motion.names}
    far = Trajectory(motion.time, values | {"T": motion["T"] + 9.0}, {name: motion.unit(name) for name in motion.names})
    with pytest.raises(ArgumentError) as caught:
        study(robot, generated, far, peer="egm", seconds=1.0, in_lockstep=True, built=built)
    assert caught.value.argument == "reference" and "at 0 s" in caught.value.message


def test_a_robot_of_other_axes_is_refused(generated: Path, motion: Trajectory) -> None:
    with pytest.raises(ArgumentError) as caught:
        study(gt.robots.f1_gantry_tau(), generated, motion, peer="egm", seconds=1.0, in_lockstep=True)
    assert caught.value.argument == "robot"


def test_a_reference_may_be_a_function_that_is_not_asked_in_vain(
    robot: Model, generated: Path, motion: Trajectory, built: Path
) -> None:
    asked: list[int] = []

    def made() -> Trajectory:
        asked.append(1)
        return motion

    with pytest.raises(ArgumentError):
        study(robot, generated, made, peer="abb", seconds=0.2, in_lockstep=True, built=built)
    with pytest.raises(ArgumentError):
        study(robot, generated / "nothing", made, peer="egm", seconds=0.2, in_lockstep=True, built=built)
    assert not asked
    s = study(robot, generated, made, peer="egm", seconds=0.2, in_lockstep=True, built=built)
    assert asked and s.files["reference.table"] == (built / "reference.table").read_bytes()


def test_an_arm_on_springs_is_off_where_its_motors_are_not(
    robot: Model, generated: Path, motion: Trajectory, built: Path
) -> None:
    s = study(robot, generated, motion, peer="egm", seconds=SECONDS, in_lockstep=True, elastic=12.0, built=built)
    off, on = s.runs
    assert s.status.ok and s.values["elastic_Hz"] == 12.0
    assert on["cart_largest_mm"] < 1e-3 < 0.1 < on["tcp_largest_mm"] < off["tcp_largest_mm"]


def test_a_loop_that_stopped_says_why(
    robot: Model, generated: Path, motion: Trajectory, built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(one_run, "STEP_LIMIT_M", 1e-6)
    s = study(robot, generated, motion, peer="rsi", seconds=0.8, in_lockstep=True, built=built)
    assert s.status is SolveStatus.CHECK_FAILED and "off_running_at_the_end" in s.message
    assert "the reference alone: stopped, the input lies outside the range where a solution exists" in s.message
    monkeypatch.undo()
    s = study(robot, generated, motion, peer="rsi", seconds=0.8, in_lockstep=True, built=built, following=1e-6)
    assert "stopped, a cart was farther than 1e-06 m from its last command" in s.message


@pytest.mark.parametrize("in_lockstep", [True, False])
def test_interrupted_run_says_so(
    robot: Model, generated: Path, motion: Trajectory, built: Path, in_lockstep: bool
) -> None:
    s = study(
        robot, generated, motion, peer="egm", seconds=60.0, in_lockstep=in_lockstep, built=built, stop=lambda: True
    )
    assert s.status is SolveStatus.INTERRUPTED and not s.files and not s.values and not s.rows


def test_the_quantities_are_named_with_their_units() -> None:
    names = [q.name(attribute) for attribute, q in LoopStudy.quantities().items()]
    assert names == [
        "peer", "law", "plant", "plant_stopped_s", "elastic_Hz", "cycles", "real_time", "hold_cycles",
        "deceleration_m_s2", "greatest_speed_m_s", "stopping_distance_m", "joint_deceleration_rad_s2",
            "greatest_joint_speed_rad_s", "stopping_angle_rad", "runs",
    ]  # fmt: skip


def test_the_way_to_the_stop_is_that_of_whole_cycles(
    robot: Model, generated: Path, motion: Trajectory, built: Path
) -> None:
    """Held cycles at full speed, then less by the same step in each cycle."""
    s = study(robot, generated, motion, peer="egm", seconds=1.2, in_lockstep=True, deceleration=7.0, built=built)
    speeds = np.maximum(0.0, s.greatest_speed - 7.0 * 0.004 * np.arange(10_000))
    way = 0.004 * (s.hold_cycles * s.greatest_speed + float(np.sum(speeds[1:])))
    assert s.greatest_speed > 0.1 and abs(s.stopping_distance - way) < 0.004 * s.greatest_speed
