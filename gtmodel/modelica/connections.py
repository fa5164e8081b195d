"""Connection equations: equal potentials, flows that sum to zero; and variables of expandable connectors
(Modelica 3.6, section 9.1.3)."""

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

Face = tuple[int, bool]  # id of a flow variable; True for an inside connector


class Connections:
    """Connection sets."""

    def __init__(self) -> None:
        self.assembly = Assembly()
        self.equalities: list[tuple[Flat, Flat, Place]] = []
        self._above: dict[int, int] = {}
        self._sets: dict[Face, Face] = {}
        self._flats: dict[int, Flat] = {}
        self._places: dict[Face, Place] = {}

    def connect(self, node: Connect, scope: NameScope, model: Evaluator) -> None:
        """Connect two connectors. Raises ModelicaError for other components, and for connectors that do not match."""
        try:
            a, b = (model.evaluate(r, scope) for r in (node.a, node.b))
        except Missing:
            return  # the condition of one end is false
        outside = [self._is_outside(r, scope) for r in (node.a, node.b)]
        self._join(a, b, outside, node)

    @staticmethod
    def _is_outside(reference: Reference, scope: NameScope) -> bool:
        """True for an outside connector, or for a connector variable of the component itself."""
        assert scope.instance is not None
        element = scope.instance.elements.get(reference.parts[0].name)
        if element is None:
            raise ModelicaError(f"there is no connector '{reference.parts[0].name}' here", reference.at)
        component = element.component
        if isinstance(component, np.ndarray) and component.size:
            component = component.ravel()[0]
        return component.connector if isinstance(component, Instance) else True

    def _join(self, a: Any, b: Any, outside: list[bool], node: Connect) -> None:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            if a.shape != b.shape:
                raise ModelicaError(f"connect() needs arrays of the same shape; found {a.shape} and {b.shape}", node.at)
            for x, y in zip(a.ravel(), b.ravel(), strict=True):
                if isinstance(x, Instance) or isinstance(y, Instance):
                    self._join(x, y, outside, node)
                elif isinstance(x, Symbol) and isinstance(y, Symbol):
                    self._equal(x.flat, y.flat, node.at)
                else:
                    raise ModelicaError("connect() needs two connectors", node.at)
            return
        if not isinstance(a, Instance) or not isinstance(b, Instance):
            raise ModelicaError("connect() needs two connectors of the same kind", node.at)
        for item in (a, b):
            if not item.connector:
                raise ModelicaError(f"'{item.path}' is a {item.restriction}, not a connector", node.at)
        if is_frame(a) and is_frame(b):
            self.assembly.join(a, b, node.at)
            return
        first, second = _leaves(a), _leaves(b)
        if first.keys() != second.keys():
            strange = sorted(first.keys() ^ second.keys())
            raise ModelicaError(
                f"'{a.path}' is a {a.space.name}, '{b.path}' is a {b.space.name}: only one of them has '{strange[0]}'",
                node.at,
            )
        for name, x in first.items():
            y = second[name]
            if x.shape != y.shape or (x.flats[:1] and x.flats[0].flow != y.flats[0].flow):
                raise ModelicaError(
                    f"'{name}' differs in shape or flow prefix between '{a.path}' and '{b.path}'", node.at
                )
            for p, q in zip(x.flats, y.flats, strict=True):
                if p.flow:
                    self._flow((id(p), not outside[0]), (id(q), not outside[1]), p, q, node.at)
                elif p.kind not in ("parameter", "constant"):
                    self._equal(p, q, node.at)
                elif number_of(Symbol(p), node.at) != number_of(Symbol(q), node.at):
                    raise ModelicaError(
                        f"the parameters '{p.name}' and '{q.name}' of connected connectors differ", node.at
                    )

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
        """Add a set for each unconnected flow of an inside connector; its sum makes the flow zero."""
        for instance in instances:
            if instance.connector:
                continue
            for element in instance.elements.values():
                if "outer" in element.text.prefixes:
                    continue
                component = element.component
                items = component.ravel() if isinstance(component, np.ndarray) else [component]
                for item in items:
                    if isinstance(item, Instance) and item.connector and not is_frame(item):
                        for leaf in _leaves(item).values():
                            for flat in leaf.flats:
                                face = (id(flat), True)
                                if flat.flow and face not in self._sets:
                                    self._flats[face[0]], self._sets[face] = flat, face
                                    self._places[face] = element.text.at

    def sums(self) -> Iterator[tuple[Any, Place]]:
        """Yield the sum of each set of flows, with the opposite sign for outside connectors."""
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
    """Return the variables of a connector and of nested connectors by name."""
    result: dict[str, Declared] = {}
    for name, element in connector.elements.items():
        component = element.component
        if isinstance(component, Declared):
            result[before + name] = component
        elif isinstance(component, Instance):
            result |= _leaves(component, f"{before}{name}.")
        elif isinstance(component, np.ndarray):
            for n, item in enumerate(component.ravel()):
                result |= _leaves(item, f"{before}{name}[{n + 1}].")
    return result


