"""gt_newton.h in NumPy, step by step in the same order, and ca.Function in float, operation by operation. C must give
the same bits."""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..results.status import Status
from .real import FLOAT, GenerationError

Rows = np.ndarray
_ONE = FLOAT.dtype(1.0)
_EXACT: dict[int, Callable[..., Rows]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: lambda x, y: x / y,
    ca.OP_NEG: lambda x: -x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: lambda x: _ONE / x,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.abs,
    ca.OP_FMIN: lambda x, y: np.where((x <= y) | (y != y), x, y),
    ca.OP_FMAX: lambda x, y: np.where((x >= y) | (y != y), x, y),
    ca.OP_SIGN: lambda x: np.where(x < 0, -_ONE, np.where(x > 0, _ONE, x)),
    ca.OP_LT: lambda x, y: (x < y).astype(FLOAT.dtype),
    ca.OP_LE: lambda x, y: (x <= y).astype(FLOAT.dtype),
    ca.OP_EQ: lambda x, y: (x == y).astype(FLOAT.dtype),
    ca.OP_NE: lambda x, y: (x != y).astype(FLOAT.dtype),
    ca.OP_NOT: lambda x: (x == 0).astype(FLOAT.dtype),
    ca.OP_AND: lambda x, y: ((x != 0) & (y != 0)).astype(FLOAT.dtype),
    ca.OP_OR: lambda x, y: ((x != 0) | (y != 0)).astype(FLOAT.dtype),
    ca.OP_IF_ELSE_ZERO: lambda x, y: np.where(x != 0, y, FLOAT.dtype(0.0)),
}
_LIBM = {
    ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_EXP: "exp",
    ca.OP_LOG: "log", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil",
}  # fmt: skip


