"""Further Kalman filters: unscented, with steady-state gain, and with a quaternion as four plain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...linear.state_space import settled_covariance
from ...results.refusal import ArgumentError
from ..belief import Belief, InitialState, Innovation
from ..error_state import ErrorState, Filter, joseph
from ..spread import moments, roots, spread_of
from ..system import System
from ..transition import Advance


class AdditiveQuaternion(ErrorState):
    """Extended Kalman filter whose quaternions are four plain numbers, with a covariance of four: Cvitanic 2021, 4.3.

    For comparison with `ErrorState`. The process is declared without `quaternions=`, and an orientation is measured as
    a vector of four numbers. The result depends on the sign of the measured quaternion, and one direction of the
    covariance has no meaning.

    Args:
        system: process and sensors.
        quaternions: names of the states with four numbers; they are normalised after each step and correction.

    >>> process = gt.filtering.ProcessModel(
    ...     gt.filtering.TurningBody(),
    ...     noise={"jerk": 1e2, "angular_jerk": 1e4},
    ...     states=["p", "v", "a", "Q", "w", "alpha"],
    ... )
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tracker", "Q", deviation=2e-4)])
    >>> gt.filtering.AdditiveQuaternion(system, quaternions=["Q"]).system.space.dimension
    19
    """

    repeatable = False

    def __init__(self, system: System, *, quaternions: Sequence[str], iterations: int = 1) -> None:
        super().__init__(system, iterations=iterations)
        self._places = []
        for name in quaternions:
            part, columns, _ = system.space.part(name)
            if part.kind != "vector" or part.size != 4:
                sentence = f"expected four plain numbers for '{name}'; found a {part.kind} of {part.size}"
                raise ArgumentError(sentence, "quaternions")
            self._places.append(columns)

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """Return the belief at a later time, and the step that led there."""
        after, step = super().advance(belief, time, u0, u1)
        return self._scaled(after), step

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """Return the belief after readings z (m, numbers) of these sensors, side by side, and the innovation."""
        after, innovation = super().correct(belief, names, z, u)
        return self._scaled(after), innovation

    def _scaled(self, belief: Belief) -> Belief:
        x = belief.x.copy()
        for columns in self._places:
            x[:, columns] /= np.linalg.norm(x[:, columns], axis=1, keepdims=True)
        return belief._replace(x=x)


class Unscented(Filter):
    """Unscented Kalman filter on the manifold.

    2n + 1 sigma points, the mean and n on each side of it, pass through process and sensors; the results have an
    intrinsic mean and covariance. All weights are positive, so every covariance is too. Process noise is added as the
    covariance of the step from the mean.

    Args:
        system: process and sensors.
        centre: weight of the mean, between 0 and 1; 1 / (n + 1) if left out, which places the other points at
            sqrt(n + 1) standard deviations.

    Source: Julier, Uhlmann 2004, Proc. IEEE 92, 401-422; on manifolds Hertzberg et al. 2013, Information Fusion 14.

    >>> parts = [gt.filtering.StatePart("angle", unit="rad")]
    >>> process = gt.filtering.DiscreteProcess(
    ...     parts, 0.1, lambda s: {"angle": s.angle}, [1e-4], {"height": lambda s: s.angle**2}
    ... )
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("height", deviation=0.01)])
    >>> log = {"height": gt.filtering.Readings(0.1 * np.arange(20), np.full(20, 0.25))}
    >>> run = gt.filtering.Unscented(system).run(log, gt.filtering.InitialState({"angle": 0.4}, {"angle": 0.2}))
    >>> run["angle"][-1].round(2)
    np.float64(0.5)
    """

    def __init__(self, system: System, *, centre: float | None = None) -> None:
        super().__init__(system)
        n = system.space.dimension
        centre = 1 / (n + 1) if centre is None else centre
        if not 0 < centre < 1:
            raise ArgumentError(f"expected a weight between 0 and 1; found {centre}", "centre")
        self.weights = np.concatenate([[centre], np.full(2 * n, (1 - centre) / (2 * n))])
        self.distance = float(np.sqrt(n / (1 - centre)))  # of the other points [standard deviations]

    def points(self, x: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return sigma points (m, 2n + 1, size) around means x (m, size), and their errors (m, 2n + 1, n)."""
        d = self.distance * roots(P).mT
        d = np.concatenate([np.zeros_like(d[:, :1]), d, -d], axis=1)
        return self.system.space.plus(x[:, None], d), d

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """Return the belief at a later time and the step; its F is the linear map that fits the sigma points."""
        space = self.system.space
        points, _ = self.points(belief.x, belief.P)
        m, k, size = points.shape
        step = self.system.transition(belief.time, time - belief.time, points.reshape(m * k, size), u0, u1)
        after = step.x.reshape(m, k, size)
        Q = step.Q.reshape(m, k, *step.Q.shape[1:])[:, 0] if step.Q.ndim == 3 else step.Q
        x = space.mean(after, self.weights, after[:, 0])
        e = space.minus(after, x[:, None])
        weights = np.broadcast_to(self.weights, (m, k))
        P = moments(e, weights) + Q
        n = space.dimension
        deviations = self.distance * roots(belief.P)
        np.einsum("mii->mi", deviations)[...] += ~deviations.any(axis=2)  # exactly known states have no spread
        halves = (e[:, 1 : n + 1] - e[:, n + 1 :]) / 2
        try:
            F = np.linalg.solve(deviations.mT, halves).mT
        except np.linalg.LinAlgError:
            F = (np.linalg.pinv(deviations.mT) @ halves).mT
        return Belief(time, x, P), Advance(x, F, P - F @ belief.P @ F.mT)

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """Return the belief after readings z (m, numbers) of these sensors, side by side, and the innovation."""
        system, space = self.system, self.system.space
        readings = system.group(names).space
        points, d = self.points(belief.x, belief.P)
        m, k, size = points.shape
        values = system.read(names, belief.time, points.reshape(m * k, size), u).reshape(m, k, -1)
        expected = readings.mean(values, self.weights, values[:, 0])
        e = system.independent(names, readings.minus(values, expected[:, None]))
        weights = np.broadcast_to(self.weights, (m, k))
        residual = system.independent(names, readings.minus(z, expected))
        spread = spread_of(system, names, residual, moments(e, weights), moments(d, weights, e))
        solved = spread.solved()
        correction = (solved.K @ spread.residual[..., None])[..., 0]
        # Joseph's form over the points: the remaining error of each point, and the noise of the readings
        remaining = d - e @ solved.K.mT
        P = moments(remaining, weights) + (solved.K * spread.R[:, None, :]) @ solved.K.mT
        if system.curved_errors:
            J = space.carried(belief.x, correction)
            P = J @ P @ J.mT
        return Belief(belief.time, space.plus(belief.x, correction), P), spread.innovation(names, solved)


