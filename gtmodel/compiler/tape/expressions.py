"""From a tape back to CasADi: all operations of one kind that wait for no other are made at once."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from .operations import NONE, Tape


def written(tape: Tape, numbers: Sequence[int], symbols: ca.SX) -> ca.SX:
    """A column with these numbers of the tape, the symbols at its inputs."""
    if not len(numbers):
        return ca.SX(0, 1)
    groups: dict[tuple[int, int], list[int]] = {}  # by level and operation
    level: dict[int, int] = {}
    for k in tape.needed(numbers):
        op = tape.op[k]
        if op in (ca.OP_INPUT, ca.OP_CONST):
            level[k] = 0
        else:
            y = tape.second[k]
            level[k] = 1 + (level[tape.first[k]] if y == NONE else max(level[tape.first[k]], level[y]))
        groups.setdefault((level[k], op), []).append(k)
    place: dict[int, int] = {}
    made = ca.SX.zeros(len(level), 1)
    begin = 0
    for (_, op), own in sorted(groups.items()):
        x = [tape.first[k] for k in own]
        if op == ca.OP_INPUT:
            value = symbols[x]
        elif op == ca.OP_CONST:
            value = ca.SX(ca.DM([tape.constants[k] for k in own]))
        elif tape.second[own[0]] == NONE:
            value = ca.SX.unary(op, made[[place[i] for i in x]])
        else:
            y = [place[tape.second[k]] for k in own]
            value = ca.SX.binary(op, made[[place[i] for i in x]], made[y])
        made[begin : begin + len(own)] = value
        place.update(zip(own, range(begin, begin + len(own)), strict=True))
        begin += len(own)
    return made[[place[k] for k in numbers]]
