"""Transformer of lark's parse tree into syntax nodes: one method for each rule of the grammar."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from lark import Token, v_args
from lark.tree import Meta
from lark.visitors import Transformer_NonRecursive

from . import syntax as s
from .syntax import Argument, ClassText, Component, ModelicaError, Place, Source, SyntaxNode

# annotations without effect on equations, most of the text of a library
PICTURES = {("Icon",), ("Diagram",), ("Documentation",)}
_SOURCE: ContextVar[Source] = ContextVar("source")


@contextmanager
def of_source(source: Source) -> Iterator[None]:
    """Context in which the transformer creates nodes of this file."""
    before = _SOURCE.set(source)
    try:
        yield
    finally:
        _SOURCE.reset(before)


def _place(meta: Any) -> Place:
    return Place(_SOURCE.get(), getattr(meta, "line", 1) or 1, getattr(meta, "column", 1) or 1)


class Several(list[Any]):
    """Result of a rule that has no syntax node of its own."""

    def __init__(self, kind: str, items: list[Any], at: Place | None = None) -> None:
        super().__init__(items)
        self.kind = kind
        self.at = at


def _of(children: list[Any], kind: str) -> Any:
    """Return the first child of a kind; None if there is none."""
    return next((c for c in children if isinstance(c, Several) and c.kind == kind), None)


def _words(children: list[Any], kind: str) -> frozenset[str]:
    return frozenset(w for c in children if isinstance(c, Several) and c.kind == kind for w in c)


def _typed(children: list[Any], *kinds: type) -> Any:
    return next((c for c in children if isinstance(c, kinds)), None)


def _name(token: str) -> str:
    return str(token)


def text_of(token: str) -> str:
    """Return the value of a string literal, with escapes replaced."""
    content = str(token)[1:-1]
    if "\\" not in content:
        return content
    try:
        return str(ast.literal_eval('"""' + content.replace('"', '\\"').replace('\\\\"', '\\"') + '"""'))
    except (SyntaxError, ValueError):
        return content


def _keep(kind: str) -> Any:
    def method(self: Any, meta: Meta, children: list[Any]) -> Several:
        return Several(kind, children, _place(meta))

    return v_args(meta=True)(method)


@v_args(meta=True)
class Shaping(Transformer_NonRecursive[Any, Any]):
    """The transformer, not recursive: a sum of a thousand terms is nested a thousand deep."""

    # files and classes

    def start(self, meta: Meta, children: list[Any]) -> list[ClassText]:
        within = _of(children, "within")
        classes = [c for c in children if isinstance(c, ClassText)]
        for item in classes:
            item.within = tuple(p.name for p in within[0].parts) if within else ()
        return classes

    within = _keep("within")
    class_prefix = _keep("class_prefix")
    restriction = _keep("restriction")
    composition = _keep("composition")
    public_section = _keep("composition")
    element_prefix = _keep("prefix")
    type_prefix = _keep("type_prefix")
    argument_prefix = _keep("prefix")
    comment = _keep("comment")
    row = _keep("row")
    subscripts = _keep("subscripts")
    else_if = _keep("else_if")
    else_part = _keep("else_part")
    else_when = _keep("else_when")
    else_if_e = _keep("else_if_e")
    loops = _keep("loops")
    outputs = _keep("outputs")
    external_call = _keep("external_call")

    def protected_section(self, meta: Meta, children: list[Any]) -> Several:
        for c in children:
            for item in c if isinstance(c, Several) else [c]:
                if isinstance(item, (Component, s.Extends)):
                    item.protected = True
        return Several("composition", children, _place(meta))

    def _sections(self, meta: Meta, children: list[Any], kind: str) -> Several:
        """Return the equations or statements of a section, and an annotation among them."""
        if children and isinstance(children[0], Token) and str(children[0]) == "initial":
            kind = f"initial_{kind}"
        body = [c for c in children if isinstance(c, SyntaxNode)]
        annotations = [c for c in children if isinstance(c, Several) and c.kind == "annotation"]
        return Several("composition", [Several(kind, body), *annotations], _place(meta))

    def equation_section(self, meta: Meta, children: list[Any]) -> Several:
        return self._sections(meta, children, "equations")

    def algorithm_section(self, meta: Meta, children: list[Any]) -> Several:
        return self._sections(meta, children, "algorithms")

    def constraint_section(self, meta: Meta, children: list[Any]) -> Several:
        return self._sections(meta, children, "constraints")

    def external(self, meta: Meta, children: list[Any]) -> Several:
        return Several("external", [s.TextJump(_place(meta), "external")], _place(meta))

    def class_definition(self, meta: Meta, children: list[Any]) -> ClassText:
        item: ClassText = _typed(children, ClassText)
        item.restriction = " ".join(_of(children, "restriction"))
        item.prefixes = _words(children, "class_prefix")
        item.at = _place(meta)
        if item.header is not None and item.restriction != "optimization" and "extends" not in item.prefixes:
            raise ModelicaError(
                f"{item.restriction} {item.name} has attributes after its name; only an optimization can have them",
                item.at,
            )
        return item

    def long_class(self, meta: Meta, children: list[Any]) -> ClassText:
        name, last = children[0], children[-1]
        if str(name) != str(last):
            where = Place(_SOURCE.get(), last.line, last.column)
            raise ModelicaError(f"'end {last}' ends {name} of line {name.line}; write end {name}", where)
        item = ClassText(_place(meta), _name(name), "", description=_of(children, "texts")[0])
        item.header = _typed(children, s.Modification)
        _fill(item, _of(children, "composition"))
        return item

    def class_extends(self, meta: Meta, children: list[Any]) -> ClassText:
        item = self.long_class(meta, children)
        item.header, item.unsupported = None, "it is a class extends clause; declare it under another name"
        return item

    def short_class(self, meta: Meta, children: list[Any]) -> ClassText:
        base: s.Reference = _typed(children, s.Reference)
        item = ClassText(_place(meta), _name(children[0]), "", short=True)
        item.elements = [s.Extends(base.at, base, _typed(children, s.Modification))]
        item.dimensions = tuple(_of(children, "subscripts") or ())
        item.type_prefixes = _words(children, "type_prefix")
        return item

    def enumeration(self, meta: Meta, children: list[Any]) -> ClassText:
        return ClassText(_place(meta), _name(children[0]), "", literals=list(_of(children, "literals") or ()))

    def enumeration_literals(self, meta: Meta, children: list[Any]) -> Several:
        return Several("literals", children)

    def enumeration_literal(self, meta: Meta, children: list[Any]) -> str:
        return str(children[0])

    def der_class(self, meta: Meta, children: list[Any]) -> ClassText:
        reason = "it is declared as a derivative with der(); write out its algorithm"
        return ClassText(_place(meta), _name(children[0]), "", unsupported=reason)

    # elements

    def import_clause(self, meta: Meta, children: list[Any]) -> Several:
        return children[0]

    def import_renamed(self, meta: Meta, children: list[Any]) -> Several:
        return Several("imports", [s.Import(_place(meta), str(children[0]), children[1])])

    def import_name(self, meta: Meta, children: list[Any]) -> Several:
        return Several("imports", [s.Import(_place(meta), children[0].parts[-1].name, children[0])])

    def import_all(self, meta: Meta, children: list[Any]) -> Several:
        return Several("imports", [s.Import(_place(meta), "", children[0])])

    def import_several(self, meta: Meta, children: list[Any]) -> Several:
        package, at = children[0], _place(meta)
        names = [str(c) for c in children[1:] if isinstance(c, Token)]
        references = [s.Reference(at, (*package.parts, s.ReferencePart(n, None))) for n in names]
        return Several("imports", [s.Import(at, n, r) for n, r in zip(names, references, strict=True)])

    def name_star(self, meta: Meta, children: list[Any]) -> s.Reference:
        return self._reference(meta, [c for c in children if isinstance(c, Token) and c.type == "IDENT"])

    name_dot = name_star

    def _reference(self, meta: Meta, tokens: list[Any]) -> s.Reference:
        return s.Reference(_place(meta), tuple(s.ReferencePart(_name(t), None) for t in tokens))

    def name(self, meta: Meta, children: list[Any]) -> s.Reference:
        words = [c for c in children if c.type == "IDENT"]
        result = self._reference(meta, words)
        result.absolute = children[0].type == "DOT"
        return result

    def constraining(self, meta: Meta, children: list[Any]) -> Several:
        base: s.Reference = _typed(children, s.Reference)
        return Several("constraint", [s.Extends(base.at, base, _typed(children, s.Modification))])

    def extends_clause(self, meta: Meta, children: list[Any]) -> s.Extends:
        return s.Extends(_place(meta), children[0], _typed(children[1:], s.Modification))

    def declaration(self, meta: Meta, children: list[Any]) -> Several:
        local_class = _typed(children, ClassText)
        declared: Several = _of(children, "components") if local_class is None else Several("classes", [local_class])
        for item in declared:
            item.prefixes |= _words(children, "prefix")
            item.constraint = _typed(_of(children, "constraint") or [], s.Extends)
        return declared

    def component_clause(self, meta: Meta, children: list[Any]) -> Several:
        base: s.Reference = _typed(children, s.Reference)
        before, prefixes = tuple(_of(children, "subscripts") or ()), _words(children, "type_prefix")
        components = [c for c in children if isinstance(c, Component)]
        for component in components:
            component.type_name = base
            component.prefixes |= prefixes
            component.dimensions += before
        return Several("components", components)

    def component(self, meta: Meta, children: list[Any]) -> Component:
        condition, comment = _of(children, "condition"), _of(children, "comment")
        return Component(
            _place(meta), _name(children[0]), s.Reference(_place(meta), ()), frozenset(),
            tuple(_of(children, "subscripts") or ()), _typed(children, s.Modification),
            condition[0] if condition else None, _of(comment or [], "texts")[0] if comment else "",
        )  # fmt: skip

    condition = _keep("condition")

    def modification(self, meta: Meta, children: list[Any]) -> s.Modification:
        inner = children[0] if isinstance(children[0], s.Modification) else None
        value = children[-1] if children[-1] is not inner else None
        return s.Modification(_place(meta), inner.arguments if inner else [], value)

    def class_modification(self, meta: Meta, children: list[Any]) -> s.Modification:
        return s.Modification(_place(meta), children)

    def modifier(self, meta: Meta, children: list[Any]) -> Argument:
        name: s.Reference = _typed(children, s.Reference)
        words = tuple(p.name for p in name.parts)
        return Argument(_place(meta), words, _typed(children, s.Modification), _words(children, "prefix"))

    def redeclaration(self, meta: Meta, children: list[Any]) -> Argument:
        prefixes = _words(children, "prefix")
        redeclared = _typed(children, ClassText) or next(iter(_of(children, "components")))
        redeclared.prefixes |= prefixes & {"replaceable"}
        redeclared.constraint = _typed(_of(children, "constraint") or [], s.Extends)
        return Argument(_place(meta), (redeclared.name,), None, prefixes, redeclared)

    def string_comment(self, meta: Meta, children: list[Any]) -> Several:
        return Several("texts", ["".join(text_of(c) for c in children)])

    def annotation(self, meta: Meta, children: list[Any]) -> Several:
        for modification in children:
            modification.arguments = [a for a in modification.arguments if a.name not in PICTURES]
        return Several("annotation", children, _place(meta))

    # equations and statements

    def equal(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Equal(_place(meta), children[0], children[1])

    def call_equation(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Calls(_place(meta), children[0])

    def call_statement(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Calls(_place(meta), self.call(meta, children[:2]))

    def if_equation(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        body = [c for c in children[1:] if isinstance(c, SyntaxNode)]
        branches = [(children[0], body)]
        branches += [(c[0], list(c[1:])) for c in children if isinstance(c, Several) and c.kind == "else_if"]
        otherwise = _of(children, "else_part")
        return s.If(_place(meta), branches, None if otherwise is None else list(otherwise))

    def for_equation(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.For(_place(meta), list(children[0]), [c for c in children[1:] if isinstance(c, SyntaxNode)])

    def when_equation(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        body = [c for c in children[1:] if isinstance(c, SyntaxNode)]
        else_branches = [(c[0], list(c[1:])) for c in children if isinstance(c, Several) and c.kind == "else_when"]
        return s.WhenEquation(_place(meta), [(children[0], body), *else_branches])

    def connect(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Connect(_place(meta), children[0], children[1])

    def assignment(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Assign(_place(meta), [children[0]], children[1])

    def assignment_of_several(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Assign(_place(meta), list(children[0]), self.call(meta, children[1:3]))

    def while_statement(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.While(_place(meta), children[0], [c for c in children[1:] if isinstance(c, SyntaxNode)])

    def jump(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.TextJump(_place(meta), str(children[0]))

    def loop(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Loop(_place(meta), str(children[0]), children[1] if len(children) > 1 else None)

    # expressions

    def conditional(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        else_branches = [(c[0], c[1]) for c in children[2:-1]]
        return s.Conditional(_place(meta), [(children[0], children[1]), *else_branches], children[-1])

    def range(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        parts = [c for c in children if isinstance(c, SyntaxNode)]
        return s.Range(_place(meta), parts[0], parts[1] if len(parts) > 2 else None, parts[-1])

    def binary(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Binary(_place(meta), str(children[1]), children[0], children[2])

    def unary(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Unary(_place(meta), str(children[0]), children[1])

    def number(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        text = str(children[0])
        value = int(text) if text.isdigit() and len(text) < 16 else float(text)
        if math.isinf(value):
            raise ModelicaError(
                f"{text} is larger than the largest number; omit the bound, or write 1e60", _place(meta)
            )
        return s.Literal(_place(meta), value)

    def string(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Literal(_place(meta), text_of(children[0]))

    def boolean(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Literal(_place(meta), str(children[0]) == "true")

    def end_index(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.EndIndex(_place(meta))

    def colon(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Colon(_place(meta))

    def reference(self, meta: Meta, children: list[Any]) -> s.Reference:
        absolute = isinstance(children[0], Token)
        return s.Reference(_place(meta), tuple(c for c in children if isinstance(c, s.ReferencePart)), absolute)

    def reference_part(self, meta: Meta, children: list[Any]) -> s.ReferencePart:
        return s.ReferencePart(_name(children[0]), tuple(children[1]) if len(children) > 1 else None)

    def call(self, meta: Meta, children: list[Any]) -> s.FunctionCall:
        return self._call(meta, children[0], children[1])

    def der_call(self, meta: Meta, children: list[Any]) -> s.FunctionCall:
        return self._call(meta, s.Reference(_place(meta), (s.ReferencePart("der", None),)), children[1])

    def _call(self, meta: Meta, reference: s.Reference, call_arguments: Several) -> s.FunctionCall:
        if call_arguments.kind == "comprehension":
            return s.FunctionCall(_place(meta), reference, [call_arguments[0]], {}, list(call_arguments[1]))
        named: dict[str, SyntaxNode] = {}
        arguments: list[SyntaxNode] = []
        for a in call_arguments:
            if isinstance(a, tuple):
                if a[0] in named:
                    raise ModelicaError(f"argument '{a[0]}' of {reference}() is specified twice", _place(meta))
                named[a[0]] = a[1]
            elif named:
                raise ModelicaError(f"a positional argument of {reference}() follows a named one", _place(meta))
            else:
                arguments.append(a)
        return s.FunctionCall(_place(meta), reference, arguments, named)

    def call_arguments(self, meta: Meta, children: list[Any]) -> Several:
        return Several("arguments", children)

    def call_comprehension(self, meta: Meta, children: list[Any]) -> Several:
        return Several("comprehension", children)

    def named_argument(self, meta: Meta, children: list[Any]) -> tuple[str, SyntaxNode]:
        return str(children[0]), children[1]

    def function_argument(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.FunctionArgument(_place(meta), ".".join(p.name for p in children[0].parts))

    def parenthesis(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        items = list(children[0])
        return items[0] if len(items) == 1 and items[0] is not None else s.Outputs(_place(meta), items)

    def output(self, meta: Meta, children: list[Any]) -> Any:
        return children[0] if children else None

    def matrix(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Matrix(_place(meta), [list(row) for row in children])

    def array(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Array(_place(meta), children)

    def comprehension(self, meta: Meta, children: list[Any]) -> SyntaxNode:
        return s.Comprehension(_place(meta), children[0], list(children[1]))


def _fill(item: ClassText, composition: Several) -> None:
    """Add elements and sections to a class in order. Raises ModelicaError for a name declared twice."""
    names: dict[str, Place] = {}

    def enter(name: str, at: Place) -> None:
        if name in names:
            raise ModelicaError(f"'{name}' is declared twice in {item.name}, first in line {names[name].line}", at)
        names[name] = at

    for c in composition:
        if isinstance(c, s.Extends):
            item.elements.append(c)
        elif not isinstance(c, Several):
            continue
        elif c.kind == "composition":
            _fill_names(item, c, enter)
        else:
            _enter(item, c, enter)


def _fill_names(item: ClassText, composition: Several, enter: Any) -> None:
    for c in composition:
        if isinstance(c, s.Extends):
            item.elements.append(c)
        elif isinstance(c, Several):
            _enter(item, c, enter)


def _enter(item: ClassText, c: Several, enter: Any) -> None:
    if c.kind == "components":
        for component in c:
            enter(component.name, component.at)
            item.elements.append(component)
    elif c.kind == "classes":
        enter(c[0].name, c[0].at)
        c[0].scope = item
        item.redeclares |= "redeclare" in c[0].prefixes
        item.classes[c[0].name] = c[0]
    elif c.kind == "imports":
        for one in c:
            if one.name and any(one.name == other.name for other in item.imports):
                raise ModelicaError(f"'{one.name}' is imported twice in {item.name}", one.at)
            item.imports.append(one)
    elif c.kind == "annotation":
        item.annotation = c[0]
    elif c.kind == "external":
        item.external = c[0]
    elif c.kind in ("equations", "initial_equations", "constraints"):
        getattr(item, c.kind).extend(c)
    elif c.kind in ("algorithms", "initial_algorithms"):
        getattr(item, c.kind).append(list(c))
