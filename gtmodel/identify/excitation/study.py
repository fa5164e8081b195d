"""The excitation study: the motion that identifies masses and friction of a robot best, its information, checks,
trajectory and plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Unpack

import numpy as np

from ... import view
from ...inference import FALSE_ALARM, Coverage, binomial_band, coverage, linear_fits
from ...lang import Model
from ...motion.options import Limits
from ...motion.path_parametrization import link_ends
from ...optimize.multistart import ReachedOptima
from ...results import ArgumentError, SolveStatus, Trajectory, Work, at_most, naming
from ...results.trajectory_files import TRAJECTORY
from ...results.work import WorkOptions, study_function
from ...workers.mapped import mapped
from .basis import FourierSeries
from .information import condition, predicted_deviations, singular_values
from .options import ExcitationSearch, ExcitationStudy, Family, IdentificationExperiment, MonteCarloFits, RandomMotions
from .search import FINER, Excitation, optimise_excitation, random_excitations
from .task import ExcitationPlan, plan_of

Array = np.ndarray

STILL_BETTER = 1.0  # bound on the optimised condition number over the best random one


@dataclass(frozen=True, eq=False)
class ExcitationMotions:
    """The optimised motion and the best random one with their stacked regressors, and the condition numbers of all."""

    best: Excitation
    W: np.ndarray
    random: np.ndarray
    W_random: np.ndarray
    conditions: np.ndarray
    runs: list[tuple[Coverage, np.ndarray]]


def study_of_motion(
    plan: ExcitationPlan, search: ExcitationSearch, title: str, motions: ExcitationMotions, runs: Sequence[Excitation]
) -> ExcitationStudy:
    """The study of the best motion."""
    best = motions.best
    trajectory = _trajectory(plan, best.c, title)
    values = _values(plan, search, motions)
    worst, force = float(np.max(best.excess)), plan.limits.force
    checks = {
        "limits_excess_on_fine_grid": at_most(worst, 0.0, "raise starts"),
        "condition_to_best_random": at_most(1 / values["improvement"], STILL_BETTER, "raise starts"),
    }
    if motions.runs:
        c = motions.runs[0][0]
        low, high = binomial_band(c.runs, c.level, 1 - FALSE_ALARM / len(c.names))
        checks["coverage_outside_band"] = at_most(float(np.count_nonzero((c.hits < low) | (c.hits > high))), 0.0)
    status = SolveStatus.INTERRUPTED if SolveStatus.INTERRUPTED in [e.status for e in runs] else best.status
    reached = ReachedOptima([e.objective if e.status.ok else None for e in runs])
    stopped = "stopped before every start was optimised" if status is not best.status else ""
    sentences = [stopped, best.message, reached.message(best.objective) if best.status.ok else ""]
    return ExcitationStudy(
        status=status, message="; ".join(filter(None, sentences)), title=title, objective=best.objective,
        iterations=sum(e.iterations for e in runs), checks=checks, **values, trajectory=trajectory,
        machine_files=(TRAJECTORY,),
        figures={
            "motion": partial(_motion_figure, trajectory),
            "information": partial(_information_figure, plan, values, title),
            "workspace": partial(_workspace_figure, plan, motions, trajectory),
        },
        scenes={"motion": partial(view.scene, plan.robot, trajectory, limits={"tau": (-force, force)})},
    )  # fmt: skip


def _trajectory(plan: ExcitationPlan, c: Array, title: str) -> Trajectory:
    """The motion with its carts and forces at the sample times, including the end of the period."""
    T, dT, ddT, dddT = plan.task.motion(c, plan.times, 4)
    derivatives = (T, dT, ddT, dddT)
    tau, q, dq, *_ = plan.inverse(*(derivatives[signal.pairs[0][1]] for signal in plan.inverse.inputs))
    return Trajectory(
        plan.times,
        {"T": T, "der(T)": dT, "der(T,2)": ddT, "q": q, "der(q)": dq, "tau": tau},
        {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2", "q": "m", "der(q)": "m/s", "tau": "N"},
        title=title,
    )


def _values(plan: ExcitationPlan, search: ExcitationSearch, motions: ExcitationMotions) -> dict[str, Any]:
    experiment = plan.experiment
    regressor, basis, c = plan.regressor, plan.task.basis, motions.best.c
    factor = 1 / np.sqrt(experiment.periods)
    deviations, at_random = (factor * predicted_deviations(W, experiment.noise) for W in (motions.W, motions.W_random))
    parameters: list[dict[str, Any]] = [
        {"name": n, "nominal": x, "unit": u, "deviation": s, "random_deviation": r, "ratio": r / s}
        for n, x, u, s, r in zip(
            regressor.names, regressor.nominal, regressor.units, deviations, at_random, strict=True
        )
    ]
    coverage_table = None
    if len(motions.runs) == 2:
        (counts, scatter), (_, random_scatter) = motions.runs
        coverage_table = {"runs": counts.runs, "band": list(counts.band), "pooled": counts.pooled}
        for p, s, r, hits in zip(parameters, scatter, random_scatter, counts.hits, strict=True):
            p |= {"seen_deviation": s, "random_seen_deviation": r, "hits": int(hits)}
    if isinstance(basis, FourierSeries):
        coefficients = dict(zip(("place_m", "cosine_m", "sine_m"), basis.amplitudes(c), strict=True))
    else:
        coefficients = {"controls_m": c}
    value = condition(motions.W, regressor.nominal)
    margins = {key: -float(max(e for k, e in zip(plan.keys, motions.best.excess, strict=True) if k == key))
               for key in dict.fromkeys(plan.keys)}  # fmt: skip
    return {
        "condition": value,
        "random_condition": {"best": float(motions.conditions.min()), "median": float(np.median(motions.conditions))},
        "improvement": float(motions.conditions.min() / value),
        "criterion": search.criterion,
        "parameters": parameters,
        "coverage": coverage_table,
        "singular_values": {
            "optimised": singular_values(motions.W, regressor.nominal),
            "random": singular_values(motions.W_random, regressor.nominal),
        },
        "limits": margins,
        "coefficients": coefficients,
        "unknowns": c,
        "draws": len(motions.conditions),
    }


def _motion_figure(trajectory: Trajectory) -> Any:
    from ...plot.signals import signals_figure

    return signals_figure(trajectory, ["T", "der(T)", "der(T,2)", "q", "der(q)", "tau"])


def _information_figure(plan: ExcitationPlan, values: dict[str, Any], title: str) -> Any:
    from ...plot.identification import information_figure

    cosine, sine = (values["coefficients"].get(key) for key in ("cosine_m", "sine_m"))
    return information_figure(
        values["singular_values"],
        [p["name"] for p in values["parameters"]],
        {
            "optimised": [p["deviation"] / abs(p["nominal"]) for p in values["parameters"]],
            "best random": [p["random_deviation"] / abs(p["nominal"]) for p in values["parameters"]],
        },
        amplitudes=None if cosine is None else np.hypot(cosine, sine),
        frequency=1 / plan.task.basis.period,
        title=f"{title},\noptimised for: {values['criterion']}",
    )


def _workspace_figure(plan: ExcitationPlan, motions: ExcitationMotions, trajectory: Trajectory) -> Any:
    from ...plot.identification import path_figure

    joints, tips, _ = link_ends(plan.robot, trajectory["T"][:1])
    random = plan.task.motion(motions.random, plan.times, 1)[0]
    limits = plan.limits
    box = None if None in (limits.tcp_low, limits.tcp_high) else np.array([limits.tcp_low, limits.tcp_high])
    return path_figure({"optimised": trajectory["T"], "best random": random}, joints[0], tips[0], box=box,
                       title=f"{trajectory.title}: paths, and the robot at the start")  # fmt: skip


FITS_AT_ONCE = 50  # synthetic identifications between two checks of the time limit


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
    **work_options: Unpack[WorkOptions],
) -> ExcitationStudy:
    """Optimise the motion for an identification, starting from the best random motions, and compare it with them.

    Args:
        robot: declares its tool centre point T, carts q and forces tau as vectors of 3; the study sets the parameter
            `velocity_scale` of its friction, if it has one.
        motion: the family of motions.
        limits: limits of the motion.
        experiment: identified parameters, noise, sample time.
        search: criterion, starts and iterations.
        random: random motions for comparison.
        monte_carlo: synthetic identifications along both motions; none if left out.
        start: (size, 3) unknowns of an earlier study, as an additional start.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    An interrupted study returns the best motion so far, which satisfies all limits. Raises ArgumentError for a robot of
    another kind, for limits that hardly any random motion satisfies, and for a start that does not fit or violates a
    limit.

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
    work = Work(**work_options)
    search, title = search or ExcitationSearch(), work.title or "excitation"
    plan = plan_of(robot, motion, limits, experiment or IdentificationExperiment(), search.criterion)
    first_starts = [] if start is None else [_checked_start(plan, np.asarray(start, dtype=float))]
    draws = _draws(plan, random or RandomMotions(), work)
    if not draws:
        return ExcitationStudy(
            status=SolveStatus.INTERRUPTED, title=title, message="stopped before the first random motion was drawn"
        )
    nominal, times = plan.regressor.nominal, plan.times[:-1]
    stacks = [plan.task.stacked(c, times, plan.sharp) for c in draws]
    conditions = np.array([condition(W, nominal) for W in stacks])
    order = np.argsort(conditions, kind="stable")
    starts = [*first_starts, *(draws[k] for k in order[: search.starts])]

    def optimised(item: tuple[int, Array]) -> Excitation:
        return optimise_excitation(task, item[1], max_iterations=most, max_seconds=seconds)

    def here(item: tuple[int, Array]) -> Excitation:
        return optimise_excitation(
            task, item[1], max_iterations=most, max_seconds=work.seconds_left(),
            progress=work.iterations(f"optimising, start {item[0]} of {len(starts)}"),
        )  # fmt: skip

    task, most, seconds = plan.task, search.max_iterations, work.seconds_left()
    work.progress(f"optimising from {len(starts)} starts")
    runs = list(mapped(optimised, enumerate(starts, 1), here=here, waiting=work.interrupted))
    if not runs:
        return ExcitationStudy(
            status=SolveStatus.INTERRUPTED, title=title, message="stopped before the first start was optimised"
        )
    best = min(runs, key=lambda e: e.objective)
    first = int(order[0])
    W = plan.task.stacked(best.c, times, plan.sharp)
    fits = [_monte_carlo(plan, monte_carlo or MonteCarloFits(), work, A) for A in (W, stacks[first])]
    finished = [fit for fit in fits if fit is not None]
    return study_of_motion(
        plan, search, title, ExcitationMotions(best, W, draws[first], stacks[first], conditions, finished), runs
    )


