"""Outputs that are finite whenever the inputs and the margins of a function have passed: no code needs to test them."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from .body import casadi_functions
from .interface import Interface
from .real import DOUBLE

# far below the largest number, since the bounds are rounded too
_LARGEST, _LARGEST_FLOAT = 1e300, 1e36


class _Bound(NamedTuple):
    """|value| is at most `most` and at least `least`; infinite if it may also be NaN. positive: value >= 0."""

    most: float
    least: float = 0.0
    positive: bool = False


_ANY = _Bound(np.inf)
_ONE = _Bound(1.0)
_WITHIN = {  # finite for finite arguments, whatever these are
    **dict.fromkeys((ca.OP_SIN, ca.OP_COS, ca.OP_TANH, ca.OP_SIGN), _ONE),
    **dict.fromkeys((ca.OP_ATAN, ca.OP_ATAN2), _Bound(4.0)),
    **dict.fromkeys((ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_NOT), _Bound(1.0, 0.0, True)),
}


def surely_finite(face: Interface) -> bool:
    """Whether the limits of the inputs and the margins bound all outputs, so that a test of them could never fail.

    Bounds of magnitudes follow the operations of the body. A divisor must be a pivot or a product of pivots, and the
    argument of a root a discriminant or a sum of squares.
    """
    if face.newton or face.loops is not None or not face.inputs:
        return False
    f = casadi_functions(face)[0]
    weights = {n: weight for weight, places in face.sizes.groups for n in places}
    if set(weights) != set(range(f.n_in())):
        return False
    inputs = [_Bound(float(np.sqrt(face.sizes.most / weights[n])) * 1.001) for n in range(f.n_in())]
    given = _given(face, f)
    largest = _LARGEST if face.real is DOUBLE else _LARGEST_FLOAT
    values: dict[int, _Bound] = {}  # by the entry of the work vector
    for k in range(f.n_instructions()):
        op, read, written = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_OUTPUT:
            if written[0] < f.n_out() - 1 and values[read[0]].most > largest:
                return False
            continue
        if op == ca.OP_INPUT:
            bound = inputs[read[0]]
        elif op == ca.OP_CONST:
            value = float(f.instruction_constant(k))
            bound = _Bound(abs(value), abs(value), value >= 0) if np.isfinite(value) else _ANY
        elif len(written) == 1:
            arguments = [values[i] for i in read]
            bound = (
                _of(op, arguments, len(set(read)) < len(read)) if all(a.most <= largest for a in arguments) else _ANY
            )
        else:
            bound = _ANY
        least, positive = given.get(k, (0.0, False))
        bound = _Bound(bound.most, max(bound.least, least), bound.positive or positive)
        values |= dict.fromkeys(written, bound if bound.most <= largest else _ANY)
    return True


def _given(face: Interface, f: ca.Function) -> dict[int, tuple[float, bool]]:
    """What the margins that have passed say of the results of instructions: least magnitude, and whether >= 0."""
    latest: dict[int, int] = {}
    given: dict[int, tuple[float, bool]] = {}
    quotients: dict[int, tuple[int, int]] = {}
    for k in range(f.n_instructions()):
        op, read, written = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_DIV:
            quotients[k] = latest[read[0]], latest[read[1]]
        if op != ca.OP_OUTPUT:
            latest |= dict.fromkeys(written, k)
        elif written[0] == f.n_out() - 1:
            margin = face.function.margins[written[1]]
            scaled = margin.kind in ("pivot", "branch")
            least = 0.999 * face.real.pivot * margin.scale if scaled else 0.0
            own = latest[read[0]]
            before, positive = given.get(own, (0.0, False))
            given[own] = max(least, before), positive or margin.kind != "pivot"
    for _ in face.function.margins:  # a pivot over its size, which is a margin too, or a margin over another one
        for k, (x, y) in quotients.items():
            if k in given and y in given:
                before, positive = given.get(x, (0.0, False))
                given[x] = max(before, 0.999 * given[k][0] * given[y][0]), positive
    return given


def _of(op: int, a: list[_Bound], same: bool) -> _Bound:
    """Bound of an operation on finite arguments. same: both arguments are one value."""
    x = a[0]
    if op in _WITHIN:
        return _WITHIN[op]
    if op in (ca.OP_ASSIGN, ca.OP_FABS):
        return _Bound(x.most, x.least, x.positive or op == ca.OP_FABS)
    if op == ca.OP_NEG:
        return _Bound(x.most, x.least)
    if op == ca.OP_TWICE:
        return _Bound(2 * x.most, x.least, x.positive)
    if op == ca.OP_SQ or (op == ca.OP_MUL and same):
        return _Bound(x.most * x.most, x.least * x.least, True)
    if op == ca.OP_SQRT:
        return _Bound(float(np.sqrt(x.most)), float(np.sqrt(x.least)), True) if x.positive else _ANY
    if op == ca.OP_INV:
        return _Bound(1 / x.least, 1 / x.most, x.positive) if x.least > 0 else _ANY
    y = a[-1]
    if op in (ca.OP_ADD, ca.OP_SUB):
        positive = op == ca.OP_ADD and x.positive and y.positive
        return _Bound(x.most + y.most, max(x.least, y.least) if positive else 0.0, positive)
    if op == ca.OP_MUL:
        return _Bound(x.most * y.most, x.least * y.least, x.positive and y.positive)
    if op == ca.OP_DIV:
        return _Bound(x.most / y.least, x.least / y.most, x.positive and y.positive) if y.least > 0 else _ANY
    if op in (ca.OP_FMIN, ca.OP_FMAX):
        return _Bound(max(x.most, y.most), min(x.least, y.least), x.positive and y.positive)
    if op == ca.OP_IF_ELSE_ZERO:
        return _Bound(y.most, 0.0, y.positive)
    return _ANY
