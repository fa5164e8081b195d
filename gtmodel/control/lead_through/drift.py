"""Drift of a force sensor's bias: names and tests, and the covariance of a fit in blocks of poses."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ...inference import RandomWalkFit
from ...measurements.drift import DriftBasis
from ...measurements.inspection import residual_tests
from ...results.suspicion import Suspicion
from .wrench import axes

OTHER = "let the sensor warm up, or take poses in random order"
ORDER = 1.5  # times wider than in random order: the order of the poses is then worth a note
SHUFFLES = 20
Word = Literal["force", "moment"]


def drift_names(drift: DriftBasis, word: Word, unit: str) -> tuple[list[str], list[str]]:
    """Names and units of the estimated drifts."""
    parts = drift.columns()
    names = [name for prefix, _, _ in parts for name in axes(f"{prefix}_{word}")]
    return names, [unit + per for _, per, _ in parts for _ in range(3)]


def drift_suspicions(
    drift: DriftBasis, word: Word, unit: str, J: np.ndarray, rest: np.ndarray, least: float
) -> list[Suspicion]:
    """Test whether residuals (poses, 3) of a fit with Jacobian J drift with each condition, or are coloured."""
    outcomes = drift.suspicions(word, unit, J, rest, least=least, other=OTHER)
    coloured = residual_tests.coloured(
        J, rest, 'set drift = "linear", or "random_walk" if the drift is irregular; the intervals allow for it',
        name=f"{word}_coloured", least=least,
    )  # fmt: skip
    return [outcomes[0], coloured, *outcomes[1:]] if outcomes else []


def by_blocks(drift: DriftBasis, J: np.ndarray, values: np.ndarray, x: np.ndarray, load: slice) -> np.ndarray:
    """Covariance (n, n) of the parameters x of a fit with a bias in each block, valid for any drift.

    The load's covariance is that of the fits without one block (jackknife, CR3 of Cameron and Miller 2015, J. Human
    Resources 50), for Student's distribution with blocks - 1 degrees of freedom (Bester, Conley and Hansen 2011, J.
    Econometrics 165). Within a block the bias moves: its variance at the end is half the mean square step from
    block to block, as of a random walk.
    """
    block, A = drift.blocks, J[:, :, load]
    q, width = int(block[-1]) + 1, A.shape[2]
    G = np.array([A[block == b].mean(axis=0) for b in range(q)])
    centred, rest = A - G[block], values - J @ x
    parts = [(centred[block == b], rest[block == b]) for b in range(q)]
    squares = np.array([np.einsum("tci,tcj->ij", C, C) for C, _ in parts])
    scores = np.array([np.einsum("tci,tc->i", C, r) for C, r in parts])
    moved = np.einsum("qij,qj->qi", np.linalg.pinv(squares.sum(axis=0) - squares), scores)
    of_load = moved.T @ moved * (q - 1) / q
    biases = np.array([(values - A @ x[load])[block == b].mean(axis=0) for b in range(q)])
    within = np.tile(np.mean(np.diff(biases, axis=0) ** 2, axis=0) / 2, q)
    # parameters by errors of the load and of each block's own bias
    by_load = np.concatenate([-G[-1], np.eye(width), *(G[-1] - G[b] for b in range(q - 1))])
    own = np.zeros((len(by_load), 3 * q))
    own[:3, -3:] = np.eye(3)
    for b in range(q - 1):
        row = slice(3 + width + 3 * b, 6 + width + 3 * b)
        own[row, 3 * b : 3 * b + 3], own[row, -3:] = np.eye(3), -np.eye(3)
    return by_load @ of_load @ by_load.T + (own * within) @ own.T


def walk_notes(walk: RandomWalkFit, J: np.ndarray, mass: float) -> tuple[str, ...]:
    """Sentences on the size of a force bias's random walk, and on the order of the poses, if it costs much.

    J (poses, 3, n), the mass in column 3. The least possible deviations of the mass are compared for these poses in
    this and in random orders.
    """
    step = walk.density * np.sqrt(np.median(np.diff(walk.time)))
    notes = [
        f"the bias of the force walks by {step[0]:.2g}, {step[1]:.2g} and {step[2]:.2g} N (x, y, z) from pose to pose; "
        f"the noise of a reading is {walk.noise:.2g} N"
    ]
    rng = np.random.default_rng(0)
    here = float(walk.bound(J)[3])
    mixed = float(np.median([walk.bound(J[rng.permutation(len(J))])[3] for _ in range(SHUFFLES)]))
    if here > ORDER * mixed:
        notes.append(
            f"because of the order of the poses no evaluation determines the mass better than {2 * here:.2g} kg "
            f"({200 * here / abs(mass):.2g} %, two standard deviations): gravity turns as slowly as the bias walks; "
            f"the same poses in random order would leave {2 * mixed:.2g} kg"
        )
    return tuple(notes)
