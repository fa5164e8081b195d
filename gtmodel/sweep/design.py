"""The rows of a sweep: all combinations of lists, or samples of distributions; row k needs only its number."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
import scipy

from ..results.options import Options, Within
from ..results.refusal import ArgumentError

Method = Literal["random", "sobol", "lhs"]


@dataclass(frozen=True, kw_only=False)
class Uniform(Options):
    """Uniform between `low` and `high`.

    >>> gt.sweep.Uniform(300.0, 1000.0).at(0.5)
    650.0
    """

    low: Annotated[float, "lower end"]
    high: Annotated[float, "upper end"]

    def at(self, u: float) -> float:
        """Return the quantile of u in (0, 1)."""
        return self.low + u * (self.high - self.low)


@dataclass(frozen=True, kw_only=False)
class LogUniform(Options):
    """Uniform in the logarithm, between `low` and `high`.

    >>> round(gt.sweep.LogUniform(1.0, 100.0).at(0.5), 12)
    10.0
    """

    low: Annotated[float, Within(above=0.0), "lower end"]
    high: Annotated[float, Within(above=0.0), "upper end"]

    def at(self, u: float) -> float:
        """Return the quantile of u in (0, 1)."""
        return math.exp(math.log(self.low) + u * (math.log(self.high) - math.log(self.low)))


@dataclass(frozen=True, kw_only=False)
class Normal(Options):
    """Normal with `mean` and standard deviation `std`.

    >>> gt.sweep.Normal(5.0, 2.0).at(0.5)
    5.0
    """

    mean: Annotated[float, "mean"]
    std: Annotated[float, Within(least=0.0), "standard deviation"]

    def at(self, u: float) -> float:
        """Return the quantile of u in (0, 1)."""
        return self.mean + self.std * float(scipy.special.ndtri(u))


@dataclass(frozen=True, kw_only=False)
class OneOf(Options):
    """One of `values`, with equal probability.

    >>> gt.sweep.OneOf(("l1_tape", "l1_tracker")).at(0.7)
    'l1_tracker'
    """

    values: Annotated[tuple[Any, ...], "values to choose from"]

    def at(self, u: float) -> Any:
        """Return the quantile of u in (0, 1)."""
        return self.values[min(int(u * len(self.values)), len(self.values) - 1)]


Distribution = Uniform | LogUniform | Normal | OneOf


@dataclass(frozen=True)
class Design:
    """The rows of a design: `len(rows)` of them; `rows[k]` is a dictionary of values by key."""

    factors: tuple[tuple[Mapping[str, Any], ...], ...]
    distributions: Mapping[str, Distribution]
    samples: int
    seed: int
    method: Method

    def __len__(self) -> int:
        return math.prod(len(factor) for factor in self.factors) * (self.samples if self.distributions else 1)

    def __getitem__(self, k: int) -> dict[str, Any]:
        if not 0 <= k < len(self):
            raise IndexError(k)
        row: dict[str, Any] = {}
        number, sizes = k, [len(factor) for factor in self.factors]
        sample, number = divmod(number, math.prod(sizes))
        parts = []
        for factor in reversed(self.factors):  # the last key varies fastest
            number, index = divmod(number, len(factor))
            parts.append(factor[index])
        for part in reversed(parts):
            row |= part
        if self.distributions:
            points = self._point(sample)
            row |= {key: d.at(float(u)) for (key, d), u in zip(self.distributions.items(), points, strict=True)}
        return row

    @property
    def keys(self) -> tuple[str, ...]:
        """The varied keys, in order."""
        return (*(key for factor in self.factors for key in factor[0]), *self.distributions)

    def _point(self, sample: int) -> np.ndarray:
        """A point of the open unit cube."""
        if self.method != "random":
            return self._cube[sample]
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(sample,)))
        return np.clip(rng.random(len(self.distributions)), 2.0**-54, None)

    @cached_property
    def _cube(self) -> np.ndarray:
        d = len(self.distributions)
        qmc = scipy.stats.qmc  # by attribute: scipy.stats takes long to import
        if self.method == "lhs":
            points = qmc.LatinHypercube(d, rng=np.random.default_rng(self.seed)).random(self.samples)
        else:
            sobol = qmc.Sobol(d, scramble=True, rng=np.random.default_rng(self.seed))
            points = sobol.random_base2(max(0, math.ceil(math.log2(self.samples))))[: self.samples]
        return np.clip(points, 2.0**-54, 1 - 2.0**-53)


def design(
    vary: Mapping[str, Any],
    *,
    rows: Sequence[Mapping[str, Any]] = (),
    samples: int = 0,
    seed: int = 0,
    method: Method = "random",
) -> Design:
    """Return the rows of a design.

    Args:
        vary: key -> list of values: all combinations, the last key fastest. A key may also have a distribution: then
            `samples` rows are drawn, and combined with the lists.
        rows: given rows, dictionaries with the same keys; combined with `vary`.
        samples: number of samples. seed: of the samples.
        method: independent samples "random", a scrambled "sobol" sequence, or a Latin hypercube "lhs".

    Raises ArgumentError for an empty design, a key that is varied twice, and for distributions without `samples` or the
    reverse.

    >>> rows = gt.sweep.design({"force": [500, 700], "robot": ["l1_tape", "l1_tracker"]})
    >>> len(rows), rows[1]
    (4, {'force': 500, 'robot': 'l1_tracker'})
    >>> len(gt.sweep.design({"force": gt.sweep.Uniform(300.0, 1000.0)}, samples=100, seed=1))
    100
    """
    factors, distributions = list[tuple[Mapping[str, Any], ...]](), {}
    if rows:
        if any(row.keys() != rows[0].keys() or not row for row in rows):
            raise ArgumentError("expected the same keys in all rows", "rows")
        factors.append(tuple(dict(row) for row in rows))
    for key, values in vary.items():
        if rows and key in rows[0]:
            raise ArgumentError(f"'{key}' is varied twice, by a list and by rows; leave one of them out", "vary")
        if isinstance(values, (Uniform, LogUniform, Normal, OneOf)):
            distributions[key] = values
            continue
        if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
            raise ArgumentError(f"expected a list of values or a distribution for '{key}'; found {values!r}", "vary")
        listed = [value.item() if isinstance(value, np.generic) else value for value in values]
        if not listed:
            raise ArgumentError(f"expected at least one value for '{key}'; found none", "vary")
        factors.append(tuple({key: value} for value in listed))
    if not (factors or distributions):
        raise ArgumentError("expected at least one key to vary; found none", "vary")
    return _checked(Design(tuple(factors), distributions, samples, seed, method))


def _checked(rows: Design) -> Design:
    if rows.method not in ("random", "sobol", "lhs"):
        raise ArgumentError(f"expected 'random', 'sobol' or 'lhs'; found {rows.method!r}", "method")
    if rows.distributions and rows.samples < 1:
        names = ", ".join(rows.distributions)
        raise ArgumentError(f"expected the number of samples for the distributions of {names}; found none", "samples")
    if rows.samples and not rows.distributions:
        raise ArgumentError("expected a key with a distribution, such as Uniform; found only lists", "samples")
    return rows
