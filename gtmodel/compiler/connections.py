"""Equations of connections: equal potentials and flows that sum to zero."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from ..lang.bind import Tree, element_names
from ..lang.connect import Connection
from ..lang.declarations import Variable
from ..lang.expression import row_by_row
from ..lang.model import Connector, Model
from ..lang.source import ModelError, SourceLocation
from .matrices import difference, total

Face = tuple[int, bool]  # port number, seen from inside its owner


def connection_equations(
    tree: Tree, connections: list[tuple[Connection, Model]]
) -> Iterator[tuple[ca.SX, str, str, SourceLocation]]:
    """Yield the equations of all connection sets as (residual, label, component path, where).

    Inside the component that owns a port, its flow has the opposite sign. Raises ModelError for a connection of a port
    that belongs neither to the component nor to one of its parts.
    """
    number = {id(p): i for i, p in enumerate(tree.ports)}
    parent: dict[Face, Face] = {}

    def find(face: Face) -> Face:
        while parent.setdefault(face, face) != face:
            parent[face] = parent[parent[face]]
            face = parent[face]
        return face

    where: dict[Face, SourceLocation] = {}
    for connection, component in connections:
        faces = []
        for port in (connection.a, connection.b):
            owner = port._parent
            while isinstance(owner, Connector):  # a port inside a port belongs to the same component
                owner = owner._parent
            inside = owner is component
            if not inside and (owner is None or owner._parent is not component):
                raise ModelError(
                    f"port '{port._path}' belongs neither to '{component._path or type(component).__name__}' nor to "
                    "one of its parts; connect it in the component that contains it",
                    connection.where,
                )
            faces.append((number[id(port)], inside))
        a, b = find(faces[0]), find(faces[1])
        if a == b:
            raise ModelError(
                f"'{connection.a._path}' and '{connection.b._path}' are connected twice; remove one connection",
                connection.where,
            )
        parent[max(a, b)] = min(a, b)
        where.setdefault(faces[0], connection.where)
        where.setdefault(faces[1], connection.where)
    for i in range(len(tree.ports)):
        find((i, False))
    sets: dict[Face, list[Face]] = {}
    for face in sorted(parent):
        sets.setdefault(find(face), []).append(face)
    for _, faces in sorted(sets.items()):
        yield from _set_equations(tree, faces, where)


def _set_equations(
    tree: Tree, faces: list[Face], where: dict[Face, SourceLocation]
) -> Iterator[tuple[ca.SX, str, str, SourceLocation]]:
    ports: list[Connector] = [tree.ports[i] for i, _ in faces]
    first = ports[0]
    origin = next((where[f] for f in faces if f in where), None)
    names = " ~ ".join(p._path for p in ports)
    for name, item in type(first)._declared.items():
        if not isinstance(item, Variable):
            continue
        line = origin or item.where
        component = first._path.rpartition(".")[0]
        columns = [row_by_row(getattr(p, name).sx) for p in ports]
        for k, element in enumerate(element_names(name, item.shape)):
            if item.role == "flow":
                flow = ca.SX(0)
                for column, (_, inside) in zip(columns, faces, strict=True):
                    flow = (difference if inside else total)(flow, column[k])
                yield flow, f"flow {element} of {names}", component, line
            elif item.role == "potential":
                for column, port in zip(columns[1:], ports[1:], strict=True):
                    label = f"connection {first._path}.{element} ~ {port._path}.{element}"
                    yield difference(columns[0][k], column[k]), label, component, line
