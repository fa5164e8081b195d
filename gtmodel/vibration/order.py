"""The order of a subspace model: where singular values fall, and what predicts samples that were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..results import ArgumentError

SLACK = 0.02  # of the least error on held-out samples: among orders that are high enough it varies by about 1 %
NOTHING = 1e-9  # of the outputs' rms: errors below are rounding, and no order is better than another
NOISE_FREE = 1e-12  # of the largest singular value: below is rounding


class OrderTrial(NamedTuple):
    """An order that was tried: the largest modulus of its poles, and the rms error on held-out samples, None where it
    is unstable."""

    order: int
    radius: float
    held_out_rms: float | None


def largest_order(block_rows: int, outputs: int) -> int:
    """The largest order that `block_rows` can determine; shift invariance needs one block row. Raises ArgumentError."""
    if block_rows < 2:
        raise ArgumentError(f"{block_rows} block rows cannot tell any order; take at least 2")
    return (block_rows - 1) * outputs


def gap(singular_values: np.ndarray, largest: int) -> int:
    """The order, from 1, after which the singular values fall by the greatest factor."""
    s = np.maximum(singular_values[: largest + 1], NOISE_FREE * singular_values[0])
    return int(np.argmax(s[:-1] / s[1:])) + 1 if len(s) > 1 else 1


def choose(trials: Sequence[OrderTrial], gap_order: int, size: float) -> tuple[int, str]:
    """The least order within SLACK of the best held-out error, and why. `size`: rms of the outputs.

    Raises ArgumentError where every order is unstable.
    """
    stable = {t.order: t.held_out_rms for t in trials if t.held_out_rms is not None}
    if not stable:
        worst = ", ".join(f"{t.order} ({t.radius:.4g})" for t in trials)
        raise ArgumentError(
            f"every order is unstable, by order with its largest pole: {worst}; record longer, or take more block rows"
        )
    bound = (1 + SLACK) * min(stable.values()) + NOTHING * size
    n = next(order for order in sorted(stable) if stable[order] <= bound)
    reason = f"smallest order within {100 * SLACK:g} % of the best held-out error"
    agrees = (
        "the singular values fall most there too"
        if gap_order == n
        else f"the singular values fall most after {gap_order}"
    )
    return n, f"{reason}; {agrees}"
