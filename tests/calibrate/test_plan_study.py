"""The plan study: poses added until criteria hold, devices, methods, turns of the plate, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.calibrate import Choice
from gtmodel.calibrate.plan import (
    Criteria,
    Evaluation,
    Gauge,
    PatternCamera,
    PlanLimits,
    PlanSimulation,
    PlanStudy,
    PosesToMeasure,
    Room,
    Safety,
    Tracker,
    Wire,
    plan_study,
    steps,
)
from gtmodel.calibrate.plan.device import measuring
from gtmodel.calibrate.plan.options import Task
from gtmodel.calibrate.plan.steps import PlanState, find_candidates, turns_of
from gtmodel.kinematics.workspace import Box
from gtmodel.results import ArgumentError, SolveStatus

ROOM = Room([0.8, -1.0, 0.4], [2.0, 0.0, 1.4], step=0.2)
TRACKER = Tracker([1.0, -4.5, 0.8])
FEW = PosesToMeasure(12, held_out=4, starts=1)
NONE = PlanSimulation(runs=0)
TWO = PlanSimulation(runs=2)
Planner = Callable[..., PlanStudy]


@pytest.fixture(scope="module")
def l1():
    return gt.robots.gantry_tau("l1_tape")


@pytest.fixture(scope="module")
def f1():
    return gt.robots.f1_gantry_tau()


@pytest.fixture(scope="module", autouse=True)
def one_compilation():
    """The same robot is compiled once for all tests here: most of a small plan's time."""
    made, known = steps.limited_mechanism, {}

    def once(model, home, bodies):
        key = repr((model, home, bodies.plate_joints))
        if key not in known:
            known[key] = made(model, home, bodies)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steps, "limited_mechanism", once)
        yield


@pytest.fixture(scope="module")
def plan(l1) -> Planner:
    def planned(device: Any = TRACKER, room: Room = ROOM, robot: Any = None, **options: Any) -> PlanStudy:
        return plan_study(robot or l1, device, room, **{"poses": FEW, "curve": (), "simulation": NONE, **options})

    return planned


def accuracy(mm: float) -> Criteria:
    return Criteria(accuracy=1e-3 * mm)


def test_every_step_has_its_picture(plan: Planner):
    box = Box(low=[0.8, -1.0, 0.4], high=[1.0, -0.8, 0.6])
    done = plan(curve=[10, 16], simulation=TWO, obstacles=[box])
    assert list(done.figures) == [
        "1_workspace", "2_obstacles_and_safety", "3_device", "4_poses", "5_number_of_poses", "6_parameters",
        "7_predicted_error",
    ]  # fmt: skip
    shown: dict[str, Any] = {name: draw() for name, draw in done.figures.items()}
    legend = shown["4_poses"].axes[0].get_legend_handles_labels()[1]
    assert any(t.startswith("calibrate: 12") for t in legend) and "held out: 4" in legend
    assert "synthetic" in shown["7_predicted_error"].axes[-1].get_title()
    assert done.purpose.count("calibrate") == done.poses == 12 and done.purpose.count("verify") == done.held_out
    assert len(done.commanded) == len(done.actuators) == 16 and "parameters determined" in str(done)


def test_poses_are_added_until_the_accuracy_is_reached(plan: Planner):
    first, again = plan(criteria=accuracy(1.0)), plan(criteria=accuracy(1.0))
    assert str(again.values) == str(first.values) and again.files == first.files
    assert first.predicted_error is not None
    wanted = 0.8 * first.predicted_error
    done = plan(criteria=Criteria(accuracy=wanted), poses=replace(FEW, more=6, most=30))
    assert list(done.rounds) == [12, 18, 24][: len(done.rounds)] and done.poses > 12
    assert done.approved and done.predicted_error is not None and done.predicted_error <= wanted
    never = plan(criteria=accuracy(1e-3), poses=replace(FEW, most=14))
    assert not never.approved and not never.checks["predicted_error_m"].passed
    assert never.status is SolveStatus.CHECK_FAILED and "predicted_error_m" in never.message
    assert "not approved with 14 poses: predicted_error_m; " in never.message


def test_a_wire_alone_is_not_approved_and_with_known_guideways_it_is(plan: Planner):
    wire, poses = Wire([3.0, -3.0, 1.0]), replace(FEW, number=30)
    done = plan(wire, poses=poses)
    assert done.status is SolveStatus.CHECK_FAILED and not done.approved
    assert (done.rank, done.parameters) == (18, 21)
    assert "depends on combinations that no pose determines" in done.message and done.predicted_error is None
    assert None in done.parameter_std.values()
    held = plan(wire, choice=Choice(fixed=["A"]), poses=poses, simulation=TWO, criteria=accuracy(1.0))
    assert held.approved and held.rank == held.parameters == 12


