"""The steady-state filter: the gain that a Kalman filter of a linear system ends with, used from the start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...linear.state_space import settled_covariance
from ...results.refusal import ArgumentError
from ..belief import Belief, InitialState, Innovation
from ..error_state import joseph
from ..filter import Filter
from ..spread import spread_of
from ..system import System
from ..transition import Advance

SAME_PERIOD = 1e-6  # of a period; stamps are rounded


class SteadyState(Filter):
    """Constant gain from the discrete algebraic Riccati equation: a linear system, all sensors at each instant.

    The covariance is constant too, so the deviations at the start are not used. A missing number leaves its residual
    zero; the gain stays, which is no longer optimal.

    Args:
        system: linear process and sensors.
        period: of the instants [s]; that of the sensors, or of a process in discrete time, if left out.

    gain: (n, k). prior, posterior: covariances (n, n) before and after a reading.

    Raises ArgumentError for a system that is not linear, and for one whose sensors do not determine a state that noise
    drives or that does not settle by itself.

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
            raise ArgumentError("a constant gain needs a linear process and linear sensors; take 'ekf'", "system")
        for name, sensor in system.sensors.items():
            if sensor.outliers:
                sentence = f"'{name}' weighs outliers, which changes the gain from reading to reading; take 'kf'"
                raise ArgumentError(sentence, "system")
        periods = {s.period for s in system.sensors.values()} - {None}
        period = period or system.dynamics.period or (periods.pop() if len(periods) == 1 else None)
        if not period or not period > 0:
            raise ArgumentError("the sensors name no period, or several; give that of the instants [s]", "period")
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
                "there is no constant gain: a state is not determined by the sensors, or is constant and without "
                "noise, so that its gain goes to zero; give it a sensor or some noise, or take 'kf'",
                "system",
            ) from None
        PH = self.prior @ self.H.T
        self.S = self.H @ PH
        solved = spread_of(system, self.names, np.zeros((1, len(R))), self.S[None].copy(), PH[None]).solved()
        self.gain = solved.K[0]
        self.posterior = joseph(self.prior[None], solved.K, self.H[None], R[None])[0]

    def begin(self, start: InitialState, time: float, runs: int = 1) -> Belief:
        """The mean of the start, with the covariance that stays."""
        belief = start.belief(self.system, time, runs)
        return belief._replace(P=np.tile(self.posterior, (runs, 1, 1)))

    def advanced(
        self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray, bends: Sequence[tuple[float, np.ndarray]]
    ) -> tuple[Belief, Advance]:
        """As `advance`, with known inputs that bend between."""
        after, step = self.advance(belief, time, u0, u1)
        x, t = belief.x, belief.time
        for end, u in [*bends, (time, u1)] if bends else []:
            x, t, u0 = self.system.transition(t, end - t, x, u0, u).x, end, u
        return (after._replace(x=x), step._replace(x=x)) if bends else (after, step)

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """The belief one period later. Raises ArgumentError for another span of time."""
        dt = time - belief.time
        if dt and abs(dt - self.period) > SAME_PERIOD * self.period + 4 * np.spacing(abs(time)):
            raise ArgumentError(
                f"the gain is for a period of {self.period:g} s; from {belief.time:g} s to the next reading it "
                f"is {dt:g} s; take 'kf' for uneven ones",
                "log",
            )
        step = self.system.transition(belief.time, dt, belief.x, u0, u1)
        return Belief(time, step.x, np.broadcast_to(self.prior, belief.P.shape)), step

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """The belief after readings of all sensors. Raises ArgumentError where one is not there."""
        if {*names} != {*self.names}:
            missing = ", ".join(f"'{n}'" for n in self.names if n not in names)
            raise ArgumentError(f"at {belief.time:g} s there is no reading of {missing}; take 'kf' then", "log")
        z = z[:, self._order(names)]
        residual, _ = self.system.reading(self.names)(belief.time, belief.x, u, z)
        rows = len(residual)
        PH = np.tile(self.prior @ self.H.T, (rows, 1, 1))
        spread = spread_of(self.system, self.names, residual, np.tile(self.S, (rows, 1, 1)), PH)
        x = belief.x + spread.residual @ self.gain.T
        after = Belief(belief.time, x, np.broadcast_to(self.posterior, belief.P.shape))
        return after, spread.innovation(self.names, spread.solved())

    def _order(self, names: tuple[str, ...]) -> Any:
        """Where the numbers of the sensors stand that come in another order."""
        places = dict(zip(names, self.system.rows_of(names), strict=True))
        return np.concatenate([np.arange(places[name].start, places[name].stop) for name in self.names])
