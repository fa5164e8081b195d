"""Random inputs of a causal function: near consistent points and far from them."""

from __future__ import annotations

import numpy as np

from ..compiler.causal import CausalFunction

# each row leaves a consistent point by its own fraction of the inputs' typical sizes, drawn evenly in the
# logarithm: most rows stay where solutions exist, a fair share leaves the range
NEAREST, FARTHEST = 0.01, 6.0
LONGEST_TIME_S = 10.0
# zero, a denormal, and numbers whose squares and products overflow
AWKWARD = (0.0, 5e-324, -1e-310, 1e160, -1e300)
# what stands in outputs before a call, and after one that fails
HELD = -1.25e300


def draw(function: CausalFunction, rows: int, seed: int) -> np.ndarray:
    """Random inputs, (rows, inputs): all signals side by side, in the order of the function's arguments."""
    rng = np.random.default_rng(seed)
    plan = function.plan
    position = {pair: n for n, pair in enumerate(plan.pairs)}
    pairs = [p for s in function.inputs for p in s.pairs]
    centres = np.zeros((len(plan.samples), len(pairs)))
    for column, pair in enumerate(pairs):
        if pair in position:
            # six digits: the noise of another linear algebra library must not reach the generated text
            centres[:, column] = [float(f"{x:.6g}") for x in plan.samples[:, position[pair]]]
    sizes = np.ones(len(pairs))
    first = 0
    for s in function.inputs:
        size = float(np.max(np.abs(centres[:, first : first + s.size]), initial=0.0))
        sizes[first : first + s.size] = max(size, function.flat.variables[s.pairs[0][0]].nominal)
        first += s.size
    spread = NEAREST * (FARTHEST / NEAREST) ** rng.random((rows, 1))
    values = centres[rng.integers(len(centres), size=rows)]
    values = values + spread * sizes * rng.standard_normal((rows, len(pairs)))
    if plan.uses_time:
        values = np.column_stack([values, LONGEST_TIME_S * rng.random(rows)])
    return values


def awkward(function: CausalFunction) -> np.ndarray:
    """Inputs that are singular, overflow or are denormal, (rows, inputs): all at once, then one at a time."""
    point = draw(function, 1, seed=0)[0]
    rows = [np.full(point.shape, value) for value in AWKWARD]
    for column in range(point.size):
        for value in AWKWARD:
            row = point.copy()
            row[column] = value
            rows.append(row)
    return np.array(rows)


def evaluate(function: CausalFunction, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (rows, outputs), NaN without a solution, and status codes (rows,) of the function in Python."""
    shapes = [s.shape for s in function.inputs] + ([()] if function.plan.uses_time else [])
    if not shapes:
        *results, status = function()
        row = np.concatenate([np.ravel(r) for r in results])
        return np.tile(row, (len(values), 1)), np.full(len(values), int(status))
    arguments = []
    first = 0
    for shape in shapes:
        size = int(np.prod(shape, dtype=int))
        arguments.append(values[:, first : first + size].reshape(-1, *shape))
        first += size
    *results, status = function(*arguments)
    return np.concatenate([r.reshape(len(values), -1) for r in results], axis=1), np.asarray(status)
