"""Tests for misread columns: exchanged, reversed, in another unit, or with a wrong gain."""

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

LEAST, MOST = (
    0.5,
    2.0,
)  # gains in this range count as 1: errors of models and lags lie inside, of signs and units outside
STRETCHES = 16  # number of stretches with equal shares of the motion, whose sums are tested
FEWEST = 8  # least number of stretches for a test


def gain_off(
    measured: ArrayLike, expected: ArrayLike, by: ArrayLike, what: str, of: str, remedy: str, *, name: str = "gain"
) -> Suspicion:
    """Test whether `measured` (n,) is `expected` (n,) times a gain below LEAST or above MOST.

    Both may be noisy. `by` (n,) is an instrumental variable, so that noise does not bias the gain: it is correlated
    with the common motion and independent of both noises, such as the response of a model to the reference. The rows
    are split into stretches with equal sums of squares of `by`. If the gain lies beyond a bound, the sums of `by`
    (measured - bound expected) over the stretches have one sign; Student's t of these sums tolerates noise that is
    coloured within a stretch. p is NaN if too little moves. The evidence reads "`what` is -1 times `of`".

    >>> from gtmodel.measurements.inspection.misread_columns import gain_off
    >>> a = np.sin(0.1 * np.arange(1000))
    >>> felt = a + 0.1 * np.random.default_rng(1).normal(size=1000)
    >>> [bool(gain_off(sign * felt, a, a, "the reading", "the model's", "turn it").p < 1e-9) for sign in (1, -1)]
    [False, True]
    """
    y, x, z = (rows - rows.mean() for rows in (np.asarray(a, float) for a in (measured, expected, by)))
    common = float(z @ x)
    moved = np.cumsum(z**2)
    ends = np.unique(np.searchsorted(moved, moved[-1] * np.arange(1, STRETCHES) / STRETCHES))
    if len(ends) + 1 < FEWEST or common == 0.0:
        return Suspicion(name, f"the gain of {what} on {of}: too little motion to test", np.nan, remedy)
    z = np.sign(common) * z
    gain = float(z @ y) / abs(common)
    sums_y, sums_x = (np.add.reduceat(z * rows, np.concatenate([[0], ends])) for rows in (y, x))
    p = min(1.0, 2 * min(_below(sums_y - LEAST * sums_x), _below(MOST * sums_x - sums_y)))
    return Suspicion(name, f"{what} is {gain:.3g} times {of} ({shown_p(p)})", p, remedy)


def _below(sums: np.ndarray) -> float:
    """Return the p-value of a mean of independent sums below zero, for a true mean of zero or more (Student's t)."""
    from scipy import special  # imported here, to keep the import of the kinds fast

    error = float(np.std(sums, ddof=1)) / np.sqrt(len(sums))
    t = float(np.mean(sums)) / error if error > 0 else np.sign(np.mean(sums)) * np.inf
    return float(special.stdtr(len(sums) - 1, t))


NEARER = 1.5  # least ratio of residuals for another reading to count; errors of a model cause smaller ones
AXES = "xyz"
THOUSANDS = ((1e-3, "large", "divided", "in millimetres"), (1e3, "small", "multiplied", "in metres"))


@dataclass(frozen=True)
class OtherReading:
    """Columns of a signal in another order, each times a factor: (n, k) in, (n, k) out.

    name: name of the suspicion. looks: the apparent fault, such as "the columns a, b look exchanged". when: the other
    reading in words, such as "when read as b, a".
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
    """Return the reading with column `order[k]` in place of column k."""
    changed = [k for k, j in enumerate(order) if j != k]
    looks = f"the columns {', '.join(names[k] for k in changed)} look exchanged"
    when = f"when read as {', '.join(names[order[k]] for k in changed)}"
    return OtherReading("exchanged_columns", looks, when, tuple(order), (1.0,) * len(names), signal)


def exchanges(names: Sequence[str], groups: Iterable[Sequence[int]] = ()) -> list[OtherReading]:
    """Return all orders of groups of up to three columns, and all swaps in larger groups; default: a single group.

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
    """Return the readings with reversed signs of single columns and of groups of columns."""
    every = tuple(range(len(names)))
    readings = []
    for columns in dict.fromkeys([*((k,) for k in every), *map(tuple, groups)]):
        factors = tuple(-1.0 if k in columns else 1.0 for k in every)
        which = ", ".join(names[k] for k in columns)
        looks = f"the columns {which} look reversed" if len(columns) > 1 else f"the column {which} looks reversed"
        when = "with the other sign; is a scale -1?"
        readings.append(OtherReading("exchanged_columns", looks, when, every, factors, signal))
    return readings


