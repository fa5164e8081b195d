"""What a filter knows at an instant, and what a reading adds to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..results.refusal import ArgumentError
from .system import System


class Belief(NamedTuple):
    """Time [s], means (m, size) and covariances (m, n, n) of the errors of m runs."""

    time: float
    x: np.ndarray
    P: np.ndarray


class Innovation(NamedTuple):
    """What the readings of one instant said of m runs.

    names: of the sensors. residual: (m, k), zero where nothing was used. variance: of each (m, k). used: (m, k).
    nis: normalised innovations squared (m,), chi-squared with `numbers` (m,) degrees of freedom. log_likelihood: (m,).
    gated: of each sensor, whether its gate left the reading out (m, sensors). weighed: whether it counted less than
        others (m, sensors); None where no sensor weighs its readings. Residual and nis are then cut at Huber's k.
    """

    names: tuple[str, ...]
    residual: np.ndarray
    variance: np.ndarray
    used: np.ndarray
    nis: np.ndarray
    numbers: np.ndarray
    log_likelihood: np.ndarray
    gated: np.ndarray
    weighed: np.ndarray | None = None


@dataclass(frozen=True)
class InitialState:
    """Where a filter begins.

    Args:
        mean: state -> value; what is not named is zero, a quaternion is no turn.
        deviation: state -> standard deviation of its error, one number or one per component [unit of the state, rad],
            or a covariance (k, k) of its components; every state and every constant that is estimated has one.
        time: [s]; the first instant that a reading tells of if left out.

    >>> start = gt.filtering.InitialState({"x": 1.0}, {"x": 0.1, "v": 2.0})
    >>> start.deviation["v"]
    2.0
    """

    mean: Mapping[str, Any]
    deviation: Mapping[str, Any]
    time: float | None = None

    def __post_init__(self) -> None:
        if self.time is not None and not (isinstance(self.time, (int, float, np.number)) and np.isfinite(self.time)):
            raise ArgumentError(f"expected a time [s]; found {self.time!r}", "start.time")

    def belief(self, system: System, time: float, runs: int = 1) -> Belief:
        """The belief of a system at the start. Raises ArgumentError for a state without a deviation."""
        space = system.space
        x = space.point({**system.start_constants(), **self.mean}, "start.mean")
        P = np.zeros((space.dimension, space.dimension))
        for name in self.deviation:
            space.part(name)
        for part in space.parts:
            _, _, along = space.part(part.name)
            if part.name not in self.deviation:
                raise ArgumentError(
                    f"state '{part.name}' has no deviation; give one [{part.error_unit}], or {part.dimension}",
                    "start.deviation",
                )
            given = np.asarray(self.deviation[part.name])
            if given.shape == (part.dimension, part.dimension) and given.ndim == 2:
                if not np.allclose(given, given.T) or np.linalg.eigvalsh(given)[0] < -1e-9 * np.trace(given):
                    raise ArgumentError(
                        f"expected a covariance, symmetric and not negative; found {given.tolist()}",
                        f"start.deviation.{part.name}",
                    )
                P[along, along] = given
                continue
            try:
                d = np.broadcast_to(np.asarray(self.deviation[part.name], float), (part.dimension,))
            except (TypeError, ValueError):
                raise ArgumentError(
                    f"expected a number, or {part.dimension}; found {self.deviation[part.name]!r}",
                    f"start.deviation.{part.name}",
                ) from None
            if not np.all(np.isfinite(d)) or np.any(d < 0):
                raise ArgumentError(f"expected at least 0; found {d.tolist()}", f"start.deviation.{part.name}")
            P[along, along] = np.diag(d**2)
        return Belief(self.time if self.time is not None else time, np.tile(x, (runs, 1)), np.tile(P, (runs, 1, 1)))
