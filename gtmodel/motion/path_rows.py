"""What a causal function says along a path, for the squared speeds: Newton's unknowns depend on the place alone."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction
from ..optimize.path import Curve, PathTask
from ..results import ArgumentError

MIDDLE = np.array([0.5])


def rows_along(f: CausalFunction, curve: Curve) -> tuple[ca.Function, Curve]:
    """(x, x', x'') and Newton's unknowns -> the targets of f, and the curve with those unknowns beside it.

    f: a function of one known variable and its derivatives up to the second. curve: s -> that variable and its
    two derivatives, (n, d) each. Positions need Newton where the robot has no closed form; they are solved once at
    each node, and all that is left is explicit: exact derivatives, and no root finder inside the optimisation.

    Raises ArgumentError for a model whose Newton blocks depend on velocities.
    """
    size = f.inputs[0].size
    x = [ca.SX.sym(name, size) for name in ("x", "v", "a")]
    _check(f, curve)
    zs, _ = _unknowns(f, curve, MIDDLE, moving=False)
    z = [ca.SX.sym(f"z{k}", part.shape[1]) for k, part in enumerate(zs)]
    outputs = f.closed.call([*f.arguments_along(*x), *z])
    rows = ca.Function("rows", [*x, *z], outputs[: len(f.outputs)], {"cse": True})

    def along(s: np.ndarray) -> tuple[np.ndarray, ...]:
        return (*curve(s), *_unknowns(f, curve, s, moving=False)[0])

    return rows, along


def task_along(
    f: CausalFunction, curve: Curve, margins_from: int, limit: np.ndarray, squares: np.ndarray, **more: Any
) -> PathTask:
    """The task of a robot along a path.

    f: as for `rows_along`; its first target are the motor forces, those from `margins_from` on are kept above zero.
    limit: (m,) of the motor forces. squares: (m,) their weights in the energy. more: of PathTask.
    """
    rows, along = rows_along(f, curve)
    given = rows.sx_in()
    values = rows.call(given)
    bounded = ca.vertcat(values[0], *values[margins_from:])
    extra = bounded.numel() - len(limit)
    return PathTask(
        along,
        ca.Function("rows", given, [bounded], {"cse": True}),
        np.concatenate([-limit, np.zeros(extra)]),
        np.concatenate([limit, np.full(extra, np.inf)]),
        np.concatenate([squares, np.zeros(extra)]),
        **more,
    )


def _unknowns(f: CausalFunction, curve: Curve, s: np.ndarray, moving: bool) -> tuple[list[np.ndarray], np.ndarray]:
    """At rest, or with the path's derivative as velocity."""
    x, slope, _ = curve(s)
    arguments = f.arguments_along(*((x, slope) if moving else (x,)))
    shaped = [a if signal.shape else a[:, 0] for a, signal in zip(arguments, f.inputs, strict=True)]
    return f.unknowns(*shaped)


def _check(f: CausalFunction, curve: Curve) -> None:
    at_rest, moving = (_unknowns(f, curve, MIDDLE, moving)[0] for moving in (False, True))
    if any(not np.array_equal(a, b, equal_nan=True) for a, b in zip(at_rest, moving, strict=True)):
        raise ArgumentError("a position of the robot depends on its velocity; a path cannot be followed by it", "robot")
