"""A ca.Function in float, operation by operation on NumPy rows: what C in float must equal bit for bit.

CasADi's own virtual machine knows double only. Basic operations and roots are rounded as IEEE 754 says on every
machine; sin, tanh and the like are asked of the libm of this one.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Callable, Sequence
from functools import cache

import casadi as ca
import numpy as np

from .real import FLOAT
from .text import GenerationError

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
    """As `compiler.rows.map_columns`, in float: inputs (size, n) -> results (r, n), for outputs of one column or,
    column below column, of several. Raises GenerationError for an operation that it does not know."""
    n = columns[0].shape[1] if columns else 1
    results = [np.zeros((f.numel_out(k), n), FLOAT.dtype) for k in range(f.n_out())]
    work: dict[int, Rows] = {}
    with np.errstate(all="ignore"):
        for k in range(f.n_instructions()):
            op, given, put = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if op == ca.OP_CONST:
                work[put[0]] = np.full(n, f.instruction_constant(k), FLOAT.dtype)
            elif op == ca.OP_INPUT:
                work[put[0]] = columns[given[0]][given[1]]
            elif op == ca.OP_OUTPUT:
                results[put[0]][put[1]] = work[given[0]]
            else:
                work[put[0]] = _operation(op)(*[work[i] for i in given])
    return results


@cache
def _operation(op: int) -> Callable[..., Rows]:
    if op in _EXACT:
        return _EXACT[op]
    name = _LIBM.get(op)
    library = ctypes.util.find_library("m")
    if name is None or library is None:
        what = f"the operation number {op} of CasADi" if name is None else f"{name}f: there is no libm"
        raise GenerationError(f"this machine cannot evaluate {what} in float; generate double")
    function = getattr(ctypes.CDLL(library), f"{name}f")
    function.restype = ctypes.c_float
    arguments = 2 if name in ("atan2", "pow") else 1
    function.argtypes = [ctypes.c_float] * arguments
    return lambda *x: np.array([function(*row) for row in zip(*[a.tolist() for a in x], strict=True)], FLOAT.dtype)
