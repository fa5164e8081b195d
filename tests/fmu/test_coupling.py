"""The inverse unit drives the forward unit: Fig. 3.2 of Dressler 2012 with units only."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from tests.fmu.makers import STOP, function
from tests.fmu.raw import OK, Raw, unpacked

H = 1e-3
NEAR = 1e-6  # m
STROKE = 0.05  # m
FINE = 10


@pytest.fixture(scope="module")
def pair(made, tmp_path_factory):
    """Inverse and forward unit that start at the same carts, at rest."""
    forward = made("forward", 3)
    home = {v.name: v.start for v in forward[0].table.variables}
    q, status = gt.robots.gantry_tau("l1_tape").causal(known="T", targets="q")([home[f"T[{k}]"] for k in (1, 2, 3)])
    assert status.value == 0
    start = {f"filter[{k}].x": [q[k]] * 3 for k in range(3)}
    unit = gt.fmu.export(function("filtered"), None, name="u_inverse", start=start, stop=STOP)
    return (unit, unpacked(unit, tmp_path_factory.mktemp("inverse"))), forward[:2], q


def reference(t, q):
    """A smooth stroke of all carts."""
    s = np.clip(t / 0.15, 0.0, 1.0)
    return q + STROKE * np.array([1.0, -0.6, 0.4]) * (s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3))


def refs(unit, name):
    return [v.reference for v in unit.table.variables if v.name.startswith(name) and "(" not in v.name]


def test_coupled_as_model_exchange_it_follows_the_filtered_reference(pair):
    """Both in one integrator: a step of Runge and Kutta of 1 ms over the states of both."""
    (inverse, a), (forward, b), q = pair
    i, f = Raw(inverse, a, co=False), Raw(forward, b, co=False)
    assert i.begin() == f.begin() == OK
    tau_out, tau_in, r = refs(inverse, "tau"), refs(forward, "tau"), refs(inverse, "reference")

    def rates(t, x):
        assert i.set_time(t) == f.set_time(t) == OK
        assert i.set(r, reference(t, q)) == OK and i.set_states(x[:9]) == OK and f.set_states(x[9:]) == OK
        status, tau = i.get(tau_out)
        assert status == OK and f.set(tau_in, tau) == OK
        (first, di), (second, df) = i.derivatives(), f.derivatives()
        assert first == second == OK
        return np.concatenate([di, df])

    x = np.concatenate([i.states()[1], f.states()[1]])
    worst, far = 0.0, 0.0
    for k in range(round(STOP / H)):
        t = k * H
        k1 = rates(t, x)
        k2 = rates(t + H / 2, x + H / 2 * k1)
        k3 = rates(t + H / 2, x + H / 2 * k2)
        k4 = rates(t + H, x + H * k3)
        x = x + H / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        rates(t + H, x)
        filtered, carts = i.get(refs(inverse, "robot.q"))[1], f.get(refs(forward, "q"))[1]
        worst, far = max(worst, np.max(np.abs(filtered - carts))), max(far, np.max(np.abs(carts - q)))
    assert far > 0.9 * STROKE
    assert worst <= NEAR, worst


def test_as_co_simulation_with_held_forces_the_error_is_half_a_step_of_velocity(pair, record_property):
    """Where it is fastest; what the hold costs: forces that are late by half a step on average."""
    errors = {}
    (inverse, a), (forward, b), q = pair
    for h in (1e-3, 5e-4):
        i, f = Raw(inverse, a), Raw(forward, b)
        assert i.begin() == f.begin() == OK
        tau_out, tau_in, r = refs(inverse, "tau"), refs(forward, "tau"), refs(inverse, "reference")
        worst = fastest = 0.0
        before = f.get(refs(forward, "q"))[1]
        for k in range(round(0.15 / h)):
            t = k * h
            assert f.set(tau_in, i.get(tau_out)[1]) == OK and f.step(t, h)[0] == OK
            for n in range(FINE):  # a reference held over h would be sampled by the lags always at one phase
                assert i.set(r, reference(t + (n + 0.5) * h / FINE, q)) == OK
                assert i.step(t + n * h / FINE, h / FINE)[0] == OK
            filtered, carts = i.get(refs(inverse, "robot.q"))[1], f.get(refs(forward, "q"))[1]
            speed = np.max(np.abs(carts - before)) / h
            if speed > fastest:
                worst, fastest = np.max(np.abs(filtered - carts)), speed
            before = carts
        errors[h] = worst / (fastest * h / 2)
        record_property(
            f"error over v h/2 at {h}", float(errors[h])
        )  # a plain number: processes of pytest send no other
        print(f"step {h} s: {worst:.3g} m, v h/2 {fastest * h / 2:.3g} m")
    assert list(errors.values()) == pytest.approx([1.0, 1.0], abs=0.1)
