"""Structures of serial chains that have closed forms: which axes meet, are parallel or square to each other.

Relations of neighbouring axes do not depend on the joints, so they are read from the lines at zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .chain import Chain, snapped

EXACT = 1e-11  # angles [rad] and relative lengths that are round-off: the closed form is the solution
NEAR = 5e-3  # the same of a calibrated arm: its closed form is a start for Newton steps

PAIRS = ("slide", "parallel", "meet", "plane", "cylinder")  # motions of two joints, the simplest first


@dataclass(frozen=True)
class Plan:
    """How a chain is solved, by indices of its joints in `order`, base to end.

    order: joints of the original chain; reverse: the order is from the end to the base. kind "wrist": the last `wrist`
    joints turn about one point, which the first ones bring to its place: `pair` together, as `motion` says, and
    `single` alone. kind "parallel": axes 2, 3 and 4 are parallel, axes 5 and 6 meet.
    """

    kind: str
    order: tuple[int, ...]
    reverse: bool
    wrist: int
    single: int | None = None
    pair: tuple[int, int] | None = None
    motion: str = ""


@dataclass(frozen=True, eq=False)
class Nominal:
    """A chain with the exact structure of a plan: joint i of it is joint `order[i]` of the original, times `sign[i]`.

    `centre` (3) is the point that the wrist leaves in place; `off` the largest difference from the original, in rad and
    relative to its size.
    """

    plan: Plan
    chain: Chain
    sign: np.ndarray
    centre: np.ndarray
    off: float


def plans(chain: Chain, oriented: bool, tolerance: float) -> Iterator[Plan]:
    """Yield the plans that the structure admits; `oriented`: the orientation is known besides the position."""
    n = len(chain)
    straight = tuple(range(n))
    orders = [(straight, False)]
    if oriented:
        ends = [chain.axes[i] for i in (-2, -1)] if n > 1 else []
        if ends and chain.revolute[-2:] == (True, False) and np.linalg.norm(np.cross(*ends)) < tolerance:
            orders.append(((*straight[:-2], n - 1, n - 2), False))
        orders.append((straight[::-1], True))
    for order, reverse in orders:
        lines = _Lines(chain, order, tolerance)
        for wrist in (3, 2, 1, 0) if oriented else (0,):
            k = n - wrist
            if 0 <= k <= 3 and not (reverse and wrist == 0) and lines.wrist(range(k, n)):
                for single, pair, motion in lines.positioning(k):
                    yield Plan("wrist", order, reverse, wrist, single, pair, motion)
        if oriented and n == 6 and all(chain.revolute) and lines.parallel(1, 2, 3) and lines.meet(4, 5):
            yield Plan("parallel", order, reverse, 2)


def nominal(chain: Chain, plan: Plan) -> Nominal:
    """Return the chain with the exact structure of a plan, as near as possible to the given one."""
    order = list(plan.order)
    h, o = chain.axes[order].copy(), chain.points[order].copy()
    revolute = tuple(chain.revolute[i] for i in order)
    sign = np.full(len(h), -1.0 if plan.reverse else 1.0)
    wrist = tuple(range(len(h) - plan.wrist, len(h)))
    parallel = (1, 2, 3) if plan.kind == "parallel" else ()
    if plan.motion in ("parallel", "cylinder"):
        parallel = plan.pair or ()
    if parallel:
        sides = np.where(h[list(parallel)] @ h[parallel[0]] < 0, -1.0, 1.0)
        mean = (sides[:, None] * h[list(parallel)]).mean(axis=0)
        sign[list(parallel)] *= sides
        h[list(parallel)] = snapped(mean / np.linalg.norm(mean))
    if plan.motion == "plane" and plan.pair:
        turning, sliding = plan.pair if revolute[plan.pair[0]] else plan.pair[::-1]
        across = h[sliding] - h[turning] * (h[turning] @ h[sliding])
        h[sliding] = snapped(across / np.linalg.norm(across))
    off = [float(np.abs(h * (sign * (-1 if plan.reverse else 1))[:, None] - chain.axes[order]).max())]
    for group in (wrist if len(wrist) > 1 else (), plan.pair if plan.motion == "meet" and plan.pair else ()):
        if group:
            point = snapped(common_point(h[list(group)], o[list(group)]), chain.size)
            off += [_distance(point, chain.axes[order[i]], o[i]) / chain.size for i in group]
            o[list(group)] = point
    # the foot of the base's origin has the most zeros
    lone = [i for i in range(len(h)) if i not in wrist[: plan.wrist if plan.wrist > 1 else 0]]
    for i in lone if plan.motion != "meet" else [i for i in lone if i not in (plan.pair or ())]:
        o[i] = snapped(o[i] - h[i] * (h[i] @ o[i]), chain.size)
    centre = o[wrist[0]] if wrist else chain.T
    if len(wrist) == 1:  # any point of the last axis: the one nearest to the end
        end = np.zeros(3) if plan.reverse else chain.T
        centre = o[wrist[0]] + h[wrist[0]] * (h[wrist[0]] @ (end - o[wrist[0]]))
    return Nominal(plan, Chain(h, o, revolute, chain.T, chain.R), sign, snapped(centre, chain.size), max(off))


class _Lines:
    """Relations of the axes of a chain in an order, within a tolerance."""

    def __init__(self, chain: Chain, order: Sequence[int], tolerance: float) -> None:
        self.h, self.o = chain.axes[list(order)], chain.points[list(order)]
        self.revolute = [chain.revolute[i] for i in order]
        self.size, self.tolerance = chain.size, tolerance

    def parallel(self, *group: int) -> bool:
        return all(np.linalg.norm(np.cross(self.h[group[0]], self.h[i])) < self.tolerance for i in group[1:])

    def meet(self, *group: int) -> bool:
        h, o = self.h[list(group)], self.o[list(group)]
        sines = [np.linalg.norm(np.cross(a, b)) for a, b in pairwise(h)]
        if min(sines) < max(10 * self.tolerance, 1e-3):
            return False
        point = common_point(h, o)
        return all(_distance(point, a, b) < self.tolerance * self.size for a, b in zip(h, o, strict=True))

    def wrist(self, joints: range) -> bool:
        return all(self.revolute[j] for j in joints) and (len(joints) < 2 or self.meet(*joints))

    def positioning(self, k: int) -> Iterator[tuple[int | None, tuple[int, int] | None, str]]:
        """Yield the joint solved alone, the pair solved together and the motion of the pair, of the first k joints."""
        if k < 2:
            yield (0 if k else None), None, ""
            return
        moving = [(self.motion(*pair), pair) for pair in (((1, 2), (0, 1)) if k == 3 else ((0, 1),))]
        for motion, pair in sorted((f for f in moving if f[0]), key=lambda f: PAIRS.index(f[0])):
            yield (None if k == 2 else 2 if pair[0] == 0 else 0), pair, motion

    def motion(self, a: int, b: int) -> str:
        """Return how two neighbouring joints move a point together; "" if they have no common invariant."""
        turns = self.revolute[a] + self.revolute[b]
        if self.parallel(a, b):
            return ("", "cylinder", "parallel")[turns]
        if turns == 2:
            return "meet" if self.meet(a, b) else ""
        return "slide" if not turns else "plane" if abs(self.h[a] @ self.h[b]) < self.tolerance else ""


def common_point(h: np.ndarray, o: np.ndarray) -> np.ndarray:
    """Return the point with the least sum of squared distances from lines."""
    across = np.eye(3) - h[:, :, None] * h[:, None, :]
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, o))


def _distance(point: np.ndarray, h: np.ndarray, o: np.ndarray) -> float:
    return float(np.linalg.norm(np.cross(h, point - o)))
