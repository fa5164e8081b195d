"""A number that was tested, and the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """A number with its bound: passed when value <= bound; bound None only reports.

    advice: what a person does when it fails, such as "use a smaller tolerance".
    """

    value: float
    bound: float | None = None
    advice: str = ""

    @property
    def passed(self) -> bool:
        """True when the value is finite and not above its bound."""
        return math.isfinite(self.value) and (self.bound is None or self.value <= self.bound)
