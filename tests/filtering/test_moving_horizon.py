"""Least squares over a window by collocation: smoother and filter where nothing is bounded, better where it is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from tests.filtering.test_smoother import turning_case, whole_log
from tests.support.carts import START, cart_log, cart_system

F = gt.filtering
DEVIATIONS = 1e-8  # of a deviation: collocation of fifth degree is exact for three integrators behind white noise


@pytest.fixture(scope="module")
def system():
    return cart_system()


@pytest.fixture(scope="module")
def case(system):
    _, _, log = cart_log(seed=1, count=20)
    return log, F.ErrorState(system).run(log, START)


def test_the_whole_log_gives_the_smoother(system, case):
    log, run = case
    smoothed = F.smooth(run)
    estimate = F.MovingHorizon(system).solve(log, START)
    assert estimate.status.ok and estimate.at_bound == ()
    assert np.array_equal(estimate.time, smoothed.time)
    assert np.abs((estimate.x - smoothed.x[:, 0]) / smoothed.deviations[:, 0]).max() < DEVIATIONS
    assert estimate.noise["jerk"].shape == (20, 1)


def test_too_low_a_degree_does_not(system, case):
    log, run = case
    smoothed = F.smooth(run)
    estimate = F.MovingHorizon(system, points=2).solve(log, START)
    assert np.abs((estimate.x - smoothed.x[:, 0]) / smoothed.deviations[:, 0]).max() > 1e-4


def test_a_window_with_its_arrival_cost_gives_filter_and_smoother(system, case):
    log, run = case
    estimate = F.MovingHorizon(system).run(log, START, window=4)
    assert estimate.status.ok
    assert np.abs((estimate.x - run.x[:, 0]) / run.deviations[:, 0]).max() < DEVIATIONS
    kept = {name: r.time >= run.time[12] for name, r in log.items()}
    last = {name: F.Readings(r.time[kept[name]], r.values[kept[name]]) for name, r in log.items()}
    own = F.MovingHorizon(system).solve(last, run.kept[12].before)
    smoothed = F.smooth(run)
    assert np.abs((own.x - smoothed.x[12:, 0]) / smoothed.deviations[12:, 0]).max() < DEVIATIONS


def test_known_inputs_and_constants_that_are_estimated():
    class Driven(gt.Model):
        x = gt.variable(unit="m")
        v = gt.variable(unit="m/s")
        u = gt.input(unit="m/s2")
        a = gt.input(unit="m/s2")
        k = gt.parameter(2.0, unit="1/s2")

        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == self.u + self.a - self.k * self.x

    process = F.ProcessModel(Driven(), noise={"a": 0.1}, inputs=["u"], states=["x", "v"])
    sensors = [F.Sensor("tape", "x", deviation=0.01, offset="estimate"), F.Sensor("odometer", "v", deviation=0.02)]
    system = F.System(process, sensors)
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.05, 0.12, 15))
    inputs = gt.Trajectory(np.append(0.0, t), {"u": 4 * np.sin(3 * np.append(0.0, t))}, {"u": "m/s2"})
    log = {"tape": F.Readings(t[::2], rng.standard_normal(8)), "odometer": F.Readings(t, rng.standard_normal(15))}
    start = F.InitialState({"x": 0.3}, {"x": 0.1, "v": 0.0, "tape.offset": 0.2}, time=0.0)
    smoothed = F.smooth(F.ErrorState(system).run(log, start, inputs=inputs))
    estimate = F.MovingHorizon(system).solve(log, start, inputs=inputs)
    assert np.abs((estimate.x - smoothed.x[:, 0]) / smoothed.deviations[:, 0]).max() < DEVIATIONS
    with pytest.raises(gt.results.ArgumentError, match="known inputs"):
        F.MovingHorizon(system).solve(log, start)


def test_a_turning_body_is_nonlinear_least_squares():
    # scipy's solution holds the rate over a step; its distance from noise in continuous time is of higher order
    noise = 0.02
    run, log, start, density = turning_case(noise)
    estimate = F.MovingHorizon(run.system, points=4).solve(log, start)
    assert estimate.status.ok
    turn, rate = whole_log(run, log, start, density, noise)
    own, smoothed = Rotation.from_quat(np.roll(estimate["Q"], -1, axis=1)), F.smooth(run)
    assert np.abs((turn.inv() * own).as_rotvec() / smoothed.deviation["Q"]).max() < 1e-3
    assert np.abs((estimate["w"] - rate) / smoothed.deviation["w"]).max() < 1e-3
    assert np.abs(np.linalg.norm(estimate["Q"], axis=1) - 1).max() < 1e-12


class Wear(gt.Model):
    """Of a tool, which a probe measures."""

    y = gt.variable(unit="m")
    rate = gt.input(unit="m/s")

    def equations(self):
        yield gt.der(self.y) == self.rate


@pytest.fixture(scope="module")
def worn():
    process = F.ProcessModel(Wear(), noise={"rate": 4e-12})
    return F.System(process, [F.Sensor("probe", "y", deviation=5e-6)])


def test_bounds_make_an_estimate_better(worn):
    """Wear never heals: with a rate that is not negative the error is a quarter smaller, whatever the seed."""
    bounded = F.MovingHorizon(worn, points=2, bounds={"rate": (0.0, None), "y": (0.0, None)})
    start, errors = F.InitialState({}, {"y": 1e-5}), []
    for seed in range(6):  # synthetic: wear of 0.2 um a minute in the mean, a probe of 5 um
        rng = np.random.default_rng(seed)
        true = np.concatenate([[0.0], np.cumsum(rng.exponential(0.2e-6, 39))])
        log = {"probe": F.Readings(np.arange(40.0), true + 5e-6 * rng.standard_normal(40))}
        free, estimate = F.smooth(F.ErrorState(worn).run(log, start)), bounded.solve(log, start)
        assert estimate.status.ok and "rate" in estimate.at_bound
        assert np.diff(estimate["y"]).min() > -1e-10
        errors.append([np.sqrt(np.mean((e["y"] - true) ** 2)) for e in (free, estimate)])
    errors = np.array(errors)
    assert np.all(errors[:, 1] < errors[:, 0])
    assert np.sqrt(np.mean(errors[:, 1] ** 2)) < 0.75 * np.sqrt(np.mean(errors[:, 0] ** 2))


def test_bounds_far_away_change_nothing(system, case):
    log, run = case
    bounds = {"x": (-1e3, 1e3), "jerk": (-1e4, None)}
    smoothed = F.smooth(run)
    estimate = F.MovingHorizon(system, bounds=bounds).solve(log, START)
    assert estimate.at_bound == ()
    assert (
        np.abs((estimate.x - smoothed.x[:, 0]) / smoothed.deviations[:, 0]).max() < 1e-5
    )  # an interior point stays off


def test_what_makes_no_sense_is_said(system, worn):
    error = gt.results.ArgumentError
    with pytest.raises(error, match=r"there is no state or noise 'z'; .* 'x', 'v', 'a', 'b', 'jerk', 'drift'"):
        F.MovingHorizon(system, bounds={"z": (0, 1)})
    with pytest.raises(error, match="lower bound is above"):
        F.MovingHorizon(system, bounds={"x": (1, 0)})
    with pytest.raises(error, match="expected \\(low, high\\)"):
        F.MovingHorizon(system, bounds={"x": 3})
    with pytest.raises(error, match="a single instant"):
        F.MovingHorizon(worn).solve({"probe": F.Readings([0.0], [0.0])}, F.InitialState({}, {"y": 1.0}))
    steps = F.DiscreteProcess([F.StatePart("x")], 0.1, lambda s: {"x": s.x}, [1.0])
    with pytest.raises(error, match="continuous time"):
        F.MovingHorizon(F.System(steps, [F.Sensor("tape", "x", deviation=1.0)]))
    singular = F.Belief(0.0, np.zeros((1, 4)), np.ones((1, 4, 4)))
    log = {"unit": F.Readings([0.0, 0.1], [0.0, 0.0])}
    with pytest.raises(error, match="the covariance at the start is singular"):
        F.MovingHorizon(system).solve(log, singular)
    start = F.InitialState({"y": -1.0}, {"y": 0.0})
    with pytest.raises(error, match="the start of 'y' is exact and outside its bounds"):
        F.MovingHorizon(worn, bounds={"y": (0.0, None)}).solve({"probe": F.Readings([0.0, 1.0], [0, 0])}, start)


def test_bounds_that_the_model_cannot_keep_end_with_a_status(worn):
    start = F.InitialState({"y": 0.0}, {"y": 0.0})
    log = {"probe": F.Readings([0.0, 1.0, 2.0], [0.0, 0.0, 0.0])}
    estimate = F.MovingHorizon(worn, bounds={"y": (None, 1.0), "rate": (2.0, None)}).solve(log, start)
    assert not estimate.status.ok and estimate.message
