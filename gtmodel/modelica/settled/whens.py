"""Translation of `when`, `assert` and `terminate` to when clauses with branches of conditions and actions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import functions
from ..arrays import Values, array, entries
from ..constraints import ScalarEquation, ScalarWhen, WhenBranch
from ..instances import NameScope
from ..scalars import EnumerationLiteral, Operation, Symbol, is_literal, operation
from ..syntax import (
    Assign,
    Calls,
    Equal,
    For,
    FunctionCall,
    If,
    Literal,
    ModelicaError,
    Place,
    Reference,
    ReferencePart,
    SyntaxNode,
    WhenEquation,
)

if TYPE_CHECKING:
    from ..expressions import Evaluator

Equations = Callable[[SyntaxNode, NameScope], list[Any]]


def when_of(node: WhenEquation, scope: NameScope, model: Evaluator, equations: Equations) -> ScalarWhen:
    """Translate a when equation. Raises ModelicaError for an unsupported action."""
    if model.horizon:
        raise ModelicaError("an optimization does not support when; use gt.phases_of_events for events", node.at)
    branches: list[WhenBranch] = []
    for written, body in node.branches:
        actions: list[ScalarEquation] = []
        restarts: list[tuple[Any, Any]] = []
        end: tuple[str, bool] | None = None
        for x in body:
            name = _called(x)
            if name == "reinit":
                restarts += _restarts(x, scope, model)
            elif name == "terminate":
                end = end or (_sentence(x), False)
            elif name == "assert":
                model.warn("this assert() is in a when clause; it is not monitored", x.at)
            elif isinstance(x, (Equal, For, If)):
                actions += [_action(e) for e in equations(x, scope)]
            else:
                raise ModelicaError("a when clause can only contain equations, reinit() and terminate()", x.at)
        branches += _each(written, scope, model, tuple(actions), tuple(restarts), end)
    return ScalarWhen(tuple(branches), node.at)


def _action(e: Any) -> ScalarEquation:
    if not isinstance(e, ScalarEquation):
        raise ModelicaError("this action of a when clause is not an equation; write an if-expression", e.at)
    if not isinstance(e.left, Symbol):
        raise ModelicaError("the left side of an equation in a when clause must be a variable", e.at)
    if e.left.flat.kind in ("parameter", "constant"):
        raise ModelicaError(f"'{e.left.flat.name}' is a {e.left.flat.kind}, which an event cannot change", e.at)
    e.left.flat.kind = "discrete"
    return e


def _each(
    written: SyntaxNode, scope: NameScope, model: Evaluator, actions: Any, restarts: Any, end: Any
) -> Iterator[WhenBranch]:
    """Yield one branch for each entry of a vector of conditions: it acts whenever one of them becomes true."""
    if not (actions or restarts or end):
        return
    for condition in entries(model.array(written, scope)):
        yield WhenBranch(condition, actions, restarts, end, written.at)


def _called(x: SyntaxNode) -> str:
    return str(x.expression.reference) if isinstance(x, Calls) and isinstance(x.expression, FunctionCall) else ""


def _restarts(x: Any, scope: NameScope, model: Evaluator) -> list[tuple[Any, Any]]:
    arguments = x.expression.arguments
    if len(arguments) != 2:
        raise ModelicaError("reinit() takes a variable and its new value", x.at)
    left, right = (model.array(a, scope) for a in arguments)
    if left.shape != right.shape:
        raise ModelicaError(
            f"reinit() of a variable of shape {left.shape} needs a value of that shape; found {right.shape}", x.at
        )
    return list(zip(entries(left), entries(right), strict=True))


def _sentence(x: SyntaxNode) -> str:
    """Return the message of terminate() or assert() if it is a literal, otherwise a general one."""
    call = x.expression if isinstance(x, Calls) else x
    arguments = [*call.arguments, *call.named.values()] if isinstance(call, FunctionCall) else []
    text = next((a.value for a in arguments if isinstance(a, Literal) and isinstance(a.value, str)), "")
    return text.strip() or "the model ends the simulation"


def check_single_when(equations: Sequence[Any]) -> None:
    """Raises ModelicaError if two when clauses assign the same variable, or apply reinit() to it.

    elsewhen defines their precedence (Modelica 3.6, 8.3.5.2 and 8.3.6).
    """
    first: dict[int, ScalarWhen] = {}
    for when in equations:
        for branch in when.branches if isinstance(when, ScalarWhen) and not when.internal else ():
            assignments = [(a.left, "assigned", a.at) for a in branch.actions]
            assignments += [(x, "set by reinit()", branch.at) for x, _ in branch.restarts]
            for x, how, at in assignments:
                other = first.setdefault(id(x.flat), when) if isinstance(x, Symbol) else when
                if other is not when:
                    raise ModelicaError(
                        f"'{x.flat.name}' is {how} in two when clauses, first in line {other.at.line}; write elsewhen",
                        at,
                    )


# assert


def watched(node: FunctionCall, scope: NameScope, model: Evaluator) -> list[Any]:
    """Translate an assertion to a clause that ends the simulation at the first violation.

    In an optimization, and for AssertionLevel.warning, add a warning instead. Raises ModelicaError if it depends on
    parameters only and is violated.
    """
    arguments = dict(zip(("condition", "message", "level"), node.arguments, strict=False)) | node.named
    if "condition" not in arguments:
        raise ModelicaError("assert() takes a condition and a message", node.at)
    condition = model.truth(arguments["condition"], scope)
    if condition is True:
        return []
    level = arguments.get("level")
    is_error = level is None or not _is_warning(model.one(level, scope))
    if condition is False and is_error:
        model.evaluate(node, scope)
    if not is_error:
        model.warn("this assert() has level warning; it is not monitored", node.at)
        return []
    if model.horizon:
        model.warn("this assert() depends on variables; it is not monitored", node.at)
        return []
    violated = operation("not", (condition,), node.at)
    end = _sentence(node), True
    start = Operation("and", (Operation("initial", (), node.at), violated), node.at)
    return [ScalarWhen(tuple(WhenBranch(c, (), (), end, node.at) for c in (start, violated)), node.at, internal=True)]


def _is_warning(level: Any) -> bool:
    return isinstance(level, EnumerationLiteral) and level.name == "warning"


# algorithms


def apart(body: Sequence[SyntaxNode], scope: NameScope, model: Evaluator) -> tuple[list[SyntaxNode], list[Any]]:
    """Split an algorithm section into continuous statements, and translated when clauses and assertions.

    Raises ModelicaError for a section with both when and continuous statements.
    """
    result: list[Any] = []
    always: list[SyntaxNode] = []
    whens: list[WhenEquation] = []
    for x in body:
        if isinstance(x, WhenEquation):
            whens.append(x)
        elif isinstance(x, Calls) and _called(x) == "assert":
            assert isinstance(x.expression, FunctionCall)
            result += watched(x.expression, scope, model)
        else:
            always.append(x)
    if whens and always:
        raise ModelicaError(
            "an algorithm section with when cannot contain other statements; write two sections", always[0].at
        )
    names = [{n for _, statements in w.branches for n in _assigned(statements)} for w in whens]
    before: set[str] = set()
    for n, when in enumerate(whens):
        if again := names[n] & before:
            raise ModelicaError(f"'{min(again)}' is assigned in two when clauses; write elsewhen", when.at)
        result.append(_of_algorithm(when, set().union(*names[n:]), names[n], scope, model))
        before |= names[n]
    return always, result


def _assigned(body: Sequence[Any]) -> Iterator[str]:
    """Yield the names that statements assign."""
    for x in body:
        if isinstance(x, Assign):
            for target in x.targets:
                if isinstance(target, Reference):
                    first, *rest = target.parts
                    if rest:
                        raise ModelicaError("a when statement can only assign variables of its own class", x.at)
                    yield first.name
        elif isinstance(x, If):
            for _, inside in x.branches:
                yield from _assigned(inside)
            yield from _assigned(x.otherwise or ())
        elif isinstance(x, For):
            yield from _assigned(x.body)


def _of_algorithm(
    when: WhenEquation, names: set[str], assigned: set[str], scope: NameScope, model: Evaluator
) -> ScalarWhen:
    """Translate a when statement; before its assignment a variable has the value before the event."""
    if model.horizon:
        raise ModelicaError("an optimization does not support when; use gt.phases_of_events for events", when.at)
    symbols = {n: model.reference(Reference(when.at, (ReferencePart(n, None),)), scope) for n in sorted(names)}
    for name, value in symbols.items():
        if not isinstance(value, np.ndarray) or not all(isinstance(x, Symbol) for x in entries(value)):
            raise ModelicaError(f"'{name}' is not a variable that a when clause can assign", when.at)
        for x in entries(value) if name in assigned else ():
            _action(ScalarEquation(x, x, when.at))
    earlier = {n: array([_pre(x, when.at) for x in entries(v)], v.shape) for n, v in symbols.items()}
    branches: list[WhenBranch] = []
    for written, body in when.branches:
        branch_scope = NameScope(scope.instance, scope.space, model, {**scope.locals, **earlier})
        ends = [x for x in body if _called(x) == "terminate"]
        for x in body:
            if _called(x) == "assert":
                model.warn("this assert() is in a when clause; it is not monitored", x.at)
        functions.carry_out([x for x in body if _called(x) not in ("terminate", "assert")], branch_scope, model)
        actions = tuple(
            _action(ScalarEquation(s, v, written.at))
            for name in sorted(assigned)
            for s, v, old in _changed(symbols[name], branch_scope.locals[name], earlier[name], written.at)
            if v is not old
        )
        conditions = NameScope(scope.instance, scope.space, model, {**scope.locals, **earlier})
        branches += _each(written, conditions, model, actions, (), (_sentence(ends[0]), False) if ends else None)
    return ScalarWhen(tuple(branches), when.at)


def _changed(symbols: Values, new: Any, old: Values, at: Place) -> Iterator[tuple[Any, Any, Any]]:
    if not isinstance(new, np.ndarray) or new.shape != symbols.shape:
        raise ModelicaError("this assignment in a when clause has another shape than its variable", at)
    yield from zip(entries(symbols), entries(new), entries(old), strict=True)


def _pre(x: Any, at: Place) -> Any:
    return x if is_literal(x) else Operation("pre", (x,), at)