def axes(signal: str, count: int) -> list[OtherReading]:
    """Return all orders and signs of the axes of a position, the unchanged one included."""
    readings = []
    for order, signs in product(permutations(range(count)), product((1.0, -1.0), repeat=count)):
        read = ", ".join(("-" if s < 0 else "") + AXES[k] for k, s in zip(order, signs, strict=True))
        when = f"when ({read}) is read as ({', '.join(AXES[:count])})"
        if np.linalg.det(np.eye(count)[list(order)]) * np.prod(signs) < 0:
            when += "; the columns are left-handed"
        readings.append(
            OtherReading("swapped_axes", f"the axes of '{signal}' look swapped", when, order, signs, signal)
        )
    return readings


def mirrored(signal: str, count: int) -> OtherReading:
    """Return the mirror image of a position in an unknown frame, which no rotation can produce."""
    when = "when mirrored; an axis is reversed or two are exchanged"
    factors = (*(1.0,) * (count - 1), -1.0)
    return OtherReading("swapped_axes", f"'{signal}' is left-handed", when, tuple(range(count)), factors, signal)


def thousands(signal: str, count: int) -> list[OtherReading]:
    """Return the readings of lengths in another unit."""
    return [
        OtherReading("unit", f"'{signal}' looks 1000 times too {size}",
                f"when it is {change} by 1000; the column is probably {unit}", tuple(range(count)), (factor,) * count,
                signal)
        for factor, size, change, unit in THOUSANDS
    ]  # fmt: skip


def scalar_last(signal: str) -> OtherReading:
    """Return the reading of a quaternion with the scalar in the last column."""
    looks = f"'{signal}' looks written with its scalar last"
    when = "when its last column is read as the first; name the columns scalar first"
    return OtherReading("scalar_last", looks, when, (3, 0, 1, 2), (1.0,) * 4, signal)


@dataclass(frozen=True)
class Compared:
    """Comparison of the columns as declared with the best other `reading`.

    given, left: RMS residuals of the columns as declared and of the other reading. bound: bound of their ratio, beyond
    which the declared columns are rejected. p: probability that the best of all readings is so much better by chance; 1
    if the improvement is too small to matter.
    """

    reading: OtherReading
    given: float
    left: float
    bound: float
    p: float

    @property
    def ratio(self) -> float:
        """Ratio of the residuals: columns as declared over the other reading."""
        return self.given / self.left

    @property
    def passed(self) -> bool:
        """Whether the declared columns are accepted."""
        return not self.ratio > self.bound

    @property
    def decisive(self) -> bool:
        """Whether the test could have detected misread columns: the other reading is worse by more than the bound."""
        return self.left > self.bound * self.given

    def suspicion(self, said: str, left: str) -> Suspicion:
        """Return the suspicion; said: the residual as declared, in words; left: the residual of the other reading."""
        return Suspicion(self.reading.name, f"{self.reading.looks}: {said} {left} {self.reading.when}", self.p)


def compared(
    given: float, readings: Sequence[OtherReading], left: Callable[[OtherReading], float], degrees_of_freedom: float,
    *, nearer: float = NEARER, tests: int = 0, least: float = 0.0,
) -> Compared:  # fmt: skip
    """Compare the residual of the declared columns, `given` (RMS), with the best of several other readings.

    The other reading counts if its residual is smaller by the factor `nearer` or more, and significantly smaller in an
    F test that allows for the number of readings. left: returns the RMS residual of a reading. degrees_of_freedom: of
    the residuals; with 0 nothing can be judged. tests: number of further readings examined. least: RMS of rounding.

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
