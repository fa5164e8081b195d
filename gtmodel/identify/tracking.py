"""Position-controlled carts as measured from outside: delayed first-order systems from reference to motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..linear.response import late_lag
from ..results import ArgumentError

Array = np.ndarray


@dataclass(frozen=True)
class Tracking:
    """How axes follow their references: q_m = b z^-delay / (1 - a z^-1) q_r (Dressler 2012, eqs. (6.10) and (6.11)).

    `b` and `a` have one number per axis; `delay` is in samples of `sample_time` [s]. The filter acts on the deviation
    from the first reference: the printed gains b / (1 - a) are 0.999, 0.996 and 1.010, and a robot at rest does not
    move for that. Raises ArgumentError for an unstable filter, other numbers of a than of b, and a negative delay.

    >>> tracking = gt.identify.Tracking(b=(0.5,), a=(0.5,), delay=1)
    >>> tracking.follow(np.array([[1.0], [2.0], [2.0], [2.0]]))[:, 0]
    array([1.  , 1.  , 1.5 , 1.75])
    """

    b: tuple[float, ...]
    a: tuple[float, ...]
    delay: int
    sample_time: float = 0.004

    def __post_init__(self) -> None:
        if len(self.a) != len(self.b) or self.delay < 0 or not all(abs(a) < 1 for a in self.a):
            raise ArgumentError(
                f"tracking takes as many a, each below 1 in size, as b, and a delay of 0 or more samples; found a = "
                f"{self.a}, b = {self.b}, delay = {self.delay}"
            )

    def follow(self, reference: Array) -> Array:
        """Positions (n, axes) of the axes for references (n, axes), at rest before the first row."""
        reference = np.asarray(reference, dtype=float)
        if reference.ndim != 2 or reference.shape[1] != len(self.a):
            raise ArgumentError(
                f"tracking of {len(self.a)} axes takes references (n, {len(self.a)}); found {reference.shape}"
            )
        moved = reference - reference[0]
        columns = [late_lag(u, a, b, self.delay) for u, a, b in zip(moved.T, self.a, self.b, strict=True)]
        return np.stack(columns, axis=1) + reference[0]
