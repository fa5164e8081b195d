"""Motions of serial arms: times known by hand, waypoints, and distances by dense samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import gtmodel as gt
from gtmodel.kinematics import BoxObstacle, CapsuleObstacle, Clearance, LinkCapsule
from gtmodel.motion import ArmLimits, ArmPose, AxisCost, AxisMesh, Waypoint, arm_study
from gtmodel.results import ArgumentError

# a point mass on a rod that turns about a vertical axis: only its inertia counts
INERTIA, TORQUE, SPEED = 2.0 * 0.5**2, 5.0, 3.0
TURN = gt.robots.serial_arm(a=[0.5], alpha=0.0, m=[2.0])
TURNING = ArmLimits(joint_speed=[SPEED], joint_effort=[TORQUE])
PLANAR = gt.robots.serial_arm(a=[0.4, 0.3], alpha=0.0, m=[4.0, 2.0], c=[[-0.2, 0, 0], [-0.15, 0, 0]])
LIMITS = ArmLimits(joint_speed=[3.0, 3.0], joint_effort=[60.0, 30.0])
RODS = [LinkCapsule("link_1", [-0.4, 0, 0], [0, 0, 0], 0.04), LinkCapsule("link_2", [-0.3, 0, 0], [0, 0, 0], 0.03)]
POST, BALL = np.array([0.55, 0.25, 0.0]), 0.08
CLEAR = Clearance(
    distance=0.02, capsules=RODS, obstacles=[CapsuleObstacle(POST.tolist(), POST.tolist(), BALL)],
    boxes=[BoxObstacle([0.3, -0.4, 0.0], [0.2, 0.2, 0.2])],
)  # fmt: skip
START, GOAL = ArmPose(q=[-0.2, 0.5]), ArmPose(q=[1.0, 0.2])
# accelerations that are linear on an element cannot jump: relative loss of time on 12 elements
MESH, LOSS = AxisMesh(12), 0.06


def fastest(angle: float) -> float:
    """Time [s] from rest to rest: full torque, speed limit, full braking."""
    a = TORQUE / INERTIA
    return angle / SPEED + SPEED / a if angle > SPEED**2 / a else 2 * np.sqrt(angle / a)


@pytest.mark.parametrize("angle", [0.5, 2.0])
def test_one_joint_needs_the_time_by_hand(angle) -> None:
    s = arm_study(TURN, ArmPose(q=[0.0]), ArmPose(q=[angle]), limits=TURNING, mesh=MESH, cost=AxisCost(energy=1e-4))
    assert s.status.ok, s.message
    assert fastest(angle) * (1 - 1e-6) <= s.final_time <= fastest(angle) * (1 + LOSS)


def test_a_stop_costs_what_two_motions_cost_and_flying_by_nothing() -> None:
    def through(stop: bool):
        s = arm_study(
            TURN, ArmPose(q=[0.0]), ArmPose(q=[2.0]), waypoints=[Waypoint(q=[0.5], stop=stop)], limits=TURNING,
            mesh=MESH, cost=AxisCost(energy=1e-4),
        )  # fmt: skip
        assert s.status.ok, s.message
        return s

    stopping, flying = through(True), through(False)
    twice = fastest(0.5) + fastest(1.5)
    assert twice * (1 - 1e-6) <= stopping.final_time <= twice * (1 + LOSS)
    assert fastest(2.0) * (1 - 1e-6) <= flying.final_time <= fastest(2.0) * (1 + LOSS)
    for s, speed in (
        (stopping, 0.0),
        (flying, min(SPEED, np.sqrt(2 * 0.5 * TORQUE / INERTIA))),
    ):  # full torque until there
        row = int(np.argmin(np.abs(s.trajectory.time - s.passed[0])))
        assert s.trajectory["q"][row, 0] == pytest.approx(0.5, abs=1e-4)
        assert s.trajectory["der(q)"][row, 0] == pytest.approx(speed, abs=0.05 * SPEED)


def test_a_waypoint_of_the_tool_is_passed() -> None:
    via = Waypoint(tcp=[0.5, 0.35, 0.0], rpy=None)
    s = arm_study(PLANAR, START, GOAL, waypoints=[via], limits=LIMITS, mesh=AxisMesh(8))
    assert s.status.ok, s.message
    row = int(np.argmin(np.abs(s.trajectory.time - s.passed[0])))
    q1, q2 = s.trajectory["q"][row]
    by_hand = [0.4 * np.cos(q1) + 0.3 * np.cos(q1 + q2), 0.4 * np.sin(q1) + 0.3 * np.sin(q1 + q2), 0.0]
    np.testing.assert_allclose(by_hand, via.tcp, atol=1e-4)


def gap(q: np.ndarray) -> float:
    """Smallest distance [m] of both links from the post, by samples of the links."""
    first = np.stack([np.cos(q[:, 0]), np.sin(q[:, 0]), 0 * q[:, 0]], axis=1)
    turned = q[:, 0] + q[:, 1]
    second = np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)
    s = np.linspace(0.0, 1.0, 301)[:, None, None]
    points = (s * 0.4 * first, 0.4 * first + s * 0.3 * second)
    return min(
        float(np.linalg.norm(p - POST, axis=2).min()) - BALL - r for p, r in zip(points, (0.04, 0.03), strict=True)
    )


def test_links_keep_their_distance_from_an_obstacle_in_the_way() -> None:
    free = arm_study(PLANAR, START, GOAL, limits=LIMITS, mesh=AxisMesh(12))
    assert free.status.ok and gap(free.trajectory["q"]) < 0.0  # the fastest motion would hit the post
    s = arm_study(PLANAR, START, GOAL, limits=LIMITS, clearance=CLEAR, mesh=AxisMesh(20))
    assert s.status.ok, s.message
    run = s.trajectory
    dense = np.linspace(0.0, run.time[-1], 3001)  # the gap is of second order there: 1e-6
    least = gap(CubicHermiteSpline(run.time, run["q"], run["der(q)"])(dense))
    assert CLEAR.distance <= s.clearance <= least <= s.clearance + 1.1e-4
    assert s.nearest == ("link_2", "obstacles[0]") and s.final_time > free.final_time
    assert least < CLEAR.distance + 1.1e-3  # it passes as near as it may
    assert "link_1-boxes[0]" not in s.constrained and s.pairs == 4


@pytest.mark.parametrize(
    ("changed", "where"),
    [
        ({"robot": gt.robots.gantry_tau("l1_tape")}, "robot"),
        ({"start": ArmPose(q=[0.0])}, "start.q"),
        ({"goal": ArmPose(slides=[0.0])}, "goal.q"),
        ({"goal": ArmPose(q=[1.0, 0.2], tcp=[0.5, 0.0, 0.0])}, "goal.q"),
        ({"goal": ArmPose(q=[1.0, 0.2], rpy=[0.0, 0.0, 0.0])}, "goal.rpy"),
        ({"goal": ArmPose(tcp=[0.9, 0.0, 0.0], rpy=[0.0, 0.0, 0.0])}, "goal.tcp"),
        ({"goal": START}, "goal.q"),
        ({"limits": ArmLimits(joint_speed=[3.0, 3.0])}, "limits.joint_effort"),
        ({"limits": ArmLimits(joint_effort=[60.0])}, "limits.joint_effort"),
        ({"cost": AxisCost(time=0.0)}, "cost"),
        ({"clearance": Clearance()}, "clearance.capsules"),
        ({"start": ArmPose(q=[0.4, 0.0]), "clearance": CLEAR}, "start.q"),
    ],
)
def test_wrong_tasks_name_their_argument(changed, where) -> None:
    given = {"robot": PLANAR, "start": START, "goal": GOAL, "limits": LIMITS} | changed
    with pytest.raises(ArgumentError) as caught:
        arm_study(given.pop("robot"), given.pop("start"), given.pop("goal"), **given)
    assert caught.value.argument == where
