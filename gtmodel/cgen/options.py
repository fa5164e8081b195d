"""What the comparison of generated C with Python is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..results.options import Options, Within


@dataclass(frozen=True)
class Verification(Options):
    """The C code is compiled, and computes the same random inputs as Python."""

    points: Annotated[int, Within(above=0), "random inputs per function"] = 1000
    seed: Annotated[int, Within(least=0), "of the random inputs"] = 0
