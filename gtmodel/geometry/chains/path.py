"""Postures along a path of poses: from row to row without a jump, with as few jumps as the arm and its limits allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...results import Status
from ..rotations import within_pi
from .chain import Chain
from .numerical import SOLVED, polished
from .postures import ON_LIMIT, Postures

STATES = 2000  # ways to one row that are followed, the shortest first
FOLLOWED = 8  # of these, those that are followed through a singular position by iteration


@dataclass(frozen=True)
class PostureJump:
    """A row (counted from 0) whose posture is not reached from the row before without a jump.

    kind: "limit": the next posture is near, but joint `joint` would exceed a limit by `amount`; "step": joint `joint`
    would move by `amount` [rad or m] at once; "gap": the row has no posture within limits, and the path begins anew
    after it.
    """

    row: int
    kind: str
    joint: int = -1
    amount: float = 0.0


@dataclass(frozen=True, eq=False)
class PosturePath:
    """One posture for each pose of a path: q (m, n) [rad or m], NaN where there is none within limits; its branch (m,),
    -1 where it has none; and the jumps that no choice of postures avoids."""

    q: np.ndarray
    branch: np.ndarray
    jumps: tuple[PostureJump, ...]


def along_path(
    chain: Chain, solutions: Postures, T: np.ndarray, R: np.ndarray | None, *, limits: ArrayLike | None = None,
    near: ArrayLike | None = None, largest_step: ArrayLike = 0.5,
) -> PosturePath:  # fmt: skip
    """Return postures of successive poses T (m, 3), R (m, 3, 3), of which `solutions` are all postures.

    A step is no jump if each joint moves by at most `largest_step` [rad or m], one number or (n,), without a turn of
    360 degrees and within `limits` (n, 2). Where postures go on in several ways, the way with the least sum of joint
    movements is taken, begun next to `near` (n,). Jumps are where every way ends; the last of them is as late as
    possible, so there are as few as possible.

    >>> from gtmodel.geometry.chains import Chain, along_path, postures
    >>> arm = Chain([[0, 0, 1], [0, 0, 1]], [[0, 0, 0], [0.4, 0, 0]], T=[0.7, 0, 0])
    >>> T = np.array([[0.5, y, 0.0] for y in (-0.2, 0.0, 0.2)])
    >>> way = along_path(arm, postures(arm, T), T, None, limits=[[-2.0, 2.0], [-2.0, 0.0]])  # elbow on one side
    >>> way.jumps, np.degrees(way.q[:, 1]).round(1)
    ((), array([-80.4, -90. , -80.4]))
    """
    m, n = len(T), len(chain)
    bound = np.tile([-np.inf, np.inf], (n, 1)) if limits is None else np.asarray(limits, float)
    ways = _Ways(chain, solutions, T, R, bound, np.broadcast_to(np.asarray(largest_step, float), n))
    q, branch, jumps = np.full((m, n), np.nan), np.full(m, -1), []
    row, last = 0, None if near is None else np.asarray(near, float)
    began = False
    while row < m:
        layers = ways.from_row(row, last)
        if not layers:
            if began:
                jumps.append(PostureJump(row, "gap"))
            began, row = False, row + 1
            continue
        chosen = int(np.argmin(layers[-1].cost))
        for k in range(len(layers) - 1, -1, -1):
            q[row + k], branch[row + k] = layers[k].q[chosen], layers[k].branch[chosen]
            chosen = int(layers[k].before[chosen])
        row, began = row + len(layers), True
        last = q[row - 1]
        if row < m and (reason := ways.reason(row, last)) is not None:
            jumps.append(reason)
    return PosturePath(q, branch, tuple(jumps))


@dataclass(frozen=True, eq=False)
class _Layer:
    """Ways to the postures of one row: q (s, n), branch, sum of movements, and the index of the way before."""

    q: np.ndarray
    branch: np.ndarray
    cost: np.ndarray
    before: np.ndarray


@dataclass(eq=False)
class _Ways:
    chain: Chain
    solutions: Postures
    T: np.ndarray
    R: np.ndarray | None
    limits: np.ndarray
    step: np.ndarray

    def __post_init__(self) -> None:
        self.turns = np.array(self.chain.revolute)
        self.scale = np.where(self.turns, 1.0, self.chain.size)

    def from_row(self, row: int, near: np.ndarray | None) -> list[_Layer]:
        """Return the layers from a row to the last one that is reached without a jump; none if the row has no posture
        within limits."""
        q, branch = self.solutions.within(self.starting(near), row)
        inside = ((q >= self.limits[:, 0] - ON_LIMIT) & (q <= self.limits[:, 1] + ON_LIMIT)).all(axis=1)
        q, branch = q[inside], branch[inside]
        if not len(q):
            return []
        cost = np.zeros(len(q)) if near is None else np.linalg.norm((q - near) / self.scale, axis=1)
        layers = [_Layer(q, branch, cost, np.zeros(len(q), int))]
        while row + len(layers) < len(self.T) and (after := self.after(row + len(layers), layers[-1])) is not None:
            layers.append(after)
        return layers

    def starting(self, near: np.ndarray | None) -> np.ndarray:
        """Return limits with at most one turn for a joint that may turn without end."""
        about = np.zeros(len(self.chain)) if near is None else near
        low, high = self.limits.T
        least = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - 2 * np.pi, about - np.pi))
        most = np.where(np.isfinite(high), high, least + 2 * np.pi)
        return np.column_stack([np.where(self.turns, least, low), np.where(self.turns, most, high)])

    def candidates(self, row: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the postures (k, n) of a row and their branches; at a singular position also those nearest to q."""
        exists = self.solutions.exists[row]
        to, branch = self.solutions.q[row][exists], self.solutions.branch[row][exists]
        if np.any(self.solutions.status[row][exists] == Status.SINGULAR):
            start = q[:FOLLOWED]
            at, turned = np.repeat(self.T[row : row + 1], len(start), axis=0), None
            if self.R is not None:
                turned = np.repeat(self.R[row : row + 1], len(start), axis=0)
            more, off = polished(self.chain, at, turned, start)
            to = np.concatenate([to, more[off < SOLVED]])
            branch = np.concatenate([branch, np.full(len(to) - len(branch), branch[0])])
        return to, branch

    def moves(self, q: np.ndarray, to: np.ndarray) -> np.ndarray:
        """Return the movements (s, k, n) from q (s, n) to postures (k, n), without whole turns."""
        d = to[None] - q[:, None]
        return np.where(self.turns, within_pi(d), d)

    def after(self, row: int, layer: _Layer) -> _Layer | None:
        order = np.argsort(layer.cost, kind="stable")[:STATES]
        q, cost = layer.q[order], layer.cost[order]
        to, branch = self.candidates(row, q)
        d = self.moves(q, to)
        reached = q[:, None] + d
        free = (np.abs(d) <= self.step).all(axis=2) & (self.excess(reached) == 0).all(axis=2)
        way, k = np.nonzero(free)
        if not len(way):
            return None
        ends, total = reached[way, k], cost[way] + np.linalg.norm(d[way, k] / self.scale, axis=1)
        ranked = np.argsort(total, kind="stable")
        _, first = np.unique((ends[ranked] / self.scale).round(6), axis=0, return_index=True)
        kept = ranked[np.sort(first)]
        return _Layer(ends[kept], branch[k[kept]], total[kept], order[way[kept]])

    def excess(self, q: np.ndarray) -> np.ndarray:
        low, high = self.limits.T
        above, below = q > high + ON_LIMIT, q < low - ON_LIMIT
        with np.errstate(invalid="ignore"):
            return np.where(above, q - high, np.where(below, q - low, 0.0))

    def reason(self, row: int, q: np.ndarray) -> PostureJump | None:
        """Return why no way leads on to a row from q (n,); None if the row has no posture within limits itself."""
        within, _ = self.solutions.within(self.starting(q), row)
        if not len(within):
            return None
        to, _ = self.candidates(row, q[None])
        d = self.moves(q[None], to)[0]
        near = (np.abs(d) <= self.step).all(axis=1)
        if near.any():
            excess = self.excess(q + d[near])
            k, joint = np.unravel_index(np.argmax(np.abs(excess) / self.scale), excess.shape)
            return PostureJump(row, "limit", int(joint), float(excess[k, joint]))
        nearest = d[np.argmin(np.abs(d / self.step).max(axis=1))]
        joint = int(np.argmax(np.abs(nearest) / self.step))
        return PostureJump(row, "step", joint, float(nearest[joint]))
