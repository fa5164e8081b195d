"""Modelica functions, inlined: their algorithms are executed on expressions, and an if in a function generates no
events (Modelica 3.6, section 12.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._near import near
from . import builtin
from .arrays import RecordValue, array, each, entries
from .instances import Instance, NameScope, kind_of
from .members import member
from .modifications import Modifier, modifier_of
from .scalars import Operation, Symbol, is_constant, is_literal, is_number, operation, replaced
from .scopes import Space
from .syntax import (
    Assign,  # fmt: skip
    Calls,
    Component,
    Extends,
    For,
    FunctionCall,
    If,
    ModelicaError,
    Place,
    Reference,
    ReferencePart,
    SyntaxNode,
    TextJump,
    WhenEquation,
    While,
)

if TYPE_CHECKING:
    from .expressions import Evaluator

DEEPEST = 40  # nested calls
TURNS = 100_000  # iterations of a while loop


class _Broken(Exception):
    """A break or return statement: the loop, or the function, ends."""

    def __init__(self, word: str) -> None:
        self.word = word


def components(space: Space) -> list[tuple[Component, Space]]:
    """Return all components of a function or record in order, each with the class that declares it."""
    result: list[tuple[Component, Space]] = []
    for element in space.text.elements:
        if isinstance(element, Extends):
            result += components(space.base(element))
        elif isinstance(element, Component):
            result.append((element, space))
    return result


def _bodies(space: Space) -> list[tuple[list[SyntaxNode], Space]]:
    inherited = [body for base, _ in space.bases() for body in _bodies(base)]
    return [*inherited, *[(body, space) for body in space.text.algorithms]]


def _short(space: Space) -> tuple[Space, list[Any]]:
    """Return the function f of `function g = f(a=2)`, and the modifications of its defaults."""
    modifications: list[Any] = []
    while space.text.short:
        extends = space.text.elements[0]
        assert isinstance(extends, Extends)
        modifications.append((extends.modification, space))
        space = space.base(extends)
    return space, modifications


def _changes(space: Space, modifications: list[Any], model: Evaluator) -> dict[str, Modifier]:
    """Return the modifiers of components, from extends clauses and short class definitions; outer ones override."""
    result: dict[str, Modifier] = {}
    for base, extends in space.bases():
        result |= _changes(base, [(extends.modification, space)], model)
    for written, around in reversed(modifications):
        result |= modifier_of(written, NameScope(None, around, model)).inside
    return result


def _assigned(inputs: Sequence[Component], node: FunctionCall, function: str) -> dict[str, SyntaxNode]:
    """Return the arguments of a call by name. Raises ModelicaError for too many, unknown or repeated ones."""
    names = [c.name for c in inputs]
    if len(node.arguments) > len(names):
        raise ModelicaError(f"{function} takes {len(names)} arguments; found {len(node.arguments)}", node.at)
    result = dict(zip(names, node.arguments, strict=False))
    for name, value in node.named.items():
        if name not in names:
            raise ModelicaError(f"{function} has no argument '{name}'{near(name, names)}", node.at)
        if name in result:
            raise ModelicaError(f"argument '{name}' of {function} is specified twice", node.at)
        result[name] = value
    return result


def constructed(space: Space, node: FunctionCall, scope: NameScope, model: Evaluator) -> RecordValue:
    """Return the value of a record constructor."""
    space, modifications = _short(space)
    fields = components(space)
    arguments = _assigned([c for c, _ in fields], node, space.name)
    changes = _changes(space, modifications, model)
    result = RecordValue()
    for c, holder in fields:
        field_scope = NameScope(None, holder, model, dict(result))
        if c.name in arguments:
            result[c.name] = model.evaluate(arguments[c.name], scope)
        elif c.name in changes and (default := changes[c.name].value) is not None:
            result[c.name] = model.given(default)
        elif c.modification is not None and c.modification.value is not None:
            result[c.name] = model.evaluate(c.modification.value, field_scope)
        else:
            raise ModelicaError(f"{space.name}() has no value for '{c.name}'; pass it as an argument", node.at)
        _check_size(c, result[c.name], field_scope, model, space.name)
    return result


def called(space: Space, node: FunctionCall, scope: NameScope, model: Evaluator) -> Any:
    """Return the first output of a function; `results` gives all."""
    return results(space, node, scope, model)[0]


def results(space: Space, node: FunctionCall, scope: NameScope, model: Evaluator) -> list[Any]:
    """Return all outputs of a function. Raises ModelicaError if it cannot be inlined."""
    space, modifications = _short(space)
    text = space.text
    function = f"function {space.name}"
    if text.external is not None:
        raise ModelicaError(f"{function} is an external function, which is not supported", node.at)
    if text.unsupported:
        raise ModelicaError(f"{function} is not supported: {text.unsupported}", node.at)
    declared = components(space)
    inputs = [c for c, _ in declared if "input" in c.prefixes]
    outputs = [c for c, _ in declared if "output" in c.prefixes]
    bodies = _bodies(space)
    if not outputs or not bodies:
        raise ModelicaError(f"{function} has no {'algorithm' if outputs else 'output'}", node.at)
    arguments = _assigned(inputs, node, function)
    changes = _changes(space, modifications, model)
    values = {name: model.evaluate(value, scope) for name, value in arguments.items()}
    local: dict[str, Any] = {}
    model.spend(20, node.at)
    if model.calls >= DEEPEST:
        raise ModelicaError(
            f"{function} calls itself, or calls are nested more than {DEEPEST} deep; recursion cannot be inlined",
            node.at,
        )
    model.calls += 1
    try:
        for c, holder in declared:
            component_scope = NameScope(None, holder, model, local)
            value = values.get(c.name)
            if value is None and c.name in changes and (default := changes[c.name].value) is not None:
                value = model.given(default)
            if value is None and c.modification is not None and c.modification.value is not None:
                value = model.evaluate(c.modification.value, component_scope)
            if isinstance(value, Instance):
                value = record_of(value, node.at)
            if value is None and "input" in c.prefixes:
                raise ModelicaError(
                    f"{function} has no value for its input '{c.name}'; pass it as an argument", node.at
                )
            local[c.name] = (
                _empty(c, component_scope, model)
                if value is None
                else _check_size(c, value, component_scope, model, function)
            )
        for body, holder in bodies:
            try:
                carry_out(body, NameScope(None, holder, model, local), model)
            except _Broken as broken:
                if broken.word != "return":
                    raise ModelicaError(f"'{broken.word}' is outside a loop", node.at) from None
    finally:
        model.calls -= 1
    for c in outputs:
        value = local[c.name]
        unset = isinstance(value, np.ndarray) and any(x is None for x in entries(value))
        if unset or (isinstance(value, RecordValue) and not value):
            raise ModelicaError(f"{function} does not assign its output '{c.name}'", c.at)
    return [local[c.name] for c in outputs]


def _size(c: Component, scope: NameScope, model: Evaluator) -> list[int | None]:
    kind = kind_of(c.type_name, scope)
    written = [(d, scope) for d in c.dimensions] + kind.dimensions
    return [None if model.is_colon(d) else model.whole(d, s, f"the size of '{c.name}'") for d, s in written]


def _empty(c: Component, scope: NameScope, model: Evaluator) -> Any:
    """Return the value of a local variable of a function before any assignment."""
    kind = kind_of(c.type_name, scope)
    if kind.space is not None and kind.base != "enumeration":
        return RecordValue()
    sizes = _size(c, scope, model)
    if None in sizes:
        return array([], (0,))
    known = tuple(s or 0 for s in sizes)
    if any(s < 0 for s in known):
        raise ModelicaError(f"the size of '{c.name}' must not be negative; found {known}", c.at)
    model.spend(math.prod(known), c.at)
    return array([None] * math.prod(known), known)


def _check_size(c: Component, value: Any, scope: NameScope, model: Evaluator, owner: str) -> Any:
    if not isinstance(value, np.ndarray) or (value.size and isinstance(value.ravel()[0], (RecordValue, Instance))):
        return value
    sizes = _size(c, scope, model)
    if len(sizes) != value.ndim or any(s is not None and s != n for s, n in zip(sizes, value.shape, strict=True)):
        expected = (
            f"shape ({', '.join(':' if s is None else str(s) for s in sizes)})" if sizes else "the shape of a scalar"
        )
        raise ModelicaError(f"'{c.name}' of {owner} must have {expected}; found shape {value.shape}", c.at)
    base = kind_of(c.type_name, scope).base
    if base == "Integer" and any(isinstance(x, float) and not x.is_integer() for x in entries(value)):
        raise ModelicaError(f"'{c.name}' of {owner} must be an Integer", c.at)
    return value.copy()


def record_of(instance: Instance, at: Place) -> RecordValue:
    """Return a component as a record value."""
    result = RecordValue()
    for name in instance.elements:
        value = member(instance, name, at)
        result[name] = record_of(value, at) if isinstance(value, Instance) else value
    return result


# statements


def carry_out(body: Sequence[SyntaxNode], scope: NameScope, model: Evaluator) -> None:
    """Execute statements, which assign local names of a scope. Raises ModelicaError if one cannot be inlined."""
    for statement in body:
        if isinstance(statement, Assign):
            _assign(statement, scope, model)
        elif isinstance(statement, If):
            _choose(statement, scope, model)
        elif isinstance(statement, For):
            for iteration in model.loops(statement.loops, scope, statement.body):
                loop_names = {loop.name for loop in statement.loops}
                inner = NameScope(
                    scope.instance, scope.space, model, _Overlay(scope.locals, iteration.locals, loop_names)
                )
                try:
                    carry_out(statement.body, inner, model)
                except _Broken as broken:
                    if broken.word == "return":
                        raise
                    break
        elif isinstance(statement, While):
            _repeat(statement, scope, model)
        elif isinstance(statement, TextJump):
            raise _Broken(statement.word)
        elif isinstance(statement, Calls):
            _call(statement.expression, scope, model)
        elif isinstance(statement, WhenEquation):
            raise ModelicaError(
                "a when statement is not supported here; write a when equation in an equation section", statement.at
            )
        else:
            raise ModelicaError("this statement is not supported", statement.at)


class _Overlay(dict[str, Any]):
    """Local names in one iteration of a loop: assignments also go to the enclosing scope, except to loop variables."""

    def __init__(self, enclosing: dict[str, Any], iteration: dict[str, Any], loop_names: set[str]) -> None:
        super().__init__({**enclosing, **{name: iteration[name] for name in loop_names}})
        self._below, self._own = enclosing, loop_names

    def __setitem__(self, name: str, value: Any) -> None:
        super().__setitem__(name, value)
        if name not in self._own:
            self._below[name] = value


def _call(node: SyntaxNode, scope: NameScope, model: Evaluator) -> None:
    if not isinstance(node, FunctionCall):
        raise ModelicaError("this is not a statement; an assignment is written with :=", node.at)
    name = str(node.reference)
    if name == "assert":
        model.evaluate(node, scope)
    elif name == "terminate" or name in builtin.BUILT_IN:
        raise ModelicaError(f"{name}() is not supported as a statement", node.at)
    else:
        space = model.function(node.reference, scope)
        if space.name.endswith((".Streams.print", ".Streams.error")):
            raise ModelicaError(f"{space.name}() has side effects and is not supported", node.at)
        results(space, node, scope, model)


def _assign(statement: Assign, scope: NameScope, model: Evaluator) -> None:
    if len(statement.targets) > 1:
        call = statement.value
        assert isinstance(call, FunctionCall)
        values = results(model.function(call.reference, scope), call, scope, model)
        if len(values) < len(statement.targets):
            raise ModelicaError(
                f"{call.reference}() has {len(values)} outputs; found {len(statement.targets)} targets", statement.at
            )
    else:
        values = [model.evaluate(statement.value, scope)]
    for target, value in zip(statement.targets, values, strict=False):
        if target is not None:
            if not isinstance(target, Reference):
                raise ModelicaError("the left side of an assignment must be a variable", statement.at)
            _put(target, value, scope, model)


def _put(target: Reference, value: Any, scope: NameScope, model: Evaluator) -> None:
    first, *rest = target.parts
    if isinstance(value, Instance):
        value = record_of(value, target.at)
    if first.name not in scope.locals:
        if not scope.holds(first.name):
            raise ModelicaError(f"there is no variable '{first.name}'{near(first.name, list(scope.locals))}", target.at)
        scope.locals[first.name] = model.first(first, Reference(target.at, (first,)), scope)
    scope.locals[first.name] = _replaced(scope.locals[first.name], first, rest, value, scope, model, target.at)


def _replaced(
    old: Any,
    part: ReferencePart,
    rest: Sequence[ReferencePart],
    value: Any,
    scope: NameScope,
    model: Evaluator,
    at: Place,
) -> Any:
    """Return a value with one part replaced, for an assignment to a field or an entry."""
    if part.subscripts is None:
        if rest:
            if not isinstance(old, RecordValue):
                raise ModelicaError(f"'{part.name}' is not a record; its fields cannot be assigned", at)
            inner = old.get(rest[0].name, RecordValue() if len(rest) > 1 else None)
            return RecordValue({**old, rest[0].name: _replaced(inner, rest[0], rest[1:], value, scope, model, at)})
        both = isinstance(old, np.ndarray) and isinstance(value, np.ndarray)
        if both and old.shape != value.shape and old.size:
            raise ModelicaError(f"'{part.name}' has shape {old.shape}; the assigned value has shape {value.shape}", at)
        return value
    if rest or not isinstance(old, np.ndarray):
        raise ModelicaError(f"an assignment to this part of '{part.name}' is not supported", at)
    places = array(list(range(old.size)), old.shape)
    chosen = model.subscripted(places, part, scope, at)
    if not isinstance(value, np.ndarray) or chosen.shape != value.shape:
        raise ModelicaError(f"'{part.name}[...]' has shape {chosen.shape}; the assigned value has another", at)
    flat = old.ravel().copy()
    for place, entry in zip(entries(chosen), entries(value), strict=True):
        flat[place] = entry
    return flat.reshape(old.shape)


def _choose(statement: If, scope: NameScope, model: Evaluator) -> None:
    """Execute an if statement: one branch if the condition has a value, otherwise both, joined by if-expressions."""
    for n, (condition, body) in enumerate(statement.branches):
        truth = model.truth(condition, scope)
        if truth is False:
            continue
        if truth is True:
            carry_out(body, scope, model)
            return
        rest = If(statement.at, statement.branches[n + 1 :], statement.otherwise)
        sides = []
        for side in (body, [rest]):
            branch_scope = NameScope(scope.instance, scope.space, model, dict(scope.locals))
            try:
                carry_out(side, branch_scope, model)
            except _Broken as broken:
                raise ModelicaError(
                    f"'{broken.word}' in an if statement whose condition depends on variables cannot be inlined",
                    statement.at,
                ) from None
            sides.append(branch_scope.locals)
        for name in sides[0].keys() | sides[1].keys():
            a, b = (side.get(name, scope.locals.get(name)) for side in sides)
            if a is not b:
                scope.locals[name] = joined(truth, a, b, name, statement.at, model)
        return
    if statement.otherwise is not None:
        carry_out(statement.otherwise, scope, model)


def joined(truth: Any, a: Any, b: Any, name: str, at: Place, model: Evaluator) -> Any:
    """Return the value of a name after an if statement whose condition depends on variables."""
    if isinstance(a, RecordValue) and isinstance(b, RecordValue) and a.keys() == b.keys():
        return RecordValue({k: joined(truth, a[k], b[k], f"{name}.{k}", at, model) for k in a})
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray) or a.shape != b.shape:
        raise ModelicaError(f"'{name}' has different shapes in the branches of this if statement", at)
    return each(lambda x, y: x if x is y else None if x is None or y is None else model.chosen(truth, x, y, at),
                a, b)  # fmt: skip


def _repeat(statement: While, scope: NameScope, model: Evaluator) -> None:
    for _ in range(TURNS):
        model.spend(4, statement.at)
        condition = model.truth(statement.condition, scope)
        if not is_literal(condition):
            raise ModelicaError("a while loop whose condition depends on variables cannot be inlined", statement.at)
        if not condition:
            return
        try:
            carry_out(statement.body, scope, model)
        except _Broken as broken:
            if broken.word == "return":
                raise
            return
    raise ModelicaError(f"this while loop has more than {TURNS} iterations", statement.at)


def algorithm(body: Sequence[SyntaxNode], scope: NameScope, model: Evaluator) -> dict[str, Any]:
    """Return the names that an algorithm section of a model assigns, with their values at its end."""
    local_scope = NameScope(scope.instance, scope.space, model, {})
    try:
        carry_out(body, local_scope, model)
    except _Broken as broken:
        raise ModelicaError(f"'{broken.word}' is outside a function", scope.space.text.at) from None
    # an assigned variable is initialised with its start value: if it is read first, or if no branch assigns it
    first: dict[int, Any] = {}
    for name, value in local_scope.locals.items():
        before = model.first(ReferencePart(name, None), Reference(scope.space.text.at, ()), scope)
        if isinstance(value, np.ndarray) and isinstance(before, np.ndarray):
            for old, new in zip(entries(before), entries(value), strict=True):
                if old is not new and isinstance(old, Symbol) and old.flat.kind != "discrete":
                    start = old.flat.get("start")
                    first[id(old.flat)] = start if start is not None else False if old.flat.base == "Boolean" else 0
    return {
        name: each(lambda x: replaced(x, first), value) if isinstance(value, np.ndarray) else value
        for name, value in local_scope.locals.items()
    }


# finite for finite arguments, so that a branch can be evaluated even if it is not selected
_DEFINED = ("+", "-", "*", "neg", "sin", "cos", "atan", "atan2", "tanh", "abs", "min", "max", "share", "time", "der")


class Eventless:
    """Writes if-expressions without events where that is safe; remembers which expressions are always defined."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Any, bool]] = {}

    def chosen(self, condition: Any, then: Any, otherwise: Any, at: Place) -> Any:
        """Return one of two expressions by a condition, without an event if both are defined everywhere.

        Three cases keep an event at the exact instant: a branch that may be undefined, for example a logarithm that
        the condition protects from negative arguments, and which is then evaluated only while it is selected; a
        condition that reads discrete variables; and two Integer branches, between which the value jumps.
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
        """True if an expression is finite for all finite values of its variables; not recursive, shared parts once."""
        stack = [x]
        while stack:
            e = stack[-1]
            if not isinstance(e, Operation) or id(e) in self._known:
                stack.pop()
                continue
            pending = [a for a in e.arguments if isinstance(a, Operation) and id(a) not in self._known]
            if pending:
                stack += pending
                continue
            defined = e.name in _DEFINED or _plain_power(e) or (e.name == "/" and is_constant(e.arguments[1]))
            self._known[id(e)] = e, defined and all(map(self._simple, e.arguments))
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
    """Return 1 if a condition holds, otherwise 0, as an expression; None if it has other parts than inequalities."""
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
