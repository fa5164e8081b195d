"""Events of a flattened model in the forms of gtmodel: discrete variables for pre() and for functions such as floor(),
and expressions in place of Boolean variables."""

from __future__ import annotations

import math
from typing import Any

from ..constraints import Flattened, ScalarEquation, ScalarIf, ScalarWhen, WhenBranch
from ..expressions import Resolver, is_declared
from ..scalars import (
    EnumerationLiteral,
    Flat,
    Operation,
    Symbol,
    extent,
    is_constant,
    is_literal,
    number_of,
    operation,
    operations,
    symbols,
    value_of,
)
from ..syntax import ModelicaError, Place
from .instants import settle_instants


def settle_macros(out: Flattened) -> None:
    """Set `replaced` of Boolean, String and enumeration variables to their defining expression, except discrete ones.

    Raises ModelicaError for a variable without such an equation, or with two.
    """
    set_by_events = {id(a.left.flat) for e in out.equations if isinstance(e, ScalarWhen) for a in e.actions}
    for flat in out.flats:
        if flat.kind == "discrete" and id(flat) not in set_by_events:
            flat.kind = "variable"  # declared discrete, but defined by an equation
    kept: list[Any] = []
    waiting: list[ScalarEquation] = []
    for e in out.equations:
        if isinstance(e, ScalarEquation) and (_stands(e.left) or _stands(e.right)):
            waiting.append(e)
        else:
            kept.append(e)
    while waiting:
        later: list[ScalarEquation] = []
        for e in waiting:
            left, right = _open(e.left), _open(e.right)
            if left and right:
                later.append(e)
            elif left:
                e.left.flat.replaced = e.right
            elif right:
                e.right.flat.replaced = e.left
            else:
                name = (e.left if _stands(e.left) else e.right).flat.name
                raise ModelicaError(f"'{name}' has two equations", e.at)
        if len(later) == len(waiting):
            flat = later[0].left.flat
            raise ModelicaError(f"'{flat.name}' is {flat.base} and has no equation {flat.name} = ...", flat.at)
        waiting = later
    out.equations = kept
    for flat in out.flats:
        if _of_values(flat) and flat.replaced is None and flat.kind == "variable":
            raise ModelicaError(f"'{flat.name}' is {flat.base} and has no equation {flat.name} = ...", flat.at)


def _of_values(flat: Flat) -> bool:
    return flat.base not in ("Real", "Integer")


def _stands(x: Any) -> bool:
    """True for a Boolean, String or enumeration variable, replaced by an expression or set by events."""
    return isinstance(x, Symbol) and _of_values(x.flat) and x.flat.kind in ("variable", "input", "discrete")


def _open(x: Any) -> bool:
    return _stands(x) and x.flat.kind != "discrete" and x.flat.replaced is None


_RELATIONS = ("<", "<=", ">", ">=")
LONGEST_NAME = 200  # size of an expression in the name of a variable of gtmodel
_WHOLE = ("floor", "ceil", "integer", "mod", "div", "rem")
_OF_WHOLE = ("+", "-", "*", "neg", "min", "max", "abs", "pre", "mod", "rem")  # Integer for Integer arguments
_LOGICAL = (*_RELATIONS, "==", "<>", "and", "or", "not", "initial", "sample", "edge", "change")


def settle_events(out: Flattened) -> None:
    """Rewrite events in the forms of gtmodel. Raises ModelicaError for events that it cannot follow exactly."""
    sides = [x for e in out.equations if isinstance(e, ScalarEquation) for x in (e.left, e.right)]
    eventful = any(isinstance(e, (ScalarWhen, ScalarIf)) for e in out.equations)
    eventful = eventful or any(f.replaced is not None for f in out.flats)
    if eventful or any(_speaks(o) for x in sides for o in operations(x)):
        _Settling(out).run()


def _speaks(o: Operation) -> bool:
    return o.name in (*_WHOLE, *_LOGICAL, "if", "pre")


