"""Evaluation of expressions to arrays of scalars: names resolved, arrays expanded, functions inlined, dependent
parameters substituted, structural parameters replaced by numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._near import near
from . import builtin, functions
from .arrays import RecordValue, Values, array, chained, each, entries, matrix_of, negative, scalar, stacked
from .functions import Eventless
from .instances import FieldOf, Instance, NameScope
from .members import constant, declares, field, member, shown
from .modifications import Given
from .scalars import (
    EnumerationLiteral,
    Flat,
    Operation,
    Symbol,
    is_literal,
    is_number,
    number_of,
    operation,
    ordered,
    value_of,
    whole,
)
from .scopes import LANGUAGE, Space
from .syntax import (
    Array,  # fmt: skip
    Binary,
    Colon,
    Comprehension,
    Conditional,
    EndIndex,
    FunctionArgument,
    FunctionCall,
    Literal,
    Loop,
    Matrix,
    ModelicaError,
    Outputs,
    Place,
    Range,
    Reference,
    ReferencePart,
    SyntaxNode,
    Unary,
)

MOST_OPERATIONS = 100_000  # operations of one expression
TOO_LONG = "this expression is too long; split it into several equations"


class Resolver:
    """Rewrites expressions in variables, declared parameters and numbers only; shared parts stay shared."""

    def __init__(self) -> None:
        self._known: dict[int, Any] = {}
        self._busy: list[Flat] = []

    def __call__(self, x: Any, at: Place) -> Any:
        """Raises ModelicaError for a parameter that depends on itself, and for an expression that is too deep."""
        try:
            for inner in ordered(x):  # inner ones first, so that recursion is shallow
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
            return x  # settle_events replaces it; the variable may depend on it
        key = id(x)
        if key not in self._known:
            arguments = tuple(map(self._resolved, x.arguments))
            if x.name == "der" and is_literal(arguments[0]):
                result: Any = 0
            elif all(a is b for a, b in zip(arguments, x.arguments, strict=True)):
                result = x
            else:
                result = operation(x.name, arguments, x.at)
            self._known[key] = (x, result)  # x stays alive, so that its id stays unique
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
    """True if a scalar is declared in the class; constants, structural and dependent parameters are not."""
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


LONGEST = 1_000_000  # entries of a range
MOST = 2_000_000  # work units of one model: entries, loop iterations, calls and components
_CHAINS = (("+", "-"), ("*",), ("and",), ("or",))  # associative operators
_HORIZON = {"startTime": "start_time", "finalTime": "final_time"}


class Evaluator:
    """Evaluates expressions during flattening; has the warnings and work counters of one model."""

    def __init__(self) -> None:
        self.warnings: list[str] = []
        self.horizon = False  # an optimization, which has startTime and finalTime
        self.calls = 0  # current depth of nested function calls
        self.spent = 0
        self._eventless = Eventless()

    def warn(self, sentence: str, place: Place) -> None:
        """Add a warning, once for each place."""
        text = f"{sentence} ({place.where})"
        if text not in self.warnings:
            self.warnings.append(text)

    def spend(self, count: int, place: Place) -> None:
        """Count work units. Raises ModelicaError beyond MOST, which bounds memory and time."""
        self.spent += count
        if self.spent > MOST:
            raise ModelicaError(
                "this model is too large: it has too many components, array entries, loop iterations or calls",
                place,
            )

    @staticmethod
    def is_colon(node: SyntaxNode) -> bool:
        return isinstance(node, Colon)

    def given(self, given: Given) -> Any:
        """Return the value of a modification in its scope, for one component of an array the entry for it."""
        node = given.node
        if isinstance(node, FieldOf):
            value = field(self.given(node.given), node.name, node.at)
        else:
            value = self.evaluate(node, given.scope)
        if given.indices and isinstance(value, np.ndarray) and value.shape and not given.each:
            if value.shape[: len(given.sizes)] != given.sizes:
                raise ModelicaError(
                    f"a value of shape {value.shape} has no entry for each component; write each to give all one value",
                    node.at,
                )
            value = value[given.indices]
            if not isinstance(value, np.ndarray):
                value = value if isinstance(value, (RecordValue, Instance)) else scalar(value)
        return value

    def array(self, node: SyntaxNode, scope: NameScope) -> Values:
        """Return the value of an expression as an array. Raises ModelicaError for a record or component."""
        value = self.evaluate(node, scope)
        if not isinstance(value, np.ndarray):
            raise ModelicaError("expected numbers; found a record or a component", node.at)
        if value.size and isinstance(value.ravel()[0], (Instance, RecordValue)):
            raise ModelicaError("expected numbers; found components", node.at)
        return value

    def one(self, node: SyntaxNode, scope: NameScope) -> Any:
        """Return the value of a scalar expression. Raises ModelicaError for an array."""
        value = self.array(node, scope)
        if value.shape:
            raise ModelicaError(f"expected a scalar; found an array of shape {value.shape}", node.at)
        return value[()]

    def number(self, node: SyntaxNode, scope: NameScope, purpose: str) -> Any:
        """Return the value of an expression that must be known at translation; purpose: its name for error messages."""
        return number_of(self.one(node, scope), node.at, purpose)

    def whole(self, node: SyntaxNode, scope: NameScope, purpose: str) -> int:
        value = self.number(node, scope, purpose)
        if isinstance(value, EnumerationLiteral):
            return value.position
        if isinstance(value, bool) or not is_number(value) or not np.isfinite(value) or value != int(value):
            raise ModelicaError(f"{purpose} must be an Integer; found {value}", node.at)
        return int(value)

    def evaluate(self, node: SyntaxNode, scope: NameScope) -> Any:
        """Return the value of an expression: an array of scalars, a RecordValue, or an Instance."""
        if isinstance(node, Literal):
            return scalar(node.value)
        if isinstance(node, Reference):
            return self.reference(node, scope)
        if isinstance(node, Binary):
            return self.binary(node, scope)
        if isinstance(node, Unary):
            value = self.array(node.operand, scope)
            if node.operator == "not":
                return each(lambda x: operation("not", (x,), node.at), value)
            return negative(value, node.at) if node.operator in ("-", ".-") else value
        if isinstance(node, FunctionCall):
            return self.call(node, scope)
        if isinstance(node, Conditional):
            return self.conditional(node, scope)
        if isinstance(node, Array):
            return stacked([self.evaluate(item, scope) for item in node.items], node.at)
        if isinstance(node, Comprehension):
            return self.comprehended(node.item, node.loops, scope, node.at)
        if isinstance(node, Matrix):
            return matrix_of([[self.array(x, scope) for x in row] for row in node.rows], node.at)
        if isinstance(node, Range):
            return self.range(node, scope)
        if isinstance(node, EndIndex):
            if "end" not in scope.locals:
                raise ModelicaError("'end' is an index and can only be used in subscripts", node.at)
            return scope.locals["end"]
        if isinstance(node, Outputs):
            raise ModelicaError("a list of values in parentheses can only be the left side of a function call", node.at)
        if isinstance(node, FunctionArgument):
            raise ModelicaError("functional input arguments are not supported", node.at)
        raise ModelicaError(f"{type(node).__name__.lower()} is not supported here", node.at)

    def binary(self, node: Binary, scope: NameScope) -> Values:
        """Return the value of a chain a + b - c + ..., not recursive along the chain."""
        alike = next((x for x in _CHAINS if node.operator in x), (node.operator,))
        chain = [node]
        while isinstance(left := chain[-1].left, Binary) and left.operator in alike:
            chain.append(left)
        terms: list[tuple[str, Values, Place | None]] = []
        for one in reversed(chain):
            for side in (one.left, one.right) if not terms else (one.right,):
                value = self.evaluate(side, scope)
                if not isinstance(value, np.ndarray):
                    raise ModelicaError(f"'{one.operator}' needs numbers; found a record", one.at)
                terms.append((one.operator, value, one.at))
            a, b = terms[-2][1], terms[-1][1]
            if a.ndim and b.ndim:
                self.spend(int(a.size * b.size / max(1, a.shape[-1])), one.at)
        return chained(terms)

    def conditional(self, node: Conditional, scope: NameScope) -> Values:
        branches: list[tuple[Any, Values]] = []
        for condition, value in node.branches:
            truth = self.truth(condition, scope)
            if truth is True:
                last = self.array(value, scope)
                break
            if truth is not False:
                branches.append((truth, self.array(value, scope)))
        else:
            last = self.array(node.otherwise, scope)
        for truth, value in reversed(branches):
            if value.shape != last.shape:
                raise ModelicaError(f"the branches have shapes {value.shape} and {last.shape}", node.at)
            last = each(lambda a, b, c=truth: self.chosen(c, a, b, node.at), value, last)
        return last

    def chosen(self, condition: Any, then: Any, otherwise: Any, at: Place) -> Any:
        """Return an if-expression of two scalars; in a function of a simulation without an event if that is safe."""
        if self.calls and not self.horizon:
            return self._eventless.chosen(condition, then, otherwise, at)
        return operation("if", (condition, then, otherwise), at)

    def truth(self, node: SyntaxNode, scope: NameScope) -> Any:
        """Return True or False if a condition depends on parameters only, otherwise the condition."""
        from .scalars import is_constant

        condition = self.one(node, scope)
        if not is_literal(condition) and is_constant(condition):
            condition = number_of(condition, node.at, "a condition")
        if is_literal(condition) and not isinstance(condition, bool):
            raise ModelicaError(f"a condition must be Boolean; found {condition}", node.at)
        return condition

    def loops(self, loops: list[Loop], scope: NameScope, body: list[Any]) -> list[NameScope]:
        """Return the scopes of all iterations of a for loop, the first iterator outermost."""
        scopes = [scope]
        for loop in loops:
            following = []
            for inside in scopes:
                if loop.over is None:
                    raise ModelicaError(f"'{loop.name}' needs a range: for {loop.name} in 1:n", loop.at)
                over = self.array(loop.over, inside)
                if over.ndim != 1:
                    raise ModelicaError(f"'{loop.name}' must iterate over a vector; found shape {over.shape}", loop.at)
                self.spend(4 * over.size, loop.at)
                following += [inside.inner({loop.name: scalar(x)}) for x in over]
            scopes = following
        return scopes

    def comprehended(self, item: SyntaxNode, loops: list[Loop], scope: NameScope, at: Place) -> Any:
        if len(loops) > 1:  # the last iterator is the first dimension
            *rest, last = loops
            return stacked([self.comprehended(item, rest, s, at) for s in self.loops([last], scope, [])], at)
        return stacked([self.evaluate(item, s) for s in self.loops(loops, scope, [])], at)

    def range(self, node: Range, scope: NameScope) -> Values:
        start, stop = (self.number(x, scope, "the end of a range") for x in (node.start, node.stop))
        if isinstance(start, EnumerationLiteral) and isinstance(stop, EnumerationLiteral):
            return array([EnumerationLiteral(start.type_name, "", n) for n in range(start.position, stop.position + 1)],
                         (stop.position - start.position + 1,))  # fmt: skip
        step = 1 if node.step is None else self.number(node.step, scope, "the step of a range")
        if isinstance(start, EnumerationLiteral) or not all(map(is_number, (start, step, stop))) or step == 0:
            raise ModelicaError(f"a range needs numbers and a nonzero step; found {start}:{step}:{stop}", node.at)
        steps = (stop - start) / step * (1 + 1e-14) + 1e-9
        if steps > LONGEST:
            raise ModelicaError(f"a range of {steps:.3g} entries is too long; at most {LONGEST} is supported", node.at)
        count = max(0, int(np.floor(max(steps, -1.0))) + 1)
        return array([start + step * k for k in range(count)], (count,))

    # names

    def reference(self, node: Reference, scope: NameScope) -> Any:
        first, *rest = node.parts
        value = None if node.absolute else self.first(first, node, scope)
        if value is None:
            return self.constant(node, scope)
        value = self.subscripted(value, first, scope, node.at)
        if isinstance(value, np.ndarray) and value.shape == () and value[()] is None:
            raise ModelicaError(f"'{first.name}' is used before it is assigned", node.at)
        for part in rest:
            outer = (
                value.ndim if isinstance(value, np.ndarray) else 0
            )  # for an array of components: subscripts of the element
            value = self.subscripted(shown(value, part.name, node.at), part, scope, node.at, outer)
        return value

    def first(self, part: ReferencePart, node: Reference, scope: NameScope) -> Any:
        """Return a local name, a component of the instance, or a built-in variable such as time; otherwise None."""
        name = part.name
        if name in scope.locals:
            value = scope.locals[name]
            whole = isinstance(value, np.ndarray) and part.subscripts is None
            if whole and any(x is None for x in entries(value)):
                raise ModelicaError(f"'{name}' is used before it is assigned", node.at)
            return value
        if scope.instance is not None and scope.holds(name):
            return member(scope.instance, name, node.at)
        if len(node.parts) == 1:
            if name == "time":
                return scalar(Operation("time", (), node.at))
            if self.horizon and name in _HORIZON:
                return scalar(Operation(_HORIZON[name], (), node.at))
        return None

    def constant(self, node: Reference, scope: NameScope) -> Any:
        """Return a constant of an enclosing class, or of the package that a dotted name names."""
        names = [p.name for p in node.parts]
        space: Space | None = scope.space.root if node.absolute else scope.space
        begin = 0
        while space is not None and not node.absolute:
            if declares(space, names[0]):
                return self.walk(constant(space, names[0], node.at, self), node, 0, scope)
            for item in space.text.imports:
                if item.name == names[0] and (reached := self.of_import(item.reference, node, scope)) is not None:
                    return reached
            packages = [space.root.absolute(i.reference) for i in space.text.imports if not i.name]
            holders = [encapsulated for encapsulated in packages if declares(encapsulated, names[0])]
            if len({id(encapsulated.text) for encapsulated in holders}) > 1:
                raise ModelicaError(f"'{names[0]}' is imported from several packages", node.at)
            if holders:
                return self.walk(constant(holders[0], names[0], node.at, self), node, 0, scope)
            if (further := space.member(names[0]) or space.imported(names[0])) is not None:
                space, begin = further, 1
                break
            encapsulated = "encapsulated" in space.text.prefixes
            space = space.outer if not encapsulated else space.root if names[0] in LANGUAGE and space.outer else None
        if space is None:
            raise ModelicaError(f"there is no '{names[0]}'{near(names[0], self.names(scope))}", node.at)
        for n in range(begin, len(names)):
            if space.text.literals is not None:
                return self.literal(space, names[n], node.at)
            if declares(space, names[n]):
                return self.walk(constant(space, names[n], node.at, self, n > 0), node, n, scope)
            following = space.member(names[n])
            if following is None:
                raise ModelicaError(f"{space.name or 'the text'} has no '{names[n]}'", node.at)
            space = following
        raise ModelicaError(f"{space.name} is a {space.text.restriction}, not a value", node.at)

    def of_import(self, reference: Reference, node: Reference, scope: NameScope) -> Any:
        """Return a constant that is imported by its full name; None if the import names a class."""
        holder = Reference(reference.at, reference.parts[:-1], True)
        space = scope.space.root.absolute(holder)
        if not declares(space, reference.parts[-1].name):
            return None
        return self.walk(constant(space, reference.parts[-1].name, node.at, self), node, 0, scope)

    def walk(self, value: Any, node: Reference, begin: int, scope: NameScope) -> Any:
        value = self.subscripted(value, node.parts[begin], scope, node.at)
        for part in node.parts[begin + 1 :]:
            outer = (
                value.ndim if isinstance(value, np.ndarray) else 0
            )  # for an array of components: subscripts of the element
            value = self.subscripted(shown(value, part.name, node.at), part, scope, node.at, outer)
        return value

    @staticmethod
    def literal(space: Space, name: str, at: Place) -> Values:
        literals = space.text.literals or []
        if name not in literals:
            raise ModelicaError(f"{space.name} has no '{name}'{near(name, literals)}", at)
        return scalar(EnumerationLiteral(space.name, name, literals.index(name) + 1))

    def names(self, scope: NameScope) -> list[str]:
        components = list(scope.instance.elements) if scope.instance is not None else []
        return [*components, *scope.locals, *scope.space.names(), "time", *(_HORIZON if self.horizon else ())]

    def subscripted(self, value: Any, part: ReferencePart, scope: NameScope, at: Place, axis: int = 0) -> Any:
        if part.subscripts is None:
            return value
        if not isinstance(value, np.ndarray) or len(part.subscripts) > value.ndim - axis:
            shape = value.shape[axis:] if isinstance(value, np.ndarray) else ()
            description = f"has shape {shape}" if shape else "is not an array"
            raise ModelicaError(f"'{part.name}' {description}; found {len(part.subscripts)} subscripts", at)
        for subscript, size in zip(part.subscripts, value.shape[axis:], strict=False):
            if isinstance(subscript, Colon):
                axis += 1
                continue
            places = self.array(subscript, scope.inner({"end": scalar(size)}))
            if places.ndim > 1:
                raise ModelicaError(
                    f"a subscript must be a scalar or a vector; found shape {places.shape}", subscript.at
                )
            indices = [self._position(x, size, part.name, subscript) for x in entries(places)]
            value = np.take(value, indices if places.shape else indices[0], axis=axis)
            if not isinstance(value, np.ndarray):
                value = value if isinstance(value, (Instance, RecordValue)) else scalar(value)
            axis += 1 if places.shape else 0
        if isinstance(value, np.ndarray) and value.shape == () and isinstance(value[()], (Instance, RecordValue)):
            return value[()]
        return value

    @staticmethod
    def _position(x: Any, size: int, name: str, node: SyntaxNode) -> int:
        n = number_of(x, node.at, f"a subscript of '{name}'")
        n = n.position if isinstance(n, EnumerationLiteral) else int(n) + 1 if isinstance(n, bool) else n
        if not is_number(n) or n != int(n):
            raise ModelicaError(f"a subscript of '{name}' must be an Integer; found {n}", node.at)
        if not 1 <= n <= size:
            raise ModelicaError(f"a subscript of '{name}' must be from 1 to {size}; found {n}", node.at)
        return int(n) - 1

    # calls

    def call(self, node: FunctionCall, scope: NameScope) -> Any:
        name = str(node.reference)
        single = len(node.reference.parts) == 1 and not node.reference.absolute
        if node.loops is not None:
            items = self.comprehended(node.arguments[0], node.loops, scope, node.at)
            return builtin.reduced(name, items, node.at, len(node.loops))
        if self.horizon and (value := self._component(node.reference, scope)) is not None:
            return self.instant(value, node, scope)
        if single and name in builtin.BUILT_IN:
            declared = scope.space.lookup(name)  # the text may declare a function of this name
            if declared is None or not declared.text.restriction.endswith("function"):
                return builtin.called(name, node, scope, self)
        space = self.function(node.reference, scope, node)
        full_name = space.name
        if full_name.startswith("Modelica.Math.") and (
            builtin_name := builtin.MATHEMATICAL.get(full_name.removeprefix("Modelica.Math."))
        ):
            return builtin.called(builtin_name, node, scope, self)
        if space.text.restriction.endswith("record"):
            return functions.constructed(space, node, scope, self)
        if not space.text.restriction.endswith("function"):
            raise ModelicaError(f"{name} is a {space.text.restriction}, not a function", node.at)
        return functions.called(space, node, scope, self)

    def _component(self, reference: Reference, scope: NameScope) -> Any:
        """Return the variable x of `x(finalTime)`; None if the reference names a function."""
        name = reference.parts[0].name
        if name in scope.locals or scope.holds(name):
            return self.reference(reference, scope)
        return None

    def instant(self, value: Any, node: FunctionCall, scope: NameScope) -> Values:
        if not isinstance(value, np.ndarray) or len(node.arguments) != 1 or node.named:
            raise ModelicaError(f"the value of '{node.reference}' at an instant needs one time: x(finalTime)", node.at)
        time = self.one(node.arguments[0], scope)
        return each(lambda x: Operation("at", (x, time), node.at), value)

    def function(self, reference: Reference, scope: NameScope, node: FunctionCall | None = None) -> Space:
        try:
            return scope.space.find(reference)
        except ModelicaError as error:
            name = reference.parts[0].name
            if len(reference.parts) > 1 or scope.space.lookup(name) is not None:
                raise
            close = near(name, [*builtin.BUILT_IN, *scope.space.names()])
            if self.horizon and scope.instance is not None and _is_instant(node):
                close = near(name, scope.instance.elements) or close
                raise ModelicaError(f"there is no variable '{name}'{close}", error.place or reference.at) from None
            raise ModelicaError(f"there is no function '{name}'{close}", error.place or reference.at) from None


def _is_instant(node: FunctionCall | None) -> bool:
    """Does a call look like the value of a variable at an instant, `x(finalTime)`?"""
    given = node.arguments if node is not None and not node.named else []
    return len(given) == 1 and isinstance(given[0], Reference) and str(given[0]) in _HORIZON
