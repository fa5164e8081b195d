"""The Kalman filter against filterpy and statsmodels, and against itself: one run or many at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import ErrorState, InitialState, ProcessModel, Readings, Sensor, System
from tests.support import turning_body as body

STATES = 1e-11  # standard deviations
LIKELIHOOD = 1e-9
H, COUNT, DENSITY = 0.01, 400, 0.3


class DrivenPoint(gt.Model):
    """Two axes driven by white jerk."""

    p = gt.variable(2, unit="m")
    v = gt.variable(2, unit="m/s")
    a = gt.variable(2, unit="m/s2")
    jerk = gt.input(2, unit="m/s3")

    def equations(self) -> Any:
        yield gt.der(self.p) == self.v
        yield gt.der(self.v) == self.a
        yield gt.der(self.a) == self.jerk


START = InitialState({"p": [0.1, -0.2]}, {"p": 0.5, "v": [0.2, 0.3], "a": 1.0})


def system() -> System:
    process = ProcessModel(DrivenPoint(), {"jerk": DENSITY}, states=["p", "v", "a"])
    return System(process, [Sensor("tape", "p", deviation=[0.01, 0.02]), Sensor("unit", "a", deviation=0.05)])


def matrices() -> tuple[np.ndarray, ...]:
    """F, Q, H and R by hand; errors in the order p, v, a."""
    h, eye = H, np.eye(2)
    F = np.kron([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]], eye)
    Q = DENSITY * np.kron(
        [[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]], eye
    )
    Hs = np.zeros((4, 6))
    Hs[:2, :2], Hs[2:, 4:] = eye, eye
    return F, Q, Hs, np.diag([0.01**2, 0.02**2, 0.05**2, 0.05**2])


def readings(seed: int = 3, runs: int = 1, missing: bool = True) -> dict[str, Readings]:
    """Of a synthetic walk; some numbers are missing, some whole instants."""
    rng = np.random.default_rng(seed)
    t = H * np.arange(COUNT)
    made = {}
    for name, deviation in (("tape", 0.02), ("unit", 0.05)):
        values = np.sin(3 * t)[:, None] * [1.0, 0.5] + rng.normal(size=(runs, COUNT, 2)) * deviation
        if missing:
            values[:, 40:60] = np.nan
            values[rng.random(values.shape) < 0.1] = np.nan
        made[name] = Readings(t, values if runs > 1 else values[0])
    return made


def test_filterpy():
    filterpy = pytest.importorskip("filterpy.kalman", reason="filterpy is an oracle: extra 'oracle'")
    log = readings(missing=False)
    run = ErrorState(system()).run(log, START)
    F, Q, Hs, R = matrices()
    oracle: Any = filterpy.KalmanFilter(dim_x=6, dim_z=4)
    oracle.x, oracle.P = run.system.space.point(START.mean), np.diag([0.25, 0.25, 0.04, 0.09, 1, 1])
    oracle.F, oracle.Q, oracle.H, oracle.R = F, Q, Hs, R
    z = np.concatenate([log["tape"].values, log["unit"].values], axis=1)
    likelihood = 0.0
    for k, row in enumerate(z):
        if k:
            oracle.predict()
        oracle.update(row)
        likelihood += oracle.log_likelihood
        spread = run.deviations[k, 0]
        assert np.max(np.abs(run.x[k, 0] - oracle.x) / spread) < STATES
        assert np.allclose(
            run.covariances[k] / np.outer(spread, spread), oracle.P / np.outer(spread, spread), atol=1e-11
        )
    assert run.log_likelihood[0] == pytest.approx(likelihood, rel=LIKELIHOOD)


def test_statsmodels_with_missing_numbers():
    statespace = pytest.importorskip(
        "statsmodels.tsa.statespace.kalman_filter", reason="statsmodels is an oracle: extra 'oracle'"
    )
    log = readings()
    run = ErrorState(system()).run(log, START)
    F, Q, Hs, R = matrices()
    oracle = statespace.KalmanFilter(4, 6, 6, tolerance=0)  # 0: it is to go on updating the covariance
    oracle.bind(np.asfortranarray(np.concatenate([log["tape"].values, log["unit"].values], axis=1).T))
    oracle["design"], oracle["obs_cov"], oracle["transition"] = Hs, R, F
    oracle["selection"], oracle["state_cov"] = np.eye(6), Q
    oracle.initialize_known(run.system.space.point(START.mean), np.diag([0.25, 0.25, 0.04, 0.09, 1, 1]))
    answer = oracle.filter()
    assert np.max(np.abs(run.x[:, 0] - answer.filtered_state.T) / run.deviations[:, 0]) < STATES
    variances = np.einsum("iik->ki", answer.filtered_state_cov)
    assert np.allclose(run.deviations[:, 0] ** 2 / variances, 1.0, rtol=0, atol=1e-11)
    assert run.log_likelihood[0] == pytest.approx(answer.llf, rel=LIKELIHOOD)


@pytest.mark.parametrize("iterations", [1, 2])
def test_a_run_among_many_is_the_run_alone(iterations):
    # of one run LAPACK is called itself, of many NumPy: the numbers differ by round-off only
    t = 0.001 * np.arange(40)
    logs = [body.noisy(t, seed) for seed in range(3)]
    logs[1]["position"].values[10:20] = np.nan
    many = {name: Readings(t, np.stack([log[name].values for log in logs])) for name in logs[0]}
    filter = ErrorState(body.tracked(), iterations=iterations)
    together = filter.run(many, body.beginning(), keep=True)
    for n, log in enumerate(logs):
        alone = filter.run(log, body.beginning())
        assert np.max(np.abs(together.x[:, n] - alone.x[:, 0])) < 1e-11
        assert together.log_likelihood[n] == pytest.approx(alone.log_likelihood[0], rel=1e-11)
        for name, values in alone.innovations.items():
            assert np.allclose(together.innovations[name][:, n], values[:, 0], rtol=0, atol=1e-9, equal_nan=True)


@pytest.mark.parametrize("runs", [1, 3])
def test_a_covariance_that_is_not_positive_ends_the_run_with_its_status(runs):
    # a density whose steps overflow
    process = ProcessModel(DrivenPoint(), {"jerk": 1e308}, states=["p", "v", "a"])
    bad = System(process, [Sensor("tape", "p", deviation=0.01)])
    log = {"tape": Readings([0.0, 1.0, 1e6, 1e9], np.zeros((runs, 4, 2)) if runs > 1 else np.zeros((4, 2)))}
    with np.errstate(all="ignore"):
        run = ErrorState(bad).run(log, START)
    assert run.status == gt.results.SolveStatus.NOT_FINITE
    assert len(run.time) < 4


def test_other_noise_is_not_taken_for_the_old_one():
    # what does not change of the readings is kept by names of sensors; a system with other deviations has its own
    first = system()
    ErrorState(first).run(readings(), START)
    rough = first.with_(deviations={"tape": 0.1})
    made_anew = System(first.process, [Sensor("tape", "p", deviation=0.1), Sensor("unit", "a", deviation=0.05)])
    assert np.array_equal(ErrorState(rough).run(readings(), START).x, ErrorState(made_anew).run(readings(), START).x)