@pytest.mark.parametrize("method", ["D", "condition", "grid"])
def test_methods_of_selection(plan: Planner, method: Any):
    done = plan(poses=replace(FEW, number=40, method=method), criteria=accuracy(1.0))
    assert done.approved
    assert done.poses == 40 if method != "grid" else 20 < done.poses < 80


@pytest.mark.parametrize(
    ("device", "free", "worse"),
    [
        (PatternCamera([1.4, -5.0, 0.8], [1.4, -0.5, 0.8]), None, 10.0),
        (Gauge([0.0, 0.0, 1.0]), ["L"], 0.1),
    ],
)
def test_other_devices(plan: Planner, device: Any, free: list[str] | None, worse: float):
    asked = {"choice": Choice(free), "criteria": accuracy(5.0)}
    tracked = plan(**asked).predicted_error
    done = plan(device, simulation=TWO, **asked)
    assert tracked is not None and done.predicted_error is not None
    assert done.approved and done.predicted_error > worse * tracked
    assert done.rank == (3 if free else 21)


TURNS = np.radians([[0, 0, 0], [20, 0, 0], [0, 20, 0], [0, 0, 20], [-15, -15, 0]]).tolist()
F1_ROOM = Room([-0.4, 2.1, -0.2], [0.0, 2.5, 0.2], step=0.2, turns=TURNS)
F1_LIMITS = PlanLimits(actuators=[[-0.5, 2.0]] * 3, axes=np.radians([[-70, 70]] * 3).tolist())
F1_TRACKER = Tracker([-0.2, -2.5, 0.3], orientation_noise=90e-6)
NARROW = PlanLimits(axes=np.radians([[-10, 10]] * 3).tolist())


def test_an_f1_is_planned_with_turns_of_its_plate(plan: Planner, f1: Any):
    """72 raw parameters, nine of them a choice of coordinates (Table 5.4: six, and three lengths of quaternions)."""
    done = plan(F1_TRACKER, F1_ROOM, f1, limits=F1_LIMITS, poses=replace(FEW, number=40), simulation=TWO,
                criteria=accuracy(1.0))  # fmt: skip
    assert done.approved and (done.rank, done.parameters) == (63, 72)
    assert done.simulated_error == pytest.approx(done.predicted_error, rel=0.4)  # two runs
    rows = [line.split(",") for line in str(done.files["poses.csv"]).splitlines() if not line.startswith("#")]
    heads = [*(f"q[{k}] [mm]" for k in range(3)), *(f"q[{k}] [deg]" for k in range(3, 6))]
    assert rows[0] == ["pose", "purpose", *heads, *(f"T[{k}] [mm]" for k in range(3)), *(f"e[{k}]" for k in range(4))]
    table = np.array([row[2:] for row in rows[1:]], float)
    assert len(table) == 44 and len(np.unique(np.round(table[:, 9:], 6), axis=0)) == 5
    # the poses are those of the robot's forward kinematics, to the digits of the file
    q = np.hstack([table[:, :3] / 1e3, np.radians(table[:, 3:6])])
    T, e, status = f1.causal(known="q", targets=["T", "e"])(q)
    assert np.all(status == 0)
    np.testing.assert_allclose(1e3 * T, table[:, 6:9], atol=2e-3)  # 1e-4 deg and 1e-4 mm at some metres
    np.testing.assert_allclose(np.abs(np.sum(e * table[:, 9:], axis=1)), 1.0, atol=1e-9)
    assert "d, e, f the rotary axes in degrees" in str(done.files["poses.mod"])
    assert list(done.figures)[-1] == "7_predicted_error" and done.figures["6_parameters"]() is not None


def test_what_a_target_on_the_plate_shows_and_what_turned_poses_must_keep(f1: Any):
    plate = Rotation.from_quat(np.array(f1.home_e), scalar_first=True)
    towards = plate.inv().apply([0.0, -1.0, 0.0]).tolist()
    facing = replace(F1_TRACKER, target_axis=towards, acceptance=np.radians(12.0))
    seen = left(f1, facing, limits=F1_LIMITS)
    assert 0 < seen["device"] < seen["safety"]  # poses turned by 20 deg about other axes do not face the tracker
    assert 0 < left(f1, limits=NARROW)["workspace"] < seen["workspace"]
    assert left(f1, limits=NARROW, safety=Safety(axes=np.radians(9.9)))["safety"] == 0


def left(robot: Any, device: Tracker = F1_TRACKER, **options: Any) -> dict[str, int]:
    task = Task(robot, device, F1_ROOM, **options)
    plan = PlanState(task, turns_of(task), measuring(task))
    try:
        find_candidates(plan, lambda *_: False)
    except ArgumentError as error:
        assert error.argument == "room"
    assert plan.candidates is not None
    return plan.candidates.counts