def _checked_start(plan: ExcitationPlan, start: Array) -> Array:
    """The unknowns of an earlier result, if they satisfy these limits. Raises ArgumentError."""
    shape = (plan.task.basis.size, plan.task.dimension)
    if start.shape != shape:
        raise ArgumentError(f"its unknowns have the shape {start.shape}; expected {shape}", "start")
    if np.any(plan.task.excess(start, plan.task.times(FINER)) > 0):
        raise ArgumentError("its motion violates a limit of this problem; leave it out", "start")
    return start


def _draws(plan: ExcitationPlan, random: RandomMotions, work: Work) -> list[Array]:
    def progress(done: float) -> bool:
        work.progress("drawing random motions", done)
        return work.interrupted()

    with naming("motion.place_low", ValueError):
        return random_excitations(plan.task, plan.centre, random.draws, random.seed, progress)


def _monte_carlo(plan: ExcitationPlan, keys: MonteCarloFits, work: Work, W: Array) -> tuple[Coverage, Array] | None:
    """Monte Carlo fits along a motion: coverage of their intervals, and their scatter (p,); None if switched off."""
    regressor, experiment = plan.regressor, plan.experiment
    if not keys.runs or work.interrupted():
        return None
    rng = np.random.default_rng(keys.seed)
    A, exact = np.tile(W, (experiment.periods, 1)), np.tile(W @ regressor.nominal, experiment.periods)
    estimates = []
    while len(estimates) < keys.runs:
        work.progress("fitting synthetic data", len(estimates) / keys.runs)
        if work.interrupted():
            return None
        count = min(FITS_AT_ONCE, keys.runs - len(estimates))
        noisy = exact + experiment.noise * rng.normal(size=(count, len(exact)))
        estimates += linear_fits(A, noisy, regressor.names, scale=regressor.nominal)
    truth = dict(zip(regressor.names, regressor.nominal.tolist(), strict=True))
    return coverage(estimates, truth), np.std([e.values for e in estimates], axis=0, ddof=1)
