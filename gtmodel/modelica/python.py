"""Code generation: a flattened class as a Python syntax tree with the line numbers of the text."""

from __future__ import annotations

import ast
import math
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from ..lang.units import UnitError, si_unit
from .classes import Written
from .constraints import Flattened, ScalarEquation, ScalarIf, ScalarWhen, WhenBranch
from .expressions import MOST_OPERATIONS, TOO_LONG, Resolver, is_declared
from .multibody.parts import PartWriter
from .scalars import (
    EnumerationLiteral,
    Flat,
    Operation,
    Symbol,
    extent,
    is_constant,
    is_literal,
    is_number,
    number_of,
    operation,
    operations,
    ordered,
    symbols,
    value_of,
)  # fmt: skip
from .syntax import ModelicaError, Place

_OPERATORS = {"+": ast.Add, "-": ast.Sub, "*": ast.Mult, "/": ast.Div, "**": ast.Pow}
_RELATIONS = {"==": ast.Eq, "<=": ast.LtE, ">=": ast.GtE, "<": ast.Lt, ">": ast.Gt}
_FUNCTIONS = {
    "sin": "sin", "cos": "cos", "tan": "tan", "asin": "asin", "acos": "acos", "atan": "atan", "atan2": "atan2",
    "tanh": "tanh", "exp": "exp", "log": "log", "sqrt": "sqrt", "abs": "absolute", "sign": "sign", "max": "maximum",
    "min": "minimum", "pre": "pre",
}  # fmt: skip
_HORIZON = {"start_time": "startTime", "final_time": "finalTime"}
_PREFERENCE = {"never": -2, "avoid": -1, "prefer": 1, "always": 2}
_ATTRIBUTES = ("min", "max", "start", "initialGuess")
_ORDER = ("<", "<=", ">", ">=")
_TRUTHS = (*_ORDER, "==", "<>", "and", "or", "not", "initial", "sample", "refused")
LONG = 400  # size of a statement beyond which repeated subexpressions become local variables
_MOVING = ("floor", "ceil", "integer", "mod", "div", "rem")


