"""Checks of parameter values: shape, sign, bounds, kind; also of values that are known only after binding."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .declarations import Declaration, Kind, Parameter
from .slips import floats, shortened
from .source import ModelError, SourceLocation

if TYPE_CHECKING:
    from .bind import ParameterRecord, Tree

# tolerance of squared lengths and scalar products: four digits, 0.7071 for sqrt(1/2), cause errors up to 1.8e-4
PRINTED_LENGTH = 2e-4
# tolerance relative to the largest entry: six digits, or the inverse of an ill-conditioned compliance
PRINTED_ENTRY = 1e-6


def check_parameter(
    item: Parameter,
    value: Any,
    name: str,
    where: SourceLocation | None = None,
    others: Mapping[str, np.ndarray] | None = None,
    origin: str = "",
) -> np.ndarray:
    """Check a parameter value and return it as a float array of the declared shape.

    others: values of the parameters that `min` and `max` name; a bound without a value is not checked. origin: text for
    the message about the parameters that determine the value.

    Raises ModelError for a wrong shape, sign or kind, a value outside the bounds, or a non-finite number.
    """
    where = where or item.where
    shape = shape_text(item.shape)
    try:
        if isinstance(value, (bool, np.bool_)):
            raise TypeError
        array = floats(value)
    except (TypeError, ValueError):
        numbers = f"numbers of shape {shape}" if item.shape else "a number"
        raise ModelError(f"parameter '{name}' takes {numbers}; found {shortened(value)}", where) from None
    if not fits(array.shape, item.shape):
        raise ModelError(f"parameter '{name}' has shape {shape}; found a value of shape {array.shape}", where)

    def fault(expected: str, detail: str = "", advice: str = "") -> ModelError:
        return ModelError(f"parameter '{name}' {expected}; found {_text(value)}{detail}{origin}{advice}", where)

    if not np.all(np.isfinite(array)):
        raise fault("must be finite")
    if item.positive and np.any(array <= 0):
        raise fault("is declared positive")
    if item.nonzero and np.any(array == 0):
        raise fault("is declared nonzero")
    if item.increasing and not np.all(np.diff(array) > 0):
        raise fault("is declared increasing")
    for bound, outside, words in ((item.low, np.less, "at least"), (item.high, np.greater, "at most")):
        limit, by_name = bound, ""
        if isinstance(bound, Declaration):
            limit, by_name = (others or {}).get(bound.name), f"'{bound.name}', "
        if limit is not None and np.any(outside(array, limit)):
            raise fault(f"must be {words} {by_name}{limit}")
    if item.kind is not None and (texts := _KINDS[item.kind](array)) is not None:
        expected, detail, advice = texts
        raise fault(expected, f", {detail}", f"; {advice}")
    return array


def fits(shape: tuple[int, ...], declared: tuple[int, ...]) -> bool:
    """Return whether a value's shape is the declared one, in which -1 stands for any length."""
    return len(shape) == len(declared) and all(d in (-1, n) for n, d in zip(shape, declared, strict=True))


def shape_text(declared: tuple[int, ...]) -> str:
    """Return the text of a declared shape, such as (n, 3)."""
    return str(declared) if -1 not in declared else str(declared).replace("-1", "n")


def _text(value: Any) -> str:
    """Return a value on one line."""
    if np.ndim(value) == 0:
        return str(value)
    return " ".join(np.array2string(np.asarray(value, float), separator=", ", threshold=18, precision=6).split())


Fault = tuple[str, str, str]  # expected, found, advice


def _rotation(R: np.ndarray) -> Fault | None:
    expected = "must be a rotation matrix"
    error = float(np.max(np.abs(R.T @ R - np.eye(3))))
    if error > PRINTED_LENGTH:
        detail = f"whose columns are not orthonormal: R'R differs from the identity by {error:.3g}"
        return expected, detail, "use the nearest rotation, U V' of its singular value decomposition"
    if np.linalg.det(R) < 0:
        return expected, "a reflection: its determinant is -1", "change the sign of one axis"
    return None


