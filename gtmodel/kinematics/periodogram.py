"""The strongest sinusoid beside a straight line, and the chance that white noise shows as strong a one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

Array = np.ndarray

SEED = 20080  # of the noise; the same places give the same chance
# noise rows: as many as this work allows, within these bounds; 2000 give a chance of 5 per cent to 0.5 per cent
WORK, FEWEST, MOST = 1e8, 300, 2000
TAIL = 0.02  # chances below this are extrapolated, from at least so many noise rows:
TAIL_ROWS = 20
SAME = 1e-9  # relative: a sine and a cosine that span one direction only, as for points two per period
PART = 2_000_000  # numbers of a basis held at once


def strongest(q: Array, e: Array, frequencies: Array) -> tuple[int, float]:
    """Index of the frequency that explains most of e, and the chance that white noise has one that explains as much.

    At each frequency sine, cosine, offset and slope are fitted; explained is the part of the sum of squares left by the
    line alone. The frequencies searched are neither independent nor at a known number of them, so the chance is found
    by synthetic noise at the same places (seed 20080, Gaussian, 300 to 2000 rows); below 2 per cent it is extrapolated
    by the law of one frequency, (1 - power)^((n - 4) / 2), times a number of frequencies that is taken from the noise
    and grows as in R. B. Davies, Biometrika 74 (1987).

    Args:
        q: (n,) places [m], n > 4. e: (n,) [m], not all on a line. frequencies: [1/m].
    """
    n = len(q)
    rows = int(np.clip(WORK / (n * len(frequencies)), FEWEST, MOST))
    line = np.linalg.qr(np.column_stack([np.ones(n), q - np.mean(q)]))[0]
    signals = np.vstack([e, np.random.default_rng(SEED).standard_normal((rows, n))])
    signals -= (signals @ line) @ line.T
    signals /= np.linalg.norm(signals, axis=1, keepdims=True)
    power, best, first = np.zeros(rows + 1), 0, 0
    for basis in _bases(q, line, frequencies):
        explained = np.sum((signals @ basis.reshape(n, -1)).reshape(rows + 1, -1, 2) ** 2, axis=2)
        if np.max(explained[0]) > power[0]:
            best = first + int(np.argmax(explained[0]))
        power = np.maximum(power, explained.max(axis=1))
        first += basis.shape[1]
    # chance of as much at one frequency given in advance
    single = np.maximum(1.0 - power, 1e-16) ** ((n - 4) / 2)
    return best, _chance(float(single[0]), np.sort(single[1:]))


def _bases(q: Array, line: Array, frequencies: Array) -> Iterator[Array]:
    """Orthonormal bases (n, frequencies, 2) of sine and cosine without their parts along the line, part by part."""
    size = max(1, PART // len(q))
    for first in range(0, len(frequencies), size):
        phase = 2 * np.pi * np.outer(q, frequencies[first : first + size])
        waves = np.stack([np.sin(phase), np.cos(phase)], axis=2)
        waves -= np.einsum("ik,kfj->ifj", line, np.einsum("ik,ifj->kfj", line, waves))
        gram = np.einsum("ifj,ifk->fjk", waves, waves)
        sizes, turn = np.linalg.eigh(gram)
        usable = sizes > SAME * sizes[:, 1:]
        scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, sizes, 1.0)), 0.0)
        yield np.einsum("ifj,fjk->ifk", waves, turn * scale[:, None])


def _chance(single: float, noise: Array) -> float:
    """The chance of a least single-frequency chance as small as this, from those of the noise, ascending."""
    rank = int(np.searchsorted(noise, single, side="right"))
    tail = max(TAIL_ROWS, int(TAIL * len(noise)))
    if rank >= tail:
        return (rank + 1) / (len(noise) + 1)
    edge = float(noise[tail - 1])
    growth = np.sqrt(np.log(max(single, 1e-300)) / np.log(edge)) if 0.0 < edge < 1.0 else 1.0
    return float(min(tail / len(noise), tail / len(noise) * single / edge * growth))
