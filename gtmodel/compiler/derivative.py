"""Derivatives of a causal function by its inputs: numbers on rows, and which ones are zero."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from .._lazy import hint
from ..results.status import Status
from .rows import map_columns

if TYPE_CHECKING:
    from .causal import CausalFunction
else:
    CausalFunction = hint("gtmodel.compiler.causal", "CausalFunction")


def jacobian_of(f: CausalFunction, columns: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return d targets / d inputs, (n, outputs, inputs), and the status codes, for columns of inputs."""
    n = columns[0].shape[1] if columns else 1
    zs, iteration = f._unknowns(list(columns))
    if _DERIVATIVES not in f.kept:
        f.kept[_DERIVATIVES] = _derivatives(f)
    by_input, by_z, margins = map_columns(f.kept[_DERIVATIVES], [*columns, *zs])
    full = _stack(by_input, n, sum(c.shape[0] for c in columns))
    block_inputs = np.vstack(columns) if columns else np.zeros((0, n))
    sensitivities: list[np.ndarray] = []
    for kernel, z in zip(f.kernels, zs, strict=True):
        dz = kernel.derivative(z, block_inputs)
        k = block_inputs.shape[0] - sum(s.shape[1] for s in sensitivities)
        total = dz[:, :, :k].copy()
        for s in sensitivities:  # earlier unknowns depend on the inputs too
            total += dz[:, :, k : k + s.shape[1]] @ s
            k += s.shape[1]
        sensitivities.append(total)
        block_inputs = np.vstack([block_inputs, z])
    if sensitivities:
        full = full + _stack(by_z, n, sum(z.shape[0] for z in zs)) @ np.concatenate(sensitivities, axis=1)
    status = f.status(list(columns), [full.reshape(n, full.shape[1] * full.shape[2]).T, margins], iteration)
    full[status != Status.OK] = np.nan
    return full, status


_DERIVATIVES = "derivatives"


def _derivatives(f: CausalFunction) -> ca.Function:
    """(inputs..., z...) -> d targets / d inputs, d targets / d z, margins."""
    args = f.closed.sx_in()
    *targets, margins = f.closed.call(args)
    inputs = len(args) - len(f.kernels)
    column = ca.SX(ca.vertcat(*targets))
    parts = [ca.densify(ca.jacobian(column, ca.SX(ca.vertcat(*a)))) for a in (args[:inputs], args[inputs:])]
    return ca.Function(f"jac_{f.closed.name()}", args, [*parts, margins])


def _stack(matrix: np.ndarray, n: int, width: int) -> np.ndarray:
    """Return mapped matrices (r, n * width) as (n, r, width)."""
    return matrix.reshape(matrix.shape[0], n, width).transpose(1, 0, 2).copy()


def given_by(f: CausalFunction) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
    """Return symbols of the inputs and of Newton's unknowns, and all outputs as a column."""
    args = f.closed.sx_in()
    blocks = len(f.kernels)
    inputs = args[: len(args) - blocks]
    results = f.closed.call(args)[: len(f.outputs)]
    return inputs, args[len(args) - blocks :], ca.vertcat(*[ca.densify(ca.SX(r)) for r in results])


def depends(f: CausalFunction) -> list[set[int]]:
    """Return for each output number the input numbers it depends on."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    n = x.numel()
    of_z: list[set[int]] = []
    for kernel, z in zip(f.kernels, zs, strict=True):
        a, unknowns = ca.SX.sym("a", len(kernel.a0)), ca.SX.sym("z", z.numel())
        r = kernel.residual.call([unknowns, a])[0]
        columns = set(ca.jacobian_sparsity(r, a).get_triplet()[1])
        inner = {c for c in columns if c < n}
        for c in columns - inner:
            inner |= of_z[c - n]
        of_z += [inner] * z.numel()
    full = ca.vertcat(x, *zs)
    rows, columns = ca.jacobian_sparsity(outputs, full).get_triplet()
    result: list[set[int]] = [set() for _ in range(outputs.numel())]
    for r, c in zip(rows, columns, strict=True):
        result[r] |= {c} if c < n else of_z[c - n]
    return result
