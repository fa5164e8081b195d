"""Identifiability: which parameters a set of measurements determines and how well, dependent columns, observability
indices O1 to O5."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results.refusal import ArgumentError
from .covariance import listed, scales, spectrum

# columns whose remaining lengths differ by a smaller share tie; the name decides
TIE = 1e-6
# coefficients below this share of a column's largest are round-off
NOTHING = 1e-8
LISTED = 0.01  # of the largest coefficient: smaller ones are not named in a sentence


@dataclass(frozen=True, eq=False)
class Dependencies:
    """Linear dependencies between the columns of a Jacobian.

    `independent` are the names in the order of the pivots. `coefficients` expresses the column of each other name d in
    terms of these: column(d) = sum coefficients[d][i] * column(i), in the parameters' own units. The data determine the
    base parameters p_i + sum_d coefficients[d][i] * p_d and nothing else.
    """

    independent: tuple[str, ...]
    coefficients: dict[str, dict[str, float]]

    def base(self, name: str) -> dict[str, float]:
        """Return the base parameter of an independent name: name -> factor. Raises ArgumentError for another name."""
        if name not in self.independent:
            raise ArgumentError(
                f"'{name}' depends on others; the independent parameters are {', '.join(self.independent)}"
            )
        more = {d: c[name] for d, c in self.coefficients.items() if name in c}
        return {name: 1.0, **more}

    @property
    def notes(self) -> list[str]:
        """One sentence per dependent name: the parameters on which it depends."""
        return [
            f"{d} moves with {listed(_largest(c))}: measure {d}, or fix one of them"
            if c
            else f"no measurement depends on {d}: fix it"
            for d, c in self.coefficients.items()
        ]


def _largest(c: dict[str, float]) -> tuple[str, ...]:
    most = max(abs(v) for v in c.values())
    return tuple(n for n, v in c.items() if abs(v) > LISTED * most)


def dependencies(
    J: np.ndarray,
    names: Sequence[str],
    *,
    scale: np.ndarray | None = None,
    tolerance: float = 1e-9,
    keep: Sequence[str] = (),
) -> Dependencies:
    """Find the dependent columns of the Jacobian J (rows, n), by QR with pivots.

    Rows are whitened; columns are compared in units of `scale` (n,), the expected sizes of the parameters.

    The first pivots are the names in `keep`, in that order, if they are independent; then always the column with the
    longest remainder. Lengths within 1e-6 tie, and the name that sorts first wins. A column is dependent if its
    remainder is below `tolerance` of the longest column. The result does not depend on the order of the columns.

    >>> a, b = np.array([1.0, 0.0, 1.0]), np.array([0.0, 1.0, 2.0])
    >>> J = np.column_stack([a, b, a + b])
    >>> d = gt.inference.dependencies(J, ["a", "b", "sum"], keep=["a", "b"])
    >>> {name: round(x, 6) for name, x in d.coefficients["sum"].items()}
    {'a': 1.0, 'b': 1.0}
    >>> d.notes
    ['sum moves with a and b: measure sum, or fix one of them']
    """
    names = tuple(names)
    by_name = sorted(range(len(names)), key=lambda k: names[k])
    size = np.ones(len(names)) if scale is None else np.abs(np.asarray(scale, float))
    columns = np.asarray(J, float) * size
    # QR of the columns sorted by name does not depend on their order
    R = columns[:, by_name]
    if len(R) > len(names):
        R = np.asarray(np.linalg.qr(R, mode="r"))
    place = {names[k]: i for i, k in enumerate(by_name)}
    rest, longest = R.copy(), float(np.linalg.norm(R, axis=0).max(initial=0.0))
    chosen: list[int] = []
    first = [place[n] for n in keep if n in place]
    while len(chosen) < len(names):
        lengths = np.linalg.norm(rest, axis=0)
        lengths[chosen] = -1.0
        open_ = [k for k in first if k not in chosen and lengths[k] > tolerance * longest]
        if open_:
            k = open_[0]
        elif lengths.max() <= tolerance * longest:
            break
        else:
            k = int(np.flatnonzero(lengths >= (1 - TIE) * lengths.max())[0])
        chosen.append(k)
        q = rest[:, k] / lengths[k]
        rest -= np.outer(q, q @ rest)
        rest -= np.outer(q, q @ rest)  # again, for orthogonality to round-off
    inverse = np.linalg.pinv(R[:, chosen]) if chosen else np.zeros((0, len(R)))
    sorted_names = [names[k] for k in by_name]
    units = size[by_name]
    coefficients: dict[str, dict[str, float]] = {}
    for d in range(len(names)):
        if d not in chosen:
            c = inverse @ R[:, d]
            least = NOTHING * np.abs(c).max(initial=0.0)
            coefficients[sorted_names[d]] = {
                sorted_names[i]: float(v * units[i] / units[d])
                for i, v in zip(chosen, c, strict=True)
                if abs(v) > max(least, tolerance)
            } if np.linalg.norm(R[:, d]) > tolerance * longest else {}  # fmt: skip
    return Dependencies(tuple(sorted_names[i] for i in chosen), coefficients)


@dataclass(frozen=True)
class Observability:
    """Observability indices of the scaled Jacobian with singular values s1 >= .. >= sr and n poses; larger is better.

    o1 = (s1 .. sr)^(1/r) / sqrt(n), o2 = sr / s1, o3 = sr, o4 = sr^2 / s1 (noise amplification; eq. (5.14) of Dressler
    2012 is misprinted), o5 = 1 / sum(1 / si). scaling: the units of columns and rows, in words.
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float
    rank: int
    poses: int
    scaling: str

    def __str__(self) -> str:
        indices = ", ".join(f"O{k} = {getattr(self, f'o{k}'):.4g}" for k in range(1, 6))
        return f"{indices} (r = {self.rank}, {self.poses} poses, {self.scaling})"


