"""Columns that may be read otherwise: exchanged, reversed, in another unit, or one a multiple of another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import ArrayLike

from ...inference.chance import f_chance
from ...inference.held_out import chance_ratio
from ...inference.residuals import shown_p
from ...results.suspicion import Suspicion

LEAST, MOST = 0.5, 2.0  # gains that still count as 1: models and lags are not told by this test, signs and units are
STRETCHES = 16  # of rows, whose sums are tested, each with the same part of the motion
FEWEST = 8  # stretches: where the motion lies in fewer rows, nothing is tested


def gain_off(
    measured: ArrayLike, expected: ArrayLike, by: ArrayLike, what: str, of: str, remedy: str, *, name: str = "gain"
) -> Suspicion:
    """Whether `measured` (n,) is `expected` (n,) times a number below LEAST or above MOST.

    Both may be noisy. `by` (n,) moves with what they should have in common and holds the noise of neither, such as a
    model's answer to the reference: an instrumental variable, so that the gain has no bias by noise. The sums of `by`
    times (measured - bound expected) over stretches of rows, each with the same sum of squares of `by`, have one sign
    where the gain lies beyond that bound; Student's t of these sums bears noise that is coloured within a stretch.
    p is NaN where too little moves to be tested. The evidence reads "`what` is -1 times `of`".

    >>> from gtmodel.measurements.inspection.misread_columns import gain_off
    >>> a = np.sin(0.1 * np.arange(1000))
    >>> felt = a + 0.1 * np.random.default_rng(1).normal(size=1000)
    >>> [bool(gain_off(sign * felt, a, a, "the reading", "the model's", "turn it").p < 1e-9) for sign in (1, -1)]
    [False, True]
    """
    y, x, z = (rows - rows.mean() for rows in (np.asarray(given, float) for given in (measured, expected, by)))
    common = float(z @ x)
    moved = np.cumsum(z**2)
    ends = np.unique(np.searchsorted(moved, moved[-1] * np.arange(1, STRETCHES) / STRETCHES))
    if len(ends) + 1 < FEWEST or common == 0.0:
        return Suspicion(name, f"the gain of {what} on {of}: too little is left to test", np.nan, remedy)
    z = np.sign(common) * z
    gain = float(z @ y) / abs(common)
    of_y, of_x = (np.add.reduceat(z * rows, np.concatenate([[0], ends])) for rows in (y, x))
    p = min(1.0, 2 * min(_below(of_y - LEAST * of_x), _below(MOST * of_x - of_y)))
    return Suspicion(name, f"{what} is {gain:.3g} times {of} ({shown_p(p)})", p, remedy)


def _below(sums: np.ndarray) -> float:
    """Probability that independent sums with mean zero or more have one so far below."""
    from scipy import special  # here: keys of kinds import what judges a log

    error = float(np.std(sums, ddof=1)) / np.sqrt(len(sums))
    t = float(np.mean(sums)) / error if error > 0 else np.sign(np.mean(sums)) * np.inf
    return float(special.stdtr(len(sums) - 1, t))


NEARER = 1.5  # another reading leaves so many times less, or it is not believed: errors of a model are not told by it
AXES = "xyz"
THOUSANDS = ((1e-3, "large", "divided", "in millimetres"), (1e3, "small", "multiplied", "in metres"))


@dataclass(frozen=True)
class OtherReading:
    """Columns of a signal in another order, each times a factor: (n, k) in, (n, k) out.

    name: of the suspicion. looks: what the columns look like. when: read how, in words, such as "when read as b, a".
    """

    name: str
    looks: str
    when: str
    order: tuple[int, ...] = ()
    factors: tuple[float, ...] = ()
    signal: str = ""

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        return rows[:, list(self.order)] * self.factors


def in_order(names: Sequence[str], order: Sequence[int], signal: str = "") -> OtherReading:
    """Column `order[k]` in place of the k-th."""
    changed = [k for k, j in enumerate(order) if j != k]
    looks = f"the columns {', '.join(names[k] for k in changed)} look exchanged"
    when = f"when read as {', '.join(names[order[k]] for k in changed)}"
    return OtherReading("exchanged_columns", looks, when, tuple(order), (1.0,) * len(names), signal)


def exchanges(names: Sequence[str], groups: Iterable[Sequence[int]] = ()) -> list[OtherReading]:
    """All orders of groups of three columns and less, single exchanges within larger ones; one group if left out.

    >>> [r.when for r in exchanges(["a", "b", "c", "d"], [[0, 1], [2, 3]])]
    ['when read as b, a', 'when read as d, c']
    """
    every = list(range(len(names)))
    readings = []
    for group in groups or [every]:
        swaps = [{a: b, b: a} for a, b in combinations(group, 2)]
        if len(group) <= 3:
            swaps = [dict(zip(group, p, strict=True)) for p in permutations(group)][1:]
        readings += [in_order(names, [swap.get(k, k) for k in every]) for swap in swaps]
    return readings


def reversals(names: Sequence[str], groups: Iterable[Sequence[int]] = (), signal: str = "") -> list[OtherReading]:
    """Columns that count the other way: single ones, and groups of them."""
    every = tuple(range(len(names)))
    readings = []
    for turned in dict.fromkeys([*((k,) for k in every), *map(tuple, groups)]):
        factors = tuple(-1.0 if k in turned else 1.0 for k in every)
        which = ", ".join(names[k] for k in turned)
        looks = f"the columns {which} look reversed" if len(turned) > 1 else f"the column {which} looks reversed"
        when = "with the other sign; is a scale -1?"
        readings.append(OtherReading("exchanged_columns", looks, when, every, factors, signal))
    return readings


def axes(signal: str, count: int) -> list[OtherReading]:
    """Axes of a position in another order or reversed, also as they are given."""
    readings = []
    for order, signs in product(permutations(range(count)), product((1.0, -1.0), repeat=count)):
        read = ", ".join(("-" if s < 0 else "") + AXES[k] for k, s in zip(order, signs, strict=True))
        when = f"when ({read}) is read as ({', '.join(AXES[:count])})"
        if np.linalg.det(np.eye(count)[list(order)]) * np.prod(signs) < 0:
            when += "; as given they are left-handed"
        readings.append(
            OtherReading("swapped_axes", f"the axes of '{signal}' look swapped", when, order, signs, signal)
        )
    return readings


def mirrored(signal: str, count: int) -> OtherReading:
    """What no turn makes of a position in an unknown frame: the other handedness."""
    when = "when mirrored; an axis is reversed or two are exchanged"
    factors = (*(1.0,) * (count - 1), -1.0)
    return OtherReading("swapped_axes", f"'{signal}' is left-handed", when, tuple(range(count)), factors, signal)


def thousands(signal: str, count: int) -> list[OtherReading]:
    """Lengths in another unit."""
    return [
        OtherReading("unit", f"'{signal}' looks 1000 times too {size}",
                f"when it is {done} by 1000; the column is probably {unit}", tuple(range(count)), (factor,) * count,
                signal)
        for factor, size, done, unit in THOUSANDS
    ]  # fmt: skip


def scalar_last(signal: str) -> OtherReading:
    """A quaternion whose scalar stands in its last column."""
    looks = f"'{signal}' looks written with its scalar last"
    when = "when its last column is read as the first; name the columns scalar first"
    return OtherReading("scalar_last", looks, when, (3, 0, 1, 2), (1.0,) * 4, signal)


@dataclass(frozen=True)
class Compared:
    """Columns as given beside the best other `reading`.

    given, left: what both leave, rms. bound: of given over left, beyond which the columns are not believed as they are
    given. p: how often the best of so many readings is so much better by chance; 1 where no chance is needed.
    """

    reading: OtherReading
    given: float
    left: float
    bound: float
    p: float

    @property
    def ratio(self) -> float:
        """What is left as given over that of the other reading."""
        return self.given / self.left

    @property
    def passed(self) -> bool:
        """Whether the columns are believed as they are given."""
        return not self.ratio > self.bound

    @property
    def decisive(self) -> bool:
        """Whether another reading would have been seen."""
        return self.left > self.bound * self.given

    def suspicion(self, said: str, left: str) -> Suspicion:
        """said: what is left as given, in words, and what then follows the number `left` of the other reading."""
        return Suspicion(self.reading.name, f"{self.reading.looks}: {said} {left} {self.reading.when}", self.p)


def compared(
    given: float, readings: Sequence[OtherReading], left: Callable[[OtherReading], float], degrees_of_freedom: float,
    *, nearer: float = NEARER, tests: int = 0, least: float = 0.0,
) -> Compared:  # fmt: skip
    """The best of several readings by what each leaves, rms, beside columns as given: it is to be believed where it
    leaves `nearer` times less or more, and less than chance explains in any of so many, by an F test.

    degrees_of_freedom: of what either leaves; with none nothing can be judged. tests: how many more readings were
    looked at. least: what is rounding.

    >>> trials = exchanges(["a", "b"])
    >>> [compared(5.0, trials, lambda r: 1.0, n, nearer=3.0).passed for n in (60, 3)]
    [False, True]
    """
    rms = [left(r) for r in readings]
    best, small, n = int(np.argmin(rms)), max(least, np.finfo(float).tiny), degrees_of_freedom
    given, other, tests = max(given, small), max(rms[best], small), len(readings) + tests
    p = min(1.0, tests * float(f_chance(min(given / other, 1e150) ** 2, n, n))) if n > 0 else np.nan
    p = 1.0 if n > 0 and not given > nearer * other else p
    return Compared(readings[best], given, other, max(nearer, chance_ratio(n, n, tests=tests)), p)
