"""Kind "excitation": the motion from which a robot's masses and friction are identified best, within all limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gtmodel.identify.excitation import FINER, Excitation, optimise_excitation
from gtmodel.identify.excitation_basis import FourierSeries
from gtmodel.identify.information import condition, predicted_deviations, singular_values
from gtmodel.identify.random_excitation import random_excitations
from gtmodel.inference import FALSE_ALARM, Coverage, binomial_band, coverage, linear_fit
from gtmodel.motion.links import link_ends
from gtmodel.problem_files.base import TRAJECTORY, Context, InputError, Outcome, Row, at_most
from gtmodel.results import SolveStatus, Trajectory

from .excitation_keys import ExcitationProblem
from .excitation_task import Plan, plan_of

NAME = "excitation"
Schema = ExcitationProblem

VALUES = {
    "condition": "condition number of the regressor along the optimised motion, columns scaled by nominal values",
    "random_condition": "of the random motions: best, median",
    "improvement": "best random condition number over the optimised one",
    "criterion": "what was optimised",
    "parameters": "for each: name, nominal, unit, deviation (predicted standard deviation in an experiment), "
    "random_deviation (along the best random motion), ratio of the two; and, with monte_carlo, seen_deviation, "
    "random_seen_deviation and hits of its 95 % interval along the optimised motion",
    "coverage": "with monte_carlo: runs, band of hits, pooled share of 95 % intervals that hold the truth; or null",
    "singular_values": "of the scaled regressor per root of samples, largest first: optimised and random",
    "limits": "by key: the least margin on the fine grid, relative to the bound, or in m for places",
    "coefficients": "of the optimised motion: place_m, cosine_m and sine_m (harmonics, 3); of a spline controls_m",
    "unknowns": "what --start takes",
    "draws": "number of random motions",
}

STILL_BETTER = 1.0  # of the best random one: the condition number that the search must at least reach


@dataclass(frozen=True, eq=False)
class _Found:
    """The optimised motion and the best random one with their stacked regressors, and all draws' condition numbers."""

    best: Excitation
    W: np.ndarray
    random: np.ndarray
    W_random: np.ndarray
    conditions: np.ndarray
    runs: list[tuple[Coverage, np.ndarray]]


def solve(problem: Schema, context: Context) -> Outcome:
    """Draw random motions, optimise from the best of them, and compare."""
    plan = plan_of(problem, context)
    started = _start(plan, context)
    draws = _draws(problem, plan, context)
    if not draws:
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the first random motion was drawn")
    nominal, times = plan.regressor.nominal, plan.times[:-1]
    stacks = [plan.task.stacked(c, times, plan.sharp) for c in draws]
    conditions = np.array([condition(W, nominal) for W in stacks])
    order = np.argsort(conditions, kind="stable")
    starts = [*started, *(draws[k] for k in order[: problem.search.starts])]
    found = [_optimise(problem, plan, context, c, n, len(starts)) for n, c in enumerate(starts)]
    best = min(found, key=lambda e: e.objective)
    first = int(order[0])
    W = plan.task.stacked(best.c, times, plan.sharp)
    fits = [_monte_carlo(problem, plan, context, A) for A in (W, stacks[first])]
    runs = [fit for fit in fits if fit is not None]
    return _outcome(problem, plan, _Found(best, W, draws[first], stacks[first], conditions, runs), found)


def explain(problem: Schema, context: Context) -> str:
    """What is identified, the unknowns and the bounded rows."""
    plan = plan_of(problem, context)
    task = plan.task
    rows = {key: plan.keys.count(key) for key in dict.fromkeys(plan.keys)}
    return "\n".join([
        f"{problem.title or 'excitation'}: {len(plan.regressor.names)} parameters "
        f"({', '.join(plan.regressor.names)})",
        f"  motion of T: {problem.motion.family}, {task.basis.size} unknowns for each of {task.dimension} coordinates, "
        f"{task.basis.period:g} s, at rest at both ends",
        f"  criterion: {problem.search.criterion}, over {task.points} samples of a period",
        f"  bounded at each: {', '.join(f'{key} ({n})' for key, n in rows.items())}; checked on {FINER} times as many",
    ])  # fmt: skip


def _start(plan: Plan, context: Context) -> list[np.ndarray]:
    """The unknowns of an earlier result, where they keep this problem's limits."""
    if context.start is None:
        return []
    given = np.array((context.start.get("values") or {}).get("unknowns", []), dtype=float)
    shape = (plan.task.basis.size, plan.task.dimension)
    if given.shape != shape:
        raise InputError(f"--start: its unknowns have the shape {given.shape}; this problem's have {shape}")
    if np.any(plan.task.excess(given, plan.task.times(FINER)) > 0):
        raise InputError("--start: its motion breaks a limit of this problem; leave it out")
    return [given]


