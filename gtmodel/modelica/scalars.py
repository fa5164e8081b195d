"""Scalar expressions of a flattened model: numbers, variables, and operations on them."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from .syntax import ModelicaError, Place


@dataclass(eq=False)
class Flat:
    """A scalar variable or parameter of the flattened model, under its name in the text, such as `tank[2].x[1]`.

    kind: "variable", "input", "parameter", "constant" or "discrete". base: Real, Integer, Boolean, String, enumeration.
    The binding and attributes are evaluated when first accessed.
    """

    name: str
    kind: str
    base: str
    at: Place
    attribute: Callable[[str], Any]
    bound: Callable[[], Any]
    top: bool = False
    flow: bool = False
    description: str = ""
    frozen: bool = False  # a structural parameter: its number was used at translation
    free: bool = False
    helper: bool = False  # a discrete variable of gtmodel for events, not in results
    computed: bool = False  # a parameter that initial equations determine (fixed = false)
    replaced: Any = None  # the expression that replaces it everywhere
    cache: dict[str, Any] = field(default_factory=dict)

    @property
    def binding(self) -> Any:
        if "binding" not in self.cache:
            self.cache["binding"] = self.bound()
        return self.cache["binding"]

    def get(self, name: str) -> Any:
        """Return the value of an attribute, such as start; None if it is not set."""
        if name not in self.cache:
            self.cache[name] = self.attribute(name)
        return self.cache[name]


@dataclass(eq=False, slots=True)
class Symbol:
    """A variable or parameter in an expression."""

    flat: Flat


@dataclass(eq=False, slots=True)
class Operation:
    """An operation on scalars."""

    name: str
    arguments: tuple[Any, ...]
    at: Place | None


@dataclass(frozen=True)
class EnumerationLiteral:
    """A literal of an enumeration."""

    type_name: str
    name: str
    position: int

    def __str__(self) -> str:
        return f"{self.type_name}.{self.name}"


Scalar = Any  # float | int | bool | str | EnumerationLiteral | Symbol | Operation


def is_number(x: Any) -> bool:
    return isinstance(x, (int, float)) and not isinstance(x, bool)


def is_literal(x: Any) -> bool:
    return isinstance(x, (int, float, bool, str, EnumerationLiteral))


def _power(a: float, b: float) -> float:
    result = float(a) ** b  # Real: a power of Integers has no bound
    if isinstance(result, complex):
        raise ValueError("a root of a negative number")
    return result


def _sign(x: float) -> int:
    return (x > 0) - (x < 0)


def _quotient(a: float, b: float) -> int:
    return math.trunc(a / b)


def _compared(compare: Callable[[Any, Any], bool]) -> Callable[[Any, Any], bool]:
    def of(a: Any, b: Any) -> bool:
        if isinstance(a, EnumerationLiteral) and isinstance(b, EnumerationLiteral):
            return compare(a.position, b.position)
        return compare(a, b)

    return of


NUMERIC: dict[str, Callable[..., Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": _power, "neg": operator.neg,
    "<": _compared(operator.lt), "<=": _compared(operator.le), ">": _compared(operator.gt),
    ">=": _compared(operator.ge), "==": _compared(operator.eq), "<>": _compared(operator.ne),
    "and": lambda a, b: bool(a and b), "or": lambda a, b: bool(a or b), "not": operator.not_,
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
    "atan2": math.atan2, "sinh": math.sinh, "cosh": math.cosh, "tanh": math.tanh, "exp": math.exp, "log": math.log,
    "log10": math.log10, "sqrt": math.sqrt, "abs": abs, "sign": _sign, "min": min, "max": max,
    "floor": math.floor, "ceil": math.ceil, "integer": math.floor, "mod": lambda a, b: a - math.floor(a / b) * b,
    "div": _quotient, "rem": lambda a, b: a - _quotient(a, b) * b,
}  # fmt: skip


_RELATIONS = ("<", "<=", ">", ">=", "==", "<>")
EXACT = 2**53  # larger Integers are not all exact as floats
LONGEST_TEXT = 100_000


_ARITHMETIC = ("+", "-", "*", "/", "**", "neg")


def _is_no_number(x: Any) -> bool:
    if isinstance(x, Symbol):
        return x.flat.base not in ("Real", "Integer")
    return is_literal(x) and not is_number(x)


def fits(x: Any, base: str, literals: tuple[str, ...] = ()) -> bool:
    """True if a variable of a predefined type, or of an enumeration of these literals, can have this value."""
    if isinstance(x, EnumerationLiteral):
        return base == "enumeration" and (not x.name or x.name in literals)
    if isinstance(x, Symbol):
        known = ("Real", "Integer") if base in ("Real", "Integer") else (base,)
        return x.flat.base in known
    if is_literal(x):
        return _sort(x) == ("Real" if base == "Integer" else base)
    return (base != "enumeration" and (base in ("Boolean", "String") or x.name not in _RELATIONS)) or x.name == "if"


def _sort(x: Any) -> str:
    """Return the type of a literal for comparisons; Integer and Real are one."""
    if isinstance(x, EnumerationLiteral):
        return x.type_name
    return "Boolean" if isinstance(x, bool) else "String" if isinstance(x, str) else "Real"


def operation(name: str, arguments: tuple[Any, ...], at: Place | None) -> Scalar:
    """Return an operation, or its value if all arguments are literals. Raises ModelicaError if it is undefined."""
    if name == "if":
        condition, then, otherwise = arguments
        if isinstance(condition, bool):
            return then if condition else otherwise
    elif name in NUMERIC and all(is_literal(a) for a in arguments):
        return computed(name, arguments, at)
    elif name in _ARITHMETIC and (wrong := [a for a in arguments if _is_no_number(a)]):
        shown = wrong[0].flat.name if isinstance(wrong[0], Symbol) else wrong[0]
        raise ModelicaError(f"'{'-' if name == 'neg' else name}' needs numbers; found {shown!r}", at)
    elif name == "not" and isinstance(arguments[0], Operation) and arguments[0].name == "not":
        return arguments[0].arguments[0]
    elif name == "and" and any(a is False for a in arguments):
        return False
    elif name == "or" and any(a is True for a in arguments):
        return True
    elif name in ("and", "or") and any(isinstance(a, bool) for a in arguments):
        return next(a for a in arguments if not isinstance(a, bool))
    return Operation(name, arguments, at)


def computed(name: str, arguments: tuple[Any, ...], at: Place | None) -> Any:
    """Return the value of an operation on literals. Raises ModelicaError if it is undefined."""
    if name == "+" and all(isinstance(a, str) for a in arguments):
        if len(arguments[0] + arguments[1]) > LONGEST_TEXT:
            raise ModelicaError(f"this string would have more than {LONGEST_TEXT} characters", at)
        return arguments[0] + arguments[1]
    texts = name in _RELATIONS and len({_sort(a) for a in arguments}) == 1
    if not texts and name in _RELATIONS:
        raise ModelicaError(f"'{name}' needs operands of one type; found {arguments[0]} and {arguments[1]}", at)
    logical = name in ("and", "or", "not")
    if not texts and not logical and not all(is_number(a) for a in arguments):
        shown = next(a for a in arguments if not is_number(a))
        raise ModelicaError(f"'{name}' needs numbers; found {shown!r}", at)
    if logical and not all(isinstance(a, bool) for a in arguments):
        raise ModelicaError(f"'{name}' needs Boolean operands; found {arguments[0]!r}", at)
    try:
        result = NUMERIC[name](*arguments)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        shown = ", ".join(map(str, arguments))
        raise ModelicaError(f"'{name}' of {shown} has no value: {error}", at) from None
    if isinstance(result, float) and not math.isfinite(result):
        raise ModelicaError(f"'{name}' of {', '.join(map(str, arguments))} is not finite", at)
    if isinstance(result, int) and abs(result) > EXACT:
        return float(result)
    return result


def symbols(x: Scalar) -> Iterator[Flat]:
    """Yield the variables and parameters in an expression; not recursive, shared operations once."""
    for e in nodes(x):
        if isinstance(e, Symbol):
            yield e.flat


def operations(x: Scalar) -> Iterator[Operation]:
    return (e for e in nodes(x) if isinstance(e, Operation))


def nodes(x: Scalar, closed: tuple[str, ...] = ()) -> Iterator[Any]:
    """Yield an expression and its subexpressions, shared ones once; arguments of closed operations are skipped."""
    stack, visited = [x], set[int]()
    while stack:
        e = stack.pop()
        if isinstance(e, Operation):
            if id(e) in visited:
                continue
            visited.add(id(e))
            stack.extend(reversed(e.arguments) if e.name not in closed else ())
        yield e


def ordered(*given: Scalar) -> list[Operation]:
    """Return the operations in expressions, each once and after its arguments; not recursive."""
    result: list[Operation] = []
    stack, visited = [(x, False) for x in reversed(given)], set[int]()
    while stack:
        e, arguments_done = stack.pop()
        if arguments_done:
            result.append(e)
        elif isinstance(e, Operation) and id(e) not in visited:
            visited.add(id(e))
            stack += [(e, True), *((a, False) for a in reversed(e.arguments))]
    return result


def extent(x: Scalar, known: dict[int, tuple[Any, int]]) -> int:
    """Return the size of an expression written out without sharing; known: sizes by id. Not recursive."""
    stack = [x]
    while stack:
        e = stack[-1]
        if not isinstance(e, Operation) or id(e) in known:
            stack.pop()
            continue
        pending = [a for a in e.arguments if isinstance(a, Operation) and id(a) not in known]
        if pending:
            stack += pending
            continue
        known[id(e)] = (e, 1 + sum(known[id(a)][1] if isinstance(a, Operation) else 1 for a in e.arguments))
        stack.pop()
    return known[id(x)][1] if isinstance(x, Operation) else 1


def replaced(x: Scalar, values: dict[int, Any], known: dict[int, Any] | None = None) -> Scalar:
    """Substitute values for variables, by the id of their Flat; arguments of pre() are left unchanged."""
    if isinstance(x, Symbol):
        return values.get(id(x.flat), x)
    if not isinstance(x, Operation) or x.name == "pre":
        return x
    if known is None:
        if not any(id(f) in values for f in symbols(x)):
            return x
        known = {}
    if id(x) not in known:
        known[id(x)] = operation(x.name, tuple(replaced(a, values, known) for a in x.arguments), x.at)
    return known[id(x)]


def is_constant(x: Scalar) -> bool:
    """True if an expression depends only on literals and parameters with given values."""
    moving = ("der", "time", "start_time", "final_time", "at", "integral", "pre", "initial", "sample", "edge", "change",
              "part", "refused")  # fmt: skip
    if any(o.name in moving for o in operations(x)):
        return False
    return all(f.kind in ("parameter", "constant") and not f.free and not f.computed for f in symbols(x))


def number_of(x: Scalar, at: Place | None = None, purpose: str = "", known: dict[int, Any] | None = None) -> Any:
    """Return the value of an expression of literals and parameters, which become structural (frozen).

    The flattened model is then valid only for these values. purpose: name of the value in error messages. Raises
    ModelicaError for variables, for a cyclic dependency, and for a parameter without a value.
    """
    if is_literal(x):
        return x
    if isinstance(x, Symbol):
        return _of_parameter(x.flat, at, purpose)
    known = {} if known is None else known
    if id(x) in known:
        return known[id(x)]
    if x.name == "if":
        condition = number_of(x.arguments[0], at or x.at, purpose, known)
        result = number_of(x.arguments[1 if condition else 2], at or x.at, purpose, known)
    elif x.name not in NUMERIC:
        raise ModelicaError(f"{purpose or 'a value needed at translation'} depends on {_shown(x.name)}", at or x.at)
    else:
        result = computed(x.name, tuple(number_of(a, at, purpose, known) for a in x.arguments), at or x.at)
    known[id(x)] = result
    return result


_BUSY = object()


def _of_parameter(flat: Flat, at: Place | None, purpose: str) -> Any:
    if flat.replaced is not None:
        return number_of(flat.replaced, at, purpose)
    if flat.kind not in ("parameter", "constant") or flat.computed or flat.free:
        description = "a free parameter" if flat.free else "not a parameter with a given value"
        raise ModelicaError(
            f"{purpose or 'a value needed at translation'} depends on '{flat.name}', which is {description}", at
        )
    value = flat.cache.get("number")
    if value is _BUSY:
        raise ModelicaError(f"the value of '{flat.name}' depends on itself", flat.at)
    if value is None:
        flat.cache["number"] = _BUSY
        try:
            value = number_of(value_of(flat), flat.at, f"'{flat.name}'")
        finally:
            if flat.cache["number"] is _BUSY:
                del flat.cache["number"]
        flat.cache["number"] = whole(flat, value)
    flat.frozen = True
    return value


def whole(flat: Flat, value: Any) -> Any:
    """Return the value of a parameter. Raises ModelicaError if an Integer has a fraction."""
    if flat.base == "Integer" and isinstance(value, float) and not value.is_integer():
        raise ModelicaError(f"'{flat.name}' must be an Integer; found {value}", flat.at)
    return value


def value_of(flat: Flat) -> Scalar:
    """Return the binding of a parameter, or else its start value. Raises ModelicaError if it has neither."""
    if flat.binding is not None:
        inside = list(symbols(flat.binding))
        if inside and is_constant(flat.binding) and all(f.kind == "constant" for f in inside):
            flat.cache["binding"] = number_of(flat.binding, flat.at, f"'{flat.name}'")  # 10*pi/180
        return flat.binding
    if (start := flat.get("start")) is not None:
        return start
    raise ModelicaError(f"{flat.kind} '{flat.name}' has no value", flat.at)


def _shown(name: str) -> str:
    words = {"start_time": "startTime", "final_time": "finalTime", "der": "a derivative", "part": "a motion"}
    return words.get(name, name)
