"""Carts and turning bodies for filters, with synthetic readings of known noise."""

from __future__ import annotations

import numpy as np

import gtmodel as gt

F = gt.filtering
JERK, DRIFT = 0.3, 2e-4  # densities: m2/s5, m2/s5
TAPE, UNIT = 0.01, 0.05  # m, m/s2


class Cart(gt.Model):
    """Driven by white jerk; its accelerometer has a bias that drifts."""

    x = gt.variable(unit="m")
    v = gt.variable(unit="m/s")
    a = gt.variable(unit="m/s2")
    b = gt.variable(unit="m/s2")
    jerk = gt.input(unit="m/s3")
    drift = gt.input(unit="m/s3")
    felt = gt.variable(unit="m/s2")

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.a
        yield gt.der(self.a) == self.jerk
        yield gt.der(self.b) == self.drift
        yield self.felt == self.a + self.b


STATES = ["x", "v", "a", "b"]
START = F.InitialState({}, {"x": 0.1, "v": 0.5, "a": 1.0, "b": 0.1})


def cart_system(**options) -> gt.filtering.System:
    process = F.ProcessModel(Cart(), noise={"jerk": JERK, "drift": DRIFT}, states=STATES)
    sensors = [F.Sensor("tape", "x", deviation=TAPE, **options), F.Sensor("unit", "felt", deviation=UNIT)]
    return F.System(process, sensors)


def step_of_cart(dt: float) -> tuple[np.ndarray, np.ndarray]:
    """F and Q of the cart in closed form."""
    A = np.eye(4)
    A[0, 1], A[0, 2], A[1, 2] = dt, dt**2 / 2, dt
    Q = np.zeros((4, 4))
    Q[:3, :3] = JERK * np.array(
        [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    )
    Q[3, 3] = DRIFT * dt
    return A, Q


def cart_log(seed: int, count: int = 40, runs: int | None = None):
    """Synthetic: times with uneven steps, true states (count, 4) or (runs, count, 4), readings of both sensors; the
    tape reads at every third instant and misses some."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 0.15, count)) - 0.05
    m = runs or 1
    x = np.empty((m, count, 4))
    x[:, 0] = rng.standard_normal((m, 4)) * [0.1, 0.5, 1.0, 0.1]
    for k, dt in enumerate(np.diff(time)):
        A, Q = step_of_cart(float(dt))
        x[:, k + 1] = x[:, k] @ A.T + rng.standard_normal((m, 4)) @ np.linalg.cholesky(Q).T
    tape = x[:, ::3, 0] + TAPE * rng.standard_normal(x[:, ::3, 0].shape)
    tape[:, 2] = np.nan
    unit = x[:, :, 2] + x[:, :, 3] + UNIT * rng.standard_normal((m, count))
    log = {"tape": F.Readings(time[::3], tape[..., None]), "unit": F.Readings(time, unit[..., None])}
    if runs is None:
        log = {"tape": F.Readings(time[::3], tape[0]), "unit": F.Readings(time, unit[0])}
        x = x[0]
    return time, x, log
