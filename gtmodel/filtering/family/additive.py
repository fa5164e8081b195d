"""The additive quaternion filter, for comparison: a quaternion as four plain numbers, scaled to unit length after each
correction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...results.refusal import ArgumentError
from ..belief import Belief, Innovation
from ..error_state import ErrorState
from ..system import System
from ..transition import Advance


class AdditiveQuaternion(ErrorState):
    """Extended Kalman filter whose quaternions are four plain numbers, with a covariance of four: Cvitanic 2021, 4.3.

    The process is declared without `quaternions=`; an orientation is measured as a vector of four. It depends on the
    sign of what is measured, and its covariance has a direction that means nothing: for comparison with `ErrorState`.

    Args:
        system: process and sensors.
        quaternions: names of the states of four numbers that are scaled to unit length after each step and correction.

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
            part, at, _ = system.space.part(name)
            if part.kind != "vector" or part.size != 4:
                raise ArgumentError(f"'{name}' is no state of four plain numbers, but a {part.kind}", "quaternions")
            self._places.append(at)

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """The belief at a later time, and the step that led there."""
        after, step = super().advance(belief, time, u0, u1)
        return self._scaled(after), step

    def correct(
        self, belief: Belief, names: tuple[str, ...], z: np.ndarray, u: np.ndarray
    ) -> tuple[Belief, Innovation]:
        """The belief after the readings z (m, numbers) of these sensors, side by side."""
        after, innovation = super().correct(belief, names, z, u)
        return self._scaled(after), innovation

    def _scaled(self, belief: Belief) -> Belief:
        x = belief.x.copy()
        for at in self._places:
            x[:, at] /= np.linalg.norm(x[:, at], axis=1, keepdims=True)
        return belief._replace(x=x)
