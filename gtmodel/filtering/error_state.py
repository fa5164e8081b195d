"""The error-state Kalman filter: Kalman's own where all is linear, extended and iterated where it is not."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..results.refusal import ArgumentError
from .belief import Belief, Innovation
from .filter import Filter
from .spread import Spread, spread_of
from .system import System
from .transition import Advance


class ErrorState(Filter):
    """Kalman filter of the error of the state: mean on the manifold, covariance in the space of errors.

    Where process and sensors are linear this is the Kalman filter, with exact steps; else the extended Kalman filter,
    with Jacobians of the very functions that move the mean, which CasADi makes. The covariance is updated in Joseph's
    form, so it stays positive.

    Args:
        system: process and sensors.
        iterations: how often the readings of one instant are linearised anew at the corrected mean (Gauss and Newton);
            1 is the extended filter.

    >>> class Cart(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     a = gt.input(unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == self.a
    >>> process = gt.filtering.ProcessModel(Cart(), noise={"a": 0.1}, states=["x", "v"])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> t = 0.1 * np.arange(50)
    >>> log = {"tape": gt.filtering.Readings(t, 0.5 * t)}
    >>> run = gt.filtering.ErrorState(system).run(log, gt.filtering.InitialState({}, {"x": 1.0, "v": 1.0}))
    >>> run["v"][-1].round(3), run.deviation["v"][-1].round(3)
    (np.float64(0.5), np.float64(0.102))
    """

    repeatable = True

    def __init__(self, system: System, *, iterations: int = 1) -> None:
        super().__init__(system)
        if not isinstance(iterations, int) or iterations < 1:
            raise ArgumentError(f"expected a whole number, at least 1; found {iterations!r}", "iterations")
        self.iterations = iterations

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """The belief at a later time, and the step that led there."""
        step = self.system.transition(belief.time, time - belief.time, belief.x, u0, u1)
        P = step.F @ belief.P @ step.F.mT + step.Q
        return Belief(time, step.x, P), step

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """The belief after the readings z (m, numbers) of these sensors, side by side."""
        residual, H, S, PH = self.seen(belief, names, z, u)
        spread = spread_of(self.system, names, residual, S, PH)
        solved = spread.solved()
        return self.corrected(belief, names, z, u, spread, solved.K, H), spread.innovation(names, solved)

    def seen(self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """Residuals (m, k) of these readings, their Jacobian H, their covariance without noise, and that of the state's
        error with them."""
        residual, H = self.system.reading(names)(belief.time, belief.x, u, z)
        PH = belief.P @ H.mT
        return residual, H, H @ PH, PH

    def corrected(
        self,
        belief: Belief,
        names: tuple[str, ...],
        z: np.ndarray,
        u: np.ndarray,
        spread: Spread,
        K: np.ndarray,
        H: np.ndarray,
    ) -> Belief:
        """The belief after readings with this gain."""
        system, space = self.system, self.system.space
        d = (K @ spread.residual[..., None])[..., 0]
        for _ in range(self.iterations - 1):
            x = space.plus(belief.x, d)
            residual, H, S, PH = self.seen(Belief(belief.time, x, belief.P), names, z, u)
            residual = residual - (H @ space.minus(belief.x, x)[..., None])[..., 0]
            there = spread_of(system, names, residual, S, PH, spread.choice)
            K = there.solved().K
            d = (K @ there.residual[..., None])[..., 0]
        P = joseph(belief.P, K, H if spread.used.all() else np.where(spread.used[..., None], H, 0.0), spread.R)
        if system.curved_errors:
            J = space.carried(belief.x, d)
            P = J @ P @ J.mT
        return Belief(belief.time, space.plus(belief.x, d), P)


def joseph(P: np.ndarray, K: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Covariance (m, n, n) after a correction with the gain K, whatever it is: the sum of two that are not negative."""
    A = -(K @ H)
    np.einsum("mii->mi", A)[...] += 1.0
    return A @ P @ A.mT + (K * R[:, None, :]) @ K.mT


def kalman(system: System, **options: Any) -> ErrorState:
    """The filter of a linear system. Raises ArgumentError where process or sensors are not linear.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> type(gt.filtering.kalman(system)).__name__
    'ErrorState'
    """
    if not system.linear:
        raise ArgumentError("the Kalman filter needs a linear process and linear sensors; take ErrorState", "filter")
    return ErrorState(system, **options)
