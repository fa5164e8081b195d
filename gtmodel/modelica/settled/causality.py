"""Which inputs of components an equation determines: the others are left to whoever solves or simulates."""

from __future__ import annotations

from typing import Any

from ..multibody.terms import PART
from ..scalars import Flat, operations, symbols


def _parts(equation: Any) -> list[Any]:
    """Expressions of an equation, or of both sides of a conditional one."""
    inside = [*equation.then, *equation.otherwise] if hasattr(equation, "then") else [equation]
    return [x for e in inside if hasattr(e, "left") for x in (e.left, e.right)]


def settle_inputs(flats: list[Flat], equations: list[Any]) -> None:
    """An input below the top becomes a variable where an equation is left over for it.

    Equations are matched with variables first; those that are left are matched with inputs of components. So
    `u = sys.u` makes sys.u the input where u is a plain variable, and `sys.u = u` the other way round.
    """
    inner = [f for f in flats if f.kind == "input" and not f.top]
    if not inner:
        return
    rank = {id(f): n for n, f in enumerate(flats) if f.kind == "variable" and f.replaced is None}
    second = {id(f): n for n, f in enumerate(flats) if f.kind == "input" and not f.top}
    hidden: dict[Any, int] = {}  # quantities of parts are variables of equations that are not seen here
    for o in (o for q in equations for e in _parts(q) for o in operations(e) if o.name == PART):
        hidden.setdefault(o.arguments, len(flats) + len(hidden))
    rank |= {-1 - n: n for n in hidden.values()}
    uses = [list(dict.fromkeys(_keys(q, hidden))) for q in equations if _parts(q)]
    owner: dict[int, int] = {}
    left = [n for n in range(len(uses)) if not augmented(n, uses, rank, owner)]
    allowed = rank | second
    for n in left:
        augmented(n, uses, allowed, owner)
    for f in inner:
        if id(f) in owner:
            f.kind = "variable"


def _keys(equation: Any, hidden: dict[Any, int]) -> list[int]:
    keys = [id(f) for e in _parts(equation) for f in symbols(e)]
    return keys + [-1 - hidden[o.arguments] for e in _parts(equation) for o in operations(e) if o.name == PART]


def augmented(start: int, uses: list[list[int]], allowed: dict[int, int], owner: dict[int, int]) -> bool:
    """Find a variable for an equation, moving others where it has to; without recursion."""
    before: dict[int, tuple[int, int | None]] = {}  # variable -> equation that asks, and the variable it had
    queue: list[tuple[int, int | None]] = [(start, None)]
    for equation, had in queue:
        for key in uses[equation]:
            if key not in allowed or key in before:
                continue
            before[key] = (equation, had)
            if key not in owner:
                current: int | None = key
                while current is not None:
                    asks, previous = before[current]
                    owner[current] = asks
                    current = previous
                return True
            queue.append((owner[key], key))
    return False
