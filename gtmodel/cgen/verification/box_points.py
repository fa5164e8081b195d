"""Inputs in the box of validity of a function, with the state that leads there."""

from __future__ import annotations

import itertools

import numpy as np

from ..interface import Interface
from ..newton_stages import samples_of
from ..points import evaluate, satisfying

CORNERS = 64  # all of up to six inputs; of more, so many drawn at random
STEPS = 25  # from home to a point of the box, for a function that follows its last solution


def box_points(face: Interface, rows: int, seed: int) -> np.ndarray:
    """Inputs in the box (corners + rows, inputs), moved onto the conditions on known values and on their
    rates; behind them the state that a function with Newton blocks has when it was led there from home in small steps.

    Where it cannot be led, the state is the last one that was reached. Empty without a box.
    """
    if face.box is None:
        return np.zeros((0, face.input_size + face.state_size), face.real.dtype)
    low, high = np.array(face.box).reshape(-1, 2).T
    rng = np.random.default_rng(seed)
    n = len(low)
    if 2**n <= CORNERS:
        corners = np.array(list(itertools.product((0.0, 1.0), repeat=n)))
    else:
        corners = rng.integers(2, size=(CORNERS, n)).astype(float)
    inputs = low + (high - low) * np.concatenate([corners.reshape(-1, n), rng.random((rows, n))])
    pairs = [p for s in face.function.inputs for p in s.pairs]
    inputs = satisfying(face.function, pairs, inputs, low, high)
    if not face.newton:
        return face.real.array(inputs)
    home = samples_of(face.function, pairs)[0]
    state = np.tile([x for stage in face.newton for x in stage.home], (len(inputs), 1))
    here = np.zeros((len(inputs), n))
    for step in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        here = face.real.array(satisfying(face.function, pairs, home + step * (inputs - home)))
        values, _ = evaluate(face, np.column_stack([here, face.real.array(state)]))
        reached = values[:, face.output_size :]
        state = np.where(np.isfinite(reached), reached, state)
    return np.column_stack([here, face.real.array(state)])