def _draws(problem: Schema, plan: Plan, context: Context) -> list[np.ndarray]:
    def progress(done: float) -> bool:
        context.progress("random motions", done)
        return context.interrupted()

    keys = problem.random
    try:
        return random_excitations(plan.task, plan.centre, keys.draws, keys.seed, progress)
    except ValueError as error:
        raise InputError(str(error), "motion.place_low_m") from error


def _optimise(problem: Schema, plan: Plan, context: Context, start: np.ndarray, number: int, count: int) -> Excitation:
    def progress(iteration: int, objective: float, violation: float) -> bool:
        numbers = {"iteration": iteration, "objective": objective, "violation": violation}
        context.progress(f"optimising, start {number + 1} of {count}", None, numbers)
        return context.interrupted()

    return optimise_excitation(
        plan.task,
        start,
        max_iterations=problem.search.max_iterations,
        max_seconds=context.seconds_left(),
        progress=progress,
    )


def _monte_carlo(problem: Schema, plan: Plan, context: Context, W: np.ndarray) -> tuple[Coverage, np.ndarray] | None:
    """Fits of synthetic forces along a motion: hits of their intervals, and how they scatter (p,); None: not wanted."""
    keys, regressor = problem.monte_carlo, plan.regressor
    if not keys.runs or context.interrupted():
        return None
    rng = np.random.default_rng(keys.seed)
    A, exact = np.tile(W, (problem.periods, 1)), np.tile(W @ regressor.nominal, problem.periods)
    estimates = []
    for run in range(keys.runs):
        context.progress("synthetic identifications", run / keys.runs)
        if context.interrupted():
            return None
        noisy = exact + problem.noise_N * rng.normal(size=len(exact))
        estimates.append(linear_fit(A, noisy, regressor.names, scale=regressor.nominal))
    truth = dict(zip(regressor.names, regressor.nominal.tolist(), strict=True))
    return coverage(estimates, truth), np.std([e.values for e in estimates], axis=0, ddof=1)


def _outcome(problem: Schema, plan: Plan, found: _Found, runs: list[Excitation]) -> Outcome:
    best = found.best
    trajectory = _trajectory(problem, plan, best.c)
    values = _values(problem, plan, found)
    worst = float(np.max(best.excess))
    checks = {
        "limits_excess_on_fine_grid": at_most(worst, 0.0, "raise starts"),
        "condition_to_best_random": at_most(1 / values["improvement"], STILL_BETTER, "raise starts"),
    }
    if found.runs:
        seen = found.runs[0][0]
        low, high = binomial_band(seen.runs, seen.level, 1 - FALSE_ALARM / len(seen.names))
        checks["coverage_outside_band"] = at_most(float(np.count_nonzero((seen.hits < low) | (seen.hits > high))), 0.0)
    status = SolveStatus.INTERRUPTED if SolveStatus.INTERRUPTED in [e.status for e in runs] else best.status
    return Outcome(
        status=status, message=best.message, objective=best.objective, iterations=sum(e.iterations for e in runs),
        checks=checks, values=values, trajectory=trajectory, rows=_rows(values), machine_files=(TRAJECTORY,),
        figures={
            "motion": partial(_motion_figure, trajectory),
            "information": partial(_information_figure, problem, plan, values),
            "workspace": partial(_workspace_figure, problem, plan, found, trajectory),
        },
    )  # fmt: skip


