"""One evenly sampled recording of inputs and outputs, checked once for every method of this package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..results.agreement import Within, agree
from ..results.refusal import ArgumentError, naming


class FitStopped(Exception):
    """A fit that was asked to end before it arrived; there is no model."""


def go_on(interrupted: Callable[[], bool]) -> None:
    """Raises FitStopped where a stop was asked for."""
    if interrupted():
        raise FitStopped("stopped before the fit arrived")


@dataclass(frozen=True, eq=False)
class Record:
    """Inputs u (N, m) and outputs y (N, p), one row per sample, every `sample_time` [s]; units are the caller's.

    The input is held between samples (zero-order hold); y[k] is read before u[k] acts. `synthetic`: seed and noise of
    synthetic data, None for measured ones. One-dimensional arrays are one column. Raises ArgumentError.

    >>> record = gt.vibration.Record(u=np.zeros(100), y=np.zeros((100, 2)), sample_time=0.004)
    >>> record.y.shape, round(float(record.time[-1]), 3)  # s
    ((100, 2), 0.396)
    >>> gt.vibration.Record(u=np.zeros(99), y=np.zeros(100), sample_time=0.004)
    Traceback (most recent call last):
    gtmodel...ArgumentError: y: 99 samples of the inputs and 100 of the outputs; give one each per sample
    """

    u: np.ndarray
    y: np.ndarray
    sample_time: float
    synthetic: str | None = None

    def __post_init__(self) -> None:
        u, y = columns(self.u, "inputs", "u"), columns(self.y, "outputs", "y")
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "y", y)
        if len(u) != len(y):
            raise ArgumentError(
                f"{len(u)} samples of the inputs and {len(y)} of the outputs; give one each per sample", "y"
            )
        check_sample_time(self.sample_time)

    def __len__(self) -> int:
        return len(self.y)

    @property
    def time(self) -> np.ndarray:
        """Times of the samples (N,) [s], from 0."""
        return self.sample_time * np.arange(len(self.y))

    def rows(self, start: int, stop: int) -> Record:
        """The samples from `start` up to `stop`, as a record of their own."""
        return Record(self.u[start:stop], self.y[start:stop], self.sample_time, self.synthetic)


def columns(values: ArrayLike, name: str, argument: str = "") -> np.ndarray:
    """Values (N,) or (N, k) as finite floats (N, k). Raises ArgumentError."""
    with naming(argument, TypeError, ValueError):
        array = np.asarray(values, float)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] == 0:
        raise ArgumentError(
            f"the {name} have the shape {array.shape}; expected one row per sample and some columns", argument
        )
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        row, column = bad[0]
        raise ArgumentError(
            f"sample {row} of column {column} of the {name} is {array[row, column]}; expected finite numbers, so cut "
            "the recording there",
            argument,
        )
    return array


def check_sample_time(sample_time: float) -> None:
    """Raises ArgumentError unless it is a positive number of seconds."""
    agree(sample_time, Annotated[float, Within(above=0.0)], "sample_time")
