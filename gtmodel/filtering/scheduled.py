"""Noise that changes with time, after the fact: a filter whose steps take the system that was right then, to smooth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..results.refusal import ArgumentError
from .belief import Belief
from .error_state import ErrorState
from .readings import SAME_INSTANT
from .system import System, agree_in_shape
from .transition import Advance

LEAST_CHANCE = 1e-300  # of a mode that nothing leads to: its share of what follows is none


class ScheduledNoise(ErrorState):
    """An error-state filter that takes, from instant to instant, one of several systems that differ in noise.

    Interacting models say at each instant how likely each system is. With all of the log known, `likely_modes` says
    which one it was; this filter goes over the log with these, so that `smooth` has one step from instant to instant.

    Args:
        systems: with the same states and sensors, such as `system.with_(noise={"jerk": 1e6})`.
        time: instants (K,), increasing [s].
        modes: number of the system (K,) of the step that ends at each instant. Before and after them the first and the
            last one holds.
        iterations: as of `ErrorState`.

    Raises ArgumentError for systems that differ in states or sensors, and for modes that are not there.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> tape = gt.filtering.Sensor("tape", "x", deviation=0.01)
    >>> def walk(variance):
    ...     process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [variance])
    ...     return gt.filtering.System(process, [tape])
    >>> t = 0.1 * np.arange(40)
    >>> filter = gt.filtering.ScheduledNoise([walk(1e-6), walk(1e-2)], t, (t > 2).astype(int))
    >>> log = {"tape": gt.filtering.Readings(t, np.where(t < 2, 0.0, t - 2))}
    >>> smoothed = gt.filtering.smooth(filter.run(log, gt.filtering.InitialState({}, {"x": 0.1})))
    >>> smoothed.deviation["x"][[15, 30]].round(4).tolist()  # at rest, and moving
    [0.0027, 0.0099]
    """

    repeatable = False

    def __init__(self, systems: Sequence[System], time: Any, modes: Any, *, iterations: int = 1) -> None:
        self.systems = (*systems,)
        if not self.systems:
            raise ArgumentError("expected systems; found none", "systems")
        super().__init__(self.systems[0], iterations=iterations)
        agree_in_shape(self.systems)
        self.time, self.modes = np.asarray(time, float), np.asarray(modes)
        if self.time.ndim != 1 or self.modes.shape != self.time.shape or not len(self.time):
            raise ArgumentError(
                f"expected instants (K,) and a mode of each; found {self.time.shape} and {self.modes.shape}", "modes"
            )
        if not np.all(np.diff(self.time) >= 0):
            raise ArgumentError("the instants do not increase", "time")
        if not np.issubdtype(self.modes.dtype, np.integer) or not np.all(
            (self.modes >= 0) & (self.modes < len(self.systems))
        ):
            raise ArgumentError(f"expected numbers of systems, 0 to {len(self.systems) - 1}", "modes")

    def advance(self, belief: Belief, time: float, u0: np.ndarray, u1: np.ndarray) -> tuple[Belief, Advance]:
        """The belief at a later time, with the system of that time, and the step that led there."""
        k = min(int(np.searchsorted(self.time, time - SAME_INSTANT)), len(self.time) - 1)
        system = self.systems[int(self.modes[k])]
        step = system.transition(belief.time, time - belief.time, belief.x, u0, u1)
        return Belief(time, step.x, step.F @ belief.P @ step.F.mT + step.Q), step


def likely_modes(probabilities: Any, chances: Any) -> np.ndarray:
    """The likeliest mode (K,) at each instant in the light of the whole log.

    Args:
        probabilities: of the modes after the readings of each instant (K, modes), as interacting models give them.
        chances: to go from mode to mode between two instants (modes, modes), from row to column.

    Raises ArgumentError for shapes that do not fit.

    Source: Kim 1994, Journal of Econometrics 60, 1-22, for the recursion.

    >>> stay = np.array([[0.99, 0.01], [0.01, 0.99]])
    >>> seen = [[0.99, 0.01], [0.7, 0.3], [0.1, 0.9], [0.02, 0.98]]  # the filter needs an instant to see a change
    >>> gt.filtering.likely_modes(seen, stay).tolist()
    [0, 1, 1, 1]
    """
    p, change = np.asarray(probabilities, float), np.asarray(chances, float)
    if p.ndim != 2 or change.shape != (p.shape[1], p.shape[1]):
        raise ArgumentError(
            f"expected (K, modes) and (modes, modes); found {p.shape} and {change.shape}", "probabilities"
        )
    whole = p.copy()
    for k in range(len(p) - 2, -1, -1):
        ahead = np.maximum(p[k] @ change, LEAST_CHANCE)
        whole[k] = p[k] * (change @ (whole[k + 1] / ahead))
        whole[k] /= max(whole[k].sum(), LEAST_CHANCE)
    return np.argmax(whole, axis=1)
