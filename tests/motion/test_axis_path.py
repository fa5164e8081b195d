"""Kind "axis_trajectory" along a path: the F1 restricted to its path coordinate, in five and six degrees of freedom."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.kinds.axis_course import turning
from gtmodel.kinds.axis_motion import AxisPlan
from gtmodel.kinds.axis_planning import plan_of
from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, solve

PROBLEM, FREE = "problems/f1_path.toml", "problems/f1_motion.toml"
STEP = 1e-3  # of s, for differences: second order
SAME_PLACE = 1e-9
BETWEEN_MIDDLES = 0.05  # limits hold in the middles of 80 intervals; forces jump at their ends, by up to 3 %
LIMITS = np.repeat([1000.0, 40.0], 3)
SPEED_M_S = 0.8


def planned(*settings: str, problem: str = PROBLEM) -> AxisPlan:
    loaded = load(problem, list(settings))
    return plan_of(loaded.problem, context_of(loaded))  # type: ignore[arg-type]  # of that kind


@cache
def declared() -> AxisPlan:
    return planned()


def refused(*settings: str) -> InputError:
    with pytest.raises(InputError) as caught:
        planned(*settings)
    return caught.value


def followed(plan: AxisPlan, s: np.ndarray, ds: float = 0.0) -> list[np.ndarray]:
    f = plan.following
    *found, status = f(s, ds + 0 * s, *[0 * s] * (len(f.inputs) - 2))
    assert np.all(status == 0)
    return found


def test_forward_kinematics_of_the_axes_is_the_declared_course():
    plan = declared()
    s = np.linspace(0.0, 1.0, 41)
    _, q, *_ = followed(plan, s)
    T, R, status = plan.robot.causal("q", ["T", "R"])(q)
    assert np.all(status == 0) and plan.course is not None
    assert T == pytest.approx(plan.course.path(s)[0], abs=SAME_PLACE)
    wanted = plan.course.turning(s)
    assert R @ [1.0, 0.0, 0.0] == pytest.approx(wanted / np.linalg.norm(wanted, axis=1)[:, None], abs=SAME_PLACE)
    assert wanted[-1] == pytest.approx(np.array([0.15, -0.15, -1.0]) / np.linalg.norm([0.15, -0.15, -1.0]))
    assert q[:, 4] == pytest.approx(-q[:, 3], abs=1e-12)
    assert q[[0, -1]] == pytest.approx(np.array([plan.start, plan.goal]), abs=SAME_PLACE)


def test_axes_forces_and_their_derivatives():
    """Differences of the axes over s, and the dynamics of known axes, against the restricted model."""
    plan = declared()
    s = np.array([0.1, 0.25, 0.8])
    tau, q, dq, ddq, *_ = followed(plan, s, 1.3)
    beside = [followed(plan, s + k * STEP)[1] for k in (-1, 1)]
    assert dq == pytest.approx(1.3 * (beside[1] - beside[0]) / (2 * STEP), rel=1e-3, abs=1e-4)
    assert ddq == pytest.approx(1.3**2 * (beside[1] - 2 * q + beside[0]) / STEP**2, rel=1e-2, abs=1e-2)
    needed, status = plan.inverse(q, dq, ddq)
    assert np.all(status == 0) and tau == pytest.approx(needed, abs=1e-6)


def test_squared_speeds_keep_forces_and_speed():
    plan = declared()
    motion = plan.by_squared_speeds(80)
    assert motion.status is SolveStatus.SOLVED
    times = np.linspace(0.05, 0.95, 121) * motion.final_time
    s, v, a = motion.at(times)
    _, q, dq, ddq, *_ = plan.following(s, v, a)
    tau, status = plan.inverse(q, dq, ddq)
    share = np.max(np.abs(tau) / LIMITS, axis=1)
    assert plan.course is not None
    speed = np.linalg.norm(plan.course.path(s)[1] * v[:, None], axis=1) / SPEED_M_S
    assert np.all(status == 0) and np.max(share) < 1 + BETWEEN_MIDDLES and np.max(speed) < 1 + BETWEEN_MIDDLES
    assert np.mean(np.maximum(share, speed) > 0.95) > 0.5  # fast, for all that the energy costs a little


def test_courses_of_directions():
    at, way = np.array([0.0, 0.3, 1.0]), np.array([[0.0, 0.0, -2.0], [0.3, 0.0, -1.0], [0.3, 0.3, -1.0]])
    curve = turning(at, way, "path.tool")
    assert curve(at) == pytest.approx(way / np.linalg.norm(way, axis=1)[:, None])
    inner = np.linspace(0.01, 0.99, 99)
    assert curve(inner, 1) == pytest.approx((curve(inner + 1e-5) - curve(inner - 1e-5)) / 2e-5, abs=1e-6)
    constant = turning(at, np.tile(way[:1], (3, 1)), "path.tool")
    assert np.all(constant(inner) == [0.0, 0.0, -1.0]) and not np.any(constant(inner, 1))
    e = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.1, 0.0, 0.0]])  # the nearer sign of a quaternion
    assert turning(at[[0, 2]], e, "goal")(1.0)[0] > 0.9
    with pytest.raises(InputError, match="turns by 180 degrees from 0 % to 30 % of the way"):
        turning(at, np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 1.0, -1.0]]), "path.tool")


@pytest.mark.parametrize(
    ("settings", "key", "words"),
    [
        (["goal.q_m=[0.9,0.5,0.35]"], "goal.q_m", "is given beside tcp_m"),
        (["goal={q_m=[0.9,0.5,0.35]}"], "goal.q_deg", "is missing; give q_m and q_deg, or tcp_m"),
        (["degrees_of_freedom=6"], "goal.tool", "leaves the turn of the plate about it open"),
        (["start.tool=[0.0,0.0,-1.0]"], "start.tool", "is given beside the axes"),
        (["goal.tool=[0.0,0.0,0.0]"], "goal.tool", "is zero"),
        (["path.tool=[{at=0.6,direction=[0,0,-1.0]},{at=0.5,direction=[0,0,-1.0]}]"], "path.tool", "do not rise"),
        (["goal.tool=[0.0,0.0,1.0]"], "goal", "turns by 178"),
        (["goal.tcp_m=[-0.32,5.0,0.3]"], "goal.tcp_m", "no axes hold the plate there"),
        (["limits.axis_high_deg=[45.0,45.0,0.5]"], "goal.tcp_m", "is above limits.axis_high_deg, 0.5"),
    ],
)  # fmt: skip
def test_wrong_inputs_are_one_sentence(settings: list[str], key: str, words: str):
    error = refused(*settings)
    assert error.key == key and words in error.sentence


def test_a_free_motion_goes_to_axes():
    with pytest.raises(InputError) as caught:
        planned("goal={tcp_m=[-0.3,2.2,0.2]}", problem=FREE)
    assert caught.value.key == "goal.tcp_m" and caught.value.sentence.startswith("needs a [path]")


def solved(*settings: str, problem: str = PROBLEM):
    loaded = load(problem, list(settings))
    return solve(loaded, context_of(loaded)).outcome


@pytest.mark.proof
def test_declared_problem():
    """All checks pass, six free axes follow the forces, and the free motion between the same axes is faster."""
    o = solved()
    assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    assert o.values["path_error_m"] < SAME_PLACE and o.values["end_error_m"] < 2.5e-4
    run = o.trajectory
    assert isinstance(run, gt.Trajectory)
    speed = np.linalg.norm(np.gradient(run["T"], run.time, axis=0), axis=1)
    assert 0.9 * SPEED_M_S < np.max(speed) < 1.02 * SPEED_M_S
    ends = {"start": run["q"][0], "goal": run["q"][-1]}
    free = solved(
        *(
            f"{name}={{q_m={q[:3].tolist()},q_deg={np.degrees([q[3], -q[3], q[5]]).tolist()}}}"
            for name, q in ends.items()
        ),
        problem=FREE,
    )
    assert free.status is SolveStatus.SOLVED and (free.objective or np.inf) < (o.objective or 0.0)


@pytest.mark.proof
@pytest.mark.parametrize(
    "settings",
    [
        ("limits.tcp_acceleration_m_s2=5",),
        ("limits.cart_velocity_m_s=0.4",),
        ("limits.cart_acceleration_m_s2=4",),
        ("limits.axis_velocity_deg_s=15",),
        ("limits.axis_acceleration_deg_s2=200",),
        ("limits.obstacles=[{center_m=[0.0,2.0,0.0],size_m=[0.1,0.1,0.1]}]",),
        ("payload_kg=3",),
        ("degrees_of_freedom=6", "goal={tcp_m=[-0.32,2.15,0.32]}"),
        ('path={shape="line",tool=[{at=0.5,direction=[-0.1,0.1,-1.0]}]}',),
        ('path={shape="arc",through_m=[-0.2,2.25,0.2]}', "start={tcp_m=[-0.18,2.3,0.0]}"),
        ('path={shape="line"}', "limits.tcp_jerk_m_s3=80"),
    ],
    ids=lambda s: s[0],
)
def test_limits_and_courses(settings: tuple[str, ...]):
    """Ten elements: found, on the path, and within half a tenth of the motion by squared speeds."""
    o = solved("mesh.elements=10", *settings)
    assert o.status is SolveStatus.SOLVED and o.values["path_error_m"] < SAME_PLACE
    second = o.values["second_road_time_s"]
    assert (second is None) == any("jerk" in s for s in settings)
    assert second is None or 0 <= o.values["final_time_s"] / second - 1 < 0.05