class _Settling:
    def __init__(self, out: Flattened) -> None:
        self.out = out
        self.resolved = Resolver()
        self.memories: dict[int, Flat] = {}
        self.wholes: dict[str, Flat] = {}
        self.whens: list[ScalarWhen] = []
        self._known: dict[int, tuple[Any, Any]] = {}
        self._conditions_known: dict[int, tuple[Any, Any]] = {}
        self._values: dict[int, tuple[Any, Any]] = {}
        self._initial: Flat | None = None

    def run(self) -> None:
        out = self.out
        out.text = list(out.flats), list(out.equations), list(out.initial)
        self._starts()
        equations: list[Any] = []
        for e in out.equations:
            if isinstance(e, ScalarEquation):
                equations.append(self._equation(e))
            elif isinstance(e, ScalarIf):
                condition = self.condition(self.resolved(e.condition, e.at), e.at)
                then, other = (tuple(self._equation(x) for x in side) for side in (e.then, e.otherwise))
                if isinstance(condition, bool):
                    equations += then if condition else other
                else:
                    equations.append(ScalarIf(condition, then, other, e.at))
            elif (when := self._when(e)) is not None:
                equations.append(when)
        for flat in list(out.flats):  # a Boolean with memory is in results, whether it is read or not
            remembers = flat.base == "Boolean" and any(o.name == "pre" for o in operations(flat.replaced))
            if remembers and id(flat) not in self.memories:
                self._remember(flat)
        out.equations = [*equations, *self.whens]
        out.initial = [ScalarEquation(self.now(e.left, e.at), self.now(e.right, e.at), e.at) for e in out.initial]
        settle_instants(out, {id(f) for f in self.memories.values()})
        if not any(f.kind == "variable" and is_declared(f) for f in out.flats):
            clock = Flat("clock", "variable", "Real", out.at, lambda _: None, lambda: None, description="time")
            out.flats.append(clock)  # a model with events only has no continuous variable
            out.equations.append(ScalarEquation(Symbol(clock), Operation("time", (), out.at), out.at))

    def _starts(self) -> None:
        """Use initial equations of discrete variables as start values, or as actions at the start if not constant."""
        kept: list[ScalarEquation] = []
        actions: list[ScalarEquation] = []
        for e in self.out.initial:
            x = e.left.arguments[0] if isinstance(e.left, Operation) and e.left.name == "pre" else e.left
            if not isinstance(x, Symbol) or (x.flat.kind != "discrete" and x is e.left):
                kept.append(e)
                continue
            right = self.resolved(e.right, e.at)
            if is_constant(right):
                x.flat.cache["start"] = number_of(right, e.at, f"the start of '{x.flat.name}'")
            elif x.flat.kind == "discrete":
                x.flat.cache["start"] = self._at_start(right)
                actions.append(ScalarEquation(x, self.value(right, e.at), e.at))
            else:
                raise ModelicaError(
                    f"the initial value of pre({x.flat.name}) must be a number; write a when initial() clause", e.at
                )
        self.out.initial = kept
        if actions:
            at = actions[0].at
            self.whens.append(
                ScalarWhen((WhenBranch(Operation("initial", (), at), tuple(actions), (), None, at),), at, True)
            )

    def _equation(self, e: ScalarEquation) -> ScalarEquation:
        return ScalarEquation(self.now(e.left, e.at), self.now(e.right, e.at), e.at, e.relation)

    # continuous expressions

    def now(self, x: Any, at: Place) -> Any:
        """Rewrite an expression outside of actions; pre() is the value at the begin of this iteration of the event."""
        x = self.resolved(x, at)
        if not any(map(_speaks, operations(x))):
            return x
        return self._now(x, at)

    def _now(self, x: Any, at: Place) -> Any:
        if not isinstance(x, Operation):
            return x
        key = id(x)
        if key not in self._known:
            self._known[key] = x, self._now_of(x, x.at or at)
        return self._known[key][1]

    def _now_of(self, x: Operation, at: Place) -> Any:
        if x.name == "pre":
            return self._memory(x.arguments[0], at)
        if x.name == "if":
            condition = self.condition(x.arguments[0], at)
            return operation("if", (condition, *(self._now(a, at) for a in x.arguments[1:])), at)
        if x.name in _LOGICAL:
            raise ModelicaError("expected a number; found a condition", at)
        arguments = tuple(self._now(a, at) for a in x.arguments)
        if x.name in _WHOLE:
            return self._whole(x.name, arguments, at)
        return x if all(a is b for a, b in zip(arguments, x.arguments, strict=True)) else operation(
            x.name, arguments, x.at)  # fmt: skip

    def condition(self, x: Any, at: Place) -> Any:
        """Rewrite a resolved condition to relations of numbers, and, or, not, initial, sample, True or False."""
        if not isinstance(x, Operation):
            return self._condition(x, at)
        if id(x) not in self._conditions_known:
            self._conditions_known[id(x)] = x, self._condition(x, at)
        return self._conditions_known[id(x)][1]

    def _condition(self, x: Any, at: Place) -> Any:
        if isinstance(x, bool):
            return x
        if isinstance(x, Symbol):
            return self._is_true(x, at)
        if not isinstance(x, Operation):
            raise ModelicaError(f"a condition must be Boolean; found {x}", at)
        at = x.at or at
        if x.name in _RELATIONS:
            return operation(x.name, tuple(self._now(a, at) for a in x.arguments), at)
        if x.name in ("and", "or", "not"):
            return operation(x.name, tuple(self.condition(a, at) for a in x.arguments), at)
        if x.name in ("==", "<>"):
            same = self._same(x.arguments[0], x.arguments[1], at)
            return same if x.name == "==" else operation("not", (same,), at)
        if x.name == "if":
            chosen, then, other = (self.condition(a, at) for a in x.arguments)
            sides = operation("and", (chosen, then), at), operation("and", (_no(chosen, at), other), at)
            return operation("or", sides, at)
        if x.name == "pre":
            return self._is_true(self._memory(x.arguments[0], at), at)
        if x.name == "initial":
            return Operation(">=", (self._initially(), 0.5), at)
        if x.name == "sample":
            return x
        if x.name in ("edge", "change"):
            raise ModelicaError(f"{x.name}() is only supported as the whole condition of a when clause", at)
        raise ModelicaError(f"a condition must be Boolean; found {x.name}()", at)

    @staticmethod
    def _is_true(x: Any, at: Place) -> Any:
        variable = x.arguments[0] if isinstance(x, Operation) and x.name == "earlier" else x
        if isinstance(variable, Symbol):
            if variable.flat.base != "Boolean":
                raise ModelicaError(f"'{variable.flat.name}' is {variable.flat.base}; a condition must be Boolean", at)
            if variable.flat.kind == "input":
                raise ModelicaError(f"'{variable.flat.name}' is a Boolean input; only Real inputs are supported", at)
            return Operation(">=", (x, 0.5), at)
        return x

    def _same(self, a: Any, b: Any, at: Place) -> Any:
        """Return the condition that two Boolean, Integer or enumeration expressions are equal."""
        if all(map(_is_boolean, (a, b))):
            a, b = (self.condition(x, at) for x in (a, b))
            both, none = operation("and", (a, b), at), operation("and", (_no(a, at), _no(b, at)), at)
            return operation("or", (both, none), at)
        if not all(map(_is_whole, (a, b))):
            raise ModelicaError("== and <> of Real variables are not allowed in events; write <= or >=", at)
        a, b = (_number(self._now(x, at)) for x in (a, b))
        above, below = operation("+", (b, 0.5), at), operation("-", (b, 0.5), at)
        return Operation("and", (Operation(">=", (a, below), at), Operation("<=", (a, above), at)), at)

    # pre()

    def _memory(self, x: Any, at: Place) -> Any:
        """Return pre() of a variable: for a discrete variable itself, otherwise its memory variable."""
        if is_literal(x):
            return x
        if isinstance(x, Symbol) and x.flat.kind in ("parameter", "constant"):
            return x
        while isinstance(x, Symbol) and isinstance(x.flat.replaced, Symbol):
            x = x.flat.replaced
        if isinstance(x, Symbol) and x.flat.kind == "discrete":
            return Operation("earlier", (x,), at)
        if not isinstance(x, Symbol) or (x.flat.base != "Integer" and x.flat.replaced is None):
            raise ModelicaError("pre() needs a variable that changes only at events", at)
        if id(x.flat) not in self.memories:
            self._remember(x.flat)
        return Symbol(self.memories[id(x.flat)])

    def _initially(self) -> Symbol:
        """Return a variable for initial() in other conditions: it starts at 1, and the initial event sets it to 0."""
        if self._initial is None:
            at = self.out.at
            self._initial = flat = Flat(
                "initial()", "discrete", "Integer", at, lambda _: None, lambda: None, helper=True,
                description="initial(): 1 at the event at the start, then 0",
            )  # fmt: skip
            flat.cache["start"] = 1
            self.out.flats.append(flat)
            action = ScalarEquation(Symbol(flat), 0.0, at)
            branch = WhenBranch(Operation("initial", (), at), (action,), (), None, at)
            self.whens.append(ScalarWhen((branch,), at, internal=True))
        return Symbol(self._initial)

    def _remember(self, flat: Flat) -> None:
        if flat.base not in ("Boolean", "Integer"):
            raise ModelicaError(f"pre() of '{flat.name}', which is {flat.base}, is not supported", flat.at)
        memory = Flat(
            flat.name if flat.base == "Boolean" else f"pre({flat.name})", "discrete", flat.base, flat.at,
            flat.attribute, lambda: None, helper=flat.base == "Integer",
            description=flat.description if flat.base == "Boolean" else f"{flat.name} before the event",
        )  # fmt: skip
        memory.cache["start"] = flat.get("start")
        flat.cache["fixed"] = None  # fixed concerns the initial value of pre()
        self.memories[id(flat)] = memory
        self.out.flats.append(memory)
        where = flat.at
        if flat.base == "Integer":
            current, previous = Symbol(flat), Symbol(memory)
            low, high = (Operation(sign, (previous, 0.5), where) for sign in "-+")
            conditions = [
                (Operation(">=", (current, high), where), current),
                (Operation("<=", (current, low), where), current),
            ]
        else:
            truth = self.condition(self.resolved(flat.replaced, flat.at), flat.at)
            if isinstance(truth, bool):
                memory.kind, memory.replaced = "constant", truth
                return
            conditions = [(truth, 1.0), (_no(truth, where), 0.0)]
        branches = [
            WhenBranch(c if not first else Operation("and", (Operation("initial", (), where), c), where),
                       (ScalarEquation(Symbol(memory), v, where),), (), None, where)
            for first in (True, False) for c, v in conditions
        ]  # fmt: skip
        self.whens.append(ScalarWhen(tuple(branches), where, internal=True))

    # floor() and related functions

    def _whole(self, name: str, arguments: tuple[Any, ...], at: Place) -> Any:
        """Return floor() or a related function by discrete variables that events count up and down."""
        if all(is_constant(x) for x in arguments):
            return Operation(name, arguments, at)
        if name in ("floor", "integer"):
            return self._floor(arguments[0], at)
        if name == "ceil":
            return operation("neg", (self._floor(_minus(arguments[0], at), at),), at)
        x, y = arguments
        quotient = operation("/", (x, y), at)
        if name == "mod":
            whole = self._floor(quotient, at)
            return operation("-", (x, operation("*", (whole, y), at)), at)
        up = operation("neg", (self._floor(_minus(quotient, at), at),), at)
        whole = Operation("if", (Operation(">=", (quotient, 0.0), at), self._floor(quotient, at), up), at)
        return whole if name == "div" else operation("-", (x, operation("*", (whole, y), at)), at)

    def _floor(self, x: Any, at: Place) -> Any:
        long = extent(x, {}) > LONGEST_NAME
        text = f"expression {len(self.wholes) + 1}" if long else text_of(x)
        name = f"floor({text[1:-1] if text.startswith('(') and text.count('(') == 1 else text})"
        if name not in self.wholes:
            words = f"{name}, which events count"
            flat = Flat(name, "discrete", "Integer", at, lambda _: None, lambda: None, helper=True, description=words)
            flat.cache["start"] = math.floor(self._at_start(x))  # an event at the start corrects it
            self.wholes[name] = flat
            self.out.flats.append(flat)
            counter = Symbol(flat)
            next_one = Operation("+", (counter, 1.0), at)
            above, below = Operation(">=", (x, next_one), at), Operation("<", (x, counter), at)
            earlier = Operation("pre", (counter,), at)
            whole = Operation("whole", (x,), at)
            up = Operation("max", (Operation("+", (earlier, 1.0), at), whole), at)
            down = Operation("min", (Operation("-", (earlier, 1.0), at), whole), at)
            branches = [
                WhenBranch(c if not first else Operation("and", (Operation("initial", (), at), c), at),
                           (ScalarEquation(counter, v, at),), (), None, at)
                for first in (True, False) for c, v in ((above, up), (below, down))
            ]  # fmt: skip
            self.whens.append(ScalarWhen(tuple(branches), at, internal=True))
        return Symbol(self.wholes[name])

    def _at_start(self, x: Any) -> float:
        """Return the value of an expression at time 0 by declared start values, 0 by default; 0 if it has no value."""
        frozen = [f for f in self.out.flats if f.frozen]

        values: dict[int, Any] = {}

        def evaluated(e: Any) -> Any:
            if isinstance(e, Symbol):
                constant = e.flat.kind in ("parameter", "constant")
                start = value_of(e.flat) if constant else e.flat.get("start")
                return evaluated(self.resolved(0.0 if start is None else start, e.flat.at))
            if not isinstance(e, Operation):
                return e
            if id(e) not in values:
                values[id(e)] = 0.0 if e.name == "time" else operation(e.name, tuple(map(evaluated, e.arguments)), e.at)
            return values[id(e)]

        try:
            value = number_of(evaluated(x))
        except ModelicaError:
            value = 0.0
        for f in self.out.flats:
            f.frozen = False
        for f in frozen:
            f.frozen = True
        return float(value) if isinstance(value, (int, float)) else 0.0

    # when

    def _when(self, e: ScalarWhen) -> ScalarWhen | None:
        branches = []
        for b in e.branches:
            if not (e.internal or _is_initial(b.condition)) and any(map(_is_initial, operations(b.condition))):
                raise ModelicaError(
                    "initial() can only be used alone as a when condition, or as an entry of a vector of conditions",
                    b.at,
                )
            try:
                conditions = self._conditions(self.resolved(b.condition, b.at), b.at, e.internal)
            except ModelicaError as error:
                if not e.internal:
                    raise
                self.out.warnings.append(f"this assert() is not monitored: {error.sentence} ({b.at.where})")
                return None
            actions = tuple(ScalarEquation(a.left, self.value(self.resolved(a.right, a.at), a.at), a.at)
                            for a in b.actions)  # fmt: skip
            restarts = tuple((self.resolved(x, b.at), self.value(self.resolved(v, b.at), b.at)) for x, v in b.restarts)
            branches += [WhenBranch(c, actions, restarts, b.end, b.at) for c in conditions if not isinstance(c, bool)]
        return ScalarWhen(tuple(branches), e.at, e.internal) if branches else None

    def _conditions(self, x: Any, at: Place, internal: bool) -> list[Any]:
        """Return the conditions of one branch; change() has two. internal: initial() may be combined with others."""
        if isinstance(x, Operation) and x.name in ("edge", "change"):
            argument = x.arguments[0]
            if not _is_boolean(argument):
                raise ModelicaError(f"{x.name}() is only supported for Boolean variables; write relations", x.at or at)
            truth = self.condition(argument, at)
            return [truth] if x.name == "edge" else [truth, _no(truth, at)]
        if _is_initial(x):
            return [x]
        if internal and x.name == "and" and _is_initial(x.arguments[0]):
            return [operation("and", (x.arguments[0], self.condition(x.arguments[1], at)), at)]
        return [self.condition(x, at)]

    def value(self, x: Any, at: Place) -> Any:
        """Rewrite the right side of an action as a number (true is 1); relations are evaluated at the instant."""
        if isinstance(x, bool):
            return 1.0 if x else 0.0
        if isinstance(x, EnumerationLiteral):
            return x.position
        if not isinstance(x, Operation):
            return x
        if id(x) not in self._values:
            self._values[id(x)] = x, self._value(x, x.at or at)
        return self._values[id(x)][1]

    def _value(self, x: Operation, at: Place) -> Any:
        if x.name == "pre":
            argument = x.arguments[0]
            moves = isinstance(argument, Symbol) and argument.flat.kind in ("variable", "input")
            if moves and argument.flat.base == "Real":
                return x
            before = self._memory(argument, at)
            before = before.arguments[0] if isinstance(before, Operation) else before
            return Operation("pre", (before,), at) if isinstance(before, Symbol) else self.value(before, at)
        if x.name == "initial":
            return Operation("pre", (self._initially(),), at)
        if x.name in ("sample", "edge", "change"):
            raise ModelicaError(f"{x.name}() is only allowed in the condition of a when clause", at)
        if x.name == "if":
            condition, then, other = x.arguments
            if not _of_events(condition):
                return Operation("if", (self.condition(condition, at), self.value(then, at), self.value(other, at)), at)
            weight = self.value(condition, at)
            left = operation("*", (weight, self.value(then, at)), at)
            right = operation("*", (operation("-", (1.0, weight), at), self.value(other, at)), at)
            return operation("+", (left, right), at)
        if x.name in _RELATIONS and not _of_events(x):
            return Operation("if", (self.condition(x, at), 1.0, 0.0), at)
        arguments = tuple(self.value(a, at) for a in x.arguments)
        if x.name in _RELATIONS:
            a, b = arguments if x.name in (">=", "<") else reversed(arguments)
            step = Operation("step", (a, b), at)
            return step if x.name.endswith("=") else operation("-", (1.0, step), at)
        if x.name in ("==", "<>"):
            same = self._equal(x.arguments, arguments, at)
            return same if x.name == "==" else operation("-", (1.0, same), at)
        if x.name in ("and", "or"):
            return operation("min" if x.name == "and" else "max", arguments, at)
        if x.name == "not":
            return operation("-", (1.0, *arguments), at)
        if x.name in _WHOLE:
            return self._whole_value(x.name, arguments, at)
        return operation(x.name, arguments, at)

    @staticmethod
    def _equal(written: tuple[Any, ...], numbers: tuple[Any, ...], at: Place) -> Any:
        if not all(_is_whole(x) or _is_boolean(x) for x in written):
            raise ModelicaError("== and <> of Real variables are not allowed in events; write <= or >=", at)
        a, b = numbers
        low, high = operation("-", (b, 0.5), at), operation("+", (b, 0.5), at)
        return Operation("min", (Operation("step", (a, low), at), Operation("step", (high, a), at)), at)

    @staticmethod
    def _whole_value(name: str, arguments: tuple[Any, ...], at: Place) -> Any:
        def whole(x: Any) -> Any:
            return Operation("whole", (x,), at)

        if name in ("floor", "integer"):
            return whole(arguments[0])
        if name == "ceil":
            return operation("neg", (whole(operation("neg", arguments, at)),), at)
        x, y = arguments
        ratio = operation("/", (x, y), at)
        if name == "mod":
            return operation("-", (x, operation("*", (whole(ratio), y), at)), at)
        size = Operation("abs", (ratio,), at)
        sign = operation("-", (operation("*", (2.0, Operation("step", (ratio, 0.0), at)), at), 1.0), at)
        quotient = operation("*", (sign, whole(size)), at)
        return quotient if name == "div" else operation("-", (x, operation("*", (quotient, y), at)), at)