def run(f: ca.Function, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Evaluate a function in float, as `compiler.rows.map_columns` does in double: inputs (size, n) -> results (r, n).
    A result with several columns is stacked column by column. Raises GenerationError for an unsupported operation."""
    n = columns[0].shape[1] if columns else 1
    results = [np.zeros((f.numel_out(k), n), FLOAT.dtype) for k in range(f.n_out())]
    work: dict[int, Rows] = {}
    with np.errstate(all="ignore"):
        for op, inputs, outputs, what in _instructions(f):
            if op == ca.OP_CONST:
                work[outputs[0]] = np.full(n, what, FLOAT.dtype)
            elif op == ca.OP_INPUT:
                work[outputs[0]] = columns[inputs[0]][inputs[1]]
            elif op == ca.OP_OUTPUT:
                results[outputs[0]][outputs[1]] = work[inputs[0]]
            else:
                work[outputs[0]] = what(*[work[i] for i in inputs])
    return results


@lru_cache(maxsize=64)
def _instructions(f: ca.Function) -> list[tuple[int, list[int], list[int], Any]]:
    """Instructions with their constants or operations, read once: CasADi takes as long as they do."""
    program = []
    for k in range(f.n_instructions()):
        op, what = f.instruction_id(k), None
        if op == ca.OP_CONST:
            what = f.instruction_constant(k)
        elif op not in (ca.OP_INPUT, ca.OP_OUTPUT):
            what = _operation(op)
        program.append((op, f.instruction_input(k), f.instruction_output(k), what))
    return program


@cache
def _operation(op: int) -> Callable[..., Rows]:
    if op in _EXACT:
        return _EXACT[op]
    name = _LIBM.get(op)
    library = ctypes.util.find_library("m")
    if name is None or library is None:
        missing = f"the operation number {op} of CasADi" if name is None else f"{name}f: there is no libm"
        raise GenerationError(f"this machine cannot evaluate {missing} in float; generate double")
    function = getattr(ctypes.CDLL(library), f"{name}f")
    function.restype = ctypes.c_float
    arguments = 2 if name in ("atan2", "pow") else 1
    function.argtypes = [ctypes.c_float] * arguments
    return lambda *x: np.array([function(*row) for row in zip(*[a.tolist() for a in x], strict=True)], FLOAT.dtype)


# as in gt_newton.h
STEPS = 4
REACH = 0.5
CONTRACTION = 0.25
NEARLY = 0.999  # of the largest candidate: `pivot_order` takes the first candidate above it, independent of round-off

Kernel = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def newton(
    kernel: Kernel, z: np.ndarray, nominal: np.ndarray, largest: np.ndarray, least: float, round_off: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return solutions (rows, n) and statuses (rows,) from the starts z, in the precision of z.

    kernel: (z of some rows, indices of these rows) -> residuals (m, n), Jacobians (m, n, n); the other arguments as in
    gt_newton.h.
    """
    z, rows = z.copy(), np.arange(len(z))
    status = np.full(len(z), Status.OK, dtype=int)
    most = np.full(len(z), REACH, z.dtype)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            r, jacobian = kernel(z[rows], rows)
            _, step, _, regular = eliminate(jacobian, r, least)
            rows, step = _keep(status, rows, regular, Status.SINGULAR, step)
            size = np.max(np.abs(step) * nominal, axis=1, initial=0.0)  # NaN if any part is NaN
            rows, step, size = _keep(status, rows, size <= most[rows], Status.NOT_CONVERGED, step, size)
            z[rows] -= step
            most[rows] = np.maximum(CONTRACTION * size, z.dtype.type(round_off))
        r, _ = kernel(z[rows], rows)
        small = np.all(np.abs(r) * largest <= 1.0, axis=1)
        _keep(status, rows, small, Status.NOT_CONVERGED)
    return z, status


def eliminate(
    jacobian: np.ndarray, r: np.ndarray, least: float, skipping: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Solve many systems J x = r in place by LU with partial pivoting: factors (m, n, n), x (m, n), smallest pivots
    (m,), and whether every pivot is above `least` (m,). A row with a factor of zero is not changed, and with `skipping`
    its right-hand side neither; that differs only beside infinite numbers."""
    m, n = r.shape
    every = np.arange(m)
    smallest = np.full(m, np.finfo(r.dtype).max)
    regular = np.ones(m, dtype=bool)
    with np.errstate(all="ignore"):
        for k in range(n):
            size = np.abs(jacobian[:, k:, k])
            best, row = size[:, 0].copy(), np.full(m, k)
            for i in range(1, n - k):  # the first of equal candidates; NaN is never greater
                greater = size[:, i] > best
                best[greater], row[greater] = size[greater, i], k + i
            regular &= best > least
            smallest = np.where(best < smallest, best, smallest)
            for a in (jacobian, r):
                upper, lower = a[every, k].copy(), a[every, row].copy()
                a[every, k], a[every, row] = lower, upper
            factors = jacobian[:, k + 1 :, k] * (1.0 / jacobian[:, k, k])[:, None]
            jacobian[:, k + 1 :, k] = factors
            zero = factors == 0.0
            reduced = r[:, k + 1 :] - factors * r[:, k : k + 1]
            r[:, k + 1 :] = np.where(zero & skipping, r[:, k + 1 :], reduced)
            rest = jacobian[:, k + 1 :, k + 1 :]
            changed = rest - factors[:, :, None] * jacobian[:, k : k + 1, k + 1 :]
            rest[...] = np.where(zero[:, :, None], rest, changed)
        for k in range(n - 1, -1, -1):
            for j in range(n - 1, k, -1):
                r[:, k] -= jacobian[:, k, j] * r[:, j]
            r[:, k] /= jacobian[:, k, k]
    return jacobian, r, smallest, regular


def pivot_order(matrix: np.ndarray) -> list[int]:
    """Return the rows in the order of partial pivoting, so that nearby matrices rarely need an exchange of rows."""
    rest, order = np.array(matrix), list(range(len(matrix)))
    for k in range(len(order)):
        size = np.abs(rest[k:, k])
        row = k + int(np.argmax(size >= NEARLY * np.max(size)))
        order[k], order[row] = order[row], order[k]
        rest[[k, row]] = rest[[row, k]]
        with np.errstate(all="ignore"):
            rest[k + 1 :, k:] -= np.outer(rest[k + 1 :, k] / rest[k, k], rest[k, k:])
    return order


def _keep(
    status: np.ndarray, rows: np.ndarray, good: np.ndarray, otherwise: Status, *arrays: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the good rows with their parts of the arrays; set the status of the other rows."""
    status[rows[~good]] = otherwise
    return (rows[good], *[a[good] for a in arrays])
