"""An if inside a function, which makes no events (Modelica 3.6, section 12.2): both sides by weights of 1 and 0."""

from __future__ import annotations

from typing import Any

from ..scalars import Operation, Symbol, is_constant, is_literal, is_number, operation
from ..syntax import Place

# of finite arguments these are finite: a side may be computed where it does not count
_DEFINED = ("+", "-", "*", "neg", "sin", "cos", "atan", "atan2", "tanh", "abs", "min", "max", "share", "time", "der")


class Eventless:
    """What is known of the sides so far."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Any, bool]] = {}

    def chosen(self, condition: Any, then: Any, otherwise: Any, at: Place) -> Any:
        """One of two expressions by a condition, without an event where both sides are defined everywhere.

        A side that may be undefined, as a logarithm that the condition keeps away from negative numbers, is
        never computed where it does not count: there, and where a condition reads what changes at events, an event
        decides at the exact instant. So it does between two whole numbers, which jump.
        """
        level = all(
            isinstance(x, int) or (isinstance(x, Symbol) and x.flat.base == "Integer") for x in (then, otherwise)
        )
        defined = not level and self._defined(then) and self._defined(otherwise)
        weight = _weight(condition, at) if defined else None
        if weight is None:
            return operation("if", (condition, then, otherwise), at)
        terms = [
            operation("*", (w, side), at)
            for w, side in ((weight, then), (_rest(weight, at), otherwise))
            if not is_literal(side) or side != 0
        ]
        return 0 if not terms else terms[0] if len(terms) == 1 else operation("+", tuple(terms), at)

    def _defined(self, x: Any) -> bool:
        """Does it have a finite value wherever its variables do? Without recursion; what is shared is asked once."""
        stack = [x]
        while stack:
            e = stack[-1]
            if not isinstance(e, Operation) or id(e) in self._known:
                stack.pop()
                continue
            inside = [a for a in e.arguments if isinstance(a, Operation) and id(a) not in self._known]
            if inside:
                stack += inside
                continue
            here = e.name in _DEFINED or _plain_power(e) or (e.name == "/" and is_constant(e.arguments[1]))
            self._known[id(e)] = e, here and all(map(self._simple, e.arguments))
            stack.pop()
        return self._simple(x)

    def _simple(self, x: Any) -> bool:
        if isinstance(x, Operation):
            return self._known[id(x)][1]
        return is_number(x) or (isinstance(x, Symbol) and x.flat.base in ("Real", "Integer"))


def _plain_power(e: Operation) -> bool:
    exponent = e.arguments[-1] if e.name == "**" else None
    return isinstance(exponent, (int, float)) and exponent >= 0 and float(exponent).is_integer()


def _weight(x: Any, at: Place) -> Any:
    """1 where a condition holds, else 0; None where it is not made of inequalities of what moves."""
    if not isinstance(x, Operation):
        return None
    if x.name in ("<", "<=", ">", ">="):
        if any(isinstance(a, (bool, str)) or not (is_literal(a) or _is_real(a)) for a in x.arguments):
            return None
        a, b = x.arguments if x.name in (">=", "<") else reversed(x.arguments)
        weight = Operation("share", (a, b), at)
        return weight if x.name.endswith("=") else _rest(weight, at)
    if x.name not in ("and", "or", "not"):
        return None
    weights = [_weight(a, at) for a in x.arguments]
    if any(w is None for w in weights):
        return None
    if x.name == "not":
        return _rest(weights[0], at)
    both = operation("*", tuple(weights), at)
    if x.name == "and":
        return both
    return operation("-", (operation("+", tuple(weights), at), both), at)


def _rest(weight: Any, at: Place) -> Any:
    """1 minus a weight."""
    if isinstance(weight, Operation) and weight.name == "-" and weight.arguments[0] == 1:
        return weight.arguments[1]
    return operation("-", (1, weight), at)


def _is_real(x: Any) -> bool:
    return isinstance(x, Operation) or (isinstance(x, Symbol) and x.flat.base in ("Real", "Integer"))