OF_QUANTITY = ("unit", "quantity", "displayUnit")  # attributes that a variable of a bus inherits beside its type


def is_bus(value: Any) -> bool:
    return isinstance(value, Instance) and "expandable" in value.space.text.prefixes


def give_variables(root: Instance, model: Any) -> None:
    """Declare in each expandable connector (bus) the connected variables, and the variables of connected buses.

    Raises ModelicaError for arrays of buses, for variables without a known type, and for a bus that is connected to
    another kind of connector.
    """
    instances = list(root.walk())
    if not any(map(is_bus, instances)):
        return
    pairs: list[tuple[Instance, Instance]] = []
    open_connects: list[tuple[Connect, NameScope]] = []
    for instance in instances:
        for element in instance.elements.values():
            component = element.component
            if isinstance(component, np.ndarray) and component.size and is_bus(component.ravel()[0]):
                raise ModelicaError(
                    "an array of expandable connectors is not supported; declare them one by one", element.text.at
                )
        for section in instance.sections:
            open_connects += _connects(section.text.equations, section.scope, model)
    while open_connects:
        remaining = [item for item in open_connects if not _taken(*item, model, pairs)]
        _share(pairs)
        if len(remaining) == len(open_connects):
            node, scope = remaining[0]
            bus, name = _end(node.a, scope, model)
            assert isinstance(bus, Instance)
            raise ModelicaError(
                f"the type of '{bus.full(name)}' is unknown: both ends are undeclared in expandable connectors; "
                "connect the variable to a declared one, or declare it",
                node.at,
            )
        open_connects = remaining


def _connects(nodes: Sequence[SyntaxNode], scope: NameScope, model: Any) -> Iterator[tuple[Connect, NameScope]]:
    """Yield the connect equations of a section with their scopes, also those in loops and in ifs of parameters."""
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
    """Return the component at one end of a connect() and ""; or a bus and the name of its undeclared variable."""
    value: Any = None
    for n in range(len(reference.parts)):
        value = model.evaluate(Reference(reference.at, reference.parts[: n + 1]), scope)
        if not is_bus(value) or n + 1 == len(reference.parts):
            continue
        following = reference.parts[n + 1]
        if following.name not in value.elements:
            if n + 2 < len(reference.parts) or following.subscripts is not None:
                raise ModelicaError(
                    f"'{value.path}' is an expandable connector without a '{following.name}', of which "
                    f"a part is connected; declare '{following.name}' in {value.space.name}",
                    reference.at,
                )
            return value, following.name
    return value, ""


def _taken(node: Connect, scope: NameScope, model: Any, pairs: list[tuple[Instance, Instance]]) -> bool:
    """Declare the variable that a connect() adds to a bus; False if its type is not known yet."""
    try:
        (a, name), (b, name_b) = (_end(r, scope, model) for r in (node.a, node.b))
    except Missing:
        return True
    if name and name_b:
        return False
    if name or name_b:
        bus, new, connected, reference = (a, name, b, node.b) if name else (b, name_b, a, node.a)
        _declare(bus, new, connected, _element(reference, scope, model), node.at)
    elif is_bus(a) and is_bus(b):
        pairs.append((a, b))
    elif is_bus(a) or is_bus(b):
        bus, plain = (a, b) if is_bus(a) else (b, a)
        plain_name = plain.path if isinstance(plain, Instance) else str(node.b if bus is a else node.a)
        raise ModelicaError(
            f"'{bus.path}' is an expandable connector and '{plain_name}' is not; connect one of its variables, "
            f"{bus.path}.name, or another expandable connector",
            node.at,
        )
    return True


