"""Random inputs of a causal function: near consistent points and far from them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction
from .interface import Interface
from .newton_stages import evaluate_stages, samples_of

# each row leaves a consistent point by its own fraction of the inputs' typical sizes, drawn evenly in the
# logarithm: most rows stay where solutions exist, a fair share leaves the range
NEAREST, FARTHEST = 0.01, 6.0
LONGEST_TIME_S = 10.0
STEPS_TO_CONDITIONS = 20
# zero, a denormal, and numbers whose squares and products overflow
AWKWARD = (0.0, 5e-324, -1e-310, 1e160, -1e300)
# what stands in outputs before a call, and after one that fails
HELD = -1.25e300


def draw(face: Interface, rows: int, seed: int) -> np.ndarray:
    """Random inputs, (rows, inputs): all signals side by side, in the order of the function's arguments; behind them
    the state that a function with Newton blocks starts from, the solution at the consistent point a row is near.

    Half of the rows satisfy the conditions on known values, such as that a quaternion has unit length.
    """
    function, rng = face.function, np.random.default_rng(seed)
    plan = function.plan
    pairs = [p for s in function.inputs for p in s.pairs]
    centres = samples_of(function, pairs)
    sizes = np.ones(len(pairs))
    first = 0
    for s in function.inputs:
        size = float(np.max(np.abs(centres[:, first : first + s.size]), initial=0.0))
        sizes[first : first + s.size] = max(size, function.flat.variables[s.pairs[0][0]].nominal)
        first += s.size
    spread = NEAREST * (FARTHEST / NEAREST) ** rng.random((rows, 1))
    near = rng.integers(len(centres), size=rows)
    values = centres[near] + spread * sizes * rng.standard_normal((rows, len(pairs)))
    if plan.conditions:
        values[::2] = _satisfying(function, pairs, values[::2])
    if plan.uses_time:
        values = np.column_stack([values, LONGEST_TIME_S * rng.random(rows)])
    starts = [p for stage in face.newton for s in stage.unknowns for p in s.pairs]
    return np.column_stack([values, samples_of(function, starts)[near]]) if starts else values


def _satisfying(function: CausalFunction, pairs: list[tuple[int, int]], values: np.ndarray) -> np.ndarray:
    """The rows moved onto the conditions on known values by Gauss-Newton, as little as it takes."""
    flat = function.flat
    x = ca.vertcat(*[flat.scope.symbol(*p) for p in pairs])
    residual = ca.substitute(ca.vertcat(*[e.residual for e in function.plan.conditions]), flat.p, flat.p0)
    if not all(flat.scope.owner(s) in pairs for s in ca.symvar(residual)):
        return values
    f = ca.Function("condition", [x], [residual, ca.densify(ca.jacobian(residual, x))])
    result = values.copy()
    for row in result:
        for _ in range(STEPS_TO_CONDITIONS):
            r, jacobian = (np.array(a.full()) for a in f(row))
            row -= np.linalg.lstsq(jacobian, r[:, 0], rcond=None)[0]
    return result


def awkward(face: Interface) -> np.ndarray:
    """Inputs that are singular, overflow or are denormal, (rows, inputs): all at once, then one at a time. The state
    is one of them."""
    point = draw(face, 1, seed=0)[0]
    rows = [np.full(point.shape, value) for value in AWKWARD]
    for column in range(point.size):
        for value in AWKWARD:
            row = point.copy()
            row[column] = value
            rows.append(row)
    return np.array(rows)


def evaluate(face: Interface, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (rows, outputs), NaN without a solution, and status codes (rows,) of the function in Python.

    Behind the outputs stands the new state of a function with Newton blocks; these run step by step as in C.
    """
    function = face.function
    shapes = [s.shape for s in function.inputs] + ([()] if function.plan.uses_time else [])
    if face.stages is None and not shapes:
        *results, status = function()
        row = np.concatenate([np.ravel(r) for r in results])
        return np.tile(row, (len(values), 1)), np.full(len(values), int(status))
    arguments = []
    first = 0
    for shape in shapes:
        size = int(np.prod(shape, dtype=int))
        arguments.append(values[:, first : first + size])
        first += size
    if face.stages is not None:
        return evaluate_stages(face.stages, arguments, values[:, first:])
    *results, status = function(*[a.reshape(-1, *shape) for a, shape in zip(arguments, shapes, strict=True)])
    return np.concatenate([r.reshape(len(values), -1) for r in results], axis=1), np.asarray(status)
