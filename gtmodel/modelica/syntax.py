"""Syntax tree of a Modelica text: classes, their elements, equations, statements and expressions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from .._pickling import PortableError
from ..lang.source import ModelError, SourceLocation, of_frame


@dataclass(frozen=True, eq=False)
class Source:
    """One file of text; the path is empty for text without a file."""

    path: str
    text: str

    @property
    def name(self) -> str:
        return self.path or "<text>"

    @cached_property
    def lines(self) -> list[str]:
        # as lark counts lines: a form feed does not end a line
        return [line.removesuffix("\r") for line in self.text.removesuffix("\n").split("\n")]

    @property
    def folder(self) -> Path:
        return Path(self.path).parent

    def line(self, number: int) -> str:
        """Return a line, counted from 1, without surrounding blanks; "" beyond the end."""
        return self.lines[number - 1].strip() if 0 < number <= len(self.lines) else ""


class Place(NamedTuple):
    """A position in a text: line and column from 1."""

    source: Source
    line: int
    column: int

    @property
    def where(self) -> SourceLocation:
        return of_frame(self.source.name, self.line)


SHOWN = 100  # characters of a text line in an error message


class ModelicaError(PortableError, ModelError):
    """Error in a Modelica text, or a construct that gtmodel does not support; shows file, line number and line."""

    def __init__(self, sentence: str, place: Place | None = None) -> None:
        self.sentence, self.place = sentence, place
        text = place.source.line(place.line) if place is not None else ""
        if len(text) > SHOWN:
            text = f"{text[:SHOWN]}..."
        super().__init__(f"{sentence}: {text}" if text else sentence, place.where if place is not None else None)


@dataclass(eq=False, slots=True)
class SyntaxNode:
    """A node of the syntax tree with its place in the text."""

    at: Place


# expressions


@dataclass(eq=False, slots=True)
class Literal(SyntaxNode):
    value: float | int | bool | str


class ReferencePart(NamedTuple):
    """One name of a reference with its subscripts: `x[1, :]`."""

    name: str
    subscripts: tuple[SyntaxNode, ...] | None


@dataclass(eq=False, slots=True)
class Reference(SyntaxNode):
    """`a.b[2].c`; absolute with a leading dot."""

    parts: tuple[ReferencePart, ...]
    absolute: bool = False

    def __str__(self) -> str:
        return ".".join(p.name for p in self.parts)


@dataclass(eq=False, slots=True)
class FunctionCall(SyntaxNode):
    reference: Reference
    arguments: list[SyntaxNode]
    named: dict[str, SyntaxNode]
    loops: list[Loop] | None = None  # sum(e for i in r): the one argument is e


@dataclass(eq=False, slots=True)
class FunctionArgument(SyntaxNode):
    name: str


@dataclass(eq=False, slots=True)
class Unary(SyntaxNode):
    operator: str
    operand: SyntaxNode


@dataclass(eq=False, slots=True)
class Binary(SyntaxNode):
    operator: str
    left: SyntaxNode
    right: SyntaxNode


@dataclass(eq=False, slots=True)
class Conditional(SyntaxNode):
    branches: list[tuple[SyntaxNode, SyntaxNode]]
    otherwise: SyntaxNode


@dataclass(eq=False, slots=True)
class Array(SyntaxNode):
    items: list[SyntaxNode]


@dataclass(eq=False, slots=True)
class Comprehension(SyntaxNode):
    item: SyntaxNode
    loops: list[Loop]


@dataclass(eq=False, slots=True)
class Matrix(SyntaxNode):
    rows: list[list[SyntaxNode]]


@dataclass(eq=False, slots=True)
class Range(SyntaxNode):
    start: SyntaxNode
    step: SyntaxNode | None
    stop: SyntaxNode


@dataclass(eq=False, slots=True)
class Colon(SyntaxNode):
    pass


@dataclass(eq=False, slots=True)
class EndIndex(SyntaxNode):
    pass


@dataclass(eq=False, slots=True)
class Outputs(SyntaxNode):
    """`(a, , b)`: outputs of a function, some omitted."""

    items: list[SyntaxNode | None]


@dataclass(eq=False, slots=True)
class Loop(SyntaxNode):
    name: str
    over: SyntaxNode | None


# equations and statements


@dataclass(eq=False, slots=True)
class Equal(SyntaxNode):
    left: SyntaxNode
    right: SyntaxNode


@dataclass(eq=False, slots=True)
class Calls(SyntaxNode):
    """A call as an equation or statement, or a relation as a constraint."""

    expression: SyntaxNode


@dataclass(eq=False, slots=True)
class If(SyntaxNode):
    branches: list[tuple[SyntaxNode, list[Any]]]
    otherwise: list[Any] | None


@dataclass(eq=False, slots=True)
class For(SyntaxNode):
    loops: list[Loop]
    body: list[Any]


@dataclass(eq=False, slots=True)
class WhenEquation(SyntaxNode):
    branches: list[tuple[SyntaxNode, list[Any]]]


@dataclass(eq=False, slots=True)
class Connect(SyntaxNode):
    a: Reference
    b: Reference


@dataclass(eq=False, slots=True)
class Assign(SyntaxNode):
    """`x := e` or `(x, , y) := f(...)`."""

    targets: list[SyntaxNode | None]
    value: SyntaxNode


@dataclass(eq=False, slots=True)
class While(SyntaxNode):
    condition: SyntaxNode
    body: list[Any]


@dataclass(eq=False, slots=True)
class TextJump(SyntaxNode):
    word: str


# declarations


@dataclass(eq=False, slots=True)
class Modification(SyntaxNode):
    arguments: list[Argument]
    value: SyntaxNode | None = None


@dataclass(eq=False, slots=True)
class Argument(SyntaxNode):
    """One modification: of an attribute or element by name, or a redeclaration."""

    name: tuple[str, ...]
    modification: Modification | None
    prefixes: frozenset[str]
    redeclared: Component | ClassText | None = None


@dataclass(eq=False, slots=True)
class Component(SyntaxNode):
    name: str
    type_name: Reference
    prefixes: frozenset[str]
    dimensions: tuple[SyntaxNode, ...]
    modification: Modification | None
    condition: SyntaxNode | None
    description: str
    protected: bool = False
    constraint: Extends | None = None  # of constrainedby


@dataclass(eq=False, slots=True)
class Extends(SyntaxNode):
    base: Reference
    modification: Modification | None
    protected: bool = False


@dataclass(eq=False, slots=True)
class Import(SyntaxNode):
    """name: the local name; "" for all names of `reference`."""

    name: str
    reference: Reference


@dataclass(eq=False)
class ClassText(SyntaxNode):
    """A class definition."""

    name: str
    restriction: str
    prefixes: frozenset[str] = frozenset()
    header: Modification | None = None
    description: str = ""
    elements: list[Component | Extends] = field(default_factory=list)
    classes: dict[str, ClassText] = field(default_factory=dict)
    imports: list[Import] = field(default_factory=list)
    equations: list[SyntaxNode] = field(default_factory=list)
    initial_equations: list[SyntaxNode] = field(default_factory=list)
    algorithms: list[list[SyntaxNode]] = field(default_factory=list)
    initial_algorithms: list[list[SyntaxNode]] = field(default_factory=list)
    constraints: list[SyntaxNode] = field(default_factory=list)
    literals: list[str] | None = None
    external: SyntaxNode | None = None
    unsupported: str = ""  # why a class of this form is not supported, for the error when it is used
    # for `class A = B[3](...)`; its only element is an Extends of B
    dimensions: tuple[SyntaxNode, ...] = ()
    type_prefixes: frozenset[str] = frozenset()
    short: bool = False
    annotation: Modification | None = None
    constraint: Extends | None = None  # of constrainedby
    redeclares: bool = False  # True if it redeclares a local class
    scope: ClassText | None = None
    within: tuple[str, ...] = ()

    @property
    def full_name(self) -> str:
        return f"{self.scope.full_name}.{self.name}" if self.scope is not None and self.scope.name else self.name

    def walk(self) -> Iterator[ClassText]:
        """Yield this class and all local classes, in the order of the text."""
        yield self
        for inner in self.classes.values():
            yield from inner.walk()
