"""From the motions found to the study: their information, checks, trajectory and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...inference import FALSE_ALARM, Coverage, binomial_band
from ...motion.links import link_ends
from ...optimize.judgement.reached_optima import ReachedOptima
from ...results import SolveStatus, Trajectory, at_most
from ...results.trajectory_files import TRAJECTORY
from .basis import FourierSeries
from .excited import ExcitationStudy
from .information import condition, predicted_deviations, singular_values
from .optimise import Excitation
from .options import ExcitationSearch
from .task import ExcitationPlan

Array = np.ndarray

STILL_BETTER = 1.0  # of the best random one: the condition number that the search must at least reach


@dataclass(frozen=True, eq=False)
class ExcitationMotions:
    """The optimised motion and the best random one with their stacked regressors, and all draws' condition numbers."""

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
    worst = float(np.max(best.excess))
    checks = {
        "limits_excess_on_fine_grid": at_most(worst, 0.0, "raise starts"),
        "condition_to_best_random": at_most(1 / values["improvement"], STILL_BETTER, "raise starts"),
    }
    if motions.runs:
        seen = motions.runs[0][0]
        low, high = binomial_band(seen.runs, seen.level, 1 - FALSE_ALARM / len(seen.names))
        checks["coverage_outside_band"] = at_most(float(np.count_nonzero((seen.hits < low) | (seen.hits > high))), 0.0)
    status = SolveStatus.INTERRUPTED if SolveStatus.INTERRUPTED in [e.status for e in runs] else best.status
    reached = ReachedOptima([e.objective if e.status.ok else None for e in runs])
    sentences = [best.message, reached.message(best.objective) if best.status.ok else ""]
    return ExcitationStudy(
        status=status, message="; ".join(filter(None, sentences)), title=title, objective=best.objective,
        iterations=sum(e.iterations for e in runs), checks=checks, **values, trajectory=trajectory,
        machine_files=(TRAJECTORY,),
        figures={
            "motion": partial(_motion_figure, trajectory),
            "information": partial(_information_figure, plan, values, title),
            "workspace": partial(_workspace_figure, plan, motions, trajectory),
        },
    )  # fmt: skip


def _trajectory(plan: ExcitationPlan, c: Array, title: str) -> Trajectory:
    """The motion with its carts and forces at the sample time, the end of the period included."""
    T, dT, ddT, dddT = plan.task.motion(c, plan.times, 4)
    given = (T, dT, ddT, dddT)
    tau, q, dq, *_ = plan.inverse(*(given[signal.pairs[0][1]] for signal in plan.inverse.inputs))
    return Trajectory(
        plan.times,
        {"T": T, "der(T)": dT, "der(T,2)": ddT, "q": q, "der(q)": dq, "tau": tau},
        {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2", "q": "m", "der(q)": "m/s", "tau": "N"},
        title=title,
    )


def _values(plan: ExcitationPlan, search: ExcitationSearch, motions: ExcitationMotions) -> dict[str, Any]:
    experiment = plan.experiment
    regressor, basis, c = plan.regressor, plan.task.basis, motions.best.c
    share = 1 / np.sqrt(experiment.periods)
    deviations, of_random = (share * predicted_deviations(W, experiment.noise) for W in (motions.W, motions.W_random))
    parameters: list[dict[str, Any]] = [
        {"name": n, "nominal": x, "unit": u, "deviation": s, "random_deviation": r, "ratio": r / s}
        for n, x, u, s, r in zip(
            regressor.names, regressor.nominal, regressor.units, deviations, of_random, strict=True
        )
    ]
    seen = None
    if len(motions.runs) == 2:
        (counted, scatter), (_, of_random) = motions.runs
        seen = {"runs": counted.runs, "band": list(counted.band), "pooled": counted.pooled}
        for p, s, r, hits in zip(parameters, scatter, of_random, counted.hits, strict=True):
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
        "coverage": seen,
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
    from ...plot.excitation import information_figure

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
    from ...plot.excitation import path_figure

    joints, tips, _ = link_ends(plan.robot, trajectory["T"][:1])
    random = plan.task.motion(motions.random, plan.times, 1)[0]
    limits = plan.limits
    box = None if None in (limits.tcp_low, limits.tcp_high) else np.array([limits.tcp_low, limits.tcp_high])
    return path_figure({"optimised": trajectory["T"], "best random": random}, joints[0], tips[0], box=box,
                       title=f"{trajectory.title}: paths, and the robot at the start")  # fmt: skip
