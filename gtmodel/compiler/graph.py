"""Graphs of equations and unknowns: strong components in the order of computation, and matchings.

SciPy has both, but importing it takes longer than these computations do for a mechanism of some hundred equations.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from typing import TypeVar

Node = TypeVar("Node", bound=Hashable)
Matching = list[int]  # the column of each row, -1 without one


def strong_components(roots: Sequence[Node], uses: Callable[[Node], Sequence[Node]]) -> list[list[Node]]:
    """Return the strong components reached from `roots` along `uses` (Tarjan's algorithm without recursion).

    A component comes after all components that it uses; nodes that no root needs do not appear.
    """
    number: dict[Node, int] = {}
    low: dict[Node, int] = {}
    on_stack: set[Node] = set()
    stack: list[Node] = []
    result: list[list[Node]] = []
    for root in roots:
        if root in number:
            continue
        work: list[tuple[Node, list[Node], int]] = []
        number[root] = low[root] = len(number)
        stack.append(root)
        on_stack.add(root)
        work.append((root, list(uses(root)), 0))
        while work:
            node, targets, position = work.pop()
            if position < len(targets):
                work.append((node, targets, position + 1))
                target = targets[position]
                if target not in number:
                    number[target] = low[target] = len(number)
                    stack.append(target)
                    on_stack.add(target)
                    work.append((target, list(uses(target)), 0))
                elif target in on_stack:
                    low[node] = min(low[node], number[target])
                continue
            if low[node] == number[node]:
                component: list[Node] = []
                while True:
                    top = stack.pop()
                    on_stack.discard(top)
                    component.append(top)
                    if top == node:
                        break
                result.append(component[::-1])
            if work:
                parent = work[-1][0]
                low[parent] = min(low[parent], low[node])
    return result


def neighbours_of(rows: int, entries: Collection[tuple[int, int]]) -> list[list[int]]:
    """Return the columns in which each row has an entry, in order."""
    columns: list[list[int]] = [[] for _ in range(rows)]
    for i, j in sorted(entries):
        columns[i].append(j)
    return columns


def largest_matching(neighbours: Sequence[Sequence[int]], columns: int, begin: Sequence[int] | None = None) -> Matching:
    """Return a maximum matching, from shortest alternating paths (Hopcroft and Karp 1973).

    neighbours: the columns that each row may be matched to; begin: a matching to enlarge. Without it the result is, of
    several maximum matchings, that of SciPy's `maximum_bipartite_matching`.

    >>> from gtmodel.compiler.graph import largest_matching
    >>> largest_matching([[0, 1], [0], [0]], 2)
    [1, 0, -1]
    """
    match = [-1] * len(neighbours) if begin is None else list(begin)
    row_of = reversed_matching(match, columns)
    while True:
        level, free = _levels(neighbours, match, row_of)
        if free < 0:
            return match
        for row, column in enumerate(match):
            if column < 0:
                _augment(row, neighbours, match, row_of, level, free)


def _levels(neighbours: Sequence[Sequence[int]], match: Matching, row_of: list[int]) -> tuple[list[int], int]:
    """Return the number of columns on the shortest alternating path from an unmatched row to each row, -1 if it is not
    needed; and to the nearest free column, -1 if there is none."""
    level = [0 if column < 0 else -1 for column in match]
    queue = [row for row, column in enumerate(match) if column < 0]
    free = -1
    for row in queue:  # grows on the way
        if 0 <= free <= level[row]:
            break
        for column in neighbours[row]:
            matched_row = row_of[column]
            if matched_row < 0:
                free = level[row] + 1 if free < 0 else free
            elif level[matched_row] < 0:
                level[matched_row] = level[row] + 1
                queue.append(matched_row)
    return level, free


def _augment(
    root: int, neighbours: Sequence[Sequence[int]], match: Matching, row_of: list[int], level: list[int], free: int
) -> None:
    """Match one more row along a path of rising levels, if there is one."""
    before: dict[int, int] = {}
    stack = [root]
    while stack:
        row = stack.pop()
        if level[row] < 0:
            continue
        deeper, level[row] = level[row] + 1, -2  # no other path leads through it, whether this one succeeds or not
        for column in neighbours[row]:
            matched_row = row_of[column]
            if matched_row >= 0:
                if level[matched_row] == deeper:
                    stack.append(matched_row)
                    before[matched_row] = row
            elif free == deeper:
                while True:
                    row_of[column], match[row], column = row, column, match[row]
                    if row == root:
                        return
                    row = before[row]


def alternating(match: Sequence[int], neighbours: Sequence[Sequence[int]], back: Sequence[int]) -> list[int]:
    """Return the nodes that alternating paths reach from unmatched ones; `back`: matching from the other side."""
    reached = {k for k, other in enumerate(match) if other < 0}
    stack = sorted(reached)
    while stack:
        fresh = {back[j] for j in neighbours[stack.pop()] if back[j] >= 0} - reached
        reached |= fresh
        stack += fresh
    return sorted(reached)


def reversed_matching(match: Matching, columns: int) -> Matching:
    """Return the row of each column, -1 if it has none."""
    row_of = [-1] * columns
    for row, column in enumerate(match):
        if column >= 0:
            row_of[column] = row
    return row_of


def highest_transversal(size: int, values: Mapping[tuple[int, int], int]) -> Matching | None:
    """Return a column for each row of a square pattern with the highest sum of values; None if there is no transversal.

    Uses potentials d_j - c_i >= value_ij (Kuhn 1955): entries with equality are matched. If rows remain unmatched,
    their c and the d of the columns that they reach increase until another entry reaches equality.

    >>> from gtmodel.compiler.graph import highest_transversal
    >>> highest_transversal(2, {(0, 0): 1, (0, 1): 0, (1, 0): 2, (1, 1): 0})
    [1, 0]
    """
    neighbours = neighbours_of(size, values)
    c, d, match = [0] * size, [0] * size, [-1] * size
    for (_, j), value in values.items():
        d[j] = max(d[j], value)
    while True:
        tight = [[j for j in columns if d[j] - c[i] == values[i, j]] for i, columns in enumerate(neighbours)]
        match = largest_matching(tight, size, match)  # matched entries stay tight
        rows = alternating(match, tight, reversed_matching(match, size))
        if not rows:
            return match
        reached = {j for i in rows for j in tight[i]}
        gaps = [d[j] - c[i] - values[i, j] for i in rows for j in neighbours[i] if j not in reached]
        if not gaps:
            return None
        for i in rows:
            c[i] += min(gaps)
        for j in reached:
            d[j] += min(gaps)
