"""Connections: potentials of joined connectors are equal, and their flows sum to zero."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from .expressions import Evaluator
from .instances import Declared, Instance, NameScope
from .members import Missing
from .multibody.assembly import Assembly
from .multibody.parts import is_frame
from .scalars import Flat, Operation, Symbol, number_of
from .syntax import Connect, ModelicaError, Place, Reference

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
