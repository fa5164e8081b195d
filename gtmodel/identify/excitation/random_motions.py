"""Random feasible excitation: the baseline that an optimised one is measured against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...linear.roots import bisected
from ...results import ArgumentError
from .basis import Array
from .optimise import FINER
from .sampled import ExcitationTask

HALVINGS = 14  # of the interval of the amplitude: found to 1e-4 of itself
LARGEST = 1.0  # amplitude that a draw begins with, in the coordinate's unit; halved until it fits
DRAWS_PER_HIT = 20  # draws that may fail for each one asked for


def random_excitations(
    task: ExcitationTask,
    centre: tuple[Array, Array],
    count: int,
    seed: int,
    progress: Callable[[float], bool] | None = None,
) -> list[Array]:
    """Unknowns c (size, d) of `count` random motions that keep all limits, each as large as they let it be.

    A draw takes the place to stand at, uniform within the box `centre`, and a normal weight for every other unknown;
    the weights are then scaled up, by bisection, to the largest amplitude that keeps every row on the fine grid. Draws
    whose place itself breaks a limit are dropped. Same seed, same motions.

    `centre` is (low, high), each (d,). `progress` is called with the fraction done; True stops, keeping what there is.
    Raises ArgumentError where hardly any draw is feasible.

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
    kept: list[Array] = []
    for _ in range(DRAWS_PER_HIT * count):
        place = np.outer(task.basis.still(), rng.uniform(*centre))
        swing = rng.normal(size=place.shape)
        if np.all(task.excess(place, coarse[:1]) <= 0):
            kept.append(_largest(task, place, swing, coarse, fine))
        if len(kept) == count or (progress is not None and progress(len(kept) / count)):
            return kept
    raise ArgumentError(
        f"only {len(kept)} of {DRAWS_PER_HIT * count} places drawn keep all limits; draw them within a smaller box"
    )


def _largest(task: ExcitationTask, place: Array, swing: Array, coarse: Array, fine: Array) -> Array:
    """The largest feasible place + amplitude * swing."""
    low, _ = bisected(
        lambda amplitude: np.all(task.excess(place + amplitude * swing, coarse) <= 0), 0.0, LARGEST, HALVINGS
    )
    while np.any(task.excess(place + low * swing, fine) > 0):  # between the samples: some 1 % at most
        low *= 0.995
    return place + low * swing
