"""The excitation study: the motion from which a robot's masses and friction are identified best, within all limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...inference import Coverage, coverage, linear_fits
from ...lang import Model
from ...motion.options import Limits
from ...results import ArgumentError, SolveStatus, Work, naming
from ...results.door import study_function
from ...results.work import Progress, never, silent
from .excitation_result import ExcitationMotions, study_of_motion
from .excited import ExcitationStudy
from .information import condition
from .optimise import FINER, optimise_excitation
from .options import ExcitationSearch, Family, IdentificationExperiment, MonteCarloFits, RandomMotions
from .random_motions import random_excitations
from .task import ExcitationPlan, plan_of

Array = np.ndarray

FITS_AT_ONCE = 50  # synthetic identifications between two looks at the clock


@study_function
def excitation_study(
    robot: Model,
    motion: Family,
    limits: Limits,
    *,
    experiment: IdentificationExperiment | None = None,
    search: ExcitationSearch | None = None,
    random: RandomMotions | None = None,
    monte_carlo: MonteCarloFits | None = None,
    start: Array | None = None,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> ExcitationStudy:
    """The motion for an identification: draw random ones, optimise from the best of them, and compare.

    Args:
        robot: declares its tool centre point T, carts q and forces tau as vectors of 3; a parameter `velocity_scale` of
            its friction is set by the study.
        motion: the family that is searched.
        limits: what the motion keeps.
        experiment: what is identified, noise, sample time.
        search: criterion, starts and iterations.
        random: the motions to compare with.
        monte_carlo: synthetic identifications along both; none if left out.
        start: (size, 3) unknowns of an earlier study, a further start.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Interrupted, it holds the best motion so far, which keeps all limits. Raises ArgumentError for a robot of another
    kind, for limits that hardly any random motion keeps, and for a start that does not fit or breaks a limit.

    >>> motion = gt.identify.Family(
    ...     period=2.0, harmonics=2, place_low=[0.9, -0.9, 0.4], place_high=[1.1, -0.7, 0.6]
    ... )
    >>> limits = gt.motion.Limits(force=700.0, tcp_low=[0.5, -1.1, 0.2], tcp_high=[1.5, -0.5, 0.8])
    >>> masses = gt.identify.IdentificationExperiment(identified=["m_p", "m_c"])
    >>> two = gt.identify.RandomMotions(draws=2)
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = gt.identify.excitation_study(robot, motion, limits, experiment=masses, random=two)
    >>> bool(s.improvement > 1)  # condition number of the best random motion over the optimised one
    True
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    search, title = search or ExcitationSearch(), title or "excitation"
    plan = plan_of(robot, motion, limits, experiment or IdentificationExperiment(), search.criterion)
    started = [] if start is None else [_started(plan, np.asarray(start, dtype=float))]
    draws = _draws(plan, random or RandomMotions(), work)
    if not draws:
        return ExcitationStudy(
            status=SolveStatus.INTERRUPTED, title=title, message="stopped before the first random motion was drawn"
        )
    nominal, times = plan.regressor.nominal, plan.times[:-1]
    stacks = [plan.task.stacked(c, times, plan.sharp) for c in draws]
    conditions = np.array([condition(W, nominal) for W in stacks])
    order = np.argsort(conditions, kind="stable")
    starts = [*started, *(draws[k] for k in order[: search.starts])]
    runs = [
        optimise_excitation(
            plan.task,
            c,
            max_iterations=search.max_iterations,
            max_seconds=work.seconds_left(),
            progress=work.iterations(f"optimising, start {n} of {len(starts)}"),
        )
        for n, c in enumerate(starts, 1)
    ]
    best = min(runs, key=lambda e: e.objective)
    first = int(order[0])
    W = plan.task.stacked(best.c, times, plan.sharp)
    fits = [_monte_carlo(plan, monte_carlo or MonteCarloFits(), work, A) for A in (W, stacks[first])]
    seen = [fit for fit in fits if fit is not None]
    return study_of_motion(
        plan, search, title, ExcitationMotions(best, W, draws[first], stacks[first], conditions, seen), runs
    )


def _started(plan: ExcitationPlan, given: Array) -> Array:
    """The unknowns of an earlier result, which keep these limits. Raises ArgumentError."""
    shape = (plan.task.basis.size, plan.task.dimension)
    if given.shape != shape:
        raise ArgumentError(f"its unknowns have the shape {given.shape}; this problem's have {shape}", "start")
    if np.any(plan.task.excess(given, plan.task.times(FINER)) > 0):
        raise ArgumentError("its motion breaks a limit of this problem; leave it out", "start")
    return given


def _draws(plan: ExcitationPlan, random: RandomMotions, work: Work) -> list[Array]:
    def progress(done: float) -> bool:
        work.progress("random motions", done)
        return work.interrupted()

    with naming("motion.place_low", ValueError):
        return random_excitations(plan.task, plan.centre, random.draws, random.seed, progress)


def _monte_carlo(plan: ExcitationPlan, keys: MonteCarloFits, work: Work, W: Array) -> tuple[Coverage, Array] | None:
    """Fits of synthetic forces along a motion: hits of their intervals, and how they scatter (p,); None: not wanted."""
    regressor, experiment = plan.regressor, plan.experiment
    if not keys.runs or work.interrupted():
        return None
    rng = np.random.default_rng(keys.seed)
    A, exact = np.tile(W, (experiment.periods, 1)), np.tile(W @ regressor.nominal, experiment.periods)
    estimates = []
    while len(estimates) < keys.runs:
        work.progress("synthetic identifications", len(estimates) / keys.runs)
        if work.interrupted():
            return None
        some = min(FITS_AT_ONCE, keys.runs - len(estimates))
        noisy = exact + experiment.noise * rng.normal(size=(some, len(exact)))
        estimates += linear_fits(A, noisy, regressor.names, scale=regressor.nominal)
    truth = dict(zip(regressor.names, regressor.nominal.tolist(), strict=True))
    return coverage(estimates, truth), np.std([e.values for e in estimates], axis=0, ddof=1)