def test_a_stop_keeps_what_is_done(plan: Planner):
    done = plan(max_seconds=1e-9)
    assert done.status is SolveStatus.INTERRUPTED and list(done.stages) == ["workspace"]
    assert list(done.figures) == ["1_workspace"] and done.rows and not done.approved


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"room": Room([9, 9, 9], [10, 10, 10])}, "room"),
        ({"room": Room([0, 0, 0], [2, 0, 2])}, "room.high"),
        ({"room": Room([0, 0, 0], [2, 2, 2], step=0.001)}, "room.step"),
        ({"room": replace(ROOM, turns=[[0.1, 0.0, 0.0]])}, "room.turns"),
        ({"room": replace(ROOM, turns=[])}, "room.turns"),
        ({"device": Tracker([1, -4, 1], farthest=1.0)}, "room"),
        ({"device": Tracker([1, -4, 1], target_axis=[0, 0, 0])}, "device.target_axis"),
        ({"device": PatternCamera([1, 1, 5], [1, 1, 0])}, "device"),
        ({"device": Gauge([0, 0, 0])}, "device"),
        ({"poses": replace(FEW, held_out=5000)}, "poses.held_out"),
        ({"poses": replace(FEW, number=5)}, "poses.number"),
        ({"poses": PosesToMeasure(5000, held_out=0)}, "poses.number"),
        ({"poses": PosesToMeasure(2, method="grid", held_out=0)}, "poses.number"),
        ({"safety": Safety(cone=0.7), "limits": PlanLimits(cone=0.7)}, "safety.cone"),
        ({"evaluation": Evaluation([0, 0, 0], [9, 9, 9])}, "evaluation"),
        ({"evaluation": Evaluation([0, 0, 0], [9, 0, 9])}, "evaluation.high"),
        ({"limits": PlanLimits(axes=[[-0.1, 0.1]])}, "limits.axes"),
        ({"home": [0.0, 1.0]}, "home"),
        ({"actuator_noise": -1e-6}, "actuator_noise"),
        ({"axis_noise": 0.0}, "axis_noise"),
        ({"curve": [0]}, "curve"),
        ({"choice": Choice(["B"])}, "choice"),
        ({"choice": Choice([])}, "choice"),
        ({"choice": Choice(["L"], ["L"])}, "choice"),
    ],
)
def test_what_cannot_be_used_is_named(plan: Planner, changes: dict[str, Any], argument: str):
    with pytest.raises(ArgumentError) as caught:
        plan(**changes)
    assert caught.value.argument == argument and caught.value.message


def test_an_f1_names_its_own(plan: Planner, f1: Any):
    for changes, argument in (
        ({"limits": PlanLimits(axes=[[-0.1, 0.1]])}, "limits.axes"),
        ({"limits": PlanLimits(actuators=[[-0.1, 0.1]])}, "limits.actuators"),
        ({"home": [9, 9, 9]}, "room.turns"),
    ):
        with pytest.raises(ArgumentError) as caught:
            plan(F1_TRACKER, ROOM, f1, **changes)
        assert caught.value.argument == argument


def test_too_few_poses_are_refused_before_the_work(plan: Planner):
    stages: list[str] = []

    def reported(stage: str, *_: object) -> None:
        stages.append(stage)

    with pytest.raises(ArgumentError, match="4 poses with 3 equations each cannot determine 21 combinations") as caught:
        plan(poses=replace(FEW, number=4), curve=[20, 30], progress=reported)
    assert caught.value.argument == "poses.number"
    assert "number of poses" not in stages and "poses" not in stages


def test_targets_of_a_plate_that_turns_by_itself_have_its_orientation():
    """By the rotation matrix of the D1, which computes it on its own; the plan asks for positions only."""
    robot, middle = gt.robots.make("d1_six_link"), np.array([-1.6, -4.4, -0.1])
    done = plan_study(
        robot, Tracker([-1.6, -8.0, 0.5]), Room(middle - 0.15, middle + 0.15, step=0.05),
        poses=replace(FEW, number=18), curve=(), simulation=NONE, criteria=accuracy(10.0),
    )  # fmt: skip
    R, status = robot.causal(known="T", targets="R")(done.commanded)
    rows = [line.split("[")[3] for line in str(done.files["poses.mod"]).splitlines() if line.startswith("    [[")]
    e = np.array([[float(x) for x in row.split("]")[0].split(",")] for row in rows])
    turned = scipy.spatial.transform.Rotation.from_quat(e, scalar_first=True).as_matrix()
    assert done.approved and np.all(status == 0) and np.ptp(e[:, 0]) > 1e-4
    np.testing.assert_allclose(turned, R, atol=1e-8)  # nine digits