def observability(singular: np.ndarray, rank: int, poses: int, scaling: str) -> Observability:
    """Compute the observability indices O1 to O5 from the first `rank` singular values, in descending order.

    `poses` is the number of measured poses; `scaling` describes the units of columns and rows. Raises ArgumentError for
    a rank or a number of poses below one, and if one of these singular values is zero.

    >>> indices = gt.inference.observability(np.array([4.0, 2.0, 1.0]), 3, poses=10, scaling="as given")
    >>> round(indices.o1, 4), indices.o2, indices.o3, indices.o4
    (0.6325, 0.25, 1.0, 0.25)
    """
    s = np.asarray(singular, float)[:rank]
    if rank < 1 or poses < 1 or not np.all(s > 0):
        raise ArgumentError(f"expected a rank and poses of at least one; found {rank} and {poses}")
    o1 = float(np.exp(np.mean(np.log(s))) / np.sqrt(poses))
    return Observability(
        o1, float(s[-1] / s[0]), float(s[-1]), float(s[-1] ** 2 / s[0]), float(1 / np.sum(1 / s)), rank, poses, scaling
    )


TOLERANCES = (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2)
# a direction whose standard deviation, in units of the scales, is larger is determined no better than it was known
NEAR = 1.0
SHOWN = 0.05  # of the largest entry of a direction: smaller ones are not named
CORRELATED = 0.95


