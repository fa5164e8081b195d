"""A flattened class as flat Modelica text, from which `load` gives the same class; names as `'tank[2].x'`."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from .classes import exact
from .constraints import Flattened, ScalarEquation, ScalarIf, ScalarWhen, expressions
from .expressions import MOST_OPERATIONS, Resolver, is_declared
from .python import Writer
from .scalars import EnumerationLiteral, Flat, Operation, Symbol, extent, is_literal, number_of, operations
from .syntax import ModelicaError, Place, Source

# operator precedence, from weak to strong: a sum in a product needs parentheses
_IF, _OR, _AND, _NOT, _RELATION, _SUM, _PRODUCT, _POWER, _ATOM = range(9)
_BINARY = {
    "or": ("or", _OR), "and": ("and", _AND), "+": ("+", _SUM), "-": ("-", _SUM), "*": ("*", _PRODUCT),
    "/": ("/", _PRODUCT), "**": ("^", _POWER), **{r: (r, _RELATION) for r in ("<", "<=", ">", ">=", "==", "<>")},
}  # fmt: skip
_WORDS = {"time": "time", "start_time": "startTime", "final_time": "finalTime"}
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_NOWHERE = Place(Source("", ""), 1, 1)
_ATTRIBUTES = ("unit", "min", "max", "start", "fixed", "nominal", "stateSelect", "free", "initialGuess")


def flat_text(flat: Flattened, naming: Callable[[str], str] = str) -> str:
    """Return a class as text: variables, parameters and equations in order, with structural parameters as numbers.

    naming: maps the names of variables. Raises ModelicaError for constructs that flat text cannot express.
    """
    if flat.parts:
        raise ModelicaError("a model with MultiBody parts has no flat text; print it with --python", flat.parts[0].at)
    Writer(flat, exact, units=False).write()  # evaluates exponents and sizes, and raises for unsupported constructs
    return "\n".join(_Printer(naming).lines(flat)) + "\n"


class _Printer:
    def __init__(self, naming: Callable[[str], str]) -> None:
        self.naming, self.resolved, self._extents = naming, Resolver(), dict[int, tuple[Any, int]]()

    def lines(self, flat: Flattened) -> list[str]:
        word = "optimization" if flat.optimization else "model"
        lines = [f"{word} {flat.name}{self._header(flat)}{_comment(flat.description)}"]
        flats, equations, initial = flat.text or (flat.flats, flat.equations, flat.initial)
        in_pre = self._remembered(equations, initial)
        declared = [f for f in flats if is_declared(f) or id(f) in in_pre]
        lines += [f"  {self._declaration(f)};" for f in declared]
        definitions = [ScalarEquation(Symbol(f), f.replaced, f.at) for f in declared if id(f) in in_pre]
        for head, items in (("initial equation", initial), ("equation", [*definitions, *equations]),
                            ("constraint", flat.constraints)):  # fmt: skip
            inside = [f"  {line};" for e in items if (line := self._equation(e))]
            lines += [head, *inside] if inside else []
        signs = [f"{self._name(name)} = {self._of(value, place)}" for name, value, place in flat.branches]
        lines += [f"  annotation(__gtmodel(branch({', '.join(signs)})));"] if signs else []
        return [*lines, f"end {flat.name};"]

    def _remembered(self, equations: list[Any], initial: list[Any]) -> set[int]:
        """Return the ids of the Boolean variables that appear in pre()."""
        result: set[int] = set()
        pending: list[Any] = [x for e in (*equations, *initial) for x in expressions(e)]
        while pending:
            for o in operations(self.resolved(pending.pop(), _NOWHERE)):
                argument = o.arguments[0] if o.name == "pre" else None
                if (
                    isinstance(argument, Symbol)
                    and argument.flat.replaced is not None
                    and id(argument.flat) not in result
                ):
                    result.add(id(argument.flat))
                    pending.append(argument.flat.replaced)
        return result

    def _header(self, flat: Flattened) -> str:
        heads: dict[str, dict[str, str]] = {}
        for name, value in flat.header.items():
            first, _, attribute = name.partition(".")
            heads.setdefault(first, {})[attribute] = self._of(value, flat.header_at[name])
        entries = []
        for name, attributes in heads.items():
            value = attributes.pop("", None)
            texts = ", ".join(f"{k} = {v}" for k, v in attributes.items())
            entries.append(name + (f"({texts})" if texts else "") + (f" = {value}" if value is not None else ""))
        return f"({', '.join(entries)})" if entries else ""

    def _declaration(self, flat: Flat) -> str:
        if flat.base == "enumeration":
            raise ModelicaError(f"'{flat.name}' is of an enumeration type, which flat text does not support", flat.at)
        kind = "" if flat.kind == "variable" else f"{flat.kind} "
        values = {name: value for name in _ATTRIBUTES if (value := flat.get(name)) is not None}
        if "stateSelect" in values:
            values["stateSelect"] = number_of(values["stateSelect"], flat.at)
        attributes = ", ".join(f"{n} = {v if n == 'stateSelect' else self._of(v, flat.at)}" for n, v in values.items())
        value = ""
        if flat.kind == "parameter" and flat.binding is not None:
            value = f" = {self._of(flat.binding, flat.at)}"
        modification = f"({attributes})" if attributes else ""
        return f"{kind}{flat.base} {self._name(flat.name)}{modification}{value}{_comment(flat.description)}"

    def _equation(self, e: Any) -> str:
        if isinstance(e, ScalarIf):
            sides = ["; ".join(map(self._relation, x)) for x in (e.then, e.otherwise)]
            return f"if {self._of(e.condition, e.at)} then {sides[0]}; else {sides[1]}; end if"
        if isinstance(e, ScalarWhen):
            return self._when(e)
        left, right = (self._whole(x, e.at) for x in (e.left, e.right))
        return "" if is_literal(left) and is_literal(right) else self._relation(e)

    def _when(self, e: ScalarWhen) -> str:
        last = e.branches[-1]
        if e.internal and last.end is not None and last.end[1]:  # an assert(), which ends the simulation when violated
            x = self._whole(last.condition, last.at)
            asserted = (
                x.arguments[0] if isinstance(x, Operation) and x.name == "not" else Operation("not", (x,), last.at)
            )
            return f"assert({self._text(asserted, _IF)}, {_quoted(last.end[0])})"
        parts: list[str] = []
        for b in e.branches:
            actions = [self._relation(a) for a in b.actions]
            actions += [f"reinit({self._of(x, b.at)}, {self._of(v, b.at)})" for x, v in b.restarts]
            actions += [f"terminate({_quoted(b.end[0])})"] if b.end is not None else []
            parts.append(f"when {self._of(b.condition, b.at)} then {'; '.join(actions)};")
        return " else".join(parts) + " end when"

    def _relation(self, e: ScalarEquation) -> str:
        # a Boolean that appears in pre() is the left side of its equation
        of = isinstance(e.left, Symbol) and e.left.flat.replaced is not None
        left = self._name(e.left.flat.name) if of else self._text(self._whole(e.left, e.at), _OR)
        right = self._text(self._whole(e.right, e.at), _OR)
        return f"{left} {'=' if e.relation == '==' else e.relation} {right}"

    # expressions

    def _name(self, name: str) -> str:
        name = self.naming(name)
        return name if _PLAIN.fullmatch(name) else f"'{name}'"

    def _of(self, x: Any, at: Place) -> str:
        return self._text(self._whole(x, at), _IF)

    def _whole(self, x: Any, at: Place) -> Any:
        """Return a resolved expression. Raises ModelicaError if it is too long when written out without sharing."""
        result = self.resolved(x, at)
        if extent(result, self._extents) > MOST_OPERATIONS:
            raise ModelicaError(
                "this expression is too long for flat text, where shared parts are repeated; print it with --python", at
            )
        return result

    def _text(self, x: Any, minimum: int) -> str:
        text, precedence = self._held(x)
        return text if precedence >= minimum else f"({text})"

    def _held(self, x: Any) -> tuple[str, int]:
        """Return the text of an expression, and the precedence of its operator."""
        if isinstance(x, Symbol):
            return self._name(x.flat.name), _ATOM
        if isinstance(x, bool):
            return str(x).lower(), _ATOM
        if isinstance(x, str):
            return _quoted(x), _ATOM
        if isinstance(x, EnumerationLiteral):
            return str(x), _ATOM
        if not isinstance(x, Operation):
            text = repr(x)
            return text, _SUM if text.startswith("-") else _ATOM
        name, arguments = x.name, x.arguments
        if name in _BINARY:
            word, precedence = _BINARY[name]
            chains = precedence not in (_RELATION, _POWER)  # relations and powers are not associative in Modelica
            left, right = precedence + (0 if chains else 1), precedence + 1
            return f"{self._text(arguments[0], left)} {word} {self._text(arguments[1], right)}", precedence
        if name == "neg":
            return f"-{self._text(arguments[0], _PRODUCT)}", _SUM
        if name == "not":
            return f"not {self._text(arguments[0], _RELATION)}", _NOT
        if name == "if":
            condition, then, otherwise = (self._text(a, _OR) for a in arguments)
            return f"if {condition} then {then} else {otherwise}", _IF
        if name == "share":
            a, b = (self._text(a, _SUM) for a in arguments)
            return f"noEvent(if {a} >= {b} then 1 else 0)", _ATOM
        if name in _WORDS:
            return _WORDS[name], _ATOM
        if name == "at":
            return f"{self._text(arguments[0], _ATOM)}({self._text(arguments[1], _IF)})", _ATOM
        return f"{name}({', '.join(self._text(a, _IF) for a in arguments)})", _ATOM


def _comment(words: str) -> str:
    return f" {_quoted(words)}" if words else ""


def _quoted(words: str) -> str:
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ") + '"'
