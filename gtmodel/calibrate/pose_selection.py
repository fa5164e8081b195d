"""Candidate poses (a grid that the robot reaches and the device sees), and selection: exchange for D-, E- and
I-optimality, and removal by the condition number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np

from ..kinematics.workspace import REACHABLE, Grid, Reach, map_grid
from ..lang.source import ModelError
from ..workers.mapped import mapped
from .pose_information import PoseInformation

# directions of the neighbours of a point: to the faces, edges and corners of a cube
_AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], float) - 1
AROUND = _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)
# neighbours per call; the overhead of a call equals some hundred of them
AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Candidates:
    """Points of a grid (N, 3) [m], and which passed each of the `stages`: name -> (N,), each a subset of the former.

    `complete`: False if stopped.
    """

    T: np.ndarray
    stages: dict[str, np.ndarray]
    complete: bool = True

    @property
    def chosen(self) -> np.ndarray:
        """Points (n, 3) [m] that passed all stages."""
        return self.T[next(reversed(self.stages.values()))]

    @property
    def counts(self) -> dict[str, int]:
        """Number of points by stage."""
        return {name: int(np.count_nonzero(m)) for name, m in self.stages.items()}


def candidates(
    grid: Grid,
    stages: dict[str, Reach],
    safety: float = 0.0,
    *,
    stop: Callable[[str, float], bool] | None = None,
) -> Candidates:
    """Return the points of a grid that pass all stages in order, such as workspace, obstacles, device.

    `safety` [m]: distance from the edge of the last stage; a point is kept if its neighbours at that distance in 26
    directions are all within the last stage (Dressler 2012, section 5.6). `stop(stage, fraction)`: True ends with the
    results so far. Raises ModelError for a negative distance.

    >>> from gtmodel.kinematics.mechanism import mechanism_of
    >>> from gtmodel.kinematics.workspace import CartesianBox, Reach
    >>> inverse = mechanism_of(gt.robots.gantry_tau("l1_tape")).inverse
    >>> reach = Reach(inverse, [CartesianBox(np.array([0.0, -1.0, 0.2]), np.array([1.0, 0.0, 0.8]))])
    >>> grid = gt.calibrate.regular_grid(np.array([0.0, -1.0, 0.2]), np.array([1.0, 0.0, 0.8]), volume=0.6, number=200)
    >>> found = gt.calibrate.candidates(grid, {"workspace": reach}, safety=0.1)
    >>> found.counts["workspace"] > found.counts["safety distance"] == len(found.chosen)
    True
    """
    if not safety >= 0:
        raise ModelError(f"the safety distance is {safety:g} m; it must not be negative")
    T = grid.points()
    passed = np.ones(len(T), bool)
    masks: dict[str, np.ndarray] = {}

    def progress_of(stage: str) -> Callable[[float], bool]:
        return lambda fraction: stop is not None and stop(stage, fraction)

    for name, reach in stages.items():
        m = map_grid(reach, grid, progress=progress_of(name))
        passed = passed & (m.codes.reshape(-1) == REACHABLE)
        masks[name] = passed
        if not m.complete or (stop is not None and stop(name, 1.0)):
            return Candidates(T, masks, complete=False)
    if safety > 0 and stages:
        masks["safety distance"] = _all_around(next(reversed(stages.values())), T, passed, safety)
    return Candidates(T, masks)


def _all_around(reach: Reach, T: np.ndarray, points: np.ndarray, distance: float) -> np.ndarray:
    """Which of the remaining points have all their neighbours at a distance [m] within reach.

    Few points are checked in several directions per call, many in one direction after the other: a point that fails in
    one direction costs nothing in the next.
    """
    within = points.copy()
    begin = 0
    while begin < len(AROUND) and within.any():
        indices = np.flatnonzero(within)
        directions = AROUND[begin : begin + max(1, AT_ONCE // len(indices))]
        begin += len(directions)
        neighbours = T[indices] + distance * directions[:, None]
        within[indices] = np.all(reach.inside(neighbours.reshape(-1, 3)).reshape(len(directions), -1), axis=0)
    return within


def regular_grid(low: np.ndarray, high: np.ndarray, volume: float, number: int) -> Grid:
    """Return a grid centred in the box low..high (3,) [m] with about `number` points per `volume` [m3] inside it.

    The grid constant is (volume / number)^(1/3) (Dressler 2012, section 5.6). Raises ModelError unless volume and
    number are positive.

    >>> grid = gt.calibrate.regular_grid(np.zeros(3), np.array([1.0, 1.0, 0.5]), volume=0.5, number=32)
    >>> grid.points().shape, round(float(grid.coordinates[0][1] - grid.coordinates[0][0]), 3)  # m
    ((75, 3), 0.25)
    """
    if not volume > 0 or number < 1:
        raise ModelError(f"no grid has {number} poses in a volume of {volume:g} m3; both must be positive")
    step = (volume / number) ** (1 / 3)
    coordinates = []
    for a, b in zip(low, high, strict=True):
        count = int((b - a) / step) + 1
        coordinates.append((a + b) / 2 + step * (np.arange(count) - (count - 1) / 2))
    return Grid(np.zeros(3), np.eye(3), tuple(coordinates))


Criterion = Literal["D", "E", "I"]
CRITERIA = get_args(Criterion)
GAIN = 1e-4  # relative decrease of the score for which a pose is exchanged
SWEEPS = 50
SHORT_LIST = 24  # candidates fully evaluated for E: those that see the weakest combination best
# of the mean information of a pose; keeps the information of a few poses invertible
RIDGE = 1e-10


@dataclass(frozen=True, eq=False)
class Selection:
    """Selected poses, `indices` ascending (repeated if chosen twice), and the minimised `score`.

    For the information I of r combinations: "D" det(I)^(-1/r), "E" 1 / its smallest eigenvalue, "I" the mean square
    error over the workspace [m2], "condition" the condition number.

    `starts`: the final score of each random start. `complete`: False if stopped early.
    """

    indices: np.ndarray
    criterion: str
    score: float
    starts: tuple[float, ...] = ()
    complete: bool = True

    def __len__(self) -> int:
        return len(self.indices)


def exchange(
    info: PoseInformation,
    number: int,
    criterion: Criterion = "I",
    moment: np.ndarray | None = None,
    *,
    repeats: int = 2,
    starts: int = 3,
    seed: int = 0,
    stop: Callable[[float], bool] | None = None,
) -> Selection:
    """Select `number` poses: swap one pose for the best candidate while the score decreases by over 1e-4 of itself.

    Each pose may be chosen up to `repeats` times: far corners contribute most, and a repeated pose reveals drift. "D":
    determinant of the information; "E": its smallest eigenvalue; "I": trace(information^-1 moment), the mean square
    error of the tool centre point, with `moment` from Positioning.moment(). The best of `starts` random starts; the
    same seed gives the same poses. `stop(fraction)`: called before each sweep; True ends with the best so far.

    Raises ModelError for an unknown criterion, if `number` exceeds the candidates, or if it is too small to determine
    the unknowns.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> moment = gt.calibrate.positioning(problem).moment(info)
    >>> chosen = gt.calibrate.exchange(info, 9, "I", moment)
    >>> len(chosen), bool(chosen.score < gt.calibrate.exchange(info, 8, "I", moment).score)
    (9, True)
    """
    require_enough(info, number)
    if criterion not in CRITERIA:
        raise ModelError(f"there is no criterion '{criterion}'; choose one of: {', '.join(CRITERIA)}")
    if criterion == "I" and moment is None:
        raise ModelError('the criterion "I" needs the moment of the positioning errors, Positioning.moment()')
    rows = info.reduced
    ridge = RIDGE * float(np.mean(rows**2)) * rows.shape[1] * np.eye(info.rank)
    constant = info.priors @ info.basis
    score = _Score(criterion, rows, np.zeros_like(ridge) if moment is None else moment)
    best, scores, complete = np.zeros(0, int), list[float](), True
    exchanged = partial(_exchanged, number, constant.T @ constant + ridge, score, repeats)

    def stopped() -> bool:
        return stop is not None and bool(scores) and stop(len(scores) / starts)

    def here(item: tuple[int, np.random.SeedSequence]) -> tuple[np.ndarray, bool]:
        k = item[0]
        return exchanged(item, lambda sweep: stop is not None and bool(k or sweep) and stop((k + sweep) / starts))

    seeds = enumerate(np.random.SeedSequence(seed).spawn(starts))
    for chosen, complete in mapped(exchanged, seeds, here=here, waiting=stopped):
        scores.append(score.of(info.matrix(chosen) + ridge))
        if scores[-1] <= min(scores):
            best = np.sort(chosen)
        if not complete:
            break
    return Selection(best, criterion, min(scores), tuple(scores), complete and len(scores) == starts)


def _exchanged(
    number: int, constant: np.ndarray, score: _Score, repeats: int, start: tuple[int, np.random.SeedSequence],
    stop: Callable[[float], bool] = lambda _: False,
) -> tuple[np.ndarray, bool]:  # fmt: skip
    """Exchange from one random start; return the chosen poses, and False if `stop`, called with the share of the start
    that is done, ended it."""
    chosen = np.random.default_rng(start[1]).permutation(len(score.rows))[:number]
    for sweep in range(SWEEPS):
        if stop(sweep / (sweep + 3)):
            return chosen, False
        if not _swept(chosen, score.rows, constant, score, repeats):
            break
    return chosen, True


def condition_removal(
    info: PoseInformation, number: int, *, one_by_one: bool = False, stop: Callable[[float], bool] | None = None
) -> Selection:
    """Select the `number` poses whose removal makes the condition number worst (Dressler 2012, eq. (5.9)).

    C_k is the condition number of the Jacobian without pose k, in units of the expected errors; poses with the largest
    C_k stay. `one_by_one`: all C_k are computed anew after each removal. `stop(fraction)`: True ends with more poses
    than `number`. Raises ModelError as exchange().

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> at_once = gt.calibrate.condition_removal(info, 12)
    >>> bool(gt.calibrate.condition_removal(info, 12, one_by_one=True).score <= at_once.score)
    True
    """
    require_enough(info, number)
    rows = info.reduced
    remaining = np.arange(len(info))
    total = info.matrix()
    complete = True
    while len(remaining) > number:
        selected = rows[remaining]
        without = _conditions(total - selected.transpose(0, 2, 1) @ selected)
        order = np.argsort(without, kind="stable")
        removed = order[:1] if one_by_one else order[: len(remaining) - number]
        total = total - np.einsum("kij,kil->jl", selected[removed], selected[removed])
        remaining = np.delete(remaining, removed)
        if stop is not None and stop((len(info) - len(remaining)) / (len(info) - number)) and len(remaining) > number:
            complete = False
            break
    return Selection(remaining, "condition", float(_conditions(info.matrix(remaining)[None])[0]), (), complete)


def spread(info: PoseInformation, number: int) -> Selection:
    """Select `number` poses evenly in their order; for a grid, where neighbours are adjacent, this is a coarser grid.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> gt.calibrate.spread(info, 9).indices
    array([ 0, 3, 6, 10, 13, 16, 20, 23, 26])
    """
    require_enough(info, number)
    return Selection(np.round(np.linspace(0, len(info) - 1, number)).astype(int), "grid", np.nan)


class _Score:
    """Scores (smaller is better) of an information matrix, and of one with each candidate's rows added."""

    def __init__(self, criterion: str, rows: np.ndarray, moment: np.ndarray) -> None:
        self.criterion, self.rows, self.moment = criterion, rows, moment
        self.grams = rows.transpose(0, 2, 1) @ rows if criterion == "E" else None

    def of(self, information: np.ndarray) -> float:
        if self.criterion == "D":
            return float(np.exp(-np.linalg.slogdet(information)[1] / len(information)))
        if self.criterion == "E":
            least = float(np.linalg.eigvalsh(information)[0])
            return 1 / least if least > 0 else np.inf
        return float(np.trace(np.linalg.solve(information, self.moment)))

    def each(self, base: np.ndarray) -> np.ndarray:
        """Scores (N,) of base with the rows of each candidate."""
        rows = self.rows
        if self.grams is not None:
            weakest = np.linalg.eigh(base)[1][:, 0]
            short = np.argsort(-np.sum((rows @ weakest) ** 2, axis=1), kind="stable")[:SHORT_LIST]
            scores = np.full(len(rows), np.inf)
            least = np.linalg.eigvalsh(base + self.grams[short])[:, 0]
            scores[short] = 1 / np.maximum(least, 1e-300)
            return scores
        C = np.linalg.inv(base)
        RC = rows @ C
        capacity = np.eye(rows.shape[1]) + RC @ rows.transpose(0, 2, 1)
        if self.criterion == "D":
            return np.exp(-(np.linalg.slogdet(base)[1] + np.linalg.slogdet(capacity)[1]) / len(base))
        gained = RC @ self.moment @ RC.transpose(0, 2, 1)
        return np.trace(C @ self.moment) - np.trace(np.linalg.solve(capacity, gained), axis1=1, axis2=2)