def _element(reference: Reference, scope: NameScope, model: Any) -> TextElement:
    """Return the declaration to which a reference refers, without its subscripts."""
    *above, last = reference.parts
    holder = model.evaluate(Reference(reference.at, tuple(above)), scope) if above else scope.instance
    holder = holder.ravel()[0] if isinstance(holder, np.ndarray) else holder
    assert isinstance(holder, Instance)
    return holder.elements[last.name]


def _declare(bus: Instance, name: str, connected: Any, declaration: TextElement, at: Place) -> None:
    """Declare a variable of a bus like the connected one, without causality, which follows from the equations."""
    example = connected.ravel()[0] if isinstance(connected, np.ndarray) and connected.size else connected
    shape = connected.shape if isinstance(connected, np.ndarray) else ()
    declared, scope = declaration.modifier.redeclared or (declaration.text, declaration.scope)
    assert isinstance(declared, Component)
    text = replace(
        declaration.text, at=at, name=name, type_name=declared.type_name, condition=None, protected=False,
        prefixes=declared.prefixes - {"input", "output", "inner", "outer"},
        dimensions=tuple(Literal(at, n) for n in shape),
    )  # fmt: skip
    quantity = {k: m for k, m in declaration.modifier.inside.items() if k in OF_QUANTITY}
    modifier = declaration.modifier if isinstance(example, Instance) else Modifier(inside=quantity)
    element = TextElement(text, replace(modifier, value=None, redeclared=None), scope, bus)
    if isinstance(element.component, Declared):
        for flat in element.component.flats:
            if flat.kind == "input":
                flat.kind, flat.top = "input" if flat.base == "Real" else "variable", False
    bus.elements[name] = element


def _share(pairs: list[tuple[Instance, Instance]]) -> None:
    """Declare in both of two connected buses the variables of each; nested buses are connected likewise."""
    joined = {(id(a), id(b)) for a, b in pairs}
    changed = True
    while changed:
        changed = False
        for a, b in list(pairs):
            for source, other in ((a, b), (b, a)):
                for name, element in list(source.elements.items()):
                    if name not in other.elements and element.component is not None:
                        connected = (
                            element.component.symbols if isinstance(element.component, Declared) else element.component
                        )
                        _declare(other, name, connected, element, element.text.at)
                        changed = True
            for name in a.elements.keys() & b.elements.keys():
                nested = a.elements[name].component, b.elements[name].component
                if all(map(is_bus, nested)) and (id(nested[0]), id(nested[1])) not in joined:
                    joined.add((id(nested[0]), id(nested[1])))
                    pairs.append(nested)
                    changed = True


def drop_unused(instances: Sequence[Instance], out: Flattened, connections: Connections) -> None:
    """Remove, from a simulation, declared variables of a bus without an equation and without another connection."""
    bus_variables: dict[int, Flat] = {
        id(f): f for i in instances if is_bus(i) for e in i.elements.values() if isinstance(e.component, Declared)
        for f in e.component.flats if not f.flow and f.kind not in ("parameter", "constant")
    }  # fmt: skip
    if not bus_variables or out.optimization:
        return
    used = {id(f) for e in (*out.equations, *out.initial, *out.constraints) for x in expressions(e) for f in symbols(x)}
    used |= {id(f) for flat in out.flats if flat.replaced is not None for f in symbols(flat.replaced)}
    pairs = connections.equalities
    alive = {key for a, b, _ in pairs for key in (id(a), id(b)) if key not in bus_variables} | (
        used & bus_variables.keys()
    )
    changed = True
    while changed:
        more = {k for a, b, _ in pairs if {id(a), id(b)} & alive for k in (id(a), id(b))} - alive
        alive |= more
        changed = bool(more)
    dead = bus_variables.keys() - alive
    out.flats = [f for f in out.flats if id(f) not in dead]
    connections.equalities = [p for p in pairs if id(p[0]) not in dead]
