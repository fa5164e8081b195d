"""What a reader must know before using joint stiffness from load tests: signs, unbounded values, repeated lines."""

from __future__ import annotations

import numpy as np

from ...measurements import copies
from ..joint_stiffness import StiffnessFit
from ..static_tests import StaticTests


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


def repeated(tests: StaticTests, q: np.ndarray, lines: np.ndarray) -> list[str]:
    """Sentences on lines that repeat an earlier one in every number, noise included."""
    again = copies(np.column_stack([q, tests.wrench, tests.displacement]))
    if not len(again):
        return []
    (line, first), count = lines[again[0]].tolist(), len(again)
    return [
        f"{count} of {len(lines)} tests repeat an earlier one to the last digit, as line {line} does line {first}: a "
        "measurement never does, and counted twice it makes intervals too narrow; take copies out"
    ]


def _joints(numbers: list[int]) -> str:
    return f"joint {numbers[0]}" if len(numbers) == 1 else f"joints {', '.join(map(str, numbers))}"