@dataclass(frozen=True, eq=False)
class Direction:
    """A combination of parameters.

    weights: by name in their own units, largest first, one for the largest. singular: its singular value over the
    largest. std: standard deviation of the combination, in units of the scales.
    """

    weights: dict[str, float]
    singular: float
    std: float

    def __str__(self) -> str:
        return " ".join(f"{w:+.3g} {n}" for n, w in self.weights.items())


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Rank, null and near-null directions, dependencies, and a standard deviation per parameter.

    singular: singular values of the scaled, whitened Jacobian, largest first. rank: number of those above `tolerance`
    of the largest; ranks: the same for other tolerances. null: directions that the data do not determine; near: those
    that they determine no better than the scales. std (n,), covariance (n, n): for the stated noise, in the parameters'
    units; std is infinite for parameters in the null space. determined_by (n,): share of each parameter's direction in
    the identifiable space, 0..1. indices: observability indices.
    """

    names: tuple[str, ...]
    scale: np.ndarray
    singular: np.ndarray
    rank: int
    tolerance: float
    ranks: dict[float, int]
    null: tuple[Direction, ...]
    near: tuple[Direction, ...]
    dependencies: Dependencies
    std: np.ndarray
    covariance: np.ndarray
    determined_by: np.ndarray
    indices: Observability
    known_noise: bool

    @property
    def redundant(self) -> int:
        """Number of parameters, or combinations of them, that the measurements do not determine."""
        return len(self.names) - self.rank

    @property
    def determined(self) -> int:
        """Number of parameters, or combinations of them, that are determined better than they were known: the rank
        without the directions in `near`."""
        return self.rank - len(self.near)

    @property
    def counts(self) -> str:
        """Counts of all parameters in words: determined, no better than known, not at all."""
        n, others = len(self.names), []
        if self.near:
            others.append(f"{len(self.near)} no better than they were known")
        if self.redundant:
            others.append(f"{self.redundant} not at all")
        return ", ".join([f"{self.determined} of {n} parameters or combinations are determined", *others])

    @property
    def condition(self) -> float:
        """Largest over smallest singular value within the rank."""
        return float(self.singular[0] / self.singular[self.rank - 1])

    @property
    def correlation(self) -> np.ndarray:
        """Correlation coefficients (n, n) within the identifiable space."""
        std = np.sqrt(np.diag(self.covariance))
        std = np.where(std > 0, std, 1.0)
        return self.covariance / np.outer(std, std)

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs with a correlation above 0.95, the strongest first."""
        c = self.correlation
        pairs = [(a, b) for b in range(len(self.names)) for a in range(b) if abs(c[a, b]) > CORRELATED]
        pairs.sort(key=lambda p: (-round(abs(c[p]), 12), self.names[p[0]], self.names[p[1]]))
        return [(self.names[a], self.names[b], float(c[a, b])) for a, b in pairs]

    @property
    def notes(self) -> list[str]:
        """Sentences on the rank, the dependencies, and the badly determined directions."""
        lines = [f"{self.counts}; {self._rank_in_words()}", *self.dependencies.notes]
        for d in self.near:
            lines.append(
                f"{listed(tuple(d.weights))} are determined no better than they were known: their combination {d} has "
                f"a standard deviation of {d.std:.3g} expected sizes"
                if len(d.weights) > 1
                else f"{next(iter(d.weights))} is determined no better than it was known: its standard deviation is "
                f"{d.std:.3g} expected sizes"
            )
        return lines

    @property
    def brief_notes(self) -> list[str]:
        """`notes` with one sentence for all badly determined directions."""
        lines, first = self.notes[: 1 + len(self.dependencies.notes)], [next(iter(d.weights)) for d in self.near]
        if first:
            names = listed(tuple(dict.fromkeys(first)))
            lines.append(f"combinations led by {names} are determined no better than they were known")
        return lines

    def _rank_in_words(self) -> str:
        text = f"the rank is {self.rank}: singular values below {self.tolerance:.0e} of the largest count as zero"
        others = {t: r for t, r in self.ranks.items() if r != self.rank}
        nearest = [max((t for t in others if t < self.tolerance), default=None),
                   min((t for t in others if t > self.tolerance), default=None)]  # fmt: skip
        changes = [f"with {t:.0e} instead, it would be {others[t]}" for t in nearest if t is not None]
        return "; ".join([text, *(changes or ["any limit from 1e-12 to 1e-02 gives the same rank"])])

    def __str__(self) -> str:
        width = max(len(n) for n in self.names)
        rows = [
            f"{n:{width}s}  {s:10.3g}  {t:6.3f}"
            for n, s, t in zip(self.names, self.std, self.determined_by, strict=True)
        ]
        return "\n".join([*self.notes, str(self.indices), f"{'':{width}s}  {'std':>10s}  {'share':>6s}", *rows])


