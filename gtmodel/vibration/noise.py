"""Outputs with noise of unequal size: each counts by its own."""

from __future__ import annotations

import numpy as np

REWEIGHTED = 4  # fits after the first, each with the outputs weighted by their noise in the last
SETTLED = 0.02  # a weight that changes by less changes no interval that a person reads
QUIETEST = 1e-6  # of the mean noise: the least that an output is taken to have, a dead one too


def weights_of(y: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """(p,) what makes the noise of every output (N, p) as large as the mean of all, by the residuals of a fit.

    Least squares repeated with these weights is maximum likelihood for white noise of an unknown size at each output.
    """
    size = np.sqrt(np.mean((fitted - y) ** 2, axis=0))
    mean = float(np.sqrt(np.mean(size**2)))
    return np.ones(len(size)) if mean == 0.0 else mean / np.maximum(size, QUIETEST * mean)


def settled(weights: np.ndarray, before: np.ndarray) -> bool:
    """Whether another fit with new weights would change nothing worth telling."""
    return bool(np.all(np.abs(weights / before - 1) < SETTLED))
