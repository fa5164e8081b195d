"""What a person may give to simulate() and linearize(), checked before anything is worked out."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..lang.slips import floats
from ..lang.source import ModelError

# rows of a trajectory: more fill the memory before anybody looks at them
MOST_ROWS = 1_000_000
# time [s]: squares of a longer one overflow, and an integrator's norms with them
LARGEST_TIME = 1e150
# steps of an integrator with a longest one: more take hours
MOST_STEPS = 10_000_000


def number(what: str, value: Any) -> float:
    """A finite number. Raises ModelError naming what it is for."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ModelError(f"{what} takes a number; found {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise ModelError(f"{what} takes a number; found one larger than any float") from None


def numbers(what: str, value: Any) -> np.ndarray:
    """Numbers as one column. Raises ModelError naming what they are for."""
    try:
        return floats(value).reshape(-1)
    except (TypeError, ValueError):
        raise ModelError(f"{what} takes numbers; found {reprlib.repr(value)}") from None


def names(what: str, value: Sequence[str] | str) -> list[str]:
    """One name or several as a list. Raises ModelError for what is no name."""
    texts: list[Any] = list(value) if isinstance(value, (list, tuple, set, dict)) else [value]
    for name in texts:
        if not isinstance(name, str):
            raise ModelError(f"{what} takes names such as 'T'; found {name!r}")
    return texts


def by_name(what: str, value: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """A dictionary from names. Raises ModelError for anything else."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ModelError(f"{what} takes a dictionary by name, such as {{'T': 0.0}}; found {value!r}")
    names(what, list(value))
    return value


def span(final_time: Any, start_time: Any) -> tuple[float, float]:
    """(start, end) [s] of a run."""
    end, start = number("final_time", final_time), number("start_time", start_time)
    if not (np.isfinite(start) and np.isfinite(end) and end > start):
        raise ModelError(f"the simulation must end after its start; found {start:g} s to {end:g} s")
    if max(abs(start), abs(end)) > LARGEST_TIME:
        raise ModelError(f"a run lies within {LARGEST_TIME:g} s of zero; found {start:g} s to {end:g} s")
    return start, end


def output_step(step: Any, length: float) -> float | None:
    """Interval [s] of the rows of a run of `length` seconds."""
    if step is None:
        return None
    step = number("step", step)
    if not 0 < step <= length:
        raise ModelError(f"the output interval must be positive and within the run; found {step:g} s")
    if length / step > MOST_ROWS:
        raise ModelError(
            f"an output interval of {step:g} s gives {length / step:.3g} rows, more than {MOST_ROWS}; give one of at "
            f"least {length / MOST_ROWS:.3g} s"
        )
    return step


def longest_step(max_step: Any, length: float) -> float:
    """Longest internal step [s] of a run of `length` seconds; infinite where none is given."""
    if max_step is None:
        return np.inf
    step = number("max_step", max_step)
    if not step > 0:
        raise ModelError(f"max_step must be positive; found {step:g} s")
    if length / step > MOST_STEPS:
        raise ModelError(
            f"a max_step of {step:g} s means {length / step:.3g} steps, more than {MOST_STEPS}; give one of at least "
            f"{length / MOST_STEPS:.3g} s"
        )
    return step
