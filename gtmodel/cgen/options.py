"""What the comparison of generated C with Python is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..results.options import Options, Within


@dataclass(frozen=True)
class Verification(Options):
    """How generated C is compared: it is compiled, and computes the same random inputs as Python.

    >>> gt.cgen.Verification(points=200, seed=3)
    Verification(points=200, seed=3)
    >>> gt.cgen.Verification(points=0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: points: ...
    """

    points: Annotated[int, Within(above=0), "random inputs per function"] = 1000
    seed: Annotated[int, Within(least=0), "of the random inputs"] = 0
