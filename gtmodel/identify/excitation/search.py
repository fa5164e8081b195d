"""Search for the motion that identifies the parameters of a regressor best within limits, and random feasible motions,
its baseline."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...linear.roots import bisected
from ...optimize.watch import Progress
from ...results import ArgumentError, SolveStatus
from .basis import Array
from .interior_point import interior_point
from .task import ExcitationTask

FINER = 20  # times as many samples when limits are checked again
TIGHTENINGS = 8  # and repetitions with a smaller barrier
RESERVE = 2e-4  # relative to a row's size: the search satisfies its rows to 1e-4
BEYOND = 1.1  # times the violation found between the samples
FARTHEST = 0.05  # relative to a row's size: largest increase of a reserve
BARRIER, WARM_BARRIER = 0.1, 1e-3  # of a search from the start, and of a warm start from the previous result
SMALLER, LEAST_FIRST = 0.03, 1e-4  # a failed search is repeated with a smaller barrier
SHARES = (0.99, 0.97, 0.9, 0.75, 0.5)


@dataclass(frozen=True, eq=False)
class Excitation:
    """The optimised motion: unknowns `c` (size, d) of the basis, and how the search ended.

    `objective` is the logarithmic cost of the criterion, `seconds` the duration of the search. `excess` (m,) is the
    violation of each row, relative to its size, on a grid FINER times as fine as in the optimisation; satisfied if <=
    0.
    """

    status: SolveStatus
    message: str
    objective: float
    iterations: int
    c: Array
    excess: Array
    seconds: float

    @property
    def feasible(self) -> bool:
        """Whether every row is satisfied on the fine grid."""
        return bool(np.all(self.excess <= 0))


def optimise_excitation(
    task: ExcitationTask,
    start: Array,
    *,
    max_iterations: int = 400,
    tolerance: float = 1e-4,
    max_seconds: float | None = None,
    progress: Progress | None = None,
) -> Excitation:
    """Find a locally optimal motion from a start by an interior-point method.

    The criteria have many local minima, whose condition numbers differ by 5 to 30 per cent. The start decides which one
    is found, so try several starts.

    Args:
        task: coordinates, limits and criterion.
        start: unknowns c (size, d), which should satisfy the limits: a random feasible motion.
        max_iterations: of all tightenings together.
        tolerance: of the logarithmic cost, see `interior_point`.
        max_seconds: time limit; the search then returns its best motion.
        progress: called with (iteration, cost, violation); True stops, keeping the best iterate.

    The result is never worse than the start: if the search finds no better motion within all limits, it returns the
    start and says so in the message.

    >>> import casadi as ca
    >>> x, v, a = (ca.SX.sym(name) for name in "xva")  # a pendulum m x'' + d x' + c sin x
    >>> task = gt.identify.ExcitationTask(
    ...     basis=gt.identify.FourierSeries(period=4.0, harmonics=3),
    ...     rows=ca.Function("rows", [x, v, a], [ca.vertcat(x, v)]),
    ...     low=np.array([-1.0, -2.0]),
    ...     high=np.array([1.0, 2.0]),
    ...     regressor=ca.Function("Y", [x, v, a], [ca.horzcat(a, v, ca.sin(x))]),
    ...     nominal=np.array([2.0, 1.0, 5.0]),
    ... )
    >>> (start,) = gt.identify.random_excitations(task, (np.array([-0.5]), np.array([0.5])), 1, seed=1)
    >>> best = gt.identify.optimise_excitation(task, start)
    >>> before, after = (gt.identify.condition(task.stacked(c, task.times()), task.nominal) for c in (start, best.c))
    >>> best.status.ok, best.feasible, after < before
    (True, True, True)
    """
    begin = time.perf_counter()
    sampled, fine = task.sampled, task.times(FINER)
    x, reserve, barrier = start.reshape(-1, order="F"), np.full(len(task.low), RESERVE), BARRIER
    best, best_cost, iterations = start, sampled.cost(x), 0
    status, message = SolveStatus.FAILED, ""
    for _ in range(TIGHTENINGS):
        seconds_left = None if max_seconds is None else max(0.0, max_seconds - (time.perf_counter() - begin))
        iterations_left = max(0, max_iterations - iterations)
        run = interior_point(
            sampled.within(reserve), x, tolerance=tolerance, max_iterations=iterations_left, max_seconds=seconds_left,
            progress=progress, barrier=barrier,
        )  # fmt: skip
        iterations += run.iterations
        status, message = run.status, run.message
        if status is SolveStatus.FAILED and barrier > LEAST_FIRST:
            # a large barrier draws motions away from all rows, but a ratio, such as the condition number, may not
            # balance it at any finite motion. A small barrier stays near x
            barrier *= SMALLER
            continue
        x, barrier = run.x, WARM_BARRIER
        c = x.reshape(start.shape, order="F")
        over = task.excess(c, fine)
        for share in SHARES if np.any(over > 0) else (1.0,):  # of the way from the feasible start
            nearer = start + share * (c - start)
            value = sampled.cost(nearer.reshape(-1, order="F"))
            if value < best_cost and np.all(task.excess(nearer, fine) <= 0):
                best, best_cost = nearer, value
                break
        if np.all(over <= 0) or status is SolveStatus.INTERRUPTED or iterations >= max_iterations:
            break
        reserve = reserve + np.where(over > 0, np.minimum(BEYOND * over, FARTHEST) + RESERVE, 0.0)
        if np.any(over > FARTHEST):  # leaves the workspace between two samples: no point to continue from
            x, barrier = best.reshape(-1, order="F"), BARRIER
    if best is start:
        message += "; no motion better than the start satisfies all limits, so the start is returned"
    seconds = time.perf_counter() - begin
    return Excitation(status, message, best_cost, iterations, best, task.excess(best, fine), seconds)


HALVINGS = 14  # of the interval of the amplitude, for a relative error of 1e-4
LARGEST = 1.0  # initial amplitude of a draw, in the unit of the coordinate; halved until feasible
DRAWS_PER_HIT = 20  # draws allowed per requested motion


def random_excitations(
    task: ExcitationTask,
    centre: tuple[Array, Array],
    count: int,
    seed: int,
    progress: Callable[[float], bool] | None = None,
) -> list[Array]:
    """Return unknowns c (size, d) of `count` random motions, each with the largest amplitude that satisfies all limits.

    A draw takes a rest position, uniform within the box `centre`, and normal weights for all other unknowns. Bisection
    then scales the weights to the largest amplitude that satisfies every row on the fine grid. Draws whose rest
    position violates a limit are discarded. The same seed gives the same motions.

    `centre` is (low, high), each (d,). `progress` is called with the fraction done; True stops and keeps the motions so
    far. Raises ArgumentError if hardly any draw is feasible.

    >>> import casadi as ca
    >>> x, v, a = (ca.SX.sym(name) for name in "xva")  # a pendulum m x'' + d x' + c sin x
    >>> task = gt.identify.ExcitationTask(
    ...     basis=gt.identify.FourierSeries(period=4.0, harmonics=3),
    ...     rows=ca.Function("rows", [x, v, a], [ca.vertcat(x, v)]),
    ...     low=np.array([-1.0, -2.0]),
    ...     high=np.array([1.0, 2.0]),
    ...     regressor=ca.Function("Y", [x, v, a], [ca.horzcat(a, v, ca.sin(x))]),
    ...     nominal=np.array([2.0, 1.0, 5.0]),
    ... )
    >>> draws = gt.identify.random_excitations(task, (np.array([-0.5]), np.array([0.5])), 3, seed=1)
    >>> len(draws), all(task.excess(c, task.times()).max() <= 0 for c in draws)
    (3, True)
    """
    rng = np.random.default_rng(seed)
    coarse, fine = task.times(), task.times(FINER)
    motions: list[Array] = []
    for _ in range(DRAWS_PER_HIT * count):
        place = np.outer(task.basis.still(), rng.uniform(*centre))
        swing = rng.normal(size=place.shape)
        if np.all(task.excess(place, coarse[:1]) <= 0):
            motions.append(_largest(task, place, swing, coarse, fine))
        if len(motions) == count or (progress is not None and progress(len(motions) / count)):
            return motions
    raise ArgumentError(
        f"only {len(motions)} of {DRAWS_PER_HIT * count} drawn rest positions satisfy all limits; use a smaller box"
    )


def _largest(task: ExcitationTask, place: Array, swing: Array, coarse: Array, fine: Array) -> Array:
    """The largest feasible place + amplitude * swing."""
    low, _ = bisected(
        lambda amplitude: np.all(task.excess(place + amplitude * swing, coarse) <= 0), 0.0, LARGEST, HALVINGS
    )
    while np.any(task.excess(place + low * swing, fine) > 0):  # violations between the samples: at most 1 % or so
        low *= 0.995
    return place + low * swing