def _swept(chosen: np.ndarray, rows: np.ndarray, constant: np.ndarray, score: _Score, repeats: int) -> bool:
    """One pass over the chosen poses, changed in place; returns whether any was exchanged."""
    exchanged = False
    for k in range(len(chosen)):
        others = rows[np.delete(chosen, k)].reshape(-1, rows.shape[2])
        each = score.each(others.T @ others + constant)
        now = each[chosen[k]]
        if not np.isfinite(now):  # E: not on the short list
            selected = rows[chosen].reshape(-1, rows.shape[2])
            now = score.of(selected.T @ selected + constant)
        each[np.bincount(np.delete(chosen, k), minlength=len(rows)) >= repeats] = np.inf
        j = int(np.argmin(each))
        if each[j] < (1 - GAIN) * now:
            chosen[k], exchanged = j, True
    return exchanged


def _conditions(information: np.ndarray) -> np.ndarray:
    """Condition numbers (k,) of Jacobians with this information (k, r, r)."""
    values = np.linalg.eigvalsh(information)
    with np.errstate(divide="ignore"):
        return np.sqrt(values[:, -1] / np.maximum(values[:, 0], 0.0))


def require_enough(info: PoseInformation, number: int) -> None:
    """Raise ModelError if `number` exceeds the candidates, or is too small to determine the unknowns."""
    if not 1 <= number <= len(info):
        raise ModelError(f"cannot select {number} poses from {len(info)} candidates; choose 1 to {len(info)}")
    prior = int(np.linalg.matrix_rank(info.priors)) if len(info.priors) else 0
    if number * info.rows.shape[1] + prior < info.rank:
        least = -(-(info.rank - prior) // info.rows.shape[1])
        raise ModelError(
            f"{number} poses with {info.rows.shape[1]} equations each cannot determine {info.rank} combinations; "
            f"use at least {least}"
        )
