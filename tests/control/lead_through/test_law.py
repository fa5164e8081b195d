"""The law by the printed equations, turned scenes, thresholds, bad sensors."""

from __future__ import annotations

import math
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


def law_of(**gains: Any) -> Any:
    return L.SurfaceLaw(L.SurfaceGains(**gains))


def steps(law: Any, handle: np.ndarray, tool: np.ndarray) -> list[Any]:
    state, states = law.start(OK), []
    for h, t in zip(handle.tolist(), tool.tolist(), strict=True):
        state = law.step(state, tuple(h), tuple(t))
        states.append(state)
    return states


def by_the_printed_equations(law: Any, handle: np.ndarray, tool: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """V and V_h by (8.4)-(8.10) in NumPy, for no filter, no dwell, and limits that are not met."""
    p, nominal = law.gains, np.asarray(law.normal)
    guided, contact, rows = np.zeros(3), False, []
    for F_h, f_t in zip(handle, tool, strict=True):
        pressed = f_t @ nominal
        contact = (pressed > p.leave_force if contact else pressed >= p.enter_force) and F_h @ nominal < p.release_force
        n = f_t / np.linalg.norm(f_t)
        n = n if np.arccos(min(nominal @ n, 1.0)) <= p.cone else nominal
        Ph = guided - np.outer(n, n) @ guided if contact else guided
        Pt = np.outer(n, n) @ (p.force_gain * (f_t - p.force_reference * n)) if contact else np.zeros(3)  # on the tool
        V = Ph + Pt
        A = (F_h - p.damping * V) / p.mass
        guided = guided + p.cycle * (A - (guided - Ph) / p.cycle)
        rows.append((V, guided))
    return np.array([r[0] for r in rows]), np.array([r[1] for r in rows])


WIDE = {"speed_limit": 1e3, "force_speed_limit": 1e3, "acceleration_limit": 1e9, "normal_filter": 0.0, "dwell": 0.0}


def test_it_is_what_the_thesis_prints() -> None:
    rng = np.random.default_rng(1)
    law = law_of(**WIDE)
    handle, tool = 6 * rng.normal(size=(3000, 3)), [0.0, 0.0, 1.5] + rng.normal(size=(3000, 3)) * [0.3, 0.3, 1.2]
    states = steps(law, handle, tool)
    V, guided = by_the_printed_equations(law, handle, tool)
    assert 300 < sum(s.contact for s in states) < 2700
    assert np.abs(np.array([s.velocity for s in states]) - V).max() < ROUNDING
    assert np.abs(np.array([s.guided for s in states]) - guided).max() < ROUNDING


def test_a_turned_scene_turns_the_result() -> None:
    rng = np.random.default_rng(2)
    Q = scipy.spatial.transform.Rotation.from_rotvec([0.4, 2.0, -0.7]).as_matrix()
    handle = np.cumsum(rng.normal(size=(5000, 3)), axis=0) * 0.3
    tool = [0.0, 0.0, 1.2] + rng.normal(size=(5000, 3)) * 0.5
    law = law_of()
    turned = L.SurfaceLaw(law.gains, tuple((Q @ law.normal).tolist()))
    a, b = steps(law, handle, tool), steps(turned, handle @ Q.T, tool @ Q.T)
    assert len({s.contact for s in a}) == 2
    assert [s.contact for s in a] == [s.contact for s in b]
    assert np.abs(np.array([s.velocity for s in a]) @ Q.T - np.array([s.velocity for s in b])).max() < ROUNDING


def test_too_large_a_force_lifts_the_tool_and_too_small_a_one_lowers_it() -> None:
    law = law_of(enter_force=0.5)
    for force, sign in ((1.0, -1), (3.0, 1)):
        assert sign * steps(law, np.zeros((1, 3)), np.array([[0, 0, force]]))[0].velocity[2] > 0


@pytest.mark.parametrize("status", [s for s in S if s is not S.OK])
def test_without_a_passed_sign_test_it_never_moves(status: Any) -> None:
    law = law_of()
    state = law.start(L.SignTest(None, status))
    for _ in range(100):
        state = law.step(state, (20.0, 5.0, -9.0), (0.0, 0.0, 5.0))
        assert state.velocity == (0.0, 0.0, 0.0) and state.status is status


def test_contact_has_two_thresholds_and_a_dwell() -> None:
    law = law_of(enter_force=1.0, leave_force=0.5, dwell=0.02)  # five cycles
    pressed = [0.9, 1.0, *[0.0] * 4, 0.6, 0.51, 0.5, *[1.0] * 5, 0.7]
    seen = [s.contact for s in steps(law, np.zeros((len(pressed), 3)), np.array([[0, 0, f] for f in pressed]))]
    assert seen == [False, True, *[True] * 6, False, *[False] * 4, True, True]


def test_at_the_edge_of_the_cone_the_estimate_counts() -> None:
    law = law_of(cone=math.radians(10), normal_filter=0.0)
    for angle, inside in ((9.999999, True), (10.000001, False)):
        f = 3 * np.array([[math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle))]])
        assert (steps(law, 0 * f, f)[0].normal != law.normal) is inside
    edge = L.SurfaceLaw(L.SurfaceGains(cone=0.0, normal_filter=0.0))
    assert steps(edge, np.zeros((1, 3)), np.array([[0.0, 0.0, 3.0]]))[0].normal == (0.0, 0.0, 1.0)