class Writer:
    """Writes one flattened class; units: whether declarations have the units of the text."""

    def __init__(self, flat: Flattened, naming: Callable[[str], str], units: bool) -> None:
        self.flat, self.units, self.warnings = flat, units, list[str]()
        self.names, self.naming, self._late = _unique(flat.flats, naming), naming, dict[tuple[str, float], str]()
        self.parts = PartWriter(flat.parts, naming, self.names.values(), units)
        self.resolved = Resolver()
        self._terms: dict[int, str] = {}  # names of repeated subexpressions of a statement, by id
        self._count = 0
        self.written = Written(flat.name, flat.at, flat.optimization, flat.description)

    def write(self) -> Written:
        decided = [(f, self._decided(f)) for f in self.flat.flats]
        header = self._header()
        self._exponents()
        for flat, numbers in decided:
            if is_declared(flat):
                self._put("", flat.at, ast.Assign([ast.Name(self.names[id(flat)], ast.Store())],
                                                  self._declaration(flat, numbers)))  # fmt: skip
        self.written.helpers += [self.names[id(f)] for f in self.flat.flats if f.helper and is_declared(f)]
        for part in self.flat.parts:
            for value in part.options.values():
                for x in value.ravel() if hasattr(value, "ravel") else ():
                    self._bounded(self.resolved(x, part.at), part.at, {})
            self._put("", part.at, self.parts.declared(part, self.resolved, self._expression))
        for name, value, place in header:
            self._put("", place, ast.Assign([ast.Name(name, ast.Store())], value))
        for a, b, place in self.flat.joined:
            self._put("equations", place, self.parts.connected(a, b))
        for e in self.flat.equations:
            self._equation(e)
        for name, value, place in self.flat.branches:
            self._named("equations", place, [value])
            expression = self._of(value, place)
            self._put("equations", place, _yield(_call("branch", [ast.Constant(name), expression])))
        for e in self.flat.initial:
            self._relation("initial_equations", e)
        for e in self.flat.constraints:
            self._relation("constraints", e)
        if self.flat.optimization:
            self._objective()
        if self.units:
            for method, statements in self.written.methods.items():
                for at, statement in statements:
                    if (method, at.source.path, at.line) in self.flat.bare:
                        self.bare(statement)
        return self.written

    @staticmethod
    def bare(node: Any) -> Any:
        """Return an expression or statement with every quantity wrapped in plain()."""
        return _Bare().visit(node)

    def _exponents(self) -> None:
        """Evaluate exponents that depend on parameters: gtmodel needs numbers there."""
        sides: list[Any] = [self.flat.header.get(name) for name in ("objective", "objectiveIntegrand")]
        for e in (*self.flat.equations, *self.flat.initial, *self.flat.constraints):
            parts = (
                (*e.then, *e.otherwise) if isinstance(e, ScalarIf) else e.actions if isinstance(e, ScalarWhen) else (e,)
            )
            sides += [x for part in parts for x in (part.left, part.right)]
        sides += [f.binding for f in self.flat.flats if f.kind == "parameter" and not f.free]
        sides += [f.get(a) for f in self.flat.flats if f.kind not in ("parameter", "constant") for a in _ATTRIBUTES]
        for side in sides:
            for o in operations(side):
                if o.name == "**" and not is_literal(o.arguments[1]) and is_constant(o.arguments[1]):
                    number_of(o.arguments[1], o.at, "an exponent")

    def _put(self, method: str, at: Place, statement: ast.stmt) -> None:
        for node in ast.walk(statement):
            node.lineno = node.end_lineno = at.line  # type: ignore[attr-defined]
            node.col_offset, node.end_col_offset = 0, 0  # type: ignore[attr-defined]
        target = self.written.methods.setdefault(method, []) if method else self.written.body
        target.append((at, statement))

    # declarations

    def _decided(self, flat: Flat) -> dict[str, Any]:
        """Return the attributes that must be numbers at translation."""
        numbers: dict[str, Any] = {}
        names = ["nominal", "fixed", "unit", "stateSelect"]
        if flat.kind in ("parameter", "discrete"):
            names += (
                ["min", "max", "start", "initialGuess"] if flat.free else ["start"] if flat.kind != "parameter" else []
            )
        if flat.free and flat.binding is not None:
            numbers["value"] = number_of(flat.binding, flat.at, f"the value of '{flat.name}'")
        for name in names:
            value = flat.get(name)
            if value is not None:
                numbers[name] = number_of(value, flat.at, f"{name} of '{flat.name}'")
        if not isinstance(numbers.get("fixed", False), bool):
            raise ModelicaError(f"fixed of '{flat.name}' must be true or false; found {numbers['fixed']}", flat.at)
        return numbers

    def _unit(self, flat: Flat, numbers: dict[str, Any]) -> dict[str, Any]:
        unit = numbers.get("unit")
        if not unit or not self.units or flat.base != "Real" or id(flat) in self.flat.without_unit:
            return {}
        try:
            si_unit(str(unit))
        except UnitError as error:
            self.warnings.append(f"unit of '{flat.name}' is ignored: {error} ({flat.at.where})")
            return {}
        return {"unit": ast.Constant(str(unit))}

    def _declaration(self, flat: Flat, numbers: dict[str, Any]) -> ast.expr:
        options = self._unit(flat, numbers)
        if flat.free:
            guess = next((numbers[k] for k in ("initialGuess", "start", "value") if k in numbers), 1.0)
            options |= {k: _constant(numbers[k]) for k in ("min", "max") if k in numbers and _finite(numbers[k])}
            return _call("free", [_constant(float(guess))], self._described(flat, options))
        if flat.kind == "parameter":
            value = value_of(flat)
            if not is_number(value):
                raise ModelicaError(f"'{flat.name}' must be a number; found {str(value)!r}", flat.at)
            low = flat.get("min")
            if is_number(low) and low > 0 < value:
                options["positive"] = ast.Constant(True)
            return _call("parameter", [_constant(float(value))], self._described(flat, options))
        if flat.kind == "discrete":
            value = numbers.get("start", 1.0 if flat.base == "enumeration" else 0.0)
            value = value.position if isinstance(value, EnumerationLiteral) else value
            return _call("discrete", [_constant(float(value))], self._described(flat, options))
        nominal = numbers.get("nominal")
        if nominal is not None and is_number(nominal) and nominal != 0:
            options["nominal"] = _constant(abs(nominal))
        for name in ("min", "max"):
            self._attribute(options, name, flat.get(name), flat)
        fixed = bool(numbers.get("fixed", False))
        start = flat.get("start")
        guess = flat.get("initialGuess")
        if not fixed and guess is not None:
            start = guess
        if start is None and fixed:
            start = 0.0
        self._attribute(options, "start", start, flat)
        if (choice := numbers.get("stateSelect")) is not None and isinstance(choice, EnumerationLiteral):
            preference = _PREFERENCE.get(choice.name, 0)
            if preference:
                options["prefer"] = _constant(preference)
        if flat.kind == "input":
            return _call("input", [], self._described(flat, options))
        if fixed:
            options["fixed"] = ast.Constant(True)
        return _call("variable", [], self._described(flat, options))

    def _attribute(self, options: dict[str, Any], name: str, value: Any, flat: Flat) -> None:
        if value is None:
            return
        value = self.resolved(value, flat.at)
        if is_literal(value):
            if is_number(value) and _finite(value):
                options[name] = _constant(float(value))
            elif not is_number(value):
                raise ModelicaError(f"{name} of '{flat.name}' must be a number; found {value!r}", flat.at)
            return
        if any(f.kind not in ("parameter", "constant") for f in symbols(value)):
            raise ModelicaError(f"{name} of '{flat.name}' must depend on parameters only", flat.at)
        self._terms = {}
        self._bounded(value, flat.at, {})
        arguments = ast.arguments(posonlyargs=[], args=[ast.arg("self")], kwonlyargs=[], kw_defaults=[], defaults=[])
        options[name] = ast.Lambda(arguments, self._expression(value))

    @staticmethod
    def _described(flat: Flat, options: dict[str, Any]) -> dict[str, Any]:
        return {**options, "description": ast.Constant(flat.description)} if flat.description else options

    def _header(self) -> list[tuple[str, ast.expr, Place]]:
        if not self.flat.optimization:
            return []
        header, result = self.flat.header, []
        start = header.get("startTime", 0.0)
        for name, attribute, default in (("startTime", "start_time", 0.0), ("finalTime", "final_time", 1.0)):
            place = next((at for k, at in self.flat.header_at.items() if k.startswith(name)), self.flat.at)
            if header.get(f"{name}.free") is True:
                words = (f"{name}.initialGuess", f"{name}.start", name)
                guess = next((header[w] for w in words if w in header), default if name == "startTime" else start + 1.0)
                options = {
                    k: _constant(float(header[f"{name}.{k}"])) for k in ("min", "max") if f"{name}.{k}" in header
                }
                options["unit"] = ast.Constant("s")
                result.append((attribute, _call("free", [_constant(float(guess))], options), place))
            else:
                value = header.get(name, default)
                if not is_number(value):
                    raise ModelicaError(f"{name} must be a number, the time in s; found {value!r}", place)
                if not header.get(f"{name}.min", value) <= value <= header.get(f"{name}.max", value):
                    raise ModelicaError(f"{name} is outside its min and max; found {value}", place)
                result.append((attribute, _constant(float(value)), place))
        return result

    # equations

    def _equation(self, e: ScalarEquation | ScalarIf | ScalarWhen) -> None:
        if isinstance(e, ScalarEquation):
            self._relation("equations", e)
        elif isinstance(e, ScalarIf):
            self._named(
                "equations", e.at, [e.condition, *(s for x in (*e.then, *e.otherwise) for s in (x.left, x.right))]
            )
            if self.flat.optimization:
                sides = [Operation("-", (x[0].left, x[0].right), e.at) for x in (e.then, e.otherwise)]
                self._relation("equations", ScalarEquation(Operation("if", (e.condition, *sides), e.at), 0, e.at))
                return
            condition = self._condition(self.resolved(e.condition, e.at), e.at)
            sides = [
                ast.Compare(self._of(x[0].left, e.at), [ast.Eq()], [self._of(x[0].right, e.at)])
                for x in (e.then, e.otherwise)
            ]
            self._put("equations", e.at, _yield(_call("If", [condition, *sides])))
        else:
            clause: Any = None
            parts = [(b.condition, *(s for a in b.actions for s in (a.left, a.right)), *(v for _, v in b.restarts))
                     for b in e.branches]  # fmt: skip
            self._named("equations", e.at, [x for part in parts for x in part])
            for b in e.branches:
                arguments = [self._condition(self.resolved(b.condition, b.at), b.at), *self._actions(b)]
                clause = (
                    _call("when", arguments) if clause is None else ast.Call(
                        ast.Attribute(clause, "elsewhen", ast.Load()), arguments, [])
                )  # fmt: skip
            self._put("equations", e.at, _yield(clause))

    def _actions(self, b: WhenBranch) -> list[ast.expr]:
        actions: list[ast.expr] = [
            ast.Compare(self._of(a.left, a.at), [ast.Eq()], [self._of(a.right, a.at)]) for a in b.actions
        ]
        actions += [_call("reinit", [self._of(x, b.at), self._of(v, b.at)]) for x, v in b.restarts]
        if b.end is not None:
            options = {"failed": ast.Constant(True)} if b.end[1] else {}
            actions.append(_call("terminate", [ast.Constant(b.end[0])], options))
        return actions

    def _of(self, x: Any, at: Place) -> ast.expr:
        return self._expression(self.resolved(x, at))

    def _relation(self, method: str, e: ScalarEquation) -> None:
        left, right = self.resolved(e.left, e.at), self.resolved(e.right, e.at)
        if method == "constraints" and not any(True for x in (left, right) for _ in symbols(x)):
            left, right = self._ends(left), self._ends(right)
        if wrong := [str(x) for x in (left, right) if is_literal(x) and not is_number(x)]:
            raise ModelicaError(f"an equation must be between numbers; found {wrong[0].lower()}", e.at)
        if is_literal(left) and is_literal(right):
            holds = {"==": left == right, "<=": left <= right, ">=": left >= right}[e.relation]
            if not holds:
                raise ModelicaError(f"this equation is false: {left} {e.relation.replace('==', '=')} {right}", e.at)
            return
        self._named(method, e.at, [left, right])
        self._put(
            method, e.at,
            _yield(ast.Compare(self._expression(left), [_RELATIONS[e.relation]()], [self._expression(right)])),
        )  # fmt: skip

    def _ends(self, x: Any) -> Any:
        """Replace startTime and finalTime by numbers if they are not free."""
        if isinstance(x, Operation):
            if x.name in _HORIZON and self.flat.header.get(f"{_HORIZON[x.name]}.free") is not True:
                return self.flat.header.get(_HORIZON[x.name], float(x.name == "final_time"))
            return operation(x.name, tuple(map(self._ends, x.arguments)), x.at)
        return x

    def _objective(self) -> None:
        terms: list[ast.expr] = []
        at = self.flat.at
        for name in ("objectiveIntegrand", "objective"):
            if name not in self.flat.header:
                continue
            at = self.flat.header_at[name]
            value = self.resolved(self.flat.header[name], at)
            self._named("objective", at, [value])
            if is_literal(value) and is_number(value) and value == 0:
                continue
            expression = self._expression(value)
            if name == "objectiveIntegrand":
                if is_literal(value):
                    span = ast.BinOp(_own("final_time"), ast.Sub(), _own("start_time"))
                    expression = ast.BinOp(expression, ast.Mult(), span)
                else:
                    expression = _call("integral", [expression])
            terms.append(expression)
        if not any(isinstance(n, ast.Attribute) and n.attr == "at" for t in terms for n in ast.walk(t)):
            terms += self._nothing(terms)
        total = terms[0]
        for term in terms[1:]:
            total = ast.BinOp(total, ast.Add(), term)
        self._put("objective", at, ast.Return(total))

    def _nothing(self, terms: list[ast.expr]) -> list[ast.expr]:
        """Return a zero term with a variable if the objective is a number: every feasible trajectory is optimal."""
        moves = [n for t in terms for n in ast.walk(t) if isinstance(n, ast.Attribute) and n.attr == "integral"]
        free = any(v is True for k, v in self.flat.header.items() if k.endswith(".free"))
        chosen = {self.names[id(f)] for f in self.flat.flats if f.free}
        read = {n.attr for t in terms for n in ast.walk(t) if isinstance(n, ast.Attribute)}
        if moves or read & chosen or (free and read & {"final_time", "start_time"}):
            return []
        first = next((f for f in self.flat.flats if is_declared(f) and f.kind in ("variable", "input")), None)
        if first is None:
            raise ModelicaError(f"optimization {self.flat.name} has no variables", self.flat.at)
        end = ast.Call(ast.Attribute(_own(self.names[id(first)]), "at", ast.Load()), [_own("final_time")], [])
        return [ast.BinOp(ast.Constant(0.0), ast.Mult(), end)]

    # expressions

    def _named(self, method: str, at: Place, expressions: list[Any]) -> None:
        """Define local variables for repeated subexpressions if the statement of these expressions is long."""
        self._terms = {}
        expressions = [self.resolved(x, at) for x in expressions]
        extents: dict[int, tuple[Any, int]] = {}
        if sum(extent(x, extents) for x in expressions) > LONG:
            extents = {}
            subexpressions = ordered(*expressions)
            uses = Counter(id(x) for x in expressions)
            for o in subexpressions:
                twice = (self.flat.optimization and o.name in _ORDER) or o.name in ("sinh", "cosh")
                uses.update(id(a) for a in o.arguments for _ in range(2 if twice else 1))
            for o in subexpressions:
                if uses[id(o)] > 1 and o.name not in _TRUTHS and extent(o, extents) > 2:
                    self._bounded(o, at, extents)
                    self._count += 1
                    name = f"term_{self._count}"
                    self._put(method, at, ast.Assign([ast.Name(name, ast.Store())], self._expression(o)))
                    self._terms[id(o)] = name
                    extents[id(o)] = o, 1
        for x in expressions:
            self._bounded(x, at, extents)

    @staticmethod
    def _bounded(x: Any, at: Place, extents: dict[int, tuple[Any, int]]) -> None:
        if extent(x, extents) > MOST_OPERATIONS:
            raise ModelicaError(TOO_LONG, at)

    def _expression(self, x: Any) -> ast.expr:
        if isinstance(x, Operation) and id(x) in self._terms:
            return ast.Name(self._terms[id(x)], ast.Load())
        if isinstance(x, Symbol):
            return _own(self.names[id(x.flat)])
        if not isinstance(x, Operation):
            return _constant(x)
        name, at = x.name, x.at
        if name == "**" and not is_number(x.arguments[1]):
            base, exponent = (self._expression(a) for a in x.arguments)
            return _call("exp", [ast.BinOp(exponent, ast.Mult(), _call("log", [base]))])
        if name in _OPERATORS:
            return ast.BinOp(self._expression(x.arguments[0]), _OPERATORS[name](), self._expression(x.arguments[1]))
        if name == "neg":
            return ast.UnaryOp(ast.USub(), self._expression(x.arguments[0]))
        if name in ("time", "start_time", "final_time"):
            bare = self.units or (name != "time" and not self.flat.header.get(f"{_HORIZON[name]}.free"))
            return _own(name) if bare else ast.Call(ast.Name("plain", ast.Load()), [_own(name)], [])
        if name == "part":
            return self.parts.quantity(x)
        if name == "refused":
            raise ModelicaError(str(x.arguments[0]), at)
        if name == "der":
            return ast.Call(ast.Name("der", ast.Load()), [self._expression(x.arguments[0])], [])
        if name == "at":
            inside, time = x.arguments
            if is_literal(inside):
                return _constant(inside)
            instant = (
                _own(time.name) if isinstance(time, Operation) and time.name in _HORIZON else self._expression(time)
            )
            return ast.Call(ast.Attribute(self._expression(inside), "at", ast.Load()), [instant], [])
        if name in _FUNCTIONS:
            return _call(_FUNCTIONS[name], [self._expression(a) for a in x.arguments])
        if name in ("sinh", "cosh"):
            (e,) = (self._expression(a) for a in x.arguments)
            both = ast.BinOp(_call("exp", [e]), ast.Sub() if name == "sinh" else ast.Add(),
                             _call("exp", [ast.UnaryOp(ast.USub(), e)]))  # fmt: skip
            return ast.BinOp(both, ast.Div(), ast.Constant(2))
        if name == "log10":
            return ast.BinOp(_call("log", [self._expression(x.arguments[0])]), ast.Div(), _constant(math.log(10)))
        if name == "if":
            return self._if(x)
        if name in _MOVING:
            raise ModelicaError(f"{name}() of variables is discontinuous and not supported here", at)
        if name == "delay":
            return self._delayed(x)
        if name == "earlier":
            return self._expression(x.arguments[0])  # every iteration of an event starts with the values before it
        if name == "share":
            number = ast.Call(ast.Name("step", ast.Load()), [self._expression(a) for a in x.arguments], [])
            return ast.Call(ast.Name("plain", ast.Load()), [number], [])
        if name in ("step", "whole"):
            return ast.Call(ast.Name(name, ast.Load()), [self._expression(a) for a in x.arguments], [])
        if name in _RELATIONS or name in ("and", "or", "not", "<>", "initial", "sample"):
            raise ModelicaError("expected a number; found a condition", at)
        raise ModelicaError(f"{name}() is not supported here", at)

    def _delayed(self, x: Operation) -> ast.expr:
        """Declare a delayed input; before the start time it has the start value of the input."""
        source, tau = x.arguments
        assert x.at is not None
        if not self.flat.optimization or not isinstance(source, Symbol) or source.flat.kind != "input":
            t = f"{tau:g}"
            delayed = "an expression"
            if isinstance(source, Symbol):
                word = "an input of a simulation" if source.flat.kind == "input" else f"a {source.flat.kind}"
                delayed = f"'{source.flat.name}', {word}"
            raise ModelicaError(
                f"only inputs of an optimization can be delayed; found {delayed}. Sample it, or use a Pade "
                f"approximation: Real p(start = x0, fixed = true), q(start = 0, fixed = true); {t}*der(p) = q; "
                f"{t}*der(q) = 12*(x - p) - 6*q; v = x - q",
                x.at,
            )  # fmt: skip
        held = source.flat.get("start")
        history = 0.0 if held is None else number_of(held, x.at, "the initial history of delay()")
        key = (self.names[id(source.flat)], tau)
        name = self._late.get(key, "")
        if not name:
            number = len(self._late) + 1
            name = self._late[key] = self.naming(f"{source.flat.name}_delayed{number if number > 1 else ''}")
            arguments = [ast.Name(self.names[id(source.flat)], ast.Load()), _constant(tau)]
            value = _call("delayed", arguments, {"history": _constant(float(history))})
            self._put("", x.at, ast.Assign([ast.Name(name, ast.Store())], value))
        return _own(name)

    def _if(self, x: Operation) -> ast.expr:
        condition, then, otherwise = x.arguments
        if not self.flat.optimization:
            assert x.at is not None
            sides = [self._expression(then), self._expression(otherwise)]
            return _call("If", [self._condition(condition, x.at), *sides])
        constant = all(f.kind in ("parameter", "constant") for side in (then, otherwise) for f in symbols(side))
        if constant and any(f.kind not in ("parameter", "constant") for f in symbols(condition)):
            raise ModelicaError(
                "this expression is discontinuous, and an optimization needs smooth functions; write a smooth "
                "approximation, or one phase for each branch and connect them with gt.solve_phases",
                x.at,
            )
        step = self._step(condition, x.at)
        left = ast.BinOp(step, ast.Mult(), self._expression(then))
        rest = ast.BinOp(ast.BinOp(ast.Constant(1), ast.Sub(), step), ast.Mult(), self._expression(otherwise))
        return ast.BinOp(left, ast.Add(), rest)

    def _step(self, x: Any, at: Place | None) -> ast.expr:
        """Return a step that is 1 if a condition holds and 0 otherwise, as `gt.piecewise`, whose breaks are known."""
        if isinstance(x, Operation) and x.name in ("<", "<=", ">", ">="):
            strict = "=" not in x.name  # a > b is written as not b >= a, for the value at the break
            a, b = x.arguments if x.name in (">=", "<") else reversed(x.arguments)
            difference = self._expression(Operation("-", (a, b), at))
            breaks = ast.List([_constant(v) for v in (-1.0, 0.0, 1.0)], ast.Load())
            heights = ast.List([ast.List([_constant(0.0), _constant(1.0)], ast.Load())], ast.Load())
            step = _call("piecewise", [difference, breaks, heights])
            return ast.BinOp(ast.Constant(1), ast.Sub(), step) if strict else step
        if isinstance(x, Operation) and x.name == "not":
            return ast.BinOp(ast.Constant(1), ast.Sub(), self._step(x.arguments[0], at))
        if isinstance(x, Operation) and x.name in ("and", "or"):
            a, b = (self._step(y, at) for y in x.arguments)
            both = ast.BinOp(a, ast.Mult(), b)
            return both if x.name == "and" else ast.BinOp(ast.BinOp(a, ast.Add(), b), ast.Sub(), both)
        raise ModelicaError("this condition is not supported in an optimization; write it with < or >", at)

    def _condition(self, x: Any, at: Place) -> ast.expr:
        if isinstance(x, Operation):
            if x.name in ("<", "<=", ">", ">="):
                a, b = (self._expression(y) for y in x.arguments)
                return ast.Compare(a, [_RELATIONS[x.name]()], [b])
            if x.name in ("and", "or"):
                a, b = (self._condition(y, at) for y in x.arguments)
                return ast.BinOp(a, ast.BitAnd() if x.name == "and" else ast.BitOr(), b)
            if x.name == "not":
                return ast.UnaryOp(ast.Invert(), self._condition(x.arguments[0], at))
            if x.name == "initial":
                return _call("initial", [])
            if x.name == "sample":
                start, interval = (self._expression(y) for y in x.arguments)
                return _call("sample", [interval], {"offset": start})
        raise ModelicaError(
            "this condition is not supported; write relations with <, <=, >, >=, combined by and, or, not", at
        )


