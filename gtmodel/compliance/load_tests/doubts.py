"""What a reader must know before using joint stiffness from load tests: signs, unbounded values."""

from __future__ import annotations

from ..joint_stiffness import StiffnessFit


def negative(fit: StiffnessFit) -> list[str]:
    """Sentences on joints with a compliance below zero: beyond noise, or within it."""
    notes: list[str] = []
    beyond: list[int] = []
    inside: list[int] = []
    for j, c in enumerate(fit.compliance):
        _, high = fit.estimate.interval(f"compliance[{j}]")
        if high <= 0:
            beyond.append(j + 1)
        elif c <= 0:
            inside.append(j + 1)
    if beyond:
        notes.append(
            f"by {fit.method} the compliance of {_joints(beyond)} is negative beyond noise, which no joint can be: "
            "look for a sign turned, a column swapped or a wrong unit in displacements, forces or angles"
        )
    if inside:
        notes.append(
            f"by {fit.method} the compliance of {_joints(inside)} is negative within its noise: the tests do not "
            "distinguish it from a rigid joint, use the lower end of its interval"
        )
    return notes


def _joints(numbers: list[int]) -> str:
    return f"joint {numbers[0]}" if len(numbers) == 1 else f"joints {', '.join(map(str, numbers))}"
