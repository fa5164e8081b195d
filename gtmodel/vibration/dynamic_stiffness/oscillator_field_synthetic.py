"""A synthetic oscillator field near given values, smooth between them: a truth for fields identified from samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .gaussian_process_kernel import KernelInputs, correlation, square_distances

WAVES = 500  # cosines that make up a draw: its covariance is right within a few per cent
NEAR = 0.01  # of the variance: how near given poses are met; exactly, poses that lie close would make it steep


@dataclass(frozen=True, eq=False)
class SyntheticField:
    """Nine smooth functions over the pose: draws of a squared exponential process that pass near given logarithms.

    Made by synthetic_field(). As `at` of OscillatorField, but a truth: no measurement is behind it.
    """

    inputs: KernelInputs
    frequencies: np.ndarray  # (WAVES, e)
    phases: np.ndarray  # (WAVES,)
    shares: np.ndarray  # (WAVES, 9)
    given: np.ndarray  # coordinates of the given poses (n, e)
    corrections: np.ndarray  # (n, 9)
    mean: np.ndarray  # (9,)
    lengths: np.ndarray

    def at(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """m [kg], c [N.s/m], k [N/m] of x, y, z: (n, 3) each at poses (n, 4)."""
        c = self.inputs.coordinates(np.asarray(poses, float)) / self.lengths[list(self.inputs.owners)]
        logs = (
            self.mean
            + _waves(c, self.frequencies, self.phases) @ self.shares
            + _between(c, self.given) @ self.corrections
        )
        m, damping, k = np.exp(logs).reshape(-1, 3, 3).transpose(1, 0, 2)
        return m, damping, k


def synthetic_field(
    poses: np.ndarray,
    m: np.ndarray,
    c: np.ndarray,
    k: np.ndarray,
    inputs: KernelInputs,
    lengths: np.ndarray,
    *,
    seed: int,
) -> SyntheticField:
    """A synthetic field near m, c, k (n, 3) at poses (n, 4), with `lengths` (4,) in units of the scales of `inputs`.

    The spread between the given poses is that of the given values. Sampling by Matheron's rule: a draw of random
    cosines, corrected towards what is given (Wilson et al. 2020, ICML).

    >>> rng = np.random.default_rng(1)
    >>> poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))  # x, y, z [m], A [rad]
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    >>> inputs = gt.vibration.KernelInputs(scale=(0.5, 0.5, 0.5, 1.0), periodic=(False, False, False, True))
    >>> truth = gt.vibration.synthetic_field(poses, m, c, k, inputs, np.array([2.0, 0.8, 2.0, 0.8]), seed=4)
    >>> bool(np.abs(truth.at(poses)[2] / k - 1).max() < 0.1)  # stiffness at the given poses
    True
    """
    rng = np.random.default_rng(seed)
    logs = np.log(np.hstack([m, c, k]))
    mean, spread = logs.mean(axis=0), logs.std(axis=0)
    lengths = np.asarray(lengths, float)
    given = inputs.coordinates(np.asarray(poses, float)) / lengths[list(inputs.owners)]
    frequencies = rng.standard_normal((WAVES, given.shape[1]))
    phases = rng.uniform(0, 2 * np.pi, WAVES)
    shares = rng.standard_normal((WAVES, logs.shape[1])) * spread
    K = _between(given, given) + NEAR * np.eye(len(given))
    missing = logs - mean - _waves(given, frequencies, phases) @ shares
    return SyntheticField(inputs, frequencies, phases, shares, given, cho_solve(cho_factor(K), missing), mean, lengths)


def _waves(c: np.ndarray, frequencies: np.ndarray, phases: np.ndarray) -> np.ndarray:
    return np.sqrt(2 / len(phases)) * np.cos(c @ frequencies.T + phases)


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return correlation(square_distances(a, b, (0,) * a.shape[1])[0], "squared_exponential")