def _trajectory(problem: Schema, plan: Plan, c: np.ndarray) -> Trajectory:
    """The motion with its carts and forces at the sample time, the end of the period included."""
    T, dT, ddT, dddT = plan.task.motion(c, plan.times, 4)
    given = (T, dT, ddT, dddT)
    tau, q, dq, *_ = plan.inverse(*(given[signal.pairs[0][1]] for signal in plan.inverse.inputs))
    return Trajectory(
        plan.times,
        {"T": T, "der(T)": dT, "der(T,2)": ddT, "q": q, "der(q)": dq, "tau": tau},
        {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2", "q": "m", "der(q)": "m/s", "tau": "N"},
        title=problem.title or f"excitation of {problem.robot}",
    )


def _values(problem: Schema, plan: Plan, found: _Found) -> dict[str, Any]:
    regressor, basis, c = plan.regressor, plan.task.basis, found.best.c
    share = 1 / np.sqrt(problem.periods)
    deviations, of_random = (share * predicted_deviations(W, problem.noise_N) for W in (found.W, found.W_random))
    parameters: list[dict[str, Any]] = [
        {"name": n, "nominal": x, "unit": u, "deviation": s, "random_deviation": r, "ratio": r / s}
        for n, x, u, s, r in zip(
            regressor.names, regressor.nominal, regressor.units, deviations, of_random, strict=True
        )
    ]
    seen = None
    if len(found.runs) == 2:
        (counted, scatter), (_, of_random) = found.runs
        seen = {"runs": counted.runs, "band": list(counted.band), "pooled": counted.pooled}
        for p, s, r, hits in zip(parameters, scatter, of_random, counted.hits, strict=True):
            p |= {"seen_deviation": s, "random_seen_deviation": r, "hits": int(hits)}
    if isinstance(basis, FourierSeries):
        coefficients = dict(zip(("place_m", "cosine_m", "sine_m"), basis.amplitudes(c), strict=True))
    else:
        coefficients = {"controls_m": c}
    value = condition(found.W, regressor.nominal)
    margins = {key: -float(max(e for k, e in zip(plan.keys, found.best.excess, strict=True) if k == key))
               for key in dict.fromkeys(plan.keys)}  # fmt: skip
    return {
        "condition": value,
        "random_condition": {"best": float(found.conditions.min()), "median": float(np.median(found.conditions))},
        "improvement": float(found.conditions.min() / value),
        "criterion": problem.search.criterion,
        "parameters": parameters,
        "coverage": seen,
        "singular_values": {
            "optimised": singular_values(found.W, regressor.nominal),
            "random": singular_values(found.W_random, regressor.nominal),
        },
        "limits": margins,
        "coefficients": coefficients,
        "unknowns": c,
        "draws": len(found.conditions),
    }


def _rows(values: dict[str, Any]) -> list[Row]:
    random = values["random_condition"]
    rows = [
        Row("condition number, optimised", values["condition"]),
        Row(f"best of {values['draws']} random motions", random["best"]),
        Row("their median", random["median"]),
        Row("best random over optimised", values["improvement"]),
    ]
    for p in values["parameters"]:
        text = f"{p['deviation']:.3g}, random {p['random_deviation']:.3g}"
        rows.append(Row(f"{p['name']} = {p['nominal']:g}, deviation", text, p["unit"]))
    rows += [Row(f"least margin of {key}", margin) for key, margin in values["limits"].items()]
    if (seen := values["coverage"]) is not None:
        low, high = seen["band"]
        hits = [p["hits"] for p in values["parameters"]]
        rows.append(
            Row(f"hits of {seen['runs']} synthetic fits, {low} to {high} expected", f"{min(hits)} to {max(hits)}")
        )
        rows.append(Row("pooled coverage of 95 % intervals", seen["pooled"]))
    return rows


def _motion_figure(trajectory: Trajectory) -> Any:
    from gtmodel.plot.signals import signals_figure

    return signals_figure(trajectory, ["T", "der(T)", "der(T,2)", "q", "der(q)", "tau"])


def _information_figure(problem: Schema, plan: Plan, values: dict[str, Any]) -> Any:
    from gtmodel.plot.excitation import information_figure

    cosine, sine = (values["coefficients"].get(key) for key in ("cosine_m", "sine_m"))
    return information_figure(
        values["singular_values"],
        [p["name"] for p in values["parameters"]],
        {
            "optimised": [p["deviation"] / abs(p["nominal"]) for p in values["parameters"]],
            "best random": [p["random_deviation"] / abs(p["nominal"]) for p in values["parameters"]],
        },
        amplitudes=None if cosine is None else np.hypot(cosine, sine),
        frequency=1 / problem.motion.period_s,
        title=f"{problem.title or 'excitation'}: {problem.search.criterion}",
    )


def _workspace_figure(problem: Schema, plan: Plan, found: _Found, trajectory: Trajectory) -> Any:
    from gtmodel.plot.excitation import path_figure

    joints, tips, _ = link_ends(plan.robot, trajectory["T"][:1])
    random = plan.task.motion(found.random, plan.times, 1)[0]
    limits = problem.limits
    box = None if None in (limits.tcp_low_m, limits.tcp_high_m) else np.array([limits.tcp_low_m, limits.tcp_high_m])
    return path_figure({"optimised": trajectory["T"], "best random": random}, joints[0], tips[0], box=box,
                       title=problem.title or "excitation")  # fmt: skip