def _unit(u: np.ndarray) -> Fault | None:
    lengths = np.linalg.norm(np.atleast_2d(u), axis=-1)
    k = int(np.argmax(np.abs(lengths - 1)))
    if abs(lengths[k] ** 2 - 1) <= PRINTED_LENGTH:
        return None
    detail = f"{'' if u.ndim == 1 else f'row {k} '}of length {lengths[k]:.6g}"
    return "must have length 1", detail, "divide it by its length" if lengths[k] else "set a vector other than zero"


def _direction(v: np.ndarray) -> Fault | None:
    zeros = np.flatnonzero(~np.any(np.atleast_2d(v) != 0, axis=-1))
    if not len(zeros):
        return None
    row = "" if v.ndim == 1 else f"in row {zeros[0]} "
    return "must be a direction", f"{row}a zero vector", "set a vector of any length but zero"


def _semidefinite(K: np.ndarray) -> Fault | None:
    expected, largest = "must be symmetric and positive semidefinite", float(np.max(np.abs(K)))
    skew = 2.0 * float(np.max(np.abs(K / 2 - K.T / 2)))
    if skew > PRINTED_ENTRY * largest:
        detail = f"whose transpose differs by {skew:.3g}"
        return expected, detail, "check the signs of the off-diagonal entries, or use the symmetric part (K + K') / 2"
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
    """Checks of the parameters that are expressions of other parameters, or are bounded by them."""

    def __init__(self, tree: Tree) -> None:
        bound = [r for r in tree.parameters if r.values is None and not r.indices]
        named = [r for r in tree.parameters if any(isinstance(b, Declaration) for b in (r.item.low, r.item.high))]
        owner = {tree.scope.parameters[i].element_hash(): r for r in tree.parameters for i in r.indices}
        self._size = len(tree.scope.parameters)
        self._sources: dict[str, list[str]] = {}
        self._ready: list[ParameterRecord] = []
        for r in bound:
            sources = _unique([owner[h] for s in ca.symvar(r.expression) if (h := s.element_hash()) in owner])
            self._sources[r.name] = [o.name for o in sources]
            if all(o.values is not None for o in sources):
                self._ready.append(r)
        self._checked = _unique([*self._ready, *named])
        expressions = [r.expression for r in self._ready]
        self._values = ca.Function("bound", [ca.vertcat(*tree.scope.parameters)], expressions)

    def check(self, parameters: list[ParameterRecord]) -> None:
        """Raise ModelError for a wrong value, naming the parameters that determine it and the line that sets them.

        parameters: the records of the tree, possibly with other values.
        """
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
            prefix = f"{r.component}." if r.component else ""
            names = [b.name for b in (r.item.low, r.item.high) if isinstance(b, Declaration)]
            others = {n: known[prefix + n] for n in names if prefix + n in known}
            sources, array = [by_name[name] for name in self._sources.get(r.name, [])], known[r.name]
            origin = ", which follows from " + " and ".join(map(_with_value, sources)) if sources else ""
            where = sources[0].where if sources else r.where
            check_parameter(r.item, array if r.shape else float(array), r.name, where, others, origin)


def check_bound(tree: Tree) -> None:
    """Raise ModelError for a wrong value of a parameter that depends on others, or is bounded by them."""
    dependent = any(r.values is None and not r.indices for r in tree.parameters)
    bounded = any(isinstance(b, Declaration) for r in tree.parameters for b in (r.item.low, r.item.high))
    if dependent or bounded:
        BoundParameters(tree).check(tree.parameters)


def _unique(records: list[ParameterRecord]) -> list[ParameterRecord]:
    return list({r.name: r for r in records}.values())


def _with_value(r: ParameterRecord) -> str:
    assert r.values is not None
    return f"{r.name} = {float(r.values[0]):.10g}" if not r.shape else r.name
