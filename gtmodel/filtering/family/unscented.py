"""The unscented filter: points around the mean that go through process and sensors themselves, no Jacobian."""

from __future__ import annotations

import numpy as np

from ...results.refusal import ArgumentError
from ..belief import Belief, Innovation
from ..filter import Filter
from ..spread import moments, roots, spread_of
from ..system import System
from ..transition import Advance


class Unscented(Filter):
    """Unscented Kalman filter on the manifold.

    2n + 1 points, the mean and n to each side of it by plus, go through process and sensors; mean and covariance of
    what comes out are intrinsic, by minus. All weights are positive, so every covariance is. The noise of the process
    is added as the covariance of its step from the mean.

    Args:
        system: process and sensors.
        centre: weight of the mean itself, between 0 and 1; 1 / (n + 1) if left out, which puts the others
            sqrt(n + 1) standard deviations from it.

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
        """Points (m, 2n + 1, size) around means x (m, size), and their errors (m, 2n + 1, n)."""
        d = self.distance * roots(P).mT
        d = np.concatenate([np.zeros_like(d[:, :1]), d, -d], axis=1)
        return self.system.space.plus(x[:, None], d), d

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """The belief at a later time, and the step that led there, whose F is the linear map that fits the points."""
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
        own = self.distance * roots(belief.P)
        np.einsum("mii->mi", own)[...] += ~own.any(axis=2)  # what is known exactly has no points around it
        halves = (e[:, 1 : n + 1] - e[:, n + 1 :]) / 2
        try:
            F = np.linalg.solve(own.mT, halves).mT
        except np.linalg.LinAlgError:
            F = (np.linalg.pinv(own.mT) @ halves).mT
        return Belief(time, x, P), Advance(x, F, P - F @ belief.P @ F.mT)

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """The belief after the readings z (m, numbers) of these sensors, side by side."""
        system, space = self.system, self.system.space
        seen = system.group(names).space
        points, d = self.points(belief.x, belief.P)
        m, k, size = points.shape
        values = system.read(names, belief.time, points.reshape(m * k, size), u).reshape(m, k, -1)
        expected = seen.mean(values, self.weights, values[:, 0])
        e = system.independent(names, seen.minus(values, expected[:, None]))
        weights = np.broadcast_to(self.weights, (m, k))
        residual = system.independent(names, seen.minus(z, expected))
        spread = spread_of(system, names, residual, moments(e, weights), moments(d, weights, e))
        solved = spread.solved()
        correction = (solved.K @ spread.residual[..., None])[..., 0]
        # Joseph's form over the points: what is left of the error of each, and the noise of the readings
        left = d - e @ solved.K.mT
        P = moments(left, weights) + (solved.K * spread.R[:, None, :]) @ solved.K.mT
        if system.curved_errors:
            J = space.carried(belief.x, correction)
            P = J @ P @ J.mT
        return Belief(belief.time, space.plus(belief.x, correction), P), spread.innovation(names, solved)
