"""The numbers that generated C computes with: double, or float. What depends on their precision stands here only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiler.analysis.sizes import DOUBLE as DOUBLE_PRECISION, Precision
from ..compiler.causal import PIVOT_TOLERANCE
from .text import GenerationError


@dataclass(frozen=True)
class Real:
    """One kind of number. `name` in C; `dtype` and `bits` in NumPy; `pivot` below which part of its typical size a
    pivot means singular; `residual`: largest one of an answer of Newton's method, over what one nominal of each
    unknown would make of it; `round_off`: Newton steps below it, in nominals, need not shrink; `held`: what stands in
    outputs before a test; `awkward`: inputs that are singular, denormal or overflow when squared; `precision`: by which
    inputs are too large."""

    name: str
    dtype: Any
    bits: Any
    pivot: float
    residual: float
    round_off: float
    held: float
    awkward: tuple[float, ...]
    precision: Precision

    def array(self, values: Any) -> np.ndarray:
        """The values rounded to these numbers; beyond their range they are infinite."""
        with np.errstate(over="ignore"):
            return np.asarray(values, dtype=self.dtype)


# residual: far above round-off of equations on squared lengths (1e-15), far below what a measurement of a robot sees
DOUBLE = Real(
    "double", np.float64, np.int64, PIVOT_TOLERANCE, 1e-11, 1e-10, -1.25e300, (0.0, 5e-324, -1e-310, 1e160, -1e300),
    DOUBLE_PRECISION,
)  # fmt: skip
# float has 6e-8 of round-off: a pivot of a hundredth leaves 6e-6, some tens of round-offs are a residual, and a
# thousandth is a millimetre of a metre
FLOAT = Real(
    "float", np.float32, np.int32, 1e-2, 1e-6, 1e-5, -1.25e30, (0.0, 1e-45, -1e-40, 1e25, -1e38),
    Precision(2.0**-24, 1e-3, 2.0**40),
)  # fmt: skip

# how far a float may be from the double of the same function, over the range of its signal
FLOAT_TOLERANCE = 1e-5


def real_of(name: str) -> Real:
    """DOUBLE or FLOAT by its name in C. Raises GenerationError for another one."""
    for real in (DOUBLE, FLOAT):
        if real.name == name:
            return real
    raise GenerationError(f"'{name}' is no kind of number for generated code; give 'double' or 'float'")