def identifiability(
    J: ArrayLike,
    names: Sequence[str],
    *,
    scale: ArrayLike | None = None,
    poses: int | None = None,
    known_noise: bool = True,
    tolerance: float = 1e-9,
    near: float = NEAR,
    keep: Sequence[str] = (),
) -> Identifiability:
    """Analyse which of the parameters `names` the measurements with the Jacobian J (rows, n) determine.

    Rows of J are whitened: divided by the standard deviation of the noise. Priors may be additional rows.

    `scale` (n,) is the expected size of each parameter's error, or its nominal value; ranks and indices refer to
    columns in these units (missing or zero: scaled to length one). `poses` is the number for the observability indices,
    by default the rows. `keep` names preferred independent parameters. With `known_noise` False, rows are in units of
    an unknown noise: `std` is then per unit of it, and `near` stays empty. `near` is the limit on the standard
    deviation of a direction, in units of the scales. The result does not depend on the order of the columns. Raises
    ArgumentError for a wrong shape, values that are not finite, or a Jacobian of zeros.

    >>> time = np.linspace(0.0, 1.0, 20)  # y = offset + drift * time + bias, noise 0.1
    >>> J = np.column_stack([np.ones(20), time, np.ones(20)]) / 0.1
    >>> i = gt.inference.identifiability(J, ["offset", "drift", "bias"])
    >>> i.rank, i.redundant, i.std.round(3)
    (2, 1, array([  inf, 0.074,   inf]))
    >>> str(i.null[0])
    '+1 bias -1 offset'
    """
    J, names = np.asarray(J, float), tuple(names)
    if J.ndim != 2 or J.shape[1] != len(names):
        raise ArgumentError(f"the derivatives have the shape {J.shape}; expected (rows, {len(names)})")
    if not np.all(np.isfinite(J)):
        raise ArgumentError(f"the derivatives of '{names[int(np.argwhere(~np.isfinite(J))[0, 1])]}' are not finite")
    # sorted by name, so that round-off does not depend on the order
    order = sorted(range(len(names)), key=lambda k: names[k])
    back = np.asarray(np.argsort(order))
    J = J[:, order]
    ordered = tuple(names[k] for k in order)
    stated = None if scale is None else np.asarray(scale, float).reshape(-1)
    if stated is not None and len(stated) == len(names):  # scales() refuses another length
        stated = stated[order]
    size = scales(stated, len(names), J)
    s = spectrum(J * size, tolerance)
    if s.rank == 0:
        raise ArgumentError("no measurement depends on any of the parameters")
    null, V = s.null, s.V
    moving = np.abs(null).max(axis=1, initial=0.0) > 1e-8
    cov = s.inverse * np.outer(size, size)
    std = np.sqrt(np.diag(cov))
    std[moving] = np.inf
    weak = [k for k in range(s.rank) if known_noise and 1 / s.singular[k] > near]
    scaling = "columns in expected sizes, rows in the noise" if scale is not None else "columns of equal length"
    return Identifiability(
        names, size[back], s.singular, s.rank, tolerance,
        {t: int(np.count_nonzero(s.singular > t * s.singular[0])) for t in TOLERANCES},
        tuple(_direction(null[:, k], ordered, size, 0.0, np.inf) for k in range(null.shape[1])),
        tuple(_direction(V[:, k], ordered, size, s.singular[k] / s.singular[0], 1 / s.singular[k]) for k in weak),
        dependencies(J, ordered, scale=size, tolerance=tolerance, keep=keep),
        std[back], cov[np.ix_(back, back)], 1 - np.sum(null**2, axis=1)[back],
        observability(s.singular, s.rank, poses or len(J), scaling), known_noise,
    )  # fmt: skip


def _direction(v: np.ndarray, names: tuple[str, ...], size: np.ndarray, singular: float, std: float) -> Direction:
    largest = int(np.argmax(np.round(np.abs(v), 9)))
    physical = v * size
    entries = [k for k in range(len(v)) if abs(v[k]) > SHOWN * abs(v[largest])]
    entries.sort(key=lambda k: (-round(abs(v[k] / v[largest]), 6), names[k]))
    return Direction({names[k]: float(physical[k] / physical[largest]) for k in entries}, float(singular), float(std))
