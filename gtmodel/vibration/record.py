"""One evenly sampled recording of inputs and outputs, checked once for all methods of this package; block Hankel
matrices with their LQ factor, the basis of all subspace methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..results.agreement import Within, agree
from ..results.refusal import ArgumentError, naming


class FitStopped(Exception):
    """A fit was interrupted before it converged; there is no model."""


def go_on(interrupted: Callable[[], bool]) -> None:
    """Raises FitStopped if a stop is requested."""
    if interrupted():
        raise FitStopped("stopped before the fit converged")


@dataclass(frozen=True, eq=False)
class Record:
    """Inputs u (N, m) and outputs y (N, p), one row per sample, every `sample_time` [s]; units are the caller's.

    The input is held between samples (zero-order hold); y[k] is read before u[k] acts. `synthetic`: seed and noise of
    synthetic data, None for measured data. One-dimensional arrays are one column. Raises ArgumentError.

    >>> record = gt.vibration.Record(u=np.zeros(100), y=np.zeros((100, 2)), sample_time=0.004)
    >>> record.y.shape, round(float(record.time[-1]), 3)  # s
    ((100, 2), 0.396)
    >>> gt.vibration.Record(u=np.zeros(99), y=np.zeros(100), sample_time=0.004)
    Traceback (most recent call last):
    gtmodel...ArgumentError: y: 99 samples of the inputs and 100 of the outputs; expected equal numbers
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
                f"{len(u)} samples of the inputs and {len(y)} of the outputs; expected equal numbers", "y"
            )
        check_sample_time(self.sample_time)

    def __len__(self) -> int:
        return len(self.y)

    @property
    def time(self) -> np.ndarray:
        """Times of the samples (N,) [s], from 0."""
        return self.sample_time * np.arange(len(self.y))

    def rows(self, start: int, stop: int) -> Record:
        """The samples from `start` up to `stop`, as a record."""
        return Record(self.u[start:stop], self.y[start:stop], self.sample_time, self.synthetic)


def columns(values: ArrayLike, name: str, argument: str = "") -> np.ndarray:
    """Values (N,) or (N, k) as finite floats (N, k). Raises ArgumentError."""
    with naming(argument, TypeError, ValueError):
        array = np.asarray(values, float)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] == 0:
        raise ArgumentError(
            f"the {name} have the shape {array.shape}; expected one row per sample and at least one column", argument
        )
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        row, column = bad[0]
        raise ArgumentError(
            f"sample {row} of column {column} of the {name} is {array[row, column]}; expected finite numbers: cut the "
            "recording there",
            argument,
        )
    return array


def check_sample_time(sample_time: float) -> None:
    """Raises ArgumentError unless the sample time is positive."""
    agree(sample_time, Annotated[float, Within(above=0.0)], "sample_time")


EXCITED = 1e-9  # relative: smaller singular values of the inputs' Hankel matrix mean too little excitation


class Projection(NamedTuple):
    """The LQ factor of [U_f; U_p; Y_p; Y_f] and the block sizes: `blocks` rows of m inputs and p outputs each.

    L (rows, rows) lower triangular, divided by the square root of the number of columns; `inputs`, `past` and `future`
    slice it.
    """

    L: np.ndarray
    blocks: int
    m: int
    p: int

    @property
    def inputs(self) -> slice:
        return slice(0, self.m * self.blocks)

    @property
    def past(self) -> slice:
        return slice(self.m * self.blocks, (2 * self.m + self.p) * self.blocks)

    @property
    def future(self) -> slice:
        return slice((2 * self.m + self.p) * self.blocks, 2 * (self.m + self.p) * self.blocks)


def block_hankel(values: np.ndarray, blocks: int) -> np.ndarray:
    """(blocks * k, N - blocks + 1) of values (N, k): row block b has the samples from b on."""
    width = len(values) - blocks + 1
    return np.vstack([values[b : b + width].T for b in range(blocks)])


def project(record: Record, blocks: int) -> Projection:
    """LQ factor of past and future with `blocks` block rows each; every row has zero mean.

    Constant offsets of an input or an output, such as a rest position, thus have no effect. Raises ArgumentError for
    too few samples, and for inputs that do not excite so many rows.
    """
    m, p = record.u.shape[1], record.y.shape[1]
    rows = 2 * blocks * (m + p)
    wide = len(record) - 2 * blocks + 1
    if wide < rows:
        raise ArgumentError(
            f"{len(record)} samples are too few for {blocks} block rows of {m} inputs and {p} outputs; expected at "
            f"least {rows + 2 * blocks - 1}: record longer, or use fewer block rows (a lower order)"
        )
    U, Y = (x - x.mean(axis=1, keepdims=True) for x in (block_hankel(v, 2 * blocks) for v in (record.u, record.y)))
    size = np.linalg.svd(np.linalg.qr(U.T, mode="r"), compute_uv=False)
    if size[0] == 0 or size[-1] < EXCITED * size[0]:
        rank = int(np.sum(size > EXCITED * max(size[0], 1e-300)))
        raise ArgumentError(
            f"the inputs excite {rank} of the {2 * blocks * m} directions that {blocks} block rows need; expected a "
            "rich signal such as a pseudo-random binary one; excite again or use fewer block rows"
        )
    mi, pi = m * blocks, p * blocks
    stacked = np.vstack([U[mi:], U[:mi], Y[:pi], Y[pi:]])
    L = np.asarray(np.linalg.qr(stacked.T, mode="r")).T / np.sqrt(wide)
    return Projection(L, blocks, m, p)
