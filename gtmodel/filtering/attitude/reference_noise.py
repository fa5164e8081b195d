"""Why references and gyro disagree between two references: their instants, the gyro's relative error, their digits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

START = (3e-3, 1e-2, 1e-4, 0.3)  # s, 1, rad, s: where the search of the most likely noise begins
LIMITS = ((1e-5, 0.1), (1e-5, 1.0), (1e-7, 0.1), (1e-2, 10.0))
SEARCH = 250  # evaluations of the likelihood at the most


@dataclass(frozen=True)
class ReferenceNoise:
    """Sizes of the three disagreements.

    timing: of the stamps of the references [s]; it turns with the rate, and two neighbours share it. relative: of the
    gyro's turns, as a part of them; it persists for `persistence` [s], as of an Ornstein-Uhlenbeck process. floor: of
    the references themselves [rad], independent between intervals.

    >>> noise = gt.filtering.ReferenceNoise(timing=3e-3, relative=0.01, floor=0.0, persistence=2.0)
    >>> noise.turn_covariance(np.array([0.1, 0.1]), np.array([0.0, 2.0])).round(9).tolist()
    [[1e-06, 3.68e-07], [3.68e-07, 1e-06]]
    """

    timing: float
    relative: float
    floor: float
    persistence: float

    def timing_covariance(self, rate: np.ndarray) -> np.ndarray:
        """Of the orientation at instants with these rates (k, 3) of the body: (k, 3, 3), in its axes."""
        return self.timing**2 * rate[:, :, None] * rate[:, None, :]

    def turn_covariance(self, angle: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """Of the turns (k, k) over intervals of these angles around these instants; the same about all axes."""
        memory = np.exp(-np.abs(middle[:, None] - middle) / self.persistence)
        return self.relative**2 * np.outer(angle, angle) * memory + self.floor**2 * np.eye(len(angle))

    def covariance(self, turn: Rotation, rate: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Of the residuals (3 k, 3 k) over k intervals, each in the axes of the body at its end.

        turn: of the reference over the intervals. rate (k + 1, 3), time (k + 1,): at their ends.
        """
        k = len(turn)
        at, back, n = self.timing_covariance(rate), turn.inv().as_matrix(), np.arange(k)
        C = np.zeros((k, 3, k, 3))
        C[n, :, n, :] = back @ at[:-1] @ np.swapaxes(back, 1, 2) + at[1:]
        shared = -at[1:-1] @ np.swapaxes(back[1:], 1, 2)
        C[n[:-1], :, n[1:], :] = shared
        C[n[1:], :, n[:-1], :] = np.swapaxes(shared, 1, 2)
        own = self.turn_covariance(turn.magnitude(), (time[1:] + time[:-1]) / 2)
        return C.reshape(3 * k, 3 * k) + np.kron(own, np.eye(3))


BLOCK = 150  # intervals whose noise is taken together, ten seconds: the cost of all is linear in their number


def blocks_of(count: int) -> list[slice]:
    """Intervals 0 .. count in stretches of equal length, at most `BLOCK`, one after the other."""
    edges = np.linspace(0, count, max(1, -(-count // BLOCK)) + 1).round().astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def factors(noise: ReferenceNoise, turn: Rotation, rate: np.ndarray, time: np.ndarray) -> list[np.ndarray]:
    """Cholesky factors of the covariance of the residuals of each block; between blocks they count as independent.

    Raises LinAlgError where one is not positive definite.
    """
    return [
        np.linalg.cholesky(noise.covariance(turn[b], rate[b.start : b.stop + 1], time[b.start : b.stop + 1]))
        for b in blocks_of(len(turn))
    ]


def whitened(roots: Sequence[np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Rows (3 k, ...) that are whitened block by block."""
    ends = np.cumsum([0, *(len(L) for L in roots)])
    parts = [
        scipy.linalg.solve_triangular(L, rows[a:b], lower=True)
        for L, a, b in zip(roots, ends[:-1], ends[1:], strict=True)
    ]
    return np.concatenate(parts)


def likeliest_noise(
    residual: np.ndarray,
    J: np.ndarray,
    turn: Rotation,
    rate: np.ndarray,
    time: np.ndarray,
    guess: ReferenceNoise,
    ask: Callable[[], None] = lambda: None,
) -> tuple[ReferenceNoise, float]:
    """The noise under which residuals (3 k,) are most likely, and their log-likelihood.

    J (3 k, n): their Jacobian by what was fitted to them. ask: called at each evaluation; may raise.
    The likelihood is that of what no fit can take away, the
    restricted one, or the noise would come out too small: Patterson and Thompson 1971, Biometrika 58, 545-554.
    """
    low, high = np.log(np.array(LIMITS)).T
    rows = np.column_stack([J, residual])

    def cost(x: np.ndarray) -> float:
        if np.any(x < low) or np.any(x > high):
            return np.inf
        ask()
        try:
            roots = factors(ReferenceNoise(*np.exp(x)), turn, rate, time)
        except np.linalg.LinAlgError:
            return np.inf
        R = np.linalg.qr(whitened(roots, rows), mode="r")
        size = np.abs(np.diag(R))
        left, logs = size[-1] ** 2, np.log(size[:-1]).sum() + sum(np.log(np.diag(L)).sum() for L in roots)
        return float(0.5 * left + logs + 0.5 * (len(rows) - J.shape[1]) * np.log(2 * np.pi))

    start = (guess.timing, guess.relative, guess.floor, guess.persistence)
    options = {"xatol": 0.02, "fatol": 0.02, "maxfev": SEARCH}
    best = scipy.optimize.minimize(cost, np.log(start), method="Nelder-Mead", options=options)
    return ReferenceNoise(*(float(v) for v in np.exp(best.x))), -float(best.fun)
