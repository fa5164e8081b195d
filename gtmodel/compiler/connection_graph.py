"""Trees of overdetermined connectors: a loop, or two roots in one tree, is an error that names its way."""

from __future__ import annotations

from ..lang.connect import Connection, TreeEdge
from ..lang.model import Connector
from ..lang.source import ModelError, SourceLocation

ROOT = -1  # stands for all roots together: two of them in one tree are a loop through it


def check_trees(connections: list[Connection], edges: list[TreeEdge]) -> None:
    """Raises ModelError for a loop of edges and connections between overdetermined connectors.

    The sentence names the line that closes the loop and the ports along it; connections close loops, because the
    edges inside components are laid first.
    """
    links: list[tuple[Connector | None, Connector, SourceLocation]] = [(e.a, e.b, e.where) for e in edges]
    links += [(c.a, c.b, c.where) for c in connections if c.a.overdetermined]
    neighbours: dict[int, list[int]] = {ROOT: []}
    ports: dict[int, Connector] = {}
    for a, b, where in links:
        ports.update({id(p): p for p in (a, b) if p is not None})
        start, end = ROOT if a is None else id(a), id(b)
        way = _way(neighbours, start, end)
        if way:
            raise ModelError(_sentence([ports[n] for n in way if n != ROOT], ROOT in way), where)
        neighbours.setdefault(start, []).append(end)
        neighbours.setdefault(end, []).append(start)


def _way(neighbours: dict[int, list[int]], start: int, end: int) -> list[int]:
    """The only way from start to end in a forest, or an empty list."""
    before: dict[int, int] = {start: start}
    stack = [start]
    while stack:
        node = stack.pop()
        for other in neighbours.get(node, []):
            if other not in before:
                before[other] = node
                stack.append(other)
    if end not in before:
        return []
    way = [end]
    while way[-1] != start:
        way.append(before[way[-1]])
    return way[::-1]


def _sentence(ports: list[Connector], through_root: bool) -> str:
    names = " - ".join(p._path for p in ports)
    components = list(dict.fromkeys(p._path.rpartition(".")[0] or p._path for p in ports))
    what = "two components fix it in the world and here they meet" if through_root else "here it closes"
    return f"a loop of {', '.join(components)} ({names}): {what}; {ports[0].overdetermined}"
