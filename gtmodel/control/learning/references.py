"""Numbers of Dressler 2012, chapters 6 and 7, defaults of the designs, and the square reference of the experiments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from ...results import ArgumentError
from ...results.options import Options, Unit, Within

# (6.11): b and a of the three controlled actuators of the L1 prototype, b q^-5 / (1 - a q^-1) at 4 ms
ACTUATORS = ((0.03527, 0.9647), (0.03425, 0.9656), (0.02748, 0.9728))
ACTUATOR_DELAY = 5
SAMPLE_TIME = 0.004
# fewest samples between lead-in and lead-out: their root mean square has an error of 1 / sqrt(2 n) = 10 %, half of the
# 20 % within which an error counts as being at its floor
JUDGED = 50
RAMP = 100  # samples of lead-in and of lead-out, section 7.3
CONTRACTION = 0.93  # required bound over the whole set
LENGTH = 125  # lags of Q on either side: half a second at 4 ms


ACCELERATING = 0.25  # share of a side's time in the trapezoidal profile


@dataclass(frozen=True)
class SquarePath(Options):
    """A square of the tool, traversed twice, starting in negative y direction and at rest in its corners.

    The profile of the thesis is not published; `smooth` has continuous acceleration and little energy above 10 Hz.

    >>> x, y = gt.control.learning.SquarePath().samples(0.004).T
    >>> len(x), round(1e3 * float(x.max() - x.min()), 6)  # mm
    (825, 10.0)
    """

    side: Annotated[float, Unit("m", written="mm"), Within(above=0.0), "of the square"] = 0.01
    side_time: Annotated[float, Unit("s"), Within(above=0.0), "for one side"] = 0.25
    profile: Annotated[
        Literal["smooth", "trapezoidal"], "of the speed along a side: with continuous or with stepwise acceleration"
    ] = "smooth"
    ramp: Annotated[int, Within(least=1), "samples of lead-in, and of lead-out"] = RAMP
    corrected: Annotated[int, Within(least=JUDGED), "samples between them, which are fully corrected"] = 625

    @property
    def size(self) -> int:
        """Number of samples of the run."""
        return self.corrected + 2 * self.ramp

    def samples(self, sample_time: float) -> np.ndarray:
        """Return x and y (N, 2) [m], from rest at zero. Raises ArgumentError if a side has fewer than four samples."""
        n = round(self.side_time / sample_time)
        if n < 4:
            raise ArgumentError(f"must be four samples or more; found {n}", "side_time")
        t = np.arange(1, n + 1) / n
        if self.profile == "smooth":
            s = t**3 * (10 - 15 * t + 6 * t**2)
        else:
            p = ACCELERATING
            rise, fall = t**2 / (2 * p), 1 - p - (1 - t) ** 2 / (2 * p)
            s = np.where(t < p, rise, np.where(t > 1 - p, fall, t - p / 2)) / (1 - p)
        path, corner, k = np.zeros((self.size, 2)), np.zeros(2), self.ramp
        for direction in (np.array(c) for c in 2 * [(0, -1), (1, 0), (0, 1), (-1, 0)]):
            side = path[k : k + n]
            side[:] = (corner + self.side * s[:, None] * direction)[: len(side)]
            corner, k = corner + self.side * direction, k + n
            path[k:] = corner
        return path
