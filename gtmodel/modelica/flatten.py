"""Flattening: one class of the text becomes scalar variables and equations, with the names of the text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from . import functions
from .arrays import RecordValue, each, entries, same_shape
from .connections import Connections, drop_unused, give_variables
from .constraints import Flattened, ScalarEquation, ScalarIf, constraints_settled, sides
from .expressions import MOST_OPERATIONS, TOO_LONG, Evaluator
from .instances import Declared, Instance, NameScope
from .members import field as field_of
from .modifications import Modifier
from .multibody.assembly import declared_places
from .multibody.library import is_own
from .multibody.parts import is_frame
from .scalars import (
    Flat,
    Operation,
    Symbol,
    is_constant,
    is_literal,
    is_number,
    number_of,
    operation,
    operations,
    symbols,
)
from .scopes import Space
from .settled.events import settle_events, settle_macros
from .settled.static import settle_inputs, settle_static
from .settled.whens import apart, check_single_when, watched, when_of
from .syntax import (
    Binary,
    Calls,
    Connect,
    Equal,
    For,
    FunctionCall,
    If,
    ModelicaError,
    Modification,
    Outputs,
    Place,
    Reference,
    SyntaxNode,
    WhenEquation,
)


def flattened(space: Space, modifier: Modifier) -> Flattened:
    """Flatten a class, with modifications from outside. Raises ModelicaError with file and line."""
    try:
        return _Flattening(space, modifier).result()
    except RecursionError:
        raise ModelicaError(f"{space.name} is nested too deep", space.text.at) from None


MOVING = ("variable", "input", "discrete")


class _Flattening:
    def __init__(self, space: Space, modifier: Modifier) -> None:
        self.model = Evaluator()
        text = space.text
        if text.restriction not in ("model", "class", "block", "optimization"):
            raise ModelicaError(
                f"{space.name} is a {text.restriction}; only a model, block or optimization can be translated", text.at
            )
        if "partial" in text.prefixes:
            raise ModelicaError(f"{space.name} is partial; name a class that extends it", text.at)
        self.model.horizon = text.restriction == "optimization"
        try:
            self.root = Instance(space, modifier, "", None, self.model, frozenset())
        except RecursionError:
            raise ModelicaError(f"{space.name} contains itself", text.at) from None
        for name in modifier.inside.keys() & self.root.elements.keys():
            self.root.elements[name].check_accessible(None)
        self.out = Flattened(text.name, text.at, text.description, self.model.horizon)
        self.connections = Connections()
        self.uncertain = False  # in an if-equation whose condition depends on variables

    def result(self) -> Flattened:
        give_variables(self.root, self.model)
        instances = list(self.root.walk())
        places = declared_places(instances)
        for instance in instances:
            if instance is not self.root and instance.restriction == "optimization":
                raise ModelicaError(f"'{instance.path}' is an optimization, which cannot be a component", instance.at)
            self._declared(instance)
        self._variability()
        for instance in instances:
            for section in instance.sections:
                first = len(self.out.equations)
                self._section(section.text, section.scope)
                if is_own(section.text.at.source.path):  # errors name the line that declares the component
                    at = places.get(id(instance), instance.at)
                    self.out.equations[first:] = [replace(e, at=at) for e in self.out.equations[first:]]
        if self.root.space.text.restriction != "optimization" and self.out.constraints:
            raise ModelicaError("a constraint section is only allowed in an optimization", self.out.constraints[0].at)
        drop_unused(instances, self.out, self.connections)
        for a, b, place in self.connections.equalities:
            self.out.equations.append(ScalarEquation(Symbol(a), Symbol(b), place))
        self.connections.complete(instances, self.root)
        for terms, place in self.connections.sums():
            self.out.equations.append(ScalarEquation(terms, 0, place))
        self.connections.assembly.settle(instances, places, self.out, self.model)
        self._bounded()
        settle_macros(self.out)
        self._header()
        check_single_when(self.out.equations)
        if not self.out.optimization:
            settle_events(self.out)
        if self.out.static and self.out.parts:
            raise ModelicaError(
                "a static optimization does not support MultiBody parts, which move", self.out.parts[0].at
            )
        if self.out.static:
            settle_static(self.out)
        elif self.out.optimization:
            constraints_settled(self.out)
        settle_inputs(self.out.flats, self.out.equations)
        for flat in self.out.flats:
            if flat.kind == "input" and flat.get("fixed") is True:
                self.model.warn(f"fixed of the input '{flat.name}' is ignored", flat.at)
        self.out.warnings = [*self.model.warnings, *self.out.warnings]
        return self.out

    # declarations

    def _declared(self, instance: Instance) -> None:
        if is_frame(instance) or (instance.parent is not None and is_frame(instance.parent)):
            return  # variables of a frame are quantities of a part
        for element in instance.elements.values():
            component = element.component
            if not isinstance(component, Declared) or "outer" in element.text.prefixes:
                continue
            for flat in component.flats:
                self.out.flats.append(flat)
                if flat.kind == "constant" and flat.base == "Real" and flat.get("unit"):
                    flat.kind = "parameter"  # a number would lose the unit
                if flat.kind == "parameter":
                    self._parameter(flat)
            if component.flats and component.flats[0].kind not in ("parameter", "constant"):
                value = component.binding()
                if value is None:
                    continue
                place = component.fixed_place
                for flat, entry in zip(
                    component.flats, entries(each(lambda x, _: x, value, component.symbols)), strict=True
                ):
                    if flat.base != "Real" and flat.base != "Integer":
                        flat.replaced = entry
                    else:
                        flat.kind = "variable" if flat.kind == "input" else flat.kind
                        self.out.equations.append(ScalarEquation(Symbol(flat), entry, place))

    def _parameter(self, flat: Flat) -> None:
        low, value, high = flat.get("min"), flat.binding, flat.get("max")
        if any(is_number(a) and is_number(b) and a > b for a, b in ((low, value), (value, high))):
            self.model.warn(f"'{flat.name}' is outside its min and max", flat.at)
        if self._flag(flat, "free"):
            if self.model.horizon:
                flat.free = True
            else:
                self.model.warn(f"'{flat.name}' has free = true, which only an optimization uses", flat.at)
        elif flat.get("fixed") is not None and not self._flag(flat, "fixed"):
            flat.computed, flat.kind = True, "variable"
            self.out.equations.append(ScalarEquation(Operation("der", (Symbol(flat),), flat.at), 0, flat.at))

    def _variability(self) -> None:
        """Raises ModelicaError for a parameter that depends on a variable, time or a derivative."""
        for flat in self.out.flats:
            if flat.kind != "parameter" or flat.binding is None:
                continue
            moving = [f.name for f in symbols(flat.binding) if f.kind in MOVING and not f.computed]
            moving += [o.name for o in operations(flat.binding) if o.name in ("time", "der")]
            if moving:
                raise ModelicaError(
                    f"parameter '{flat.name}' depends on '{moving[0]}', which varies with time", flat.at
                )

    @staticmethod
    def _flag(flat: Flat, name: str) -> bool:
        value = flat.get(name)
        if value is None:
            return False
        value = number_of(value, flat.at, f"{name} of '{flat.name}'")
        if not isinstance(value, bool):
            raise ModelicaError(f"{name} of '{flat.name}' must be true or false; found {value}", flat.at)
        return value

    # sections

    def _section(self, text: Any, scope: NameScope) -> None:
        for node in text.equations:
            self.out.equations += self._equations(node, scope)
        for node in text.initial_equations:
            self.out.initial += self._plain(self._equations(node, scope), "an initial equation")
        for body in text.algorithms:
            self.out.equations += self._algorithm(body, scope)
        for body in text.initial_algorithms:
            self.out.initial += self._plain(self._algorithm(body, scope), "a statement of an initial algorithm")
        for node in text.constraints:
            self.out.constraints += self._constraints(node, scope)
        if text.annotation is not None:
            self._annotated(text.annotation, scope)

    def _plain(self, items: Sequence[Any], what: str) -> list[ScalarEquation]:
        for item in items:
            if not isinstance(item, ScalarEquation):
                raise ModelicaError(
                    f"{what} must be an equation; found an if or when whose condition depends on variables", item.at
                )
        return list(items)

    def _algorithm(self, body: Sequence[SyntaxNode], scope: NameScope) -> list[Any]:
        body, result = apart(body, scope, self.model)
        place = body[0].at if body else scope.space.text.at
        for name, value in functions.algorithm(body, scope, self.model).items():
            symbol = self.model.reference(_name(name, place), scope)
            if not isinstance(value, np.ndarray):
                raise ModelicaError("an algorithm of a model must assign numbers; found a record", place)
            pairs = zip(entries(symbol), entries(value), strict=True)
            result += [ScalarEquation(s, v, place) for s, v in pairs if s is not v]
        return result

    def _equations(self, node: SyntaxNode, scope: NameScope) -> list[Any]:
        if isinstance(node, Equal):
            return self._equal(node, scope)
        if isinstance(node, For):
            return [e for s in self.model.loops(node.loops, scope, node.body) for x in node.body
                    for e in self._equations(x, s)]  # fmt: skip
        if isinstance(node, If):
            return self._if(node, scope)
        if isinstance(node, Connect):
            if self.uncertain:
                raise ModelicaError(
                    "connect() under a condition of variables is not supported; use a condition of parameters",
                    node.at,
                )
            self.connections.connect(node, scope, self.model)
            return []
        if isinstance(node, WhenEquation):
            return [when_of(node, scope, self.model, self._equations)]
        if isinstance(node, Calls):
            return self._call(node, scope)
        raise ModelicaError("this is not an equation", node.at)

    def _equal(self, node: Equal, scope: NameScope) -> list[ScalarEquation]:
        if isinstance(node.left, Outputs):
            call = node.right
            if not isinstance(call, FunctionCall):
                raise ModelicaError("a list of variables on the left needs a function call on the right", node.at)
            values = functions.results(self.model.function(call.reference, scope), call, scope, self.model)
            if len(values) < len(node.left.items):
                raise ModelicaError(
                    f"{call.reference}() has {len(values)} outputs; found {len(node.left.items)} variables", node.at
                )
            pairs = [(self.model.evaluate(t, scope), v)
                     for t, v in zip(node.left.items, values, strict=False) if t is not None]  # fmt: skip
            return [e for a, b in pairs for e in self._between(a, b, node.at)]
        return self._between(self.model.evaluate(node.left, scope), self.model.evaluate(node.right, scope), node.at)

    def _between(self, a: Any, b: Any, at: Place) -> list[ScalarEquation]:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            if a.size and isinstance(a.ravel()[0], Instance):
                return [e for x, y in zip(a.ravel(), b.ravel(), strict=True) for e in self._between(x, y, at)]
            same_shape(a, b, "=", at)
            return [ScalarEquation(x, y, at) for x, y in zip(entries(a), entries(b), strict=True)]
        names = list(a.elements if isinstance(a, Instance) else a) if isinstance(a, (Instance, RecordValue)) else None
        if names is None or not isinstance(b, (Instance, RecordValue)):
            raise ModelicaError("one side of this equation is a record, the other a number", at)
        return [e for name in names for e in self._between(field_of(a, name, at), field_of(b, name, at), at)]

    def _if(self, node: If, scope: NameScope) -> list[Any]:
        branches: list[tuple[Any, list[Any]]] = []
        rest: list[Any] = []
        for condition, body in node.branches:
            truth = self.model.truth(condition, scope)
            if truth is False:
                continue
            before, self.uncertain = self.uncertain, self.uncertain or truth is not True or bool(branches)
            branch = [e for x in body for e in self._equations(x, scope)]
            self.uncertain = before
            if truth is True:
                rest = branch
                break
            branches.append((truth, branch))
        else:
            before, self.uncertain = self.uncertain, self.uncertain or bool(branches)
            rest = [e for x in node.otherwise or () for e in self._equations(x, scope)]
            self.uncertain = before
        for truth, branch in reversed(branches):
            if len(branch) != len(rest):
                raise ModelicaError(f"the branches have {len(branch)} and {len(rest)} equations", node.at)
            if not all(isinstance(e, ScalarEquation) for e in (*branch, *rest)):
                then, other = (self._plain(x, "a branch") if not _ifs(x) else x for x in (branch, rest))
                rest = [ScalarIf(truth, (t,), (o,), node.at) for t, o in zip(then, other, strict=True)]
                if not all(isinstance(e, ScalarEquation) for x in rest for e in (*x.then, *x.otherwise)):
                    raise ModelicaError("elseif between equations is not supported; write an if-expression", node.at)
                continue
            if all(t.left is o.left or _same(t.left, o.left) for t, o in zip(branch, rest, strict=True)):
                rest = [ScalarEquation(t.left, operation("if", (truth, t.right, o.right), node.at), t.at)
                        for t, o in zip(branch, rest, strict=True)]  # fmt: skip
            else:
                rest = [ScalarIf(truth, (t,), (o,), t.at) for t, o in zip(branch, rest, strict=True)]
        return rest

    def _call(self, node: Calls, scope: NameScope) -> list[Any]:
        expression = node.expression
        if not isinstance(expression, FunctionCall):
            relation = "; a relation is only allowed in a constraint section" if isinstance(expression, Binary) else ""
            raise ModelicaError(f"this is not an equation: it has no '='{relation}", node.at)
        name = str(expression.reference)
        if name == "assert" and self.uncertain:
            self.model.warn("this assert() is under a condition of variables; it is not monitored", node.at)
            return []
        if name == "assert":
            return watched(expression, scope, self.model)
        if name.startswith("Connections."):
            raise ModelicaError(f"{name}() is for overdetermined connectors, which are not supported", node.at)
        if name in ("reinit", "terminate"):
            raise ModelicaError(f"{name}() is only allowed in a when clause", node.at)
        raise ModelicaError(f"a call of {name}() alone is not an equation; it has no '='", node.at)

    def _constraints(self, node: SyntaxNode, scope: NameScope) -> list[ScalarEquation]:
        if isinstance(node, Equal):
            return self._equal(node, scope)
        if isinstance(node, For):
            return [e for s in self.model.loops(node.loops, scope, node.body) for x in node.body
                    for e in self._constraints(x, s)]  # fmt: skip
        if isinstance(node, If):
            for condition, body in node.branches:
                truth = self.model.truth(condition, scope)
                if not isinstance(truth, bool):
                    raise ModelicaError(
                        f"the condition of a constraint must contain parameters only; found {_moving(truth)}",
                        condition.at,
                    )
                if truth:
                    return [e for x in body for e in self._constraints(x, scope)]
            return [e for x in node.otherwise or () for e in self._constraints(x, scope)]
        if isinstance(node, Calls) and isinstance(node.expression, Binary):
            e = node.expression
            if e.operator in ("<=", ">=", "<", ">"):
                a, b = self.model.array(e.left, scope), self.model.array(e.right, scope)
                same_shape(a, b, e.operator, node.at, scalars=True)
                relation = e.operator if e.operator.endswith("=") else f"{e.operator}="
                relations: Any = each(lambda x, y: Operation("pair", (x, y), node.at), a, b)
                pairs: list[Any] = [pair.arguments for pair in entries(relations)]
                return [ScalarEquation(x, y, node.at, relation) for x, y in pairs]
        raise ModelicaError("a constraint must be an equation, or a relation with <= or >=", node.at)

    # the whole class

    def _bounded(self) -> None:
        """Raises ModelicaError for an expression with more than MOST_OPERATIONS operations."""
        for e in (*self.out.equations, *self.out.initial, *self.out.constraints):
            if any(sum(1 for _ in operations(x)) > MOST_OPERATIONS for x in sides(e)):
                raise ModelicaError(TOO_LONG, e.at)

    def _header(self) -> None:
        for name, header_value in self.root.header.items():
            value = self.model.given(header_value)
            if not isinstance(value, np.ndarray) or value.shape:
                raise ModelicaError(f"{name} must be a scalar", header_value.node.at)
            entry = value[()]
            attribute = "." in name or name.endswith("Time") or name == "static"
            if attribute and not is_literal(entry):
                if not is_constant(entry):
                    raise ModelicaError(f"{name} must depend on parameters only", header_value.node.at)
                entry = number_of(entry, header_value.node.at, name)
            if name == "static":
                if not isinstance(entry, bool):
                    raise ModelicaError(f"static must be true or false; found {entry}", header_value.node.at)
                self.out.static = entry
                continue
            if name.endswith(".free") and not isinstance(entry, bool):
                raise ModelicaError(f"{name} must be true or false; found {entry}", header_value.node.at)
            if is_literal(entry) and not name.endswith(".free") and not is_number(entry):
                raise ModelicaError(f"{name} must be a number; found {str(entry)!r}", header_value.node.at)
            self.out.header[name] = entry
            self.out.header_at[name] = header_value.node.at

    def _annotated(self, annotation: Modification, scope: NameScope) -> None:
        """Read `__gtmodel(branch(ahead = x))`: the sign of an expression that selects a solution branch."""
        for argument in annotation.arguments:
            items = argument.modification.arguments if argument.modification is not None else []
            if argument.name != ("__gtmodel",):
                continue
            if not items:
                raise ModelicaError("__gtmodel needs branch(name = expression)", argument.at)
            for item in items:
                if item.name != ("branch",) or item.modification is None or not item.modification.arguments:
                    raise ModelicaError(f"__gtmodel needs branch(name = expression); found {item.name[0]}", item.at)
                for one in item.modification.arguments:
                    if one.modification is None or one.modification.value is None:
                        raise ModelicaError(f"the branch '{one.name[0]}' has no expression", one.at)
                    value = self.model.one(one.modification.value, scope)
                    assert scope.instance is not None
                    name = scope.instance.full(one.name[0]).replace("'", "")
                    self.out.branches.append((name, value, one.at))


def _name(name: str, at: Place) -> Reference:
    from .syntax import ReferencePart

    return Reference(at, (ReferencePart(name, None),))


def _moving(x: Any) -> str:
    """What in a condition is no parameter."""
    names = [f"'{f.name}'" for f in symbols(x) if f.kind not in ("parameter", "constant")]
    names += [o.name for o in operations(x) if o.name in ("time", "der")]
    return ", ".join(dict.fromkeys(names)) or "a value that is chosen by the optimisation"


def _ifs(items: Sequence[Any]) -> bool:
    return all(isinstance(e, (ScalarIf, ScalarEquation)) for e in items)


def _same(a: Any, b: Any) -> bool:
    """True if two expressions are the same operations on the same variables."""
    pairs, visited = [(a, b)], set[tuple[int, int]]()
    while pairs:
        x, y = pairs.pop()
        if (id(x), id(y)) in visited:
            continue
        visited.add((id(x), id(y)))
        if isinstance(x, Symbol) and isinstance(y, Symbol):
            if x.flat is not y.flat:
                return False
        elif isinstance(x, Operation) and isinstance(y, Operation):
            if x.name != y.name or len(x.arguments) != len(y.arguments):
                return False
            pairs += zip(x.arguments, y.arguments, strict=True)
        else:
            return False
    return True