SAME_PERIOD = 1e-6  # of a period; stamps are rounded


class SteadyState(Filter):
    """Kalman filter with the constant gain of the discrete algebraic Riccati equation.

    It needs a linear system and readings of all sensors at each instant. The covariance is constant too, so the initial
    deviations are not used. A missing number counts as a zero residual with the same gain, which is not optimal.

    Args:
        system: linear process and sensors.
        period: between instants [s]; the period of the sensors or of the discrete process if left out.

    gain: (n, k). prior, posterior: covariances (n, n) before and after a reading.

    Raises ArgumentError for a nonlinear system, and for one without a steady state: the sensors do not determine a
    state that noise drives or that is not stable.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> filter = gt.filtering.SteadyState(system)
    >>> filter.gain.round(4).tolist()  # the golden ratio, less one: noise and readings are equally uncertain
    [[0.618]]
    """

    def __init__(self, system: System, *, period: float | None = None) -> None:
        super().__init__(system)
        if not system.linear:
            raise ArgumentError("a constant gain needs a linear process and linear sensors; use 'ekf'", "system")
        for name, sensor in system.sensors.items():
            if sensor.outliers:
                sentence = f"'{name}' weighs outliers, which changes the gain from reading to reading; use 'kf'"
                raise ArgumentError(sentence, "system")
        periods = {s.period for s in system.sensors.values()} - {None}
        period = period or system.dynamics.period or (periods.pop() if len(periods) == 1 else None)
        if not period or not period > 0:
            raise ArgumentError("the sensors have no period, or several; give the period of the instants [s]", "period")
        self.period, self.names = float(period), tuple(system.sensors)
        x, u = np.zeros((1, system.space.size)), np.zeros(sum(system.dynamics.inputs.values()))
        step = system.transition(0.0, self.period, x, u, u)
        F, Q = (a if a.ndim == 2 else a[0] for a in (step.F, step.Q))
        z = np.zeros((1, system.group(self.names).space.size))
        self.H = system.reading(self.names)(0.0, x, u, z)[1][0]
        R = system.variances(self.names)
        try:
            self.prior = settled_covariance(F, self.H, Q, R)
        except np.linalg.LinAlgError:
            raise ArgumentError(
                "there is no constant gain: the sensors do not determine a state, or a state is constant without "
                "noise, so that its gain tends to zero; give it a sensor or some noise, or use 'kf'",
                "system",
            ) from None
        PH = self.prior @ self.H.T
        self.S = self.H @ PH
        solved = spread_of(system, self.names, np.zeros((1, len(R))), self.S[None].copy(), PH[None]).solved()
        self.gain = solved.K[0]
        self.posterior = joseph(self.prior[None], solved.K, self.H[None], R[None])[0]

    def begin(self, start: InitialState, time: float, runs: int = 1) -> Belief:
        """Return the initial mean with the steady-state covariance."""
        belief = start.belief(self.system, time, runs)
        return belief._replace(P=np.tile(self.posterior, (runs, 1, 1)))

    def advanced(
        self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray, bends: Sequence[tuple[float, np.ndarray]]
    ) -> tuple[Belief, Advance]:
        """As `advance`, with known inputs whose slope changes in between."""
        after, step = self.advance(belief, time, u0, u1)
        x, t = belief.x, belief.time
        for end, u in [*bends, (time, u1)] if bends else []:
            x, t, u0 = self.system.transition(t, end - t, x, u0, u).x, end, u
        return (after._replace(x=x), step._replace(x=x)) if bends else (after, step)

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """Return the belief one period later, and the step. Raises ArgumentError for another time span."""
        dt = time - belief.time
        if dt and abs(dt - self.period) > SAME_PERIOD * self.period + 4 * np.spacing(abs(time)):
            raise ArgumentError(
                f"the gain is for a period of {self.period:g} s, but the next reading after {belief.time:g} s comes "
                f"{dt:g} s later; use 'kf' for uneven readings",
                "log",
            )
        step = self.system.transition(belief.time, dt, belief.x, u0, u1)
        return Belief(time, step.x, np.broadcast_to(self.prior, belief.P.shape)), step

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """Return the belief after readings of all sensors. Raises ArgumentError if one is missing."""
        if {*names} != {*self.names}:
            missing = ", ".join(f"'{n}'" for n in self.names if n not in names)
            raise ArgumentError(f"there is no reading of {missing} at {belief.time:g} s; use 'kf' instead", "log")
        z = z[:, self._order(names)]
        residual, _ = self.system.reading(self.names)(belief.time, belief.x, u, z)
        rows = len(residual)
        PH = np.tile(self.prior @ self.H.T, (rows, 1, 1))
        spread = spread_of(self.system, self.names, residual, np.tile(self.S, (rows, 1, 1)), PH)
        x = belief.x + spread.residual @ self.gain.T
        after = Belief(belief.time, x, np.broadcast_to(self.posterior, belief.P.shape))
        return after, spread.innovation(self.names, spread.solved())

    def _order(self, names: tuple[str, ...]) -> Any:
        """Indices of the numbers of all sensors in readings that come in another order."""
        places = dict(zip(names, self.system.rows_of(names), strict=True))
        return np.concatenate([np.arange(places[name].start, places[name].stop) for name in self.names])
