"""Smoothing against least squares over the whole log, solved by other means, and against its own exact statistics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import gtmodel as gt
from tests.support.carts import START, TAPE, UNIT, cart_log, cart_system, step_of_cart

F = gt.filtering
DEVIATIONS = 1e-8  # of a deviation: two ways to solve one linear least-squares problem


@pytest.fixture(scope="module")
def system():
    return cart_system()


@pytest.fixture(scope="module")
def case(system):
    time, truth, log = cart_log(seed=1)
    return time, truth, log, F.ErrorState(system).run(log, START)


def batch(time, log):
    """Means (K, 4) and covariance (4 K, 4 K) by dense least squares of all states at once."""
    K = len(time)
    rows, right = [], []

    def add(block, at, value, root):
        row = np.zeros((len(block), 4 * K))
        row[:, at : at + block.shape[1]] = np.linalg.solve(root, block)
        rows.append(row)
        right.append(np.linalg.solve(root, value))

    add(np.eye(4), 0, np.zeros(4), np.diag([0.1, 0.5, 1.0, 0.1]))
    for k, dt in enumerate(np.diff(time)):
        A, Q = step_of_cart(float(dt))
        add(np.hstack([-A, np.eye(4)]), 4 * k, np.zeros(4), np.linalg.cholesky(Q))
    for name, h, sigma in (("tape", [[1.0, 0, 0, 0]], TAPE), ("unit", [[0, 0, 1.0, 1.0]], UNIT)):
        for t, z in zip(log[name].time, log[name].values[:, 0], strict=True):
            if np.isfinite(z):
                add(np.array(h), 4 * int(np.argmin(np.abs(time - t))), np.array([z]), np.array([[sigma]]))
    J, r = np.vstack(rows), np.concatenate(right)
    q, upper = np.linalg.qr(J)
    inverse = np.linalg.solve(upper, np.eye(4 * K))
    return (inverse @ (q.T @ r)).reshape(K, 4), inverse @ inverse.T


def test_smoothing_is_least_squares_over_the_whole_log(case):
    time, _, log, run = case
    mean, covariance = batch(time, log)
    smoothed = F.smooth(run)
    own = np.sqrt(np.diag(covariance)).reshape(-1, 4)
    assert np.abs((smoothed.x[:, 0] - mean) / own).max() < DEVIATIONS
    for k in range(len(time)):
        block = covariance[4 * k : 4 * k + 4, 4 * k : 4 * k + 4]
        difference = (smoothed.covariances[k] - block) / np.outer(own[k], own[k])
        assert np.abs(difference).max() < DEVIATIONS


def test_the_last_state_of_the_filter_is_that_of_least_squares(case):
    time, _, log, run = case
    mean, covariance = batch(time, log)
    own = np.sqrt(np.diag(covariance)[-4:])
    assert np.abs((run.x[-1, 0] - mean[-1]) / own).max() < DEVIATIONS
    assert np.abs(run.covariances[-1] - covariance[-4:, -4:]).max() < DEVIATIONS * own.max() ** 2


def test_a_lag_of_the_whole_interval_is_smoothing_and_none_is_the_filter(case):
    time, _, _, run = case
    whole, smoothed = F.fixed_lag(run, time[-1] - time[0]), F.smooth(run)
    assert np.array_equal(whole.x, smoothed.x)
    assert np.array_equal(whole.P, smoothed.P)
    none = F.fixed_lag(run, 0.0)
    assert np.array_equal(none.x, run.x)
    assert np.array_equal(none.deviations, run.deviations)


def test_a_fixed_lag_is_smoothing_of_the_log_up_to_it(system, case):
    time, _, log, run = case
    lag = 0.45
    later = F.fixed_lag(run, lag)
    for k in (0, 7, 20, 33, 39):
        cut = {
            n: F.Readings(r.time[keep], r.values[keep]) for n, r in log.items() for keep in [r.time <= time[k] + lag]
        }
        own = F.smooth(F.ErrorState(system).run(cut, START))
        assert np.abs(own.x[k] - later.x[k]).max() < 1e-12
        assert np.abs(own.P[k] - later.P[k]).max() < 1e-12
    assert np.all(later.deviations >= F.smooth(run).deviations - 1e-12)
    assert np.all(later.deviations <= run.deviations + 1e-12)


def test_squared_errors_of_the_smoother_stand_in_their_exact_band(system):
    runs = 200
    time, truth, log = cart_log(seed=7, runs=runs)
    given = {name: truth[:, :, k] for k, name in enumerate(["x", "v", "a", "b"])}
    run = F.ErrorState(system).run(log, START, truth={n: v[..., None] for n, v in given.items()}, keep=True)
    smoothed = F.smooth(run)
    low, high = chi2.ppf([0.0005, 0.9995], 4 * runs) / runs
    for k in (0, 10, 20, 30, 39):
        assert low < smoothed.nees[k].mean() < high, (k, smoothed.nees[k].mean())
    assert np.array_equal(smoothed.error["x"].shape, (runs, len(time)))


class Turning(gt.Model):
    """A body that turns at a rate driven by white angular acceleration."""

    Q = gt.variable(4)
    w = gt.variable(3, unit="rad/s")
    alpha = gt.input(3, unit="rad/s2")

    def equations(self):
        q, w = self.Q, self.w
        yield gt.der(q[0]) == -0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2])
        yield gt.der(q[1]) == 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1])
        yield gt.der(q[2]) == 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2])
        yield gt.der(q[3]) == 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0])
        yield gt.der(self.w) == self.alpha


def turning_case(noise: float, seed: int = 3, count: int = 12, dt: float = 0.02):
    """A body tumbling at 3 rad/s; its attitude and its rate are read, with a noise of this size (synthetic)."""
    rng = np.random.default_rng(seed)
    density = (2.0 * noise) ** 2
    rate = np.empty((count, 3))
    rate[0] = [3.0, -1.0, 2.0]
    turn = [Rotation.from_rotvec([0.2, 0.1, -0.3])]
    for k in range(count - 1):
        rate[k + 1] = rate[k] + np.sqrt(density * dt) * rng.standard_normal(3)
        turn.append(turn[-1] * Rotation.from_rotvec(dt * (rate[k] + rate[k + 1]) / 2))
    read = [r * Rotation.from_rotvec(noise * rng.standard_normal(3)) for r in turn]
    Q = np.array([np.roll(r.as_quat(), 1) for r in read])
    gyro = rate + 5 * noise * rng.standard_normal((count, 3))
    time = dt * np.arange(count)
    process = F.ProcessModel(Turning(), noise={"alpha": density}, states=["Q", "w"], quaternions=["Q"])
    sensors = [F.Sensor("camera", "Q", deviation=noise, kind="quaternion"), F.Sensor("gyro", "w", deviation=5 * noise)]
    start = F.InitialState({"Q": Q[0], "w": gyro[0]}, {"Q": 10 * noise, "w": 50 * noise})
    log = {"camera": F.Readings(time, Q), "gyro": F.Readings(time, gyro)}
    run = F.ErrorState(F.System(process, sensors)).run(log, start)
    return run, log, start, density


def whole_log(run, log, start, density, noise):
    """The nonlinear least-squares estimate of all states, with scipy's rotations and its own integration."""
    time, Q, gyro = run.time, log["camera"].values, log["gyro"].values
    read = Rotation.from_quat(np.roll(Q, -1, axis=1))
    first, K, dt = read[0], len(time), float(time[1] - time[0])
    guess = Rotation.from_quat(np.roll(run["Q"], -1, axis=1))

    def unpacked(p):
        p = p.reshape(K, 6)
        return guess * Rotation.from_rotvec(p[:, :3]), p[:, 3:]

    def carried(r, w):  # Q and w after one step without noise, as one rotation: the rate does not change
        return r * Rotation.from_rotvec(dt * w)

    # covariance of one step in closed form where the body turns little in it: angle is the integral of the rate
    S = density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    root = np.linalg.inv(np.linalg.cholesky(S))

    def residuals(p):
        r, w = unpacked(p)
        parts = [(first.inv() * r[0]).as_rotvec() / (10 * noise), (w[0] - gyro[0]) / (50 * noise)]
        after = carried(r[:-1], w[:-1])
        d = np.stack([(after.inv() * r[1:]).as_rotvec(), w[1:] - w[:-1]], axis=-1)
        parts.append((d @ root.T).ravel())
        parts.append(((read.inv() * r).as_rotvec() / noise).ravel())
        parts.append(((w - gyro) / (5 * noise)).ravel())
        return np.concatenate(parts)

    fit = least_squares(residuals, np.hstack([np.zeros((K, 3)), run["w"]]).ravel(), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    r, w = unpacked(fit.x)
    return r, w


@pytest.fixture(scope="module")
def turned():
    return {noise: turning_distance(noise) for noise in (0.02, 0.002)}


def turning_distance(noise):
    """Distance of the smoother, and of the filter, from nonlinear least squares, in deviations."""
    run, log, start, density = turning_case(noise)
    smoothed = F.smooth(run)
    r, w = whole_log(run, log, start, density, noise)

    def distance(estimate):
        own = Rotation.from_quat(np.roll(estimate["Q"], -1, axis=1))
        turn = (r.inv() * own).as_rotvec() / smoothed.deviation["Q"]
        return max(np.abs(turn).max(), np.abs((estimate["w"] - w) / smoothed.deviation["w"]).max())

    return distance(smoothed), distance(run)


def test_a_turning_body_is_smoothed_as_by_nonlinear_least_squares(turned):
    # what is left is of second order: the filter linearises at its own estimates, and the noise of a step is that of
    # its begin. Both fall with the noise: a tenth of it, a tenth of the distance in deviations.
    coarse, fine = turned[0.02][0], turned[0.002][0]
    assert coarse < 0.01
    assert fine < 0.12 * coarse
    assert turned[0.002][1] > 0.5  # the filter alone does not know what comes later


def test_quaternions_may_be_read_with_either_sign():
    run, log, start, _ = turning_case(0.02)
    Q = log["camera"].values * np.where(np.arange(len(run.time)) % 3, 1.0, -1.0)[:, None]
    other = F.ErrorState(run.system).run({"camera": F.Readings(run.time, Q), "gyro": log["gyro"]}, start)
    assert np.abs(F.smooth(other).x - F.smooth(run).x).max() < 1e-12


def test_a_delayed_copy_of_the_state_which_is_certain_is_smoothed_too():
    P = F.StatePart
    process = F.DiscreteProcess([P("x"), P("old")], 0.1, lambda s: {"x": s.x, "old": s.x}, [1e-2, 0.0])
    system = F.System(process, [F.Sensor("late", "old", deviation=0.1), F.Sensor("now", "x", deviation=0.3)])
    rng = np.random.default_rng(5)
    t = 0.1 * np.arange(20)
    log = {"late": F.Readings(t, rng.standard_normal(20)), "now": F.Readings(t, rng.standard_normal(20))}
    run = F.ErrorState(system).run(log, F.InitialState({}, {"x": 1.0, "old": 0.0}))
    smoothed = F.smooth(run)
    assert np.abs(smoothed["old"][1:] - smoothed["x"][:-1]).max() < 1e-12
    assert np.abs(smoothed.deviation["old"][1:] - smoothed.deviation["x"][:-1]).max() < 1e-12


def test_what_cannot_be_smoothed_is_said(system, case):
    _, _, log, run = case
    with pytest.raises(gt.results.ArgumentError, match="run with keep=True"):
        F.smooth(F.ErrorState(system).run(log, START, keep=False))
    with pytest.raises(gt.results.ArgumentError, match="at least 0 s"):
        F.fixed_lag(run, -1.0)


def test_a_gate_that_leaves_out_too_much_is_said():
    _, _, log = cart_log(seed=2)
    gated = cart_system(gate=0.999)
    assert F.ErrorState(gated).run(log, START).notes == ()
    bad = log["tape"].values.copy()
    bad[3:9] += 1.0
    run = F.ErrorState(gated).run({"tape": F.Readings(log["tape"].time, bad), "unit": log["unit"]}, START)
    assert run.gated["tape"][0] == 6
    assert run.notes[0].startswith("the gate of 'tape' at 0.999 left out 6 of 13 readings, 46.2 %, more than the 2 %")


@pytest.mark.parametrize("continuous", [True, False])
def test_a_system_of_a_single_state_is_the_scalar_recursion(continuous):
    class Walk(gt.Model):
        x = gt.variable(unit="m")
        v = gt.input(unit="m/s")

        def equations(self):
            yield gt.der(self.x) == self.v

    q, r, dt, t = 2e-3, 0.1**2, 0.1, 0.1 * np.arange(30)
    steps = F.DiscreteProcess([F.StatePart("x", unit="m")], dt, lambda s: {"x": s.x}, [q * dt])
    process = F.ProcessModel(Walk(), noise={"v": q}) if continuous else steps
    system = F.System(process, [F.Sensor("tape", "x", deviation=0.1)])
    z = np.random.default_rng(0).standard_normal(30)
    run = F.ErrorState(system).run({"tape": F.Readings(t, z)}, F.InitialState({}, {"x": 2.0}))
    x, p, means, variances = 0.0, 4.0, [], []
    for k in range(30):
        p = p + (q * dt if k else 0.0)
        x, p = x + p / (p + r) * (z[k] - x), p * r / (p + r)
        means.append(x)
        variances.append(p)
    for k in range(28, -1, -1):
        gain = variances[k] / (variances[k] + q * dt)
        means[k] += gain * (means[k + 1] - means[k])
        variances[k] += gain**2 * (variances[k + 1] - variances[k] - q * dt)
    smoothed = F.smooth(run)
    assert np.abs(smoothed["x"] - means).max() < 1e-12
    assert np.abs(smoothed.deviation["x"] ** 2 - variances).max() < 1e-12
