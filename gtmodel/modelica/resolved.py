"""The last pass over expressions: dependent parameters written out, decided ones as numbers."""

from __future__ import annotations

from typing import Any

from .scalars import (
    EnumerationLiteral,
    Flat,
    Symbol,
    is_literal,
    number_of,
    operation,
    ordered,
    value_of,
    whole,
)
from .syntax import ModelicaError, Place

LONGEST = 100_000  # operations of one expression
TOO_LONG = "this expression is too long to be taken; write it in several equations"


class Resolver:
    """Expressions in variables, declared parameters and numbers only; the same symbol always becomes the same thing."""

    def __init__(self) -> None:
        self._known: dict[int, Any] = {}
        self._busy: list[Flat] = []

    def __call__(self, x: Any, at: Place) -> Any:
        """Raises ModelicaError for parameters that depend on themselves and for what is too deep."""
        try:
            for inner in ordered(x):  # so that nothing is deep
                self._resolved(inner)
            return self._resolved(x)
        except RecursionError:
            raise ModelicaError(TOO_LONG, at) from None

    def _resolved(self, x: Any) -> Any:
        if isinstance(x, EnumerationLiteral):
            return x.position
        if is_literal(x):
            return x
        if isinstance(x, Symbol):
            return self._symbol(x)
        if x.name == "pre" and isinstance(x.arguments[0], Symbol) and x.arguments[0].flat.replaced is not None:
            return x  # what events remember of it; it may follow from that itself
        key = id(x)
        if key not in self._known:
            arguments = tuple(map(self._resolved, x.arguments))
            if x.name == "der" and is_literal(arguments[0]):
                result: Any = 0
            elif all(a is b for a, b in zip(arguments, x.arguments, strict=True)):
                result = x
            else:
                result = operation(x.name, arguments, x.at)
            self._known[key] = (x, result)  # with what the key is the address of
        return self._known[key][1]

    def _symbol(self, x: Symbol) -> Any:
        flat = x.flat
        if is_declared(flat) and flat.replaced is None:
            return x
        key = id(flat)
        if key not in self._known:
            if flat in self._busy:
                raise ModelicaError(f"the value of '{flat.name}' depends on itself", flat.at)
            self._busy.append(flat)
            try:
                if flat.replaced is not None:
                    result = self._resolved(flat.replaced)
                elif flat.frozen or flat.kind == "constant":
                    result = self._resolved(number_of(x))
                else:
                    result = whole(flat, self._resolved(value_of(flat)))
            finally:
                self._busy.pop()
            self._known[key] = (flat, result)
        return self._known[key][1]


def is_declared(flat: Flat) -> bool:
    """Does it become a name of the class? Constants, decided and dependent parameters do not."""
    if flat.replaced is not None:
        return False
    if flat.kind not in ("parameter", "constant"):
        return flat.base in ("Real", "Integer") or flat.kind == "discrete"
    if flat.kind == "constant":
        return False
    if flat.free:
        return True
    if flat.frozen or flat.base != "Real":
        return False
    value = value_of(flat)
    return is_literal(value)
