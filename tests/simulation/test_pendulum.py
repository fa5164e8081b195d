"""The Cartesian pendulum, index 3, against the angle model: small and full swings, full turns, and from x = L."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gtmodel.simulation import simulate
from tests.simulation.models import SwingingPendulum
from tests.support.models import Pendulum

G = 9.81
# Over ten swings an Adams integrator at 1e-13 per step adds up to some 1e-10 J of 2 J.
FINE = dict(tolerance=1e-13, method="adams")
ENERGY = 1e-8
LENGTH = 1e-9
# What the conformance table asks for at this tolerance.
CONFORMANCE, CONFORMANCE_TOLERANCE = 1e-6, 1e-10
# Fast turns multiply an error of the speed by the time: 10 s * 8 rad/s * 1e-9.
TURNING = 1e-7


def angle_model(times, phi, rate):
    """(n, 2) positions x, y and the unwrapped angle from hanging, by SciPy."""
    options = dict(rtol=1e-13, atol=1e-13, t_eval=times)
    y = solve_ivp(lambda _, y: [y[1], -G * np.sin(y[0])], (0.0, times[-1]), [phi, rate], "DOP853", **options).y[0]
    return np.column_stack([np.sin(y), -np.cos(y)]), y


def position(trajectory):
    return np.column_stack([trajectory["x"], trajectory["y"]])


def test_energy_and_length_over_ten_seconds():
    run = simulate(SwingingPendulum(), 10.0, start={"x": 0.6, "der(x)": 0.0}, **FINE)
    assert run.energy_error is not None and run.energy_error < ENERGY
    length = np.hypot(*position(run.trajectory).T)
    assert np.max(np.abs(length - 1.0)) < LENGTH
    assert run.residual < LENGTH
    # the balance is no identity: the energy itself moves from one kind to the other
    assert np.ptp(run.trajectory["y"]) > 0.19 and run.trajectory["der(x)"].max() > 1.5


def test_released_at_rest_at_x_equals_L():
    run = simulate(Pendulum(), 10.0, start={"x": 1.0}, tolerance=CONFORMANCE_TOLERANCE)
    expected, _ = angle_model(run.trajectory.time, np.pi / 2, 0.0)
    assert np.max(np.abs(position(run.trajectory) - expected)) < CONFORMANCE
    # full swings from side to side, and the states change on the way down and up
    assert run.trajectory["x"].min() < -0.999 and run.trajectory["y"].max() < 1e-6
    assert {s.after for s in run.switches} == {("x", "der(x)"), ("y", "der(y)")}
    assert run.switches[0].before == ("y", "der(y)")
    assert run.message == f"simulated; states switched {len(run.switches)} times"


@pytest.mark.parametrize("rate", [7.0, -7.0])
@pytest.mark.parametrize("prefer", [(), "x", "y"])
def test_with_more_energy_full_turns(rate, prefer):
    # at the top 7^2 - 4 g leaves 3.1 rad/s; every turn passes four poses that are singular for x or for y
    run = simulate(Pendulum(), 5.0, start={"x": 0.0, "y": -1.0, "der(x)": rate}, prefer=prefer, **FINE)
    expected, angle = angle_model(run.trajectory.time, 0.0, rate)
    assert np.abs(angle[-1]) > 3 * 2 * np.pi
    assert np.max(np.abs(position(run.trajectory) - expected)) < TURNING


@pytest.mark.parametrize("step", [0.01, 0.5, 1.0, 5.0])
def test_rows_far_apart_hide_no_singular_pose(step):
    # between two rows the motion passes singular poses, some twice: the states are watched at times of their own
    run = simulate(Pendulum(), 5.0, start={"x": 0.0, "y": -1.0, "der(x)": 7.0}, step=step, **FINE)
    assert len(run.trajectory) == round(5.0 / step) + 1
    expected, _ = angle_model(run.trajectory.time, 0.0, 7.0)
    assert np.max(np.abs(position(run.trajectory) - expected)) < TURNING


def test_a_choice_made_before_costs_nothing(monkeypatch):
    from gtmodel.compiler.flat_cache import shared
    from gtmodel.simulation import systems

    made = []
    plan = systems.make_plan
    monkeypatch.setattr(systems, "make_plan", lambda *a, **k: made.append(1) or plan(*a, **k))
    shared.cache_clear()  # plans of the tests before this one
    model = Pendulum()
    run = simulate(model, 5.0, start={"x": 0.0, "y": -1.0, "der(x)": 7.0}, tolerance=1e-8)
    # two choices of states with two signs each, and the plan they share
    assert len(run.switches) > 12 and len(made) == 5
    # the model keeps them
    assert simulate(model, 2.0, start={"x": 0.95}, tolerance=1e-9).switches and len(made) == 5


def test_a_wish_is_heard_where_it_can_be():
    run = simulate(Pendulum(), 0.3, start={"x": 0.7}, prefer="y")
    assert run.states == ("y", "der(y)") and not run.switches
    run = simulate(Pendulum(), 0.3, start={"x": 0.7}, prefer="x")
    assert run.states == ("x", "der(x)") and not run.switches
