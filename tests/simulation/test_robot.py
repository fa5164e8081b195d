"""A closed chain in motion: against hand-written dynamics, in other states, under prescribed motion."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gtmodel import SolveStatus
from gtmodel.simulation import simulate
from tests.simulation.robot import AHEAD, T0, by_hand, l1, oracle

# Both integrators hold 1e-10 per step on motions of 1 m and 1 m/s; over some hundred steps that adds up to 1e-8.
INTEGRATORS = 1e-8
TOLERANCE = 1e-10
# Algebra on both sides: forces of 1e2 to 1e3 N to twelve digits.
ROUND_OFF = 1e-9


def drop(seconds=0.4, friction=0.2, **options):
    """Motors off, little friction, so that it really falls."""
    return simulate(
        l1(friction=friction),
        seconds,
        inputs={"tau": 0.0},
        start={"T": T0, "der(T)": 0.0},
        **{"tolerance": TOLERANCE, **options},
    )


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_drop_against_hand_written_dynamics(method):
    run = drop(step=0.04)
    T, Td, q = by_hand(l1(friction=0.2), run.trajectory.time, method=method)
    assert T[0, 2] - T[-1, 2] > 0.2
    assert run.trajectory["T"] == pytest.approx(T, abs=INTEGRATORS)
    assert run.trajectory["q"] == pytest.approx(q, abs=INTEGRATORS)
    assert run.trajectory["der(T)"] == pytest.approx(Td, abs=10 * INTEGRATORS)


def test_in_states_of_carts_and_in_states_of_the_plate():
    runs = {prefer: drop(prefer=prefer) for prefer in ("q", "T")}
    for prefer, run in runs.items():
        assert {s.split("[")[0].removeprefix("der(") for s in run.states} == {prefer} and not run.switches
        assert run.residual < ROUND_OFF
    for name in ("T", "q", "der(T)"):
        difference = np.abs(runs["q"].trajectory[name] - runs["T"].trajectory[name])
        assert np.max(difference) < 10 * INTEGRATORS


def test_driven_by_forces_over_time():
    def force(t):
        return np.array([200 * np.sin(8 * t), 60.0, -150 * np.cos(5 * t)])

    run = simulate(
        l1(), 0.5, step=0.05, inputs={"tau": lambda t: [200 * np.sin(8 * t), 60.0, -150 * np.cos(5 * t)]},
        start={"T": T0, "der(T)": [0.2, 0.1, -0.1]}, tolerance=TOLERANCE,
    )  # fmt: skip
    T, _, _ = by_hand(l1(), run.trajectory.time, force, velocity=np.array([0.2, 0.1, -0.1]))
    assert run.trajectory["T"] == pytest.approx(T, abs=INTEGRATORS)
    assert run.trajectory["tau"] == pytest.approx(np.array([force(t) for t in run.trajectory.time]), abs=ROUND_OFF)


def test_prescribed_motion_gives_the_forces():
    run = simulate(
        l1(), 1.0, step=0.1, inputs={"T": lambda t: [T0[0] + 0.3 * np.sin(2 * t), T0[1], T0[2] + 0.1 * t**2]}
    )
    assert run.states == () and run.chosen == {}
    hand = oracle(l1())
    for k, t in enumerate(run.trajectory.time):
        T = T0 + np.array([0.3 * np.sin(2 * t), 0.0, 0.1 * t**2])
        Td, Tdd = np.array([0.6 * np.cos(2 * t), 0.0, 0.2 * t]), np.array([-1.2 * np.sin(2 * t), 0.0, 0.2])
        q = hand.inverse_kinematics(T, AHEAD)
        assert run.trajectory["T"][k] == pytest.approx(T, abs=1e-12)
        assert run.trajectory["q"][k] == pytest.approx(q, abs=1e-12)
        assert run.trajectory["tau"][k] == pytest.approx(hand.inverse_dynamics(T, q, Td, Tdd), rel=1e-10)
    # and the motors do the work
    assert run.energy_error is not None and run.energy_error < 1e-6 * np.max(np.abs(run.trajectory["energy.supplied"]))


def test_a_path_is_prescribed_and_one_force():
    """Known tau[0], T[1], T[2]: two states are left, the path-constrained model of Dressler 2012, section 3.5."""
    run = simulate(
        l1(), 0.4, step=0.04, tolerance=TOLERANCE, start={"T[0]": 0.5, "der(T[0])": 0.2},
        inputs={"tau[0]": 150.0, "T[1]": -0.9, "T[2]": lambda t: 0.3 + 0.05 * np.sin(4 * t)},
    )  # fmt: skip
    assert run.states == ("T[0]", "der(T[0])")
    hand = oracle(l1())

    def pose(t, x, xd):
        s, c = np.sin(4 * t), np.cos(4 * t)
        return np.array([x, -0.9, 0.3 + 0.05 * s]), np.array([xd, 0.0, 0.2 * c]), np.array([0.0, 0.0, -0.8 * s])

    def forces(t, x, xd, xdd):
        T, Td, Tdd = pose(t, x, xd)
        return hand.inverse_dynamics(T, hand.inverse_kinematics(T, AHEAD), Td, Tdd + np.array([xdd, 0.0, 0.0]))

    def rates(t, y):  # the force of motor 0 is affine in the acceleration along the path
        at_zero, at_one = forces(t, *y, 0.0)[0], forces(t, *y, 1.0)[0]
        return [y[1], (150.0 - at_zero) / (at_one - at_zero)]

    t = run.trajectory.time
    y = solve_ivp(rates, (0.0, t[-1]), [0.5, 0.2], "DOP853", t, rtol=1e-11, atol=1e-12).y
    assert run.trajectory["T"][:, 0] == pytest.approx(y[0], abs=INTEGRATORS)
    others = np.array([forces(*at, rates(at[0], at[1:])[1]) for at in zip(t, *y, strict=True)])
    assert run.trajectory["tau"] == pytest.approx(others, abs=1e-5)


def test_pulled_through_a_dead_point_it_goes_on_in_other_states():
    # pulled aside, two links come to stand across their guideways: there the plate no longer tells the carts apart
    force = {"tau": [300.0, 300.0, -300.0]}
    run = simulate(l1(), 2.5, step=0.05, inputs=force, start={"T": T0, "der(T)": 0.0}, tolerance=TOLERANCE)
    assert run.switches and run.residual < ROUND_OFF
    ahead = np.sign(run.trajectory["T"][:, :1] - np.array(l1().A)[:, 0] - run.trajectory["q"])
    assert np.all(ahead[0] == 1) and np.any(ahead[-1] == -1)
    turnover = np.max(np.abs(run.trajectory["energy.supplied"]))
    assert run.energy_error is not None and run.energy_error < 1e-6 * turnover
    # until then it is the motion that the hand-written equations give
    before = int(np.searchsorted(run.trajectory.time, run.switches[0].time - 0.1))
    T, _, _ = by_hand(l1(), run.trajectory.time[:before], lambda t: np.array(force["tau"]))
    assert run.trajectory["T"][:before] == pytest.approx(T, abs=10 * INTEGRATORS)


def test_out_of_reach_it_says_so():
    run = simulate(l1(), 2.0, inputs={"T": lambda t: [0.5, -0.9 - t, 0.3]}, step=0.1, throw=False)
    assert run.status is SolveStatus.FAILED
    # arm 0 reaches so far: |T - A| = L across its guideway
    A, L = np.array(l1().A)[0], float(np.array(l1().L)[0])
    last = -0.9 - (A[1] - np.sqrt(L**2 - (0.3 - A[2]) ** 2))
    assert float(re.search(r"the motion ends at (\S+) s", run.message)[1]) == pytest.approx(last, abs=1e-5)
    assert "leaves the model's range: the discriminant of arm[0].rod" in run.message
    assert run.trajectory.time[-1] == pytest.approx(0.1 * np.floor(last / 0.1)) and np.all(
        np.isfinite(run.trajectory["tau"])
    )


@pytest.mark.slow
def test_six_links_and_a_plate_that_turns():
    """A Newton block for the quaternion rides along; links of unequal lengths turn the plate."""
    from tests.robots.test_six_link import perturbed

    run = simulate(
        perturbed(), 0.2, step=0.05, inputs={"tau": [120.0, 40.0, -60.0]}, start={"der(T)": [0.5, 0.3, -0.2]},
        outputs="e", tolerance=TOLERANCE,
    )  # fmt: skip
    t = run.trajectory
    assert np.ptp(t["e"], axis=0).max() > 1e-4 and np.ptp(t["T"], axis=0).max() > 0.05
    assert np.linalg.norm(t["e"], axis=1) == pytest.approx(1.0, abs=1e-12)
    assert run.residual < ROUND_OFF
    assert run.energy_error is not None and run.energy_error < 1e-6 * t["energy.dissipated"][-1]
