"""Connections: potentials of joined connectors are equal, and their flows sum to zero; expandable connectors
(Modelica 3.6, section 9.1.3) have the variables that are connected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .constraints import Flattened, expressions
from .expressions import Evaluator
from .instances import Declared, Instance, NameScope, TextElement
from .members import Missing
from .modifications import Modifier
from .multibody.assembly import Assembly
from .multibody.parts import is_frame
from .scalars import Flat, Operation, Symbol, number_of, symbols
from .syntax import Component, Connect, For, If, Literal, ModelicaError, Place, Reference, SyntaxNode

Face = tuple[int, bool]  # a flow variable, and whether it is seen from inside its component


class Connections:
    """What is joined so far, as sets."""

    def __init__(self) -> None:
        self.assembly = Assembly()
        self.equalities: list[tuple[Flat, Flat, Place]] = []
        self._above: dict[int, int] = {}
        self._sets: dict[Face, Face] = {}
        self._flats: dict[int, Flat] = {}
        self._places: dict[Face, Place] = {}

    def connect(self, node: Connect, scope: NameScope, model: Evaluator) -> None:
        """Join two connectors. Raises ModelicaError for what is none, and for connectors that do not fit."""
        try:
            a, b = (model.evaluate(r, scope) for r in (node.a, node.b))
        except Missing:
            return  # one end has a condition that is false
        outside = [self._is_outside(r, scope) for r in (node.a, node.b)]
        self._join(a, b, outside, node)

    @staticmethod
    def _is_outside(reference: Reference, scope: NameScope) -> bool:
        """Is it a connector of the component whose equations connect it?"""
        assert scope.instance is not None
        element = scope.instance.elements.get(reference.parts[0].name)
        if element is None:
            raise ModelicaError(f"there is no connector '{reference.parts[0].name}' here", reference.at)
        made = element.made
        if isinstance(made, np.ndarray) and made.size:
            made = made.ravel()[0]
        return made.connector if isinstance(made, Instance) else True

    def _join(self, a: Any, b: Any, outside: list[bool], node: Connect) -> None:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            if a.shape != b.shape:
                raise ModelicaError(f"connect() takes connectors of one shape; found {a.shape} and {b.shape}", node.at)
            for x, y in zip(a.ravel(), b.ravel(), strict=True):
                if isinstance(x, Instance) or isinstance(y, Instance):
                    self._join(x, y, outside, node)
                elif isinstance(x, Symbol) and isinstance(y, Symbol):
                    self._equal(x.flat, y.flat, node.at)
                else:
                    raise ModelicaError("connect() takes connectors", node.at)
            return
        if not isinstance(a, Instance) or not isinstance(b, Instance):
            raise ModelicaError("connect() takes two connectors of one kind", node.at)
        for item in (a, b):
            if not item.connector:
                raise ModelicaError(f"'{item.path}' is a {item.restriction} and no connector", node.at)
        if is_frame(a) and is_frame(b):
            self.assembly.join(a, b, node.at)
            return
        first, second = _leaves(a), _leaves(b)
        if first.keys() != second.keys():
            strange = sorted(first.keys() ^ second.keys())
            raise ModelicaError(
                f"'{a.path}' is a {a.space.name} and '{b.path}' a {b.space.name}: only one of them has '{strange[0]}'",
                node.at,
            )
        for name, x in first.items():
            y = second[name]
            if x.shape != y.shape or (x.flats[:1] and x.flats[0].flow != y.flats[0].flow):
                raise ModelicaError(f"'{name}' of '{a.path}' and of '{b.path}' do not fit", node.at)
            for p, q in zip(x.flats, y.flats, strict=True):
                if p.flow:
                    self._flow((id(p), not outside[0]), (id(q), not outside[1]), p, q, node.at)
                elif p.kind not in ("parameter", "constant"):
                    self._equal(p, q, node.at)
                elif number_of(Symbol(p), node.at) != number_of(Symbol(q), node.at):
                    raise ModelicaError(f"connectors whose '{p.name}' and '{q.name}' differ are joined", node.at)

    def _equal(self, a: Flat, b: Flat, at: Place) -> None:
        self._flats[id(a)], self._flats[id(b)] = a, b
        p, q = self._root(id(a)), self._root(id(b))
        if p != q:
            self._above[q] = p
            self.equalities.append((a, b, at))

    def _root(self, key: int) -> int:
        while (above := self._above.get(key, key)) != key:
            key = above
        return key

    def _flow(self, a: Face, b: Face, p: Flat, q: Flat, at: Place) -> None:
        self._flats[a[0]], self._flats[b[0]] = p, q
        for face in (a, b):
            self._sets.setdefault(face, face)
            self._places.setdefault(face, at)
        self._sets[self._set(b)] = self._set(a)

    def _set(self, face: Face) -> Face:
        while self._sets[face] != face:
            face = self._sets[face]
        return face

    def complete(self, instances: Sequence[Instance], root: Instance) -> None:
        """A flow that nothing is connected to from outside is zero."""
        for instance in instances:
            if instance.connector:
                continue
            for element in instance.elements.values():
                if "outer" in element.text.prefixes:
                    continue
                made = element.made
                several = made.ravel() if isinstance(made, np.ndarray) else [made]
                for item in several:
                    if isinstance(item, Instance) and item.connector and not is_frame(item):
                        for leaf in _leaves(item).values():
                            for flat in leaf.flats:
                                face = (id(flat), True)
                                if flat.flow and face not in self._sets:
                                    self._flats[face[0]], self._sets[face] = flat, face
                                    self._places[face] = element.text.at

    def sums(self) -> Iterator[tuple[Any, Place]]:
        """The sum of each set of flows; from inside of a component its own connectors count with the other sign."""
        members: dict[Face, list[Face]] = {}
        for face in self._sets:
            members.setdefault(self._set(face), []).append(face)
        for root, faces in members.items():
            total: Any = None
            place = self._places[faces[-1]] if len(faces) > 1 else self._places[root]
            for face in faces:
                symbol = Symbol(self._flats[face[0]])
                if total is None:
                    total = symbol if face[1] else Operation("neg", (symbol,), place)
                else:
                    total = Operation("+" if face[1] else "-", (total, symbol), place)
            yield total, place


def _leaves(connector: Instance, before: str = "") -> dict[str, Declared]:
    """Variables of a connector and of those inside it, by name."""
    result: dict[str, Declared] = {}
    for name, element in connector.elements.items():
        made = element.made
        if isinstance(made, Declared):
            result[before + name] = made
        elif isinstance(made, Instance):
            result |= _leaves(made, f"{before}{name}.")
        elif isinstance(made, np.ndarray):
            for n, item in enumerate(made.ravel()):
                result |= _leaves(item, f"{before}{name}[{n + 1}].")
    return result


OF_QUANTITY = ("unit", "quantity", "displayUnit")  # what a variable of a bus takes over beside its type


def is_bus(value: Any) -> bool:
    return isinstance(value, Instance) and "expandable" in value.space.text.prefixes


def give_variables(root: Instance, model: Any) -> None:
    """Declare in each bus what connect() asks of it, and what the buses joined with it have.

    Raises ModelicaError for arrays of buses, for variables that nothing gives a type, and for what a bus does not fit.
    """
    instances = list(root.walk())
    if not any(map(is_bus, instances)):
        return
    pairs: list[tuple[Instance, Instance]] = []
    open_ones: list[tuple[Connect, NameScope]] = []
    for instance in instances:
        for element in instance.elements.values():
            made = element.made
            if isinstance(made, np.ndarray) and made.size and is_bus(made.ravel()[0]):
                raise ModelicaError(
                    "an array of expandable connectors is not taken; declare each by itself", element.text.at
                )
        for section in instance.sections:
            open_ones += _connects(section.text.equations, section.scope, model)
    while open_ones:
        left = [item for item in open_ones if not _taken(*item, model, pairs)]
        _share(pairs)
        if len(left) == len(open_ones):
            node, scope = left[0]
            bus, name = _end(node.a, scope, model)
            assert isinstance(bus, Instance)
            raise ModelicaError(
                f"nothing says what '{bus.full(name)}' is: '{bus.path}' is an expandable connector, and so is the "
                "other end; connect the variable to a connector with a type, or declare it",
                node.at,
            )
        open_ones = left


def _connects(nodes: Sequence[SyntaxNode], scope: NameScope, model: Any) -> Iterator[tuple[Connect, NameScope]]:
    """The connect() of a section with their scopes, those of loops and of what parameters decide included."""
    for node in nodes:
        if isinstance(node, Connect):
            yield node, scope
        elif isinstance(node, For) and _holds_connect(node):
            for inside in model.loops(node.loops, scope, node.body):
                yield from _connects(node.body, inside, model)
        elif isinstance(node, If) and _holds_connect(node):
            for condition, body in [*node.branches, (None, node.otherwise or [])]:
                truth = True if condition is None else model.truth(condition, scope)
                if truth is True:
                    yield from _connects(body, scope, model)
                if truth is not False:
                    break


def _holds_connect(node: SyntaxNode) -> bool:
    if isinstance(node, If):
        return any(map(_holds_connect, [x for _, body in node.branches for x in body] + list(node.otherwise or [])))
    return isinstance(node, Connect) or (isinstance(node, For) and any(map(_holds_connect, node.body)))


def _end(reference: Reference, scope: NameScope, model: Any) -> tuple[Any, str]:
    """What an end of a connect() names; a bus with the name of a variable that it does not have yet, else with ""."""
    value: Any = None
    for n in range(len(reference.parts)):
        value = model.evaluate(Reference(reference.at, reference.parts[: n + 1]), scope)
        if not is_bus(value) or n + 1 == len(reference.parts):
            continue
        following = reference.parts[n + 1]
        if following.name not in value.elements:
            if n + 2 < len(reference.parts) or following.subscripts is not None:
                raise ModelicaError(
                    f"'{value.path}' is an expandable connector without a '{following.name}', of which a part is "
                    f"connected; declare '{following.name}' in {value.space.name}",
                    reference.at,
                )
            return value, following.name
    return value, ""


def _taken(node: Connect, scope: NameScope, model: Any, pairs: list[tuple[Instance, Instance]]) -> bool:
    """Give the buses at both ends what the connect() says of them; False where that is not known yet."""
    try:
        (a, name), (b, other) = (_end(r, scope, model) for r in (node.a, node.b))
    except Missing:
        return True
    if name and other:
        return False
    if name or other:
        bus, new, made, at = (a, name, b, node.b) if name else (b, other, a, node.a)
        _declare(bus, new, made, _element(at, scope, model), node.at)
    elif is_bus(a) and is_bus(b):
        pairs.append((a, b))
    elif is_bus(a) or is_bus(b):
        bus, plain = (a, b) if is_bus(a) else (b, a)
        what = plain.path if isinstance(plain, Instance) else str(node.b if bus is a else node.a)
        raise ModelicaError(
            f"'{bus.path}' is an expandable connector and '{what}' is none; connect one of its variables, "
            f"{bus.path}.name, or two expandable ones",
            node.at,
        )
    return True


def _element(reference: Reference, scope: NameScope, model: Any) -> TextElement:
    """The declaration behind a reference, without its subscripts."""
    *above, last = reference.parts
    holder = model.evaluate(Reference(reference.at, tuple(above)), scope) if above else scope.instance
    holder = holder.ravel()[0] if isinstance(holder, np.ndarray) else holder
    assert isinstance(holder, Instance)
    return holder.elements[last.name]


def _declare(bus: Instance, name: str, made: Any, of: TextElement, at: Place) -> None:
    """A variable of a bus, like the one that is connected to it; who computes it follows from the equations."""
    first = made.ravel()[0] if isinstance(made, np.ndarray) and made.size else made
    shape = made.shape if isinstance(made, np.ndarray) else ()
    declared, scope = of.said.redeclared or (of.text, of.scope)
    assert isinstance(declared, Component)
    text = replace(
        of.text, at=at, name=name, type_name=declared.type_name, condition=None, protected=False,
        prefixes=declared.prefixes - {"input", "output", "inner", "outer"},
        dimensions=tuple(Literal(at, n) for n in shape),
    )  # fmt: skip
    quantity = {k: m for k, m in of.said.inside.items() if k in OF_QUANTITY}
    said = of.said if isinstance(first, Instance) else Modifier(inside=quantity)
    element = TextElement(text, replace(said, value=None, redeclared=None), scope, bus)
    if isinstance(element.made, Declared):
        for flat in element.made.flats:
            if flat.kind == "input":
                flat.kind, flat.top = "input" if flat.base == "Real" else "variable", False
    bus.elements[name] = element


def _share(pairs: list[tuple[Instance, Instance]]) -> None:
    """What one of two joined buses has the other one has too; buses inside of them are joined in turn."""
    joined = {(id(a), id(b)) for a, b in pairs}
    changed = True
    while changed:
        changed = False
        for a, b in list(pairs):
            for one, other in ((a, b), (b, a)):
                for name, element in list(one.elements.items()):
                    if name not in other.elements and element.made is not None:
                        made = element.made.symbols if isinstance(element.made, Declared) else element.made
                        _declare(other, name, made, element, element.text.at)
                        changed = True
            for name in a.elements.keys() & b.elements.keys():
                inside = a.elements[name].made, b.elements[name].made
                if all(map(is_bus, inside)) and (id(inside[0]), id(inside[1])) not in joined:
                    joined.add((id(inside[0]), id(inside[1])))
                    pairs.append(inside)
                    changed = True


def drop_unused(instances: Sequence[Instance], out: Flattened, connections: Connections) -> None:
    """A variable that a bus declares is none in a simulation where no equation and no other connector has it."""
    own: dict[int, Flat] = {
        id(f): f for i in instances if is_bus(i) for e in i.elements.values() if isinstance(e.made, Declared)
        for f in e.made.flats if not f.flow and f.kind not in ("parameter", "constant")
    }  # fmt: skip
    if not own or out.optimization:
        return
    used = {id(f) for e in (*out.equations, *out.initial, *out.constraints) for x in expressions(e) for f in symbols(x)}
    used |= {id(f) for flat in out.flats if flat.replaced is not None for f in symbols(flat.replaced)}
    pairs = connections.equalities
    alive = {key for a, b, _ in pairs for key in (id(a), id(b)) if key not in own} | (used & own.keys())
    growing = True
    while growing:
        more = {k for a, b, _ in pairs if {id(a), id(b)} & alive for k in (id(a), id(b))} - alive
        alive |= more
        growing = bool(more)
    dead = own.keys() - alive
    out.flats = [f for f in out.flats if id(f) not in dead]
    connections.equalities = [p for p in pairs if id(p[0]) not in dead]