class _Bare(ast.NodeTransformer):
    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if not isinstance(node.value, ast.Name) or node.value.id != "self":
            return self.generic_visit(node)
        return ast.copy_location(ast.Call(ast.copy_location(ast.Name("plain", ast.Load()), node), [node], []), node)


def _unique(flats: Iterable[Flat], naming: Callable[[str], str]) -> dict[int, str]:
    names: dict[int, str] = {}
    taken: set[str] = set()
    for flat in flats:
        if flat.replaced is not None:
            continue
        try:
            name = naming(flat.name)
        except ModelicaError as error:
            raise ModelicaError(error.sentence, flat.at) from None
        while name in taken:
            name += "_"
        taken.add(name)
        names[id(flat)] = name
    return names


def _finite(value: Any) -> bool:
    return is_number(value) and abs(value) < 1e60  # Modelica.Constants.inf of the libraries


def _constant(value: Any) -> ast.expr:
    if isinstance(value, EnumerationLiteral):
        return ast.Constant(value.position)
    if is_number(value) and (value < 0 or math.copysign(1.0, value) < 0):
        return ast.UnaryOp(ast.USub(), ast.Constant(-value))
    return ast.Constant(value)


def _own(name: str) -> ast.expr:
    return ast.Attribute(ast.Name("self", ast.Load()), name, ast.Load())


def _call(name: str, arguments: list[Any], options: dict[str, Any] | None = None) -> ast.expr:
    function = ast.Attribute(ast.Name("gt", ast.Load()), name, ast.Load())
    return ast.Call(function, arguments, [ast.keyword(k, v) for k, v in (options or {}).items()])


def _yield(value: ast.expr) -> ast.stmt:
    return ast.Expr(ast.Yield(value))
