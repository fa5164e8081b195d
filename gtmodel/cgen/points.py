"""Random inputs of a causal function: near consistent points and far from them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.causal import CausalFunction
from ..compiler.rows import map_columns, status_codes
from ..results.status import Status
from .body import casadi_functions
from .interface import Interface, places
from .newton_stages import evaluate_stages, samples_of
from .newton_steps import run
from .real import DOUBLE

# distance of a row from a consistent point in typical sizes of the inputs, log-uniform: most rows have a solution, many
# are out of range
NEAREST, FARTHEST = 0.01, 6.0
LONGEST_TIME_S = 10.0
STEPS_TO_CONDITIONS = 20
# value of outputs in double before a call, kept by a call that fails
HELD = DOUBLE.held


def draw(face: Interface, rows: int, seed: int, farthest: float = FARTHEST) -> np.ndarray:
    """Return random inputs (rows, inputs): all signals side by side in the order of the function's arguments, then, for
    a function with Newton blocks, the state: the solution at the nearby consistent point.

    The standard deviation of the distance is up to `farthest` typical sizes. Half of the rows satisfy the conditions on
    known values, for example the unit length of a quaternion.
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
    spread = NEAREST * (farthest / NEAREST) ** rng.random((rows, 1))
    near = rng.integers(len(centres), size=rows)
    values = centres[near] + spread * sizes * rng.standard_normal((rows, len(pairs)))
    if plan.chain is not None and plan.chain.has_conditions:  # random poses are none that its joints reach
        chain = plan.chain
        joints = samples_of(function, chain.symbols)[near[::2]] * [sign for sign, _ in chain.kept]
        joints += spread[::2] * rng.standard_normal(joints.shape)
        columns = np.array([pairs.index(p) for p in chain.given])
        locked = np.array([sign * values[::2, pairs.index(p)] for sign, p in chain.locked]).reshape(-1, len(joints)).T
        values[np.ix_(np.arange(0, rows, 2), columns)] = chain.pose_values(joints, locked)
    if plan.on_known:
        values[::2] = satisfying(function, pairs, values[::2])
    if plan.uses_time:
        values = np.column_stack([values, LONGEST_TIME_S * rng.random(rows)])
    starts = [p for stage in face.newton for s in stage.unknowns for p in s.pairs]
    return face.real.array(np.column_stack([values, samples_of(function, starts)[near]]) if starts else values)


def satisfying(
    function: CausalFunction,
    pairs: list[tuple[int, int]],
    values: np.ndarray,
    low: np.ndarray | float = -np.inf,
    high: np.ndarray | float = np.inf,
) -> np.ndarray:
    """Move rows of inputs by Gauss-Newton, as little as possible, onto the conditions on known values and their rates;
    within `low` and `high` if that is possible."""
    if not function.plan.on_known:
        return values
    flat = function.flat
    x = ca.vertcat(*[flat.scope.symbol(*p) for p in pairs])
    residual = ca.substitute(ca.vertcat(*[c.residual for c in function.plan.on_known]), flat.p, flat.p0)
    if not all(flat.scope.owner(s) in pairs for s in ca.symvar(residual)):
        return values
    f = ca.Function("condition", [x], [residual, ca.densify(ca.jacobian(residual, x))])
    result = values.copy()
    bounded = bool(np.any(np.isfinite(low)) or np.any(np.isfinite(high)))
    for step in range(STEPS_TO_CONDITIONS * (1 + bounded)):
        if step < STEPS_TO_CONDITIONS and bounded:
            result = np.clip(result, low, high)
        r, jacobian = map_columns(f, [result.T])
        m, width = r.shape[0], len(pairs)
        jacobians = jacobian.reshape(m, len(result), width).transpose(1, 0, 2)
        result -= (np.linalg.pinv(jacobians) @ r.T[:, :, None])[:, :, 0]
    return result


def awkward(face: Interface) -> np.ndarray:
    """Return inputs (rows, inputs) with singular, overflowing or denormal values: in all inputs, then in one at a time.
    The state counts as an input."""
    point = draw(face, 1, seed=0)[0]
    values = face.real.array(face.real.awkward)
    rows = np.tile(point, (point.size, len(values), 1))
    for column in range(point.size):
        rows[column, :, column] = values
    return np.concatenate([np.tile(values[:, None], point.size), rows.reshape(-1 if point.size else 0, point.size)])


def evaluate(face: Interface, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return outputs (rows, outputs), NaN without a solution, and status codes (rows,) of the function in Python.

    For a function with Newton blocks, which run step by step as in C, the new state follows the outputs. A function in
    float is evaluated in float, operation by operation.
    """
    function = face.function
    if face.stages is None and not face.inputs:
        *results, status = function()
        row = np.concatenate([np.ravel(r) for r in results])
        return np.tile(face.real.array(row), (len(values), 1)), np.full(len(values), int(status))
    arguments = [values[:, span] for span, _ in places(face.inputs)]
    if face.stages is not None:
        return evaluate_stages(face.stages, arguments, values[:, face.input_size :], face.sizes, face.real)
    if face.real is not DOUBLE:
        columns = [a.T for a in arguments]
        results = run(casadi_functions(face)[0], columns)
        status = status_codes(face.function.margins, columns, results, None, face.real.pivot, face.sizes)
        rows = np.vstack(results[:-1]).T.copy()
        rows[status != Status.OK] = np.nan
        return rows, status
    *results, status = function(*[a.reshape(-1, *m.shape) for a, m in zip(arguments, face.inputs, strict=True)])
    return np.concatenate([r.reshape(len(values), -1) for r in results], axis=1), np.asarray(status)
