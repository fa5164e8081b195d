"""Pantelides (1988), SIAM J. Sci. Stat. Comput. 9(2), Algorithm 4.1: how often each equation is differentiated.

Works on which derivatives occur in which equation; the graph grows as equations and variables are differentiated.
"""

from __future__ import annotations


def differentiation_counts(equations: list[set[tuple[int, int]]], limit: int = 1000) -> list[int]:
    """Number of differentiations of each equation, given as the set of its (unknown, order) pairs.

    Raises ValueError when the system is structurally singular (more than `limit` differentiations).
    """
    highest: dict[int, int] = {}
    for e in equations:
        for j, k in e:
            highest[j] = max(highest.get(j, 0), k)
    uses = [set(e) for e in equations]  # grows by differentiated equations
    origin = list(range(len(equations)))
    derivative: dict[int, int] = {}
    assigned: dict[tuple[int, int], int] = {}

    def augment(i: int, seen_equations: set[int], seen_pairs: set[tuple[int, int]]) -> bool:
        seen_equations.add(i)
        active = sorted(p for p in uses[i] if p[1] == highest[p[0]])
        for pair in active:
            if pair not in assigned:
                assigned[pair] = i
                return True
        for pair in active:
            if pair not in seen_pairs:
                seen_pairs.add(pair)
                if augment(assigned[pair], seen_equations, seen_pairs):
                    assigned[pair] = i
                    return True
        return False

    for k in range(len(equations)):
        i = k
        while True:
            seen_equations: set[int] = set()
            seen_pairs: set[tuple[int, int]] = set()
            if augment(i, seen_equations, seen_pairs):
                break
            if len(uses) > limit:
                raise ValueError("structurally singular")
            for j, _ in sorted(seen_pairs):
                highest[j] += 1
            for e in sorted(seen_equations):
                uses.append(uses[e] | {(j, order + 1) for j, order in uses[e]})
                origin.append(origin[e])
                derivative[e] = len(uses) - 1
            for j, order in sorted(seen_pairs):
                assigned[(j, order + 1)] = derivative[assigned[(j, order)]]
            i = derivative[i]
    counts = [0] * len(equations)
    for e in derivative:
        counts[origin[e]] += 1
    return counts
