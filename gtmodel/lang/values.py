"""Checks of parameter values: shape, sign, bounds, the kind of thing that they describe, and those that only binding
allows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .declare import Declaration, Kind, Parameter
from .slips import floats, shortened
from .source import ModelError, SourceLocation

if TYPE_CHECKING:
    from .bind import ParameterRecord, Tree

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


class BoundParameters:
    """Which parameters follow from others, or are bounded by them: the same for all values of a tree's parameters."""

    def __init__(self, tree: Tree) -> None:
        bound = [r for r in tree.parameters if r.values is None and not r.indices]
        named = [r for r in tree.parameters if any(isinstance(b, Declaration) for b in (r.item.low, r.item.high))]
        owner = {tree.scope.parameters[i].element_hash(): r for r in tree.parameters for i in r.indices}
        self._size = len(tree.scope.parameters)
        self._sources: dict[str, list[str]] = {}
        self._ready: list[ParameterRecord] = []
        for r in bound:
            given = _unique([owner[h] for s in ca.symvar(r.expression) if (h := s.element_hash()) in owner])
            self._sources[r.name] = [o.name for o in given]
            if all(o.values is not None for o in given):
                self._ready.append(r)
        self._checked = _unique([*self._ready, *named])
        expressions = [r.expression for r in self._ready]
        self._values = ca.Function("bound", [ca.vertcat(*tree.scope.parameters)], expressions)

    def check(self, parameters: list[ParameterRecord]) -> None:
        """ModelError as for given values, with the parameters that a value follows from and the line that gave them.
        The parameters are those of the tree, with any values where they have some of their own."""
        known: dict[str, np.ndarray] = {}
        numbers, by_name = np.zeros(self._size), {r.name: r for r in parameters}
        for r in parameters:
            if r.values is not None:
                numbers[r.indices] = r.values
                known[r.name] = r.values.reshape(r.shape)
        for r, value in zip(self._ready, self._values.call([ca.DM(numbers)]), strict=True):
            known[r.name] = value.full().reshape(r.shape)
        for r in self._checked:
            if r.name not in known:
                continue
            assert isinstance(r.item, Parameter)
            inside = f"{r.component}." if r.component else ""
            names = [b.name for b in (r.item.low, r.item.high) if isinstance(b, Declaration)]
            others = {n: known[inside + n] for n in names if inside + n in known}
            given, array = [by_name[name] for name in self._sources.get(r.name, [])], known[r.name]
            origin = ", which follows from " + " and ".join(map(_with_value, given)) if given else ""
            where = given[0].where if given else r.where
            check_parameter(r.item, array if r.shape else float(array), r.name, where, others, origin)


def check_bound(tree: Tree) -> None:
    """ModelError where a parameter that follows from others, or is bounded by them, is not allowed."""
    own = [r for r in tree.parameters if r.values is None and not r.indices]
    named = any(isinstance(b, Declaration) for r in tree.parameters for b in (r.item.low, r.item.high))
    if own or named:
        BoundParameters(tree).check(tree.parameters)


def _unique(records: list[ParameterRecord]) -> list[ParameterRecord]:
    return list({r.name: r for r in records}.values())


def _with_value(r: ParameterRecord) -> str:
    assert r.values is not None
    return f"{r.name} = {float(r.values[0]):.10g}" if not r.shape else r.name
