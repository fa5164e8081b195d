"""The law in six degrees of freedom: sensors' frames and loads, turned and mirrored scenes, rotation, bad readings."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError

L = gt.control.lead_through
S = L.WrenchStatus
OK = L.SignTest(None, S.OK)
ROUNDING = 1e-12
G = np.array([0.0, 0.0, -9.81])
NOTHING = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
UPRIGHT = np.eye(3)
Rotation = scipy.spatial.transform.Rotation


def rows(matrix: Any) -> Any:
    return tuple(tuple(float(x) for x in row) for row in np.asarray(matrix))


def vector(values: Any) -> Any:
    return tuple(float(x) for x in values)


HANDLE = L.MountedSensor(
    rows(Rotation.from_rotvec([0.3, 0.9, -0.2]).as_matrix()), (0.05, -0.1, 0.3), (1.0, -0.5, 2.0), (0.1, 0.0, -0.05),
    0.4, (0.0, 0.01, 0.03),
)  # fmt: skip
TOOL = L.MountedSensor(
    rows(Rotation.from_rotvec([-1.0, 0.2, 0.5]).as_matrix()), (0.01, 0.02, 0.18), (-2.0, 0.3, 0.7), (0.0, 0.02, 0.01),
    0.8, (0.004, 0.0, 0.07),
)  # fmt: skip


def reading(sensor: Any, force: np.ndarray, moment: np.ndarray, turn: np.ndarray, gravity: np.ndarray = G) -> Any:
    """What the sensor reads when force and moment (about the tool centre point, world frame) act, by NumPy."""
    R = turn @ np.array(sensor.turn)
    f = R.T @ force
    m = R.T @ moment + np.cross(sensor.point, f)
    g = R.T @ gravity
    f = f + sensor.mass * g + sensor.force_bias
    return vector(f), vector(m + np.cross(sensor.first_moment, g) + sensor.moment_bias)


def random_scene(cycles: int = 1500) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(8)
    turns = (Rotation.from_rotvec([0.4, -0.3, 1.0]) * Rotation.from_rotvec(
        0.002 * np.cumsum(rng.normal(size=(cycles, 3)), axis=0))).as_matrix()  # fmt: skip
    f_h, t_h = 0.2 * np.cumsum(rng.normal(size=(cycles, 3)), axis=0), 0.02 * np.cumsum(rng.normal(size=(cycles, 3)), 0)
    f_t, t_t = [0.0, 0.0, 1.1] + 0.5 * rng.normal(size=(cycles, 3)), 0.02 * rng.normal(size=(cycles, 3))
    return turns, f_h, t_h, f_t, t_t


def law_of(task: str, about: str = "free", **more: Any) -> Any:
    peg = task == "peg"
    gains = L.SurfaceGains(any_direction=peg, force_reference=0.0 if peg else 2.0, friction=0.1)
    turning = L.TurningGains(by_handle=True, torque_gain=2.0 if peg else 0.0, about_axis=about)
    watch = L.OscillationWatch(level=0.4)
    return L.LeadThroughLaw(
        L.SurfaceLaw(gains, more.pop("normal", (0.0, 0.0, 1.0)), watch), L.TurningLaw(turning, **more.pop("axes", {})),
        **({"handle": HANDLE, "tool": TOOL} | more),
    )  # fmt: skip


def steps(law: Any, scene: tuple[np.ndarray, ...]) -> list[Any]:
    turns, f_h, t_h, f_t, t_t = scene
    state, states, g = law.start(OK, OK), [], np.array(law.gravity)
    for k, R in enumerate(turns):
        wrenches = reading(law.handle, f_h[k], t_h[k], R, g), reading(law.tool, f_t[k], t_t[k], R, g)
        state = law.step(state, *wrenches, rows(R))
        states.append(state)
    return states


def twists(states: list[Any]) -> np.ndarray:
    return np.array([[s.velocity, s.rate] for s in states])


def test_bias_weight_frame_and_lever_arm_leave_the_wrench_from_outside() -> None:
    rng = np.random.default_rng(1)
    for R in Rotation.random(50, rng=rng).as_matrix():
        f, m = 10 * rng.normal(size=3), rng.normal(size=3)
        got = TOOL.wrench(reading(TOOL, f, m, R), rows(R))
        assert np.abs(np.array(got) - [f, m]).max() < ROUNDING


def test_a_calibration_gives_the_sensor() -> None:
    turns = Rotation.random(20, rng=np.random.default_rng(2)).as_matrix()
    zero = np.zeros(3)
    at_rest = [reading(replace(TOOL, turn=rows(UPRIGHT)), zero, zero, R) for R in turns]
    c = L.calibrate_wrench(turns, [r[0] for r in at_rest], [r[1] for r in at_rest])
    pushes = 20 * np.random.default_rng(3).normal(size=(9, 3))
    arm = L.lever_arm(pushes, np.cross(TOOL.point, pushes), sigma_force=0.01, sigma_moment=0.001)
    sensor = L.MountedSensor.calibrated(c, TOOL.turn, arm)
    for name in ("point", "force_bias", "moment_bias", "mass", "first_moment"):
        assert getattr(sensor, name) == pytest.approx(getattr(TOOL, name), abs=1e-9)
    empty = L.calibrate_wrench(turns, np.zeros((20, 3)), np.zeros((20, 3)), sigma_force=0.1, sigma_moment=0.01)
    assert L.MountedSensor.calibrated(empty).mass == 0.0


def test_with_ideal_sensors_the_translation_is_that_of_the_surface_to_the_bit() -> None:
    f_h, t_h, f_t, t_t = random_scene(2000)[1:]
    law = law_of("surface", handle=L.MountedSensor(), tool=L.MountedSensor(), gravity=(0.0, 0.0, 0.0))
    state, alone = law.start(OK, OK), law.translation.start(OK)
    for k in range(2000):
        state = law.step(state, (vector(f_h[k]), vector(t_h[k])), (vector(f_t[k]), vector(t_t[k])))
        alone = law.translation.step(alone, vector(f_h[k]), vector(f_t[k]))
        assert state.translation == alone
    assert 0.02 <= alone.watched[2] < 1


CASES = [("surface", "free"), ("peg", "free"), ("peg", "lock"), ("peg", "hold"), ("peg", "guide")]
TURNED = (0, 3)  # of the cases, at every run; the others are mirrored then


def cases(chosen: tuple[int, ...]) -> Any:
    """Those that are not chosen in `make proof`."""
    return [pytest.param(*case, marks=[pytest.mark.proof] * (k not in chosen)) for k, case in enumerate(CASES)]


@pytest.mark.parametrize(("task", "about"), cases(TURNED))
def test_a_turned_scene_turns_the_result(task: str, about: str) -> None:
    scene, Q = random_scene(), Rotation.from_rotvec([0.4, 2.0, -0.7]).as_matrix()
    law = law_of(task, about)
    turned = replace(
        law, gravity=vector(Q @ G), translation=replace(law.translation, normal=vector(Q @ [0.0, 0.0, 1.0]))
    )
    a, b = steps(law, scene), steps(turned, (Q @ scene[0], *(x @ Q.T for x in scene[1:])))
    assert len({s.contact for s in a}) == 2 and a[-1].status.value <= 1
    assert [s.contact for s in a] == [s.contact for s in b]
    assert np.abs(twists(a) @ Q.T - twists(b)).max() < ROUNDING
    assert abs(twists(a)[:, 1]).max() > 0.05


@pytest.mark.parametrize(("task", "about"), cases((1, 2, 4)))
def test_a_mirrored_scene_mirrors_the_result(task: str, about: str) -> None:
    M = np.diag([1.0, -1.0, 1.0])  # moments and rates are axial: they get the other sign besides
    scene = random_scene()
    law = law_of(task, about)

    def mirrored(sensor: Any) -> Any:
        return L.MountedSensor(
            rows(M @ np.array(sensor.turn) @ M), vector(M @ sensor.point), vector(M @ sensor.force_bias),
            vector(-M @ sensor.moment_bias), sensor.mass, vector(M @ sensor.first_moment),
        )  # fmt: skip

    other = replace(law, handle=mirrored(HANDLE), tool=mirrored(TOOL))
    turns, f_h, t_h, f_t, t_t = scene
    a, b = steps(law, scene), steps(other, (M @ turns @ M, f_h @ M, -t_h @ M, f_t @ M, -t_t @ M))
    assert np.abs(twists(a) * [[[1, -1, 1], [-1, 1, -1]]] - twists(b)).max() < ROUNDING
    assert a[-1].rotation.about == pytest.approx(-b[-1].rotation.about, abs=1e-9)


def test_free_of_contact_the_rate_is_torque_over_damping_where_the_handle_may_turn() -> None:
    for by_handle, rate in ((True, 0.3), (False, 0.0)):
        law = L.LeadThroughLaw(rotation=L.TurningLaw(L.TurningGains(by_handle=by_handle)))
        state = law.start(OK, OK)
        for _ in range(500):
            state = law.step(state, ((0.0, 0.0, 0.0), (0.0, 0.3, 0.0)), NOTHING)
        assert state.rate == pytest.approx((0.0, rate, 0.0), rel=1e-6)
        assert max(map(abs, state.rotation.guided)) <= 0.3 + 1e-12  # not wound up where it may not turn


def peg_rate(about: str, torque: Any, handle: Any = (0.0, 0.0, 0.0)) -> Any:
    law = L.LeadThroughLaw(
        L.SurfaceLaw(L.SurfaceGains(any_direction=True, force_reference=0.0)),
        L.TurningLaw(L.TurningGains(torque_gain=2.0, about_axis=about)),  # type: ignore[arg-type]
    )
    state = law.start(OK, OK)
    for _ in range(300):
        state = law.step(state, ((0.0, 0.0, 0.0), handle), ((0.0, 0.0, 0.0), torque))
    assert state.contact and state.status is S.NO_FORCE  # a couple: a torque without a force
    return state


def test_the_torque_on_the_tool_turns_it_along_and_about_the_axis_as_asked() -> None:
    torque = (0.05, -0.04, 0.03)
    assert peg_rate("free", torque).rate == pytest.approx((0.1, -0.08, 0.06), rel=1e-9)
    for about in ("lock", "hold"):
        assert peg_rate(about, torque).rate == pytest.approx((0.1, -0.08, 0.0), rel=1e-9, abs=1e-12)
    assert peg_rate("lock", torque).rotation.about == pytest.approx(0.0, abs=1e-12)
    assert peg_rate("free", torque).rotation.about == pytest.approx(300 * 0.004 * 0.06, rel=0.02)
    guided = peg_rate("guide", torque, (0.5, 0.5, 0.2))
    assert guided.rate == pytest.approx((0.1, -0.08, 0.2), rel=1e-6)  # about the axis the hand's torque / damping


def test_hold_turns_back_to_the_angle_at_which_contact_began() -> None:
    law = L.LeadThroughLaw(
        L.SurfaceLaw(L.SurfaceGains(any_direction=True, force_reference=0.0)),
        L.TurningLaw(L.TurningGains(torque_gain=2.0, about_axis="hold")),
    )
    state, tool = law.start(OK, OK), ((0.0, 0.0, 0.0), (0.06, 0.0, 0.0))
    state = law.step(state, NOTHING, tool)
    for angle, sign in ((0.02, -1), (-0.02, 1)):  # somebody turned the robot meanwhile
        turned = law.step(state, NOTHING, tool, rows(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()))
        assert sign * turned.rate[2] > 0


def test_hostile_readings_only_brake() -> None:
    """Each hostile number in each place."""
    law = law_of("peg")
    scene = random_scene(200)
    good = steps(law, scene)[-1]
    wrenches = [reading(s, f, m, scene[0][-1]) for s, f, m in (
        (HANDLE, scene[1][-1], scene[2][-1]), (TOOL, scene[3][-1], scene[4][-1]))]  # fmt: skip
    assert law.step(good, *wrenches, rows(scene[0][-1])).allowed
    evil = [float("nan"), float("inf"), -float("inf"), 100.0, -100.0, 1e300, -1e308, 1e9]
    flat = [x for wrench in wrenches for part in wrench for x in part]
    p, q = law.translation.gains, law.rotation.gains
    before = np.linalg.norm([good.velocity, good.rate], axis=1)
    seen = set()
    for place, number in itertools.product(range(12), evil):
        numbers = [*flat[:place], number, *flat[place + 1 :]]
        parts = [vector(numbers[k : k + 3]) for k in range(0, 12, 3)]
        state = law.step(good, (parts[0], parts[1]), (parts[2], parts[3]), rows(scene[0][-1]))
        seen.add(state.status)
        after = [np.sqrt(np.dot(x, x)) for x in (state.velocity, state.rate)]
        assert not state.allowed and after[0] <= max(before[0] - p.acceleration_limit * p.cycle, 0) + ROUNDING
        assert after[1] <= max(before[1] - q.acceleration_limit * p.cycle, 0) + ROUNDING
    assert seen == {S.NOT_FINITE, S.SATURATED}
    for _ in range(100):  # good readings do not start it again
        state = law.step(state, *wrenches, rows(scene[0][-1]))
    assert state.velocity == (0.0, 0.0, 0.0) == state.rate


def test_an_orientation_that_is_none_and_old_wrenches_stop_it() -> None:
    law = L.LeadThroughLaw()
    good = law.start(OK, OK)
    for turn in (rows(np.zeros((3, 3))), rows(-UPRIGHT), rows(1.01 * UPRIGHT), rows(UPRIGHT + 0.01)):
        assert law.step(good, NOTHING, NOTHING, turn).status is S.NO_ROTATION
    assert law.step(good, NOTHING, NOTHING, rows(np.full((3, 3), np.nan))).status is S.NOT_FINITE
    for ages in ((0.0121, 0.0), (0.0, 0.0121), (-1e-9, 0.0)):
        assert law.step(good, NOTHING, NOTHING, rows(UPRIGHT), *ages).status is S.STALE


@pytest.mark.parametrize("wrong", [0, 1])
def test_both_sensors_pass_their_sign_test_before_it_moves(wrong: int) -> None:
    tests = [OK, OK]
    tests[wrong] = L.SignTest(None, S.WRONG_SIGN)
    law = L.LeadThroughLaw()
    state = law.start(*tests)
    for _ in range(50):
        state = law.step(state, ((9.0, 0.0, 0.0), (0.0, 0.0, 0.0)), NOTHING)
    assert state.velocity == (0.0, 0.0, 0.0) and state.status is S.WRONG_SIGN


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: L.MountedSensor(mass=-1.0), "mass"),
        (lambda: L.MountedSensor(point=(0.0, float("nan"), 0.0)), "point"),
        (lambda: L.MountedSensor(turn=rows(2 * UPRIGHT)), "turn"),
        (lambda: L.MountedSensor(turn=rows(-UPRIGHT)), "turn"),
        (lambda: L.LeadThroughLaw(gravity=(0.0, 0.0, float("inf"))), "gravity"),
        (lambda: L.LeadThroughLaw(rotation=L.TurningLaw(axis=(0.0, 0.0, 2.0))), "axis"),
        (lambda: L.LeadThroughLaw(rotation=L.TurningLaw(across=(0.0, 0.0, 1.0))), "across"),
        (lambda: L.TurningGains(about_axis="loose"), "about_axis"),
        (lambda: L.TurningGains(torque_gain=-1.0), "torque_gain"),
        (lambda: L.OscillationWatch(fall=0.0), "fall"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_name(call: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument
