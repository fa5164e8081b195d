"""Drift of a force sensor's bias: with time, from session to session, with temperature, or in blocks of poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...inference.residuals import shown_p
from ...measurements.inspection import residual_tests
from ...results import ArgumentError
from ...results.suspicion import Suspicion
from .options import Drift
from .wrench import axes

MOST_BLOCKS, POSES = 10, 6  # blocks, and poses in each: our choice, by the coverage under random walks in the tests
LEAST_BLOCKS = 4  # more than the three components of the first moment
OTHER = "let the sensor warm up, or take poses in random order"
Word = Literal["force", "moment"]


@dataclass(frozen=True, eq=False)
class BiasDrift:
    """Conditions of the poses (poses,), and the drifts of the bias to estimate, relative to the last reading.

    time [s]; session: numbers of the recordings, or None; temperature [K], or None.
    """

    kinds: tuple[Drift, ...]
    time: np.ndarray
    session: np.ndarray | None = None
    temperature: np.ndarray | None = None

    @property
    def starts(self) -> tuple[int, ...]:
        """First row of each session."""
        changes = [] if self.session is None else np.flatnonzero(np.diff(self.session)) + 1
        return (0, *(int(k) for k in changes))

    @property
    def blocks(self) -> np.ndarray:
        """Block of each pose, from 0."""
        count = len(self.time)
        return np.arange(count) * min(MOST_BLOCKS, count // POSES) // count

    def columns(self) -> list[tuple[str, str, np.ndarray]]:
        """Prefix of the names, unit after that of the bias, and column (poses,) of each estimated drift."""
        parts = list[tuple[str, str, np.ndarray]]()
        if "linear" in self.kinds:
            parts.append(("drift", "/s", self.time - self.time[-1]))
        if "temperature" in self.kinds and self.temperature is not None:
            parts.append(("thermal", "/K", self.temperature - self.temperature[-1]))
        if "session" in self.kinds and self.session is not None:
            parts += _groups("session", self.session)
        if "blocks" in self.kinds:
            parts += _groups("block", self.blocks + 1)
        return parts

    def names(self, word: Word, unit: str) -> tuple[list[str], list[str]]:
        """Names and units of the estimated drifts."""
        parts = self.columns()
        names = [name for prefix, _, _ in parts for name in axes(f"{prefix}_{word}")]
        return names, [unit + per for _, per, _ in parts for _ in range(3)]

    def suspicions(self, word: Word, unit: str, J: np.ndarray, rest: np.ndarray, least: float) -> list[Suspicion]:
        """Test whether residuals (poses, 3) of a fit with Jacobian J drift with each condition. A drift that is
        estimated leaves nothing to test; the intervals by blocks allow for every drift."""
        if "blocks" in self.kinds:
            return []
        remedy = f'set drift = "{{}}"; or {OTHER}'
        outcomes = [
            residual_tests.drifts(
                J, rest, self.time, remedy.format("linear"), name=f"{word}_drift", unit=unit, least=least
            ),
            residual_tests.coloured(
                J, rest, 'set drift = "linear", or "blocks" if the drift is irregular; the intervals allow for it',
                name=f"{word}_coloured", least=least,
            ),
        ]  # fmt: skip
        if self.temperature is not None and np.ptp(self.temperature) > 0:
            over = f"the range of temperature, {np.ptp(self.temperature):.3g} K,"
            outcomes.append(residual_tests.drifts(
                J, rest, self.temperature, remedy.format("temperature"), name=f"{word}_temperature", unit=unit,
                least=least, over=over,
            ))  # fmt: skip
        if self.session is not None and len(self.starts) > 1:
            each = np.array([column for _, _, column in _groups("session", self.session)])
            test = residual_tests.explained_by(
                J, rest, np.einsum("kn,ij->nikj", each, np.eye(3)).reshape(*rest.shape, -1), least=least
            )
            means = np.array([rest[self.session == s].mean(axis=0) for s in np.unique(self.session)])
            size = float(scipy.spatial.distance.pdist(means).max())
            text = f"the biases of the sessions differ by up to {size:.3g} {unit} ({shown_p(test.p)})"
            outcomes.append(Suspicion(f"{word}_session", text, test.p, remedy.format("session")))
        return outcomes

    def by_blocks(self, J: np.ndarray, values: np.ndarray, x: np.ndarray, load: slice) -> np.ndarray:
        """Covariance (n, n) of the parameters x of a fit with a bias in each block, valid for any drift.

        The load's covariance is that of the fits without one block (jackknife, CR3 of Cameron and Miller 2015, J. Human
        Resources 50), for Student's distribution with blocks - 1 degrees of freedom (Bester, Conley and Hansen 2011, J.
        Econometrics 165). Within a block the bias moves: its variance at the end is half the mean square step from
        block to block, as of a random walk.
        """
        block, A = self.blocks, J[:, :, load]
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


def bias_drift(
    drift: bool | Drift | Sequence[Drift], poses: int, time: ArrayLike | None, session: ArrayLike | None,
    temperature: ArrayLike | None,
) -> BiasDrift:  # fmt: skip
    """Return the drift to estimate, with conditions by row. Raises ArgumentError."""
    kinds = _kinds(drift)
    for kind, given in (("linear", time), ("session", session), ("temperature", temperature)):
        if kind in kinds and given is None:
            argument = "time" if kind == "linear" else kind
            raise ArgumentError(f"is needed to estimate a drift ({kind})", argument)
    numbers = None if session is None else _row(session, poses, "session")
    kelvins = None if temperature is None else _row(temperature, poses, "temperature")
    if kelvins is not None and "temperature" in kinds and not np.ptp(kelvins) > 0:
        raise ArgumentError("is the same in all poses; a drift with temperature needs it to change", "temperature")
    t = np.arange(float(poses)) if time is None else _row(time, poses, "time")
    known = BiasDrift(kinds, t, numbers, kelvins)
    if numbers is not None and len(known.starts) > len(np.unique(numbers)):
        raise ArgumentError("begins again after another session; sort the rows by session", "session")
    backward = np.diff(t) <= 0
    backward[np.array(known.starts[1:], int) - 1] = False  # the clock may restart
    if backward.any():
        raise ArgumentError(f"expected {poses} increasing numbers, one per pose; found {t[1:][backward][0]:g} after "
                            f"{t[:-1][backward][0]:g}", "time")  # fmt: skip
    if "blocks" in kinds and poses < LEAST_BLOCKS * POSES:
        raise ArgumentError(f"'blocks' needs at least {LEAST_BLOCKS * POSES} poses; found {poses}", "drift")
    return known


def _kinds(drift: bool | Drift | Sequence[Drift]) -> tuple[Drift, ...]:
    if isinstance(drift, bool):
        return ("linear",) if drift else ()
    kinds = (drift,) if isinstance(drift, str) else tuple(drift)
    for kind in kinds:
        if kind not in get_args(Drift):
            raise ArgumentError(
                f"expected true, false or some of {', '.join(get_args(Drift))}; found {kind!r}", "drift"
            )
        if kind in ("none", "blocks") and len(kinds) > 1:
            raise ArgumentError(f"'{kind}' stands alone; found it with {len(kinds) - 1} others", "drift")
    return () if kinds == ("none",) else kinds


def _groups(word: str, numbers: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    """A column that is 1 in each group but the last, in the order of the rows."""
    each = dict.fromkeys(numbers.tolist())
    return [(f"{word}_{k:g}", "", (numbers == k).astype(float)) for k in each if k != numbers[-1]]


def _row(values: ArrayLike, count: int, name: str) -> np.ndarray:
    row = np.asarray(values, float)
    if row.shape != (count,) or not np.all(np.isfinite(row)):
        raise ArgumentError(f"expected {count} finite numbers, one per pose; found the shape {row.shape}", name)
    return row
