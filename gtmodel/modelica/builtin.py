"""Built-in functions and operators of Modelica: der, mathematical functions, array constructors and reductions."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import Values, array, each, entries, identity, joined, product, scalar, stacked, summed
from .multibody import assembly as multibody
from .scalars import EnumerationLiteral, Operation, is_literal, number_of, operation
from .syntax import FunctionCall, Literal, ModelicaError, Place, Reference, SyntaxNode

if TYPE_CHECKING:
    from .expressions import Evaluator
    from .instances import NameScope

_ONE = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "abs", "sign",
    "floor", "ceil", "integer",
)  # fmt: skip
_TWO = ("atan2", "mod", "rem", "div")
_EVENTS = {
    "terminal": "terminal() is not supported: a simulation does not know its end in advance",
    "reinit": "reinit() has no value; it is an action of a when clause",
    "terminate": "terminate() has no value; it is an action of a when clause",
    "spliceFunction": "spliceFunction() is specific to another tool and is not supported",
    "cardinality": "cardinality() counts connections, which is not supported; use a Boolean parameter",
    "inStream": "stream connectors are not supported", "actualStream": "stream connectors are not supported",
}  # fmt: skip
MATHEMATICAL = {name: name for name in (*_ONE, "atan2")}


def reduced(name: str, items: Values, at: Place, loops: int = 1) -> Values:
    """Return the value of a reduction, such as sum(e for i in r); loops: number of iterators."""
    flat = [x for item in items for x in (entries(item) if isinstance(item, np.ndarray) else [item])]
    if name == "sum":
        if items.ndim > loops:
            columns = items.reshape(int(np.prod(items.shape[:loops])), -1).T
            return array([summed(list(column), at) for column in columns], items.shape[loops:])
        return scalar(summed(flat, at))
    if name == "array":
        return items
    if name == "product":
        return scalar(_folded("*", flat, 1, at))
    if name in ("min", "max"):
        if not flat:
            raise ModelicaError(f"{name}() of an empty array has no value", at)
        return scalar(_folded(name, flat, None, at))
    raise ModelicaError(f"{name}() is not a reduction; only sum, product, min, max and array take iterators", at)


def _folded(name: str, items: list[Any], empty: Any, at: Place) -> Any:
    if not items:
        return empty
    total = items[0]
    for x in items[1:]:
        total = operation(name, (total, x), at)
    return total


def called(name: str, node: FunctionCall, scope: NameScope, model: Evaluator) -> Any:
    """Return the value of a call of a built-in function. Raises ModelicaError for wrong arguments."""
    if node.named and name not in ("smooth", "delay", "homotopy", "assert", "String"):
        raise ModelicaError(f"{name}() takes positional arguments only", node.at)
    if name in _EVENTS:
        raise ModelicaError(_EVENTS[name], node.at)
    try:
        return _called(name, node, scope, model)
    except ModelicaError:
        raise
    except (IndexError, TypeError, ValueError) as error:  # NumPy's, for wrong shapes
        raise ModelicaError(f"{name}() has invalid arguments: {error}", node.at) from None


def _called(name: str, node: FunctionCall, scope: NameScope, model: Evaluator) -> Any:
    if name in _ONE:
        (x,) = _arguments(name, node, scope, model, 1)
        return each(lambda e: operation(name, (e,), node.at), x)
    if name in _TWO:
        a, b = _arguments(name, node, scope, model, 2)
        return each(lambda x, y: operation(name, (x, y), node.at), a, b)
    return BUILT_IN[name](node, scope, model)


def _arguments(name: str, node: FunctionCall, scope: NameScope, model: Evaluator, count: int) -> list[Values]:
    if len(node.arguments) != count:
        words = {1: "one argument", 2: "two arguments", 3: "three arguments"}[count]
        raise ModelicaError(f"{name}() takes {words}; found {len(node.arguments)}", node.at)
    return [model.array(a, scope) for a in node.arguments]


def _der(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    (x,) = _arguments("der", node, scope, model, 1)
    for e in entries(x):
        if is_literal(e):
            raise ModelicaError(f"der() needs an expression that contains variables; found {e}", node.at)
    return each(lambda e: Operation("der", (e,), node.at), x)


def _least(name: str) -> Callable[[FunctionCall, NameScope, Evaluator], Values]:
    def of(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
        if len(node.arguments) == 1:
            return reduced(name, model.array(node.arguments[0], scope).ravel(), node.at)
        a, b = _arguments(name, node, scope, model, 2)
        return each(lambda x, y: operation(name, (x, y), node.at), a, b)

    return of


def _sum(name: str) -> Callable[[FunctionCall, NameScope, Evaluator], Values]:
    def of(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
        (x,) = _arguments(name, node, scope, model, 1)
        return reduced(name, x.ravel(), node.at)

    return of


def _size(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    first = node.arguments[0] if node.arguments else None
    x = None
    if isinstance(first, Reference) and len(first.parts) == 1 and first.parts[0].subscripts is None:
        x = scope.locals.get(first.parts[0].name)  # a local variable has a size before it has values
    if x is None and first is not None:
        x = model.evaluate(first, scope)
    if not isinstance(x, np.ndarray) or len(node.arguments) > 2:
        raise ModelicaError("size() takes an array and optionally one of its dimensions", node.at)
    if len(node.arguments) == 1:
        return array(list(x.shape), (x.ndim,))
    n = model.whole(node.arguments[1], scope, "the dimension in size()")
    if not 1 <= n <= x.ndim:
        raise ModelicaError(f"the array has {x.ndim} dimensions; found size(..., {n})", node.at)
    return scalar(x.shape[n - 1])


def _ndims(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    (x,) = _arguments("ndims", node, scope, model, 1)
    return scalar(x.ndim)


def _filled(value: Any) -> Callable[[FunctionCall, NameScope, Evaluator], Values]:
    def of(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
        sizes = node.arguments if value is not None else node.arguments[1:]
        shape = tuple(model.whole(a, scope, "a size") for a in sizes)
        entry = scalar(value) if value is not None else model.array(node.arguments[0], scope)
        if not sizes:
            raise ModelicaError(f"{node.reference}() needs at least one size", node.at)
        count = math.prod(shape)
        if any(n < 0 for n in shape):
            raise ModelicaError(f"a size must not be negative; found {shape}", node.at)
        model.spend(count * entry.size, node.at)
        return array([x for _ in range(count) for x in entries(entry)], shape + entry.shape)

    return of


def _identity(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    if len(node.arguments) != 1:
        raise ModelicaError("identity() takes one size", node.at)
    n = model.whole(node.arguments[0], scope, "a size")
    model.spend(n * n, node.at)
    return identity(n)


def _diagonal(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    (x,) = _arguments("diagonal", node, scope, model, 1)
    n = len(x)
    model.spend(n * n, node.at)
    return array([x[i] if i == j else 0 for i in range(n) for j in range(n)], (n, n))


def _linspace(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    if len(node.arguments) != 3:
        raise ModelicaError("linspace() takes the two ends and the number of points", node.at)
    a, b = (model.one(x, scope) for x in node.arguments[:2])
    n = model.whole(node.arguments[2], scope, "the number of points in linspace()")
    model.spend(n, node.at)
    step = operation("-", (b, a), node.at)
    parts = [operation("/", (operation("*", (k, step), node.at), n - 1), node.at) for k in range(n)]
    return array([operation("+", (a, p), node.at) for p in parts], (n,))


def _transpose(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    (x,) = _arguments("transpose", node, scope, model, 1)
    return np.swapaxes(x, 0, 1)


def _cross(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    a, b = _arguments("cross", node, scope, model, 2)
    if a.shape != (3,) or b.shape != (3,):
        raise ModelicaError(f"cross() takes two vectors of length 3; found {a.shape} and {b.shape}", node.at)

    def entry(i: int, j: int) -> Any:
        left, right = operation("*", (a[i], b[j]), node.at), operation("*", (a[j], b[i]), node.at)
        return operation("-", (left, right), node.at)

    return array([entry(1, 2), entry(2, 0), entry(0, 1)], (3,))


def _skew(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    (x,) = _arguments("skew", node, scope, model, 1)
    if x.shape != (3,):
        raise ModelicaError(f"skew() takes a vector of length 3; found {x.shape}", node.at)

    def minus(e: Any) -> Any:
        return operation("neg", (e,), node.at)

    return array([0, minus(x[2]), x[1], x[2], 0, minus(x[0]), minus(x[1]), x[0], 0], (3, 3))


def _outer_product(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    a, b = _arguments("outerProduct", node, scope, model, 2)
    model.spend(a.size * b.size, node.at)
    return product(a.reshape(-1, 1), b.reshape(1, -1), node.at)


def _cat(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    if len(node.arguments) < 2:
        raise ModelicaError("cat() takes a dimension and arrays", node.at)
    dimension = model.whole(node.arguments[0], scope, "the dimension in cat()")
    items = [model.array(a, scope) for a in node.arguments[1:]]
    if not 1 <= dimension <= min(x.ndim for x in items):
        raise ModelicaError(
            f"cat() concatenates along a dimension that all its arrays have; found {dimension}", node.at
        )
    model.spend(sum(x.size for x in items), node.at)
    return joined(dimension, items, node.at)


def _array(node: FunctionCall, scope: NameScope, model: Evaluator) -> Any:
    return stacked([model.evaluate(a, scope) for a in node.arguments], node.at)


def _reshaped(name: str) -> Callable[[FunctionCall, NameScope, Evaluator], Values]:
    def of(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
        (x,) = _arguments(name, node, scope, model, 1)
        if name == "vector":
            return x.reshape(-1)
        if name == "scalar":
            if x.size != 1:
                raise ModelicaError(f"scalar() takes one entry; found shape {x.shape}", node.at)
            return x.reshape(())
        return x.reshape(x.shape[0], -1) if x.ndim > 1 else x.reshape(-1, 1)

    return of


def _symmetric(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    (x,) = _arguments("symmetric", node, scope, model, 1)
    n = len(x)
    if x.shape != (n, n):
        raise ModelicaError(f"symmetric() takes a square matrix; found {x.shape}", node.at)
    return array([x[min(i, j), max(i, j)] for i in range(n) for j in range(n)], (n, n))


def _first(node: FunctionCall, scope: NameScope, model: Evaluator) -> Any:
    """Return the first argument, for noEvent(e), homotopy(a, s) and Integer(e)."""
    expression = node.arguments[0] if node.arguments else node.named.get("actual")
    if expression is None:
        raise ModelicaError(f"{node.reference}() takes an expression", node.at)
    return model.evaluate(expression, scope)


def _smooth(node: FunctionCall, scope: NameScope, model: Evaluator) -> Any:
    expression = node.arguments[1] if len(node.arguments) > 1 else None
    if expression is None:
        raise ModelicaError("smooth() takes an order and an expression", node.at)
    return model.evaluate(expression, scope)


def _semi_linear(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    x, above, below = (model.one(a, scope) for a in node.arguments)
    condition = operation(">=", (x, 0), node.at)
    sides = [operation("*", (slope, x), node.at) for slope in (above, below)]
    return scalar(operation("if", (condition, *sides), node.at))


def _at_events(name: str) -> Callable[[FunctionCall, NameScope, Evaluator], Values]:
    def of(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
        arguments = [model.array(a, scope) for a in node.arguments]
        if name == "initial":
            return scalar(Operation("initial", (), node.at))
        if name == "sample":
            if len(arguments) != 2:
                raise ModelicaError(
                    f"sample() takes a start and an interval; found {len(arguments)} arguments", node.at
                )
            return each(lambda x, y: Operation("sample", (x, y), node.at), *arguments)
        if len(arguments) != 1:
            raise ModelicaError(f"{name}() takes one argument; found {len(arguments)}", node.at)
        return each(lambda x: Operation(name, (x,), node.at), arguments[0])

    return of


def _delay(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    if len(node.arguments) < 2:
        raise ModelicaError("delay() takes an expression and a delay time", node.at)
    x = model.one(node.arguments[0], scope)
    tau = model.number(node.arguments[1], scope, "the delay time of delay()")
    return scalar(Operation("delay", (x, float(tau)), node.at))


def _text(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    value = number_of(model.one(node.arguments[0], scope), node.at, "the argument of String()")
    return scalar(str(value).lower() if isinstance(value, bool) else str(value))


def _assert(node: FunctionCall, scope: NameScope, model: Evaluator) -> Values:
    arguments = dict(zip(("condition", "message", "level"), node.arguments, strict=False)) | node.named
    if "condition" not in arguments:
        raise ModelicaError("assert() takes a condition and a message", node.at)
    condition = model.truth(arguments["condition"], scope)
    if condition is False:
        message = arguments.get("message")
        text = message.value if isinstance(message, Literal) else "assertion violated"
        level = model.one(arguments["level"], scope) if "level" in arguments else None
        if not isinstance(level, EnumerationLiteral) or level.name != "warning":
            raise ModelicaError(f"assert: {text}", node.at)
        model.warn(f"assert: {text}", node.at)
        return scalar(True)
    if condition is not True:
        model.warn("this assert() depends on variables; it is not monitored", node.at)
    return scalar(True)


def _unnamed(node: SyntaxNode, *_: Any) -> Any:
    raise ModelicaError("this function is not supported here", node.at)


BUILT_IN: dict[str, Callable[[FunctionCall, NameScope, Evaluator], Any]] = {
    **dict.fromkeys((*_ONE, *_TWO, *_EVENTS), _unnamed),
    "der": _der, "min": _least("min"), "max": _least("max"), "sum": _sum("sum"), "product": _sum("product"),
    "size": _size, "ndims": _ndims, "zeros": _filled(0), "ones": _filled(1), "fill": _filled(None),
    "identity": _identity, "diagonal": _diagonal, "linspace": _linspace, "transpose": _transpose, "cross": _cross,
    "skew": _skew, "outerProduct": _outer_product, "cat": _cat, "array": _array, "vector": _reshaped("vector"),
    "matrix": _reshaped("matrix"), "scalar": _reshaped("scalar"), "symmetric": _symmetric, "noEvent": _first,
    "homotopy": _first, "smooth": _smooth, "semiLinear": _semi_linear, "pre": _at_events("pre"),
    "initial": _at_events("initial"), "sample": _at_events("sample"), "edge": _at_events("edge"),
    "change": _at_events("change"), "delay": _delay, "String": _text, "assert": _assert, "Integer": _first,
    "__mechanics": lambda node, scope, model: multibody.called(node, scope),
}  # fmt: skip
