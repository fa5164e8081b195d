"""Trees of overdetermined connectors: in each loop one joint is cut, which then uses its constraints."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from ..lang.connect import Connection, Loops, TreeEdge
from ..lang.model import Connector, Model
from ..lang.source import ModelError, SourceLocation

ROOT = -1  # one node for all roots: two roots in one tree form a loop through it


@dataclass(frozen=True, eq=False)
class TreeStep:
    """One component edge along a loop, passed from its port a to its port b, or the reverse (`forward` False)."""

    edge: TreeEdge
    component: Model
    forward: bool


@dataclass(frozen=True, eq=False)
class LoopCut:
    """A joint that closes a loop, and the other edges of the loop on the way from its port a to its port b."""

    edge: TreeEdge
    component: Model
    steps: tuple[TreeStep, ...]


@dataclass(frozen=True, eq=False)
class _Link:
    """A link of the graph of ports: a connection (`component` None) or an edge of a component."""

    start: int
    end: int
    where: SourceLocation
    edge: TreeEdge | None = None
    component: Model | None = None


def loop_of(component: Model, cut: LoopCut | None) -> str:
    """Return the joints of a loop in order, such as "crank - elbow - rocker - wrist"; the last one closes it."""
    joints = [s.component._path for s in cut.steps if s.edge.closing is not None] if cut is not None else []
    return " - ".join([*joints, component._path])


def cuts_of(
    connections: Sequence[Connection], edges: Sequence[tuple[TreeEdge, Model]], loops: Sequence[Loops]
) -> tuple[list[LoopCut], set[int], list[Model]]:
    """Return the joints that are cut so that connections and edges form trees, in order of declaration, the ids of the
    edges that the trees pass from port b to port a, and the components of trees without a root.

    Cut are the joints that the user names, then passive joints, those farthest from the roots and declared last first.
    Raises ModelError for a loop without a joint that can be cut, naming its ports and the line that closes it, and for
    a joint named by the user that closes no loop.
    """
    ports = {id(p): p for e, _ in edges for p in (e.a, e.b) if p is not None}
    links = [_Link(ROOT if e.a is None else id(e.a), id(e.b), e.where, e, c) for e, c in edges]
    for c in connections:
        if c.a.overdetermined:
            ports |= {id(c.a): c.a, id(c.b): c.b}
            links.append(_Link(id(c.a), id(c.b), c.where))
    depth = _depths(links)
    named = {id(joint) for entry in loops for joint in entry.cut}
    driven = _driven(connections)
    ranked = sorted(links, key=lambda link: _rank(link, depth, named, driven))
    forest: dict[int, list[tuple[int, _Link]]] = {ROOT: []}
    cuts: list[LoopCut] = []
    for link in ranked:
        path = _path(forest, link.start, link.end)
        if path is None:
            forest.setdefault(link.start, []).append((link.end, link))
            forest.setdefault(link.end, []).append((link.start, link))
        elif link.edge is None or link.edge.closing is None:
            nodes = [link.start, *(n for n, _ in path)]
            raise ModelError(_sentence([ports[n] for n in nodes if n != ROOT], ROOT in nodes), link.where)
        else:
            nodes = [link.start, *(n for n, _ in path)]
            steps = [
                TreeStep(on.edge, on.component, on.start == before)
                for before, (_, on) in zip(nodes, path, strict=False)
                if on.edge is not None and on.component is not None and on.edge.a is not None
            ]
            assert link.component is not None
            cuts.append(LoopCut(link.edge, link.component, tuple(steps)))
    for entry in loops:
        for joint in entry.cut:
            if not any(_inside(c.component, {id(joint)}) for c in cuts):
                raise ModelError(
                    f"loops(cut=...) names '{joint._path}', which closes no loop; name a joint of a loop"
                    + (f", such as '{cuts[0].component._path}'" if cuts else ": this model has none"),
                    entry.where,
                )
    order = {id(e): n for n, (e, _) in enumerate(edges)}
    rooted, stack = {ROOT}, [ROOT]
    while stack:
        reached = {node for node, _ in forest[stack.pop()]} - rooted
        rooted |= reached
        stack += reached
    floating = [c for e, c in edges if id(e.b) not in rooted] if len(rooted) > 1 else []
    return sorted(cuts, key=lambda c: order[id(c.edge)]), _reversed(forest), floating


def _reversed(forest: dict[int, list[tuple[int, _Link]]]) -> set[int]:
    """Return the ids of edges whose port b is nearer to the root; in a tree without root, to its first port."""
    passed: set[int] = set()
    seen: set[int] = set()
    for first in forest:
        stack = [] if first in seen else [first]
        seen.add(first)
        while stack:
            node = stack.pop()
            for other, link in forest[node]:
                if other not in seen:
                    seen.add(other)
                    stack.append(other)
                    if link.edge is not None and link.end == node:
                        passed.add(id(link.edge))
    return passed


def _rank(link: _Link, depth: dict[int, int], named: set[int], driven: set[int]) -> tuple[int, int]:
    """Sort key: what stays in the tree first; ties keep the order of declaration."""
    if link.edge is None or link.edge.closing is None or link.component is None:
        # roots, then components without another form, then connections: the last one closes a loop of these
        return -1, 0 if link.start == ROOT else 1 if link.edge is not None else 2
    if _inside(link.component, named):
        return 2, 0
    near = min(depth.get(link.start, 0), depth.get(link.end, 0))
    return (0 if id(link.component) in driven else 1), near


def _inside(component: Model | None, named: set[int]) -> bool:
    while component is not None:
        if id(component) in named:
            return True
        component = component._parent
    return False


def _depths(links: Sequence[_Link]) -> dict[int, int]:
    """Return the number of joints from the roots to each port; from the first port of a tree without a root."""
    neighbours: dict[int, list[tuple[int, int]]] = {ROOT: []}
    for link in links:
        cost = int(link.edge is not None and link.edge.closing is not None)
        neighbours.setdefault(link.start, []).append((link.end, cost))
        neighbours.setdefault(link.end, []).append((link.start, cost))
    depth: dict[int, int] = {}
    for first in neighbours:
        if first in depth:
            continue
        depth[first] = 0
        queue = deque([first])
        while queue:
            node = queue.popleft()
            for other, cost in neighbours[node]:
                if other not in depth or depth[node] + cost < depth[other]:
                    depth[other] = depth[node] + cost
                    (queue.append if cost else queue.appendleft)(other)
    return depth


def _driven(connections: Sequence[Connection]) -> set[int]:
    """Return the components one of whose coordinates is connected to a component that does not contain it."""
    sets: dict[int, set[int]] = {}
    ports: dict[int, Connector] = {}
    for c in connections:
        if c.a.overdetermined:
            continue
        ports |= {id(c.a): c.a, id(c.b): c.b}
        joined = sets.get(id(c.a), {id(c.a)}) | sets.get(id(c.b), {id(c.b)})
        for p in joined:
            sets[p] = joined
    driven: set[int] = set()
    for port, joined in sets.items():
        owner = ports[port]._parent
        if owner is not None and not all(_inside(owner, {id(ports[p]._parent)}) for p in joined):
            driven.add(id(owner))
    return driven


def _path(forest: dict[int, list[tuple[int, _Link]]], start: int, end: int) -> list[tuple[int, _Link]] | None:
    """Return the nodes after `start` on the only path to `end`, each with the link to it; None if there is none."""
    before: dict[int, tuple[int, _Link]] = {}
    seen, stack = {start}, [start]
    while stack:
        node = stack.pop()
        for other, link in forest.get(node, []):
            if other not in seen:
                seen.add(other)
                before[other] = node, link
                stack.append(other)
    if end not in seen:
        return None
    path: list[tuple[int, _Link]] = []
    while end != start:
        previous, link = before[end]
        path.append((end, link))
        end = previous
    return path[::-1]


def _sentence(ports: list[Connector], through_root: bool) -> str:
    names = " - ".join(p._path for p in ports)
    components = list(dict.fromkeys(p._path.rpartition(".")[0] or p._path for p in ports))
    cause = "two components fix it in the world, and this line connects them" if through_root else "this line closes it"
    return f"a loop of {', '.join(components)} ({names}): {cause}; {ports[0].overdetermined}"