def _is_initial(x: Any) -> bool:
    return isinstance(x, Operation) and x.name == "initial"


def _minus(x: Any, at: Place) -> Any:
    return x.arguments[0] if isinstance(x, Operation) and x.name == "neg" else operation("neg", (x,), at)


def _no(x: Any, at: Place) -> Any:
    return operation("not", (x,), at)


def _number(x: Any) -> Any:
    return x.position if isinstance(x, EnumerationLiteral) else x


def _of_events(x: Any) -> bool:
    """True if an expression contains a discrete variable or pre()."""
    return any(f.kind == "discrete" for f in symbols(x)) or any(o.name == "pre" for o in operations(x))


def _is_boolean(x: Any) -> bool:
    if isinstance(x, Symbol):
        return x.flat.base == "Boolean"
    if isinstance(x, Operation):
        if x.name in ("pre", "if"):
            return _is_boolean(x.arguments[-1])
        return x.name in _LOGICAL
    return isinstance(x, bool)


def _is_whole(x: Any) -> bool:
    """True if an expression is Integer or of an enumeration type."""
    stack, visited = [x], set[int]()
    while stack:
        e = stack.pop()
        if isinstance(e, Symbol):
            if e.flat.base not in ("Integer", "enumeration"):
                return False
        elif isinstance(e, Operation):
            if e.name not in _OF_WHOLE and e.name not in ("if", "integer", "sign", "div", "share"):
                return False
            if id(e) not in visited and e.name in (*_OF_WHOLE, "if"):
                visited.add(id(e))
                stack += e.arguments[1:] if e.name == "if" else e.arguments
        elif not isinstance(e, EnumerationLiteral) and not (isinstance(e, (int, float)) and float(e).is_integer()):
            return False
    return True


def text_of(x: Any) -> str:
    """Return a short text of an expression for the name of a variable."""
    if isinstance(x, Symbol):
        return x.flat.name
    if isinstance(x, Operation):
        arguments = [text_of(a) for a in x.arguments]
        if x.name == "neg":
            return f"-{arguments[0]}"
        if len(arguments) == 2 and not x.name.isalpha():
            return f"({arguments[0]}{x.name}{arguments[1]})"
        return x.name + (f"({','.join(arguments)})" if arguments else "")
    return f"{x:.9g}" if isinstance(x, float) else str(x)
