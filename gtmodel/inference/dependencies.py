"""Which columns depend on others: QR with pivots that neither the machine nor the order of columns can change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError
from .make_estimate import listed

# columns whose remaining lengths differ by less than this part tie; the name decides
TIE = 1e-6
# coefficients below this part of a column's largest are rounding
NOTHING = 1e-8
SHOWN = 0.01  # of the largest: smaller ones are not named in a sentence


@dataclass(frozen=True, eq=False)
class Dependencies:
    """Which columns of a Jacobian depend on which others.

    `independent` are the names in the order of the pivots; `coefficients` has for each other name d those of its column
    in terms of these, column(d) = sum coefficients[d][i] * column(i), in the parameters' own units. The data determine
    the base parameters p_i + sum_d coefficients[d][i] * p_d and nothing else.
    """

    independent: tuple[str, ...]
    coefficients: dict[str, dict[str, float]]

    def base(self, name: str) -> dict[str, float]:
        """The base parameter of an independent name: name -> factor. Raises ArgumentError for a dependent one."""
        if name not in self.independent:
            raise ArgumentError(
                f"'{name}' depends on others; base parameters are those of {', '.join(self.independent)}"
            )
        more = {d: c[name] for d, c in self.coefficients.items() if name in c}
        return {name: 1.0, **more}

    @property
    def notes(self) -> list[str]:
        """One sentence per dependent name: what it moves with."""
        return [
            f"{d} moves with {listed(_largest(c))}: measure {d}, or fix one of them"
            if c
            else f"{d} moves nothing that is measured: fix it"
            for d, c in self.coefficients.items()
        ]


def _largest(c: dict[str, float]) -> tuple[str, ...]:
    most = max(abs(v) for v in c.values())
    return tuple(n for n, v in c.items() if abs(v) > SHOWN * most)


def dependencies(
    J: np.ndarray,
    names: Sequence[str],
    *,
    scale: np.ndarray | None = None,
    tolerance: float = 1e-9,
    keep: Sequence[str] = (),
) -> Dependencies:
    """Which columns of the Jacobian J (rows, n) depend on others, by QR with pivots.

    Rows are whitened; columns are compared in units of `scale` (n,), the expected sizes of the parameters.

    Pivots are first the names in `keep`, in that order, as far as they are independent, then always the column with the
    longest remainder; lengths within 1e-6 of it tie, and the name that sorts first wins. A column depends on others
    when its remainder is below `tolerance` of the longest column. The order of the columns changes nothing.

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
    # the triangle of columns sorted by name: the same for every order in which they come
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
        rest -= np.outer(q, q @ rest)  # again: orthogonal to rounding
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
