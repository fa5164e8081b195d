"""Strong components of the dependency graph in the order of computation."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

Node = TypeVar("Node", bound=Hashable)


def strong_components(roots: Sequence[Node], uses: Callable[[Node], Sequence[Node]]) -> list[list[Node]]:
    """Tarjan's algorithm from `roots` along `uses`, without recursion.

    Components come out with everything they use before them; nodes that no root needs never appear.
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
