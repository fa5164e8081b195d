"""The steady-state filter: Riccati's equation, and what a long Kalman filter ends with."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import DiscreteProcess, InitialState, ProcessModel, Readings, Sensor, StatePart, System, make
from gtmodel.results.refusal import ArgumentError
from tests.support.carts import START, cart_system, step_of_cart

RICCATI = 1e-9


@pytest.fixture(scope="module")
def system() -> System:
    return cart_system(period=0.1)


H = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 1.0]])
R = np.diag([0.01**2, 0.05**2])


def test_its_covariance_solves_riccati_s_equation(system):
    filter = make("steady", system)
    F, Q = step_of_cart(0.1)
    P = filter.prior
    S = H @ P @ H.T + R
    other = F @ (P - P @ H.T @ np.linalg.solve(S, H @ P)) @ F.T + Q
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    assert np.max(np.abs(other - P) / scale) < RICCATI
    assert np.max(np.abs(filter.gain - P @ H.T @ np.linalg.inv(S))) < RICCATI
    assert np.all(np.linalg.eigvalsh(filter.posterior / scale) > 0)


def test_it_is_what_the_kalman_filter_ends_with(system):
    rng = np.random.default_rng(4)
    t = 0.1 * np.arange(4000)
    log = {"tape": Readings(t, 0.01 * rng.normal(size=4000)), "unit": Readings(t, 0.05 * rng.normal(size=4000))}
    steady, exact = (make(name, system).run(log, START) for name in ("steady", "kf"))
    assert np.allclose(steady.covariances[-1], exact.covariances[-1], rtol=RICCATI, atol=0)
    assert np.max(np.abs(steady.x[-1] - exact.x[-1]) / exact.deviations[-1]) < RICCATI
    assert np.allclose(steady.nis[-100:], exact.nis[-100:], rtol=0, atol=1e-8)


def test_of_a_rigid_body_whose_states_differ_by_1e8():
    # position in micrometres, acceleration in metres per second squared, at 1 kHz
    process = ProcessModel(gt.filtering.TranslatingBody(), {"jerk": 1e6}, states=["p", "v", "a"])
    sensors = [Sensor("p", deviation=6.4e-6, period=0.001), Sensor("a", deviation=0.0124, period=0.001)]
    system = System(process, sensors)
    t = 0.001 * np.arange(3000)
    log = {"p": Readings(t, np.zeros((3000, 3))), "a": Readings(t, np.zeros((3000, 3)))}
    exact = make("kf", system).run(log, InitialState({}, {"p": 1e-5, "v": 0.01, "a": 1.0}))
    posterior, scale = make("steady", system).posterior, exact.deviations[-1, 0]
    assert np.max(np.abs(posterior - exact.covariances[-1]) / np.outer(scale, scale)) < RICCATI


def test_sensors_in_another_order_and_of_several_runs(system):
    rng = np.random.default_rng(4)
    t = 0.1 * np.arange(30)
    log = {"tape": Readings(t, rng.normal(size=(2, 30, 1))), "unit": Readings(t, rng.normal(size=(2, 30, 1)))}
    filter = make("steady", system)
    a, b = filter.run(log, START), filter.run(dict(reversed(log.items())), START)
    assert np.array_equal(a.x, b.x) and np.array_equal(a.innovations["tape"], b.innovations["tape"])
    alone = filter.run({name: Readings(t, r.values[1]) for name, r in log.items()}, START)
    assert np.allclose(a.x[:, 1], alone.x[:, 0], rtol=0, atol=1e-12)


def test_refusals(system):
    filter = make("steady", system)
    t = 0.1 * np.arange(5)
    with pytest.raises(ArgumentError, match="there is no reading of 'unit'"):
        filter.run({"tape": Readings(t, t)}, START)
    with pytest.raises(ArgumentError, match="the gain is for a period of"):
        filter.run({"tape": Readings(2 * t, t), "unit": Readings(2 * t, t)}, START)
    parts = [StatePart("x"), StatePart("y")]
    unseen = DiscreteProcess(parts, 0.1, lambda s: {"x": s.x, "y": s.y}, [1.0, 1.0])
    with pytest.raises(ArgumentError, match="no constant gain"):
        make("steady", System(unseen, [Sensor("x", deviation=1.0)]))