def test_no_force_in_contact_is_a_status_and_keeps_the_normal() -> None:
    tool = np.array([[0.3, 0.0, 3.0]] * 3 + [[0.0, 0.0, 0.0]] * 5)
    states = steps(law_of(normal_filter=0.0), np.zeros((8, 3)), tool)
    assert [s.status for s in states] == [S.OK] * 3 + [S.NO_FORCE] * 5
    assert all(s.contact and s.normal == states[2].normal for s in states)
    assert np.isfinite([s.velocity for s in states]).all()


def test_a_hundred_thousand_hostile_wrenches_only_brake() -> None:
    """From a motion each brakes along it, by the declared acceleration; what follows moves nothing."""
    rng = np.random.default_rng(3)
    law = law_of()
    good = steps(law, np.full((50, 3), 5.0), np.zeros((50, 3)))[-1]
    fast = math.hypot(*good.velocity)
    braked = np.array(good.velocity) * (1 - law.gains.acceleration_limit * law.gains.cycle / fast)
    assert fast > 2 * law.gains.acceleration_limit * law.gains.cycle
    evil = [float("nan"), float("inf"), -float("inf"), 100.0, -100.0, 1e300, -1e308, 1e9]
    picks, places, forces = (
        rng.integers(len(evil), size=100_000),
        rng.integers(6, size=100_000),
        rng.normal(size=(100, 6)),
    )
    off, seen = 0.0, set()
    for k in range(100_000):
        numbers = forces[k % 100].tolist()
        numbers[places[k]] = evil[picks[k]]
        state = law.step(good, tuple(numbers[:3]), tuple(numbers[3:]))
        off = max(
            off, *(abs(v - b) for v, b in zip(state.velocity, braked.tolist(), strict=True)), *map(abs, state.guided)
        )
        seen.add(state.status)
    assert off < ROUNDING and seen == {S.NOT_FINITE, S.SATURATED}


@pytest.mark.parametrize("ages", [(0.0121, 0.0), (0.0, 0.0121), (-0.001, 0.0), (float("nan"), 0.0)])
def test_an_old_wrench_brakes_it_for_good(ages: tuple[float, float]) -> None:
    law = law_of()
    good = steps(law, np.full((50, 3), 5.0), np.zeros((50, 3)))[-1]
    state = law.step(good, (5.0, 5.0, 5.0), (0.0, 0.0, 0.0), *ages)
    why, speeds = state.status, [math.hypot(*good.velocity), math.hypot(*state.velocity)]
    assert why in (S.STALE, S.NOT_FINITE) and speeds[1] > 0
    for _ in range(100):
        state = law.step(state, (5.0, 5.0, 5.0), (0.0, 0.0, 0.0))
        speeds.append(math.hypot(*state.velocity))
    assert state.status is why and state.velocity == (0.0, 0.0, 0.0)
    lost = -np.diff(speeds) / law.gains.cycle
    assert np.all(lost[: np.flatnonzero(lost)[-1]] > 0) and lost.max() <= law.gains.acceleration_limit * (1 + ROUNDING)
    assert law.step(law.start(OK), (5.0, 5.0, 5.0), (0.0, 0.0, 0.0), 0.012, 0.012).guided[0] > 0


def test_gains_beyond_reason_stop_it_before_they_give_what_is_no_number() -> None:
    law = law_of(mass=1e-310, damping=1e-308)
    states = steps(law, np.full((20, 3), 50.0), np.zeros((20, 3)))
    assert np.isfinite([(*s.velocity, *s.guided) for s in states]).all() and states[-1].status is S.NOT_FINITE


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: L.SurfaceGains(mass=0.0), "mass"),
        (lambda: L.SurfaceGains(force_gain=-0.01), "force_gain"),
        (lambda: L.SurfaceGains(cone=2.0), "cone"),
        (lambda: L.SurfaceGains(leave_force=1.0), "leave_force"),
        (lambda: L.SurfaceGains(enter_force=2.5), "enter_force"),
        (lambda: L.SurfaceLaw(normal=(0.0, 0.0, 1.1)), "normal"),
        (lambda: L.SurfaceLaw(normal=(0.0, 0.0, float("nan"))), "normal"),
    ],
)
def test_gains_that_do_not_fit_are_refused_by_their_name(call: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument
