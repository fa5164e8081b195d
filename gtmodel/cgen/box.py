"""The box of validity: intervals of inputs inside which a function must answer at every point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..compiler.causal import CausalFunction
from .text import GenerationError

Intervals = tuple[tuple[float, float], ...]


def box_of(function: CausalFunction, box: Mapping[str, Sequence[Sequence[float]]]) -> Intervals | None:
    """Least and greatest value of every number of the inputs, in their order; None where the box lacks one.

    box: intervals by name of a signal such as "der(T)", one for each of its numbers, or one for all. Raises
    GenerationError for an interval that is none, and for another number of them.
    """
    intervals: list[tuple[float, float]] = []
    for s in function.inputs:
        if s.name not in box:
            return None
        given = [tuple(float(x) for x in interval) for interval in box[s.name]]
        if len(given) not in (1, s.size):
            raise GenerationError(
                f"the box gives {len(given)} intervals for '{s.name}'; give {s.size}, or one for all", "box"
            )
        for interval in given * (s.size if len(given) == 1 else 1):
            if len(interval) != 2 or not np.all(np.isfinite(interval)) or interval[0] > interval[1]:
                raise GenerationError(f"the box gives {list(interval)} for '{s.name}'; give [least, greatest]", "box")
            intervals.append((interval[0], interval[1]))
    return None if function.plan.uses_time else tuple(intervals)


def check_names(functions: Mapping[str, CausalFunction], box: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """GenerationError for a name in the box that is the input of no function."""
    known = {s.name for f in functions.values() for s in f.inputs}
    for name in box:
        if name not in known:
            raise GenerationError(
                f"the box speaks of '{name}', which no function takes; it knows {', '.join(sorted(known))}",
                "box",
            )
