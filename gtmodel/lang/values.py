"""Checks of parameter values: shape, sign, bounds, and the kind of thing that they describe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .declare import Declaration, Kind, Parameter
from .slips import floats, shortened
from .source import ModelError, SourceLocation

# of squared lengths and scalar products: four printed digits, 0.7071 for sqrt(1/2), are off by 1.8e-4 at the most
PRINTED_LENGTH = 2e-4
# of the largest entry: six printed digits, and the inverse of an ill-conditioned compliance
PRINTED_ENTRY = 1e-6


def check_parameter(
    item: Parameter,
    value: Any,
    name: str,
    where: SourceLocation | None = None,
    others: Mapping[str, np.ndarray] | None = None,
    origin: str = "",
) -> np.ndarray:
    """The value as a float array of the declared shape.

    others: values of the parameters that `min` and `max` name; without one its bound is not checked. origin: what the
    value follows from, for the sentence.

    Raises ModelError for shape, sign, bounds, another kind of thing, or a non-finite number.
    """
    where = where or item.where
    shape = shape_text(item.shape)
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        array = floats(value)
    except (TypeError, ValueError):
        numbers = f"numbers of shape {shape}" if item.shape else "a number"
        raise ModelError(
            f"parameter '{name}' takes {numbers}; found {shortened(value)}",
            where,
        ) from None
    if not fits(array.shape, item.shape):
        raise ModelError(f"parameter '{name}' has shape {shape}; found a value of shape {array.shape}", where)

    def refused(expected: str, what: str = "", what_to_do: str = "") -> ModelError:
        return ModelError(f"parameter '{name}' {expected}; found {_shown(value)}{what}{origin}{what_to_do}", where)

    if not np.all(np.isfinite(array)):
        raise refused("must be finite")
    if item.positive and np.any(array <= 0):
        raise refused("is declared positive")
    if item.nonzero and np.any(array == 0):
        raise refused("is declared nonzero")
    if item.increasing and not np.all(np.diff(array) > 0):
        raise refused("is declared increasing")
    for bound, outside, words in ((item.low, np.less, "at least"), (item.high, np.greater, "at most")):
        limit, by_name = bound, ""
        if isinstance(bound, Declaration):
            limit, by_name = (others or {}).get(bound.name), f"'{bound.name}', "
        if limit is not None and np.any(outside(array, limit)):
            raise refused(f"must be {words} {by_name}{limit}")
    if item.kind is not None and (fault := _KINDS[item.kind](array)) is not None:
        expected, misfit, what_to_do = fault
        raise refused(expected, f", {misfit}", f"; {what_to_do}")
    return array


def fits(shape: tuple[int, ...], declared: tuple[int, ...]) -> bool:
    """Whether a value's shape is the declared one, in which -1 stands for any length."""
    return len(shape) == len(declared) and all(d in (-1, n) for n, d in zip(shape, declared, strict=True))


def shape_text(declared: tuple[int, ...]) -> str:
    """A declared shape as people write it: (n, 3)."""
    return str(declared) if -1 not in declared else str(declared).replace("-1", "n")


def _shown(value: Any) -> str:
    """A value on one line."""
    if np.ndim(value) == 0:
        return str(value)
    return " ".join(np.array2string(np.asarray(value, float), separator=", ", threshold=18, precision=6).split())


Fault = tuple[str, str, str]  # what was expected, what was found, what to do


def _rotation(R: np.ndarray) -> Fault | None:
    expected = "must be a rotation"
    error = float(np.max(np.abs(R.T @ R - np.eye(3))))
    if error > PRINTED_LENGTH:
        misfit = f"whose columns are not of length 1 and at right angles: R'R is off by {error:.3g}"
        return expected, misfit, "give the nearest rotation, U V' of its singular value decomposition"
    if np.linalg.det(R) < 0:
        return expected, "a reflection: its determinant is -1", "change the sign of one axis"
    return None


def _unit(u: np.ndarray) -> Fault | None:
    lengths = np.linalg.norm(np.atleast_2d(u), axis=-1)
    k = int(np.argmax(np.abs(lengths - 1)))
    if abs(lengths[k] ** 2 - 1) <= PRINTED_LENGTH:
        return None
    misfit = f"{'' if u.ndim == 1 else f'row {k} '}of length {lengths[k]:.6g}"
    return "must have length 1", misfit, "divide it by its length" if lengths[k] else "give another"


def _direction(v: np.ndarray) -> Fault | None:
    none = np.flatnonzero(~np.any(np.atleast_2d(v) != 0, axis=-1))
    if not len(none):
        return None
    where = "" if v.ndim == 1 else f"in row {none[0]} "
    return "must have a length other than 0", f"{where}a zero vector", "it says no direction"


def _semidefinite(K: np.ndarray) -> Fault | None:
    expected, largest = "must be symmetric and positive semidefinite", float(np.max(np.abs(K)))
    skew = 2.0 * float(np.max(np.abs(K / 2 - K.T / 2)))
    if skew > PRINTED_ENTRY * largest:
        misfit = f"whose transpose differs by {skew:.3g}"
        return expected, misfit, "check the signs beside the diagonal, or give the mean of both"
    least = float(np.linalg.eigvalsh(K / 2 + K.T / 2)[0])
    if least < -PRINTED_ENTRY * largest:
        return expected, f"with the eigenvalue {least:.4g}", "check its signs and units"
    return None


_KINDS: dict[Kind, Callable[[np.ndarray], Fault | None]] = {
    "rotation": _rotation,
    "unit": _unit,
    "direction": _direction,
    "semidefinite": _semidefinite,
}
