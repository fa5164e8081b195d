"""All postures of a serial chain for given poses: closed form, elimination, or iteration from many starts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError, Status
from ..rotations import within_pi
from .chain import Chain
from .closed import ClosedForm, closed_form
from .elbow import ElbowAngle, elbow_postures
from .general import GeneralArm
from .numerical import SOLVED, jacobian, nearest_starts, polished, starts
from .quartic import QuarticArm

SINGULAR = 1e-6  # relative size of a pivot, or smallest singular value, below which angles have fewer than ten digits
ROTATION = 1e-6  # largest entry of R'R - I
ON_LIMIT = 1e-9  # rad or m
SAME = 1e-6  # rad or relative length between two postures that are one
KEPT = 16  # postures of one pose that an iteration keeps
ROUNDS, AT_ONCE = 6, 16  # rounds of starts, and starts of one round


@dataclass(frozen=True)
class LockedJoint:
    """Redundancy resolved by holding one joint (counted from 0, negative from the end) at a value [rad or m]."""

    joint: int
    value: float


@dataclass(frozen=True, eq=False)
class Postures:
    """Postures of m poses: q (m, k, n) [rad or m], NaN where there is none, and status (m, k).

    OK, or SINGULAR: next to a singular position, where q is one of the solutions or two of them meet. OUT_OF_RANGE: the
    pose is out of reach on this branch, or only beyond the limits, as `beyond` (m, k) tells. NOT_FINITE: the pose has a
    number that is not finite. NOT_CONVERGED: no posture was found by iteration.

    `branch` (m, k) is an index of `names`, or a number without a meaning if `names` is empty: a cuspidal or general arm
    changes posture without a singular position, and its postures have no names. `complete`: all postures are known, by
    algebra. `method` says how they were found.
    """

    q: np.ndarray
    status: np.ndarray
    branch: np.ndarray
    beyond: np.ndarray
    names: tuple[str, ...]
    complete: bool
    method: str
    revolute: tuple[bool, ...]

    @property
    def exists(self) -> np.ndarray:
        """Where a posture exists within the limits, (m, k)."""
        return np.asarray(np.isfinite(self.q).all(axis=2))

    def within(self, limits: ArrayLike, pose: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return all joint coordinates (j, n) of one pose within limits (n, 2), and their branches (j,).

        Each revolute joint may be rotated by multiples of 360 degrees. The result is empty if none is within.
        """
        low, high = np.asarray(limits, float).reshape(-1, 2).T
        turn = np.where(self.revolute, 2 * np.pi, np.inf)
        rows, branches = [np.zeros((0, self.q.shape[2]))], [np.zeros(0, int)]
        for q, branch in zip(self.q[pose], self.branch[pose], strict=True):
            if not np.all(np.isfinite(q)):
                continue
            with np.errstate(invalid="ignore"):
                first, last = np.ceil((low - ON_LIMIT - q) / turn), np.floor((high + ON_LIMIT - q) / turn)
            slides = ~np.array(self.revolute)
            inside = (q >= low - ON_LIMIT) & (q <= high + ON_LIMIT)
            first, last = np.where(slides, 0, first), np.where(slides, inside - 1, last)
            turns = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
            grid = np.stack(np.meshgrid(*turns, indexing="ij"), axis=-1).reshape(-1, len(q))
            rows.append(q + np.where(slides, 0.0, 2 * np.pi) * grid)
            branches.append(np.full(len(grid), branch))
        return np.concatenate(rows), np.concatenate(branches)

    def placed(self, limits: ArrayLike, near: ArrayLike | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return q (m, k, n) with whole turns into limits (n, 2), and its excess (m, k, n) beyond them [rad or m].

        The excess is positive above the upper limit, negative below the lower one, 0 within. Of several turns within
        the limits, the one nearest to `near` (n,) or (m, n), or else to the middle of the limits, is taken.
        """
        at = None if near is None else np.broadcast_to(np.asarray(near, float), (len(self.q), self.q.shape[2]))
        return _turned(self.revolute, self.q, _limits(limits, self.q.shape[2]), at)


def postures(
    chain: Chain, T: ArrayLike, R: ArrayLike | None = None, *, limits: ArrayLike | None = None,
    near: ArrayLike | None = None, redundancy: LockedJoint | ElbowAngle | None = None,
) -> Postures:  # fmt: skip
    """Return the postures of poses T (m, 3) [m] and R (m, 3, 3), or of T alone.

    First all postures are found, then turns of 360 degrees, then limits. `limits` (n, 2) [rad or m]: each posture is
    turned into them, next to `near` or else to their middle, or left out. `near` (n,) or (m, n): postures are turned
    next to these joint coordinates and sorted by their distance. `redundancy`: of seven joints, which may be a
    LockedJoint or an ElbowAngle.

    Methods: the closed form that `closed_form` finds, with named branches; a quartic for other arms with a spherical
    wrist and for three revolute joints; for other six revolute joints the elimination of Raghavan and Roth, all up to
    sixteen postures; else damped iteration from the nearest of 2,000 stored poses and a
    fixed list of starts, which may miss postures (`complete` is False). Raises ArgumentError for wrong shapes.

    >>> from gtmodel.geometry.chains import Chain, postures
    >>> arm = Chain([[0, 0, 1], [0, 0, 1]], [[0, 0, 0], [0.4, 0, 0]], T=[0.7, 0, 0])
    >>> both = postures(arm, [0.5, 0.3, 0.0])
    >>> both.names, np.degrees(both.q[0]).round(1)
    (('left', 'right'), array([[ 59.5, -68. ],
           [  2.5,  68. ]]))
    """
    T, R = _poses(T, R)
    bound = None if limits is None else _limits(limits, len(chain))
    at = None if near is None else np.broadcast_to(np.asarray(near, float), (len(T), len(chain)))
    usable = np.asarray(np.isfinite(T).all(axis=1) & (True if R is None else np.isfinite(R).all(axis=(1, 2))))
    safe_T = np.where(usable[:, None], T, 0.0)
    safe_R = None if R is None else np.where(usable[:, None, None], R, np.eye(3))
    made = _solved(chain, safe_T, safe_R, bound, at, redundancy)
    status, q = made.status.copy(), made.q.copy()
    if safe_R is not None:
        off = np.abs(safe_R.transpose(0, 2, 1) @ safe_R - np.eye(3)).max(axis=(1, 2))
        status[(off > ROTATION) | (np.linalg.det(safe_R) < 0)] = Status.OUT_OF_RANGE
    status[~usable] = Status.NOT_FINITE
    q[(status != Status.OK) & (status != Status.SINGULAR)] = np.nan
    beyond = np.zeros(status.shape, bool)
    if bound is not None or at is not None:
        q, excess = _turned(chain.revolute, q, bound, at)
        beyond = (excess != 0).any(axis=2)
        q[beyond] = np.nan
        status[beyond] = Status.OUT_OF_RANGE
    made = replace(made, q=q, status=status, beyond=beyond)
    return made if at is None else _sorted(made, at)


def _poses(T: ArrayLike, R: ArrayLike | None) -> tuple[np.ndarray, np.ndarray | None]:
    T = np.atleast_2d(np.asarray(T, float))
    if T.ndim != 2 or T.shape[1] != 3:
        raise ArgumentError(f"has the shape {T.shape}; expected (m, 3)", "T")
    if R is None:
        return T, None
    R = np.asarray(R, float)
    R = R[None] if R.ndim == 2 else R
    if R.shape != (len(T), 3, 3):
        raise ArgumentError(f"has the shape {R.shape} for {len(T)} positions; expected ({len(T)}, 3, 3)", "R")
    return T, R


def _limits(limits: ArrayLike, n: int) -> np.ndarray:
    bound = np.asarray(limits, float)
    if bound.shape != (n, 2) or not np.all(bound[:, 0] <= bound[:, 1]):
        raise ArgumentError(f"are {bound.tolist()}; expected ({n}, 2), lower and upper limits", "limits")
    return bound


def _solved(
    chain: Chain, T: np.ndarray, R: np.ndarray | None, limits: np.ndarray | None, near: np.ndarray | None,
    redundancy: LockedJoint | ElbowAngle | None,
) -> Postures:  # fmt: skip
    if isinstance(redundancy, LockedJoint):
        j = redundancy.joint % len(chain) if -len(chain) <= redundancy.joint < len(chain) else redundancy.joint
        rest = np.arange(len(chain)) != j
        made = _solved(
            chain.locked(j, redundancy.value), T, R, None if limits is None else limits[rest],
            None if near is None else near[:, rest], None,
        )  # fmt: skip
        q = np.insert(made.q, j, redundancy.value, axis=2)
        q[np.isnan(made.q).any(axis=2)] = np.nan
        return replace(made, q=q, revolute=chain.revolute)
    if isinstance(redundancy, ElbowAngle):
        if R is None:
            raise ArgumentError("is missing; an elbow angle needs the whole pose", "R")
        q, names, complete = elbow_postures(chain, T, R, redundancy)
        return _judged(chain, q, names, complete, "the elbow's angle", oriented=True)
    form = closed_form(chain, oriented=R is not None)
    if form is not None:
        return _by_closed_form(form, T, R)
    quartic = QuarticArm.of(chain, oriented=R is not None)
    if quartic is not None:
        q = _distinct(chain, _within_pi(chain, quartic.postures(chain, T, R)))
        return _judged(chain, q, (), True, "quartic", oriented=R is not None)
    if len(chain) == 6 and all(chain.revolute) and R is not None:
        return _by_elimination(chain, T, R)
    return _by_iteration(chain, T, R, limits, near)


def _by_closed_form(form: ClosedForm, T: np.ndarray, R: np.ndarray | None) -> Postures:
    q, exists, pivot = form.values(T, R)
    m, k, _ = q.shape
    if form.near:  # next to singular positions more steps are needed, and two branches may lead to one posture
        flat, off = _polished(form.chain, T, R, np.where(np.isfinite(q), q, 0.0))
        q = np.where((off < SOLVED)[..., None], flat, np.nan)
        return _judged(form.chain, _distinct(form.chain, q), form.names, True, form.structure, oriented=R is not None)
    status = np.where(exists, np.where(pivot < SINGULAR, Status.SINGULAR, Status.OK), Status.OUT_OF_RANGE)
    branch = np.tile(np.arange(k), (m, 1))
    return Postures(
        np.where(exists[..., None], q, np.nan), status.astype(int), branch, np.zeros((m, k), bool), form.names, True,
        form.structure, form.chain.revolute,
    )  # fmt: skip


def _by_elimination(chain: Chain, T: np.ndarray, R: np.ndarray) -> Postures:
    arm = GeneralArm(chain)
    more = nearest_starts(chain, T, R, AT_ONCE if arm.structured else 0)
    starts_of = [np.concatenate([arm.candidates(t, r), start]) for t, r, start in zip(T, R, more, strict=True)]
    of = np.repeat(np.arange(len(T)), [len(q) for q in starts_of])
    q, off = polished(chain, T[of], R[of], np.concatenate(starts_of))
    q = np.where((off < SOLVED)[:, None], _within_pi(chain, q), np.nan)
    rows = [_distinct(chain, q[None, of == k])[0] for k in range(len(T))]
    return _judged(chain, _stacked(rows, len(chain)), (), not arm.structured, "elimination", oriented=True)


def _by_iteration(
    chain: Chain, T: np.ndarray, R: np.ndarray | None, limits: np.ndarray | None, near: np.ndarray | None
) -> Postures:
    m, n = len(T), len(chain)
    tried = starts(chain, ROUNDS * AT_ONCE, limits)
    first = nearest_starts(chain, T, R, AT_ONCE, limits)
    if near is not None:
        first = np.concatenate([near[:, None], first[:, :-1]], axis=1)
    q = np.full((m, 0, n), np.nan)
    redundant = n > (3 if R is None else 6)
    for k in range(ROUNDS + 1):
        if limits is None:
            inside = np.asarray(np.isfinite(q).all(axis=2))
        else:
            excess = _turned(chain.revolute, q, limits, None)[1]
            inside = np.asarray(np.isfinite(q).all(axis=2) & (excess == 0).all(axis=2))
        # isolated postures: two rounds for all, further ones where none is within limits
        open_ = np.flatnonzero(~inside.any(axis=1) if redundant or k > 1 else np.ones(m, bool))
        if not len(open_):
            break
        start = first[open_] if k == 0 else np.tile(tried[(k - 1) * AT_ONCE : k * AT_ONCE], (len(open_), 1, 1))
        new, off = _polished(chain, T[open_], None if R is None else R[open_], start)
        more = np.full((m, AT_ONCE, n), np.nan)
        more[open_] = np.where((off < SOLVED)[..., None], _within_pi(chain, new), np.nan)
        q = _distinct(chain, np.concatenate([q, more], axis=1))
    kept = _stacked([row[np.isfinite(row).all(axis=1)][:KEPT] for row in q], n)
    made = _judged(chain, kept, (), False, "iteration", oriented=R is not None)
    status = np.where(made.exists, made.status, Status.NOT_CONVERGED)
    return replace(made, status=status)


def _polished(chain: Chain, T: np.ndarray, R: np.ndarray | None, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return joint coordinates (m, k, n) after damped steps, and the pose error (m, k)."""
    m, k, n = q.shape
    of = None if R is None else np.repeat(R, k, axis=0)
    flat, off = polished(chain, np.repeat(T, k, axis=0), of, q.reshape(-1, n))
    return _within_pi(chain, flat).reshape(m, k, n), off.reshape(m, k)


def _judged(
    chain: Chain, q: np.ndarray, names: tuple[str, ...], complete: bool, method: str, oriented: bool
) -> Postures:
    """Return postures with the status by the smallest singular value of the Jacobian."""
    exists = np.isfinite(q).all(axis=2)
    status = np.full(exists.shape, int(Status.OUT_OF_RANGE))
    if exists.any():
        J = jacobian(chain, q[exists], oriented)
        smallest = np.linalg.svd(J, compute_uv=False)[:, -1]
        status[exists] = np.where(smallest < SINGULAR, Status.SINGULAR, Status.OK)
    branch = np.tile(np.arange(q.shape[1]), (len(q), 1))
    return Postures(q, status, branch, np.zeros(exists.shape, bool), names, complete, method, chain.revolute)


def _within_pi(chain: Chain, q: np.ndarray) -> np.ndarray:
    return np.where(chain.revolute, within_pi(q), q)


def _distinct(chain: Chain, q: np.ndarray) -> np.ndarray:
    """Return postures (m, k, n) without those that are the same as an earlier one of their pose."""
    scale = np.where(chain.revolute, 1.0, chain.size)
    q = q.copy()
    for k in range(1, q.shape[1]):
        apart = np.abs(_within_pi(chain, q[:, :k] - q[:, k : k + 1]) / scale).max(axis=2)
        q[(apart < SAME).any(axis=1), k] = np.nan
    return q


def _stacked(rows: list[np.ndarray], n: int) -> np.ndarray:
    """Return rows of different lengths as one array, the missing ones NaN."""
    rows = [row[np.isfinite(row).all(axis=1)] for row in rows]
    q = np.full((len(rows), max([1, *map(len, rows)]), n), np.nan)
    for k, row in enumerate(rows):
        q[k, : len(row)] = row
    return q


def _turned(
    revolute: tuple[bool, ...], q: np.ndarray, limits: np.ndarray | None, near: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return postures with whole turns next to `near` and into limits, and by how much they exceed them."""
    turn = np.where(revolute, 2 * np.pi, 0.0)
    low, high = (np.full(len(turn), x) for x in (-np.inf, np.inf)) if limits is None else limits.T
    middle = np.zeros((len(q), len(turn))) if near is None else near
    if near is None:
        both = np.isfinite(low) & np.isfinite(high)
        middle = np.broadcast_to(
            np.where(both, (np.where(both, low, 0) + np.where(both, high, 0)) / 2, 0), middle.shape
        )
    count = np.where(turn > 0, np.round((middle[:, None] - q) / np.where(turn > 0, turn, 1.0)), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.where(turn > 0, np.ceil((low - ON_LIMIT - q) / turn), 0.0)
        most = np.where(turn > 0, np.floor((high + ON_LIMIT - q) / turn), 0.0)
        turned = q + turn * np.clip(count, least, np.maximum(least, most))
        # beyond both limits: the turn that exceeds them less
        other = turned - turn
        turned = np.where((turned > high + ON_LIMIT) & (low - other < turned - high), other, turned)
        above, below = turned > high + ON_LIMIT, turned < low - ON_LIMIT
        excess = np.where(above, turned - high, np.where(below, turned - low, 0.0))
    return turned, excess


def _sorted(made: Postures, near: np.ndarray) -> Postures:
    distance = np.linalg.norm(made.q - near[:, None], axis=2)
    order = np.argsort(np.where(np.isnan(distance), np.inf, distance), axis=1, kind="stable")
    taken: dict[str, Any] = {
        name: np.take_along_axis(getattr(made, name), order, axis=1) for name in ("status", "branch", "beyond")
    }
    return replace(made, q=np.take_along_axis(made.q, order[..., None], axis=1), **taken)
