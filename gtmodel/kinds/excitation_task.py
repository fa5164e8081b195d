"""An excitation problem file as a task: rows that are bounded, regressors, the place where motions are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gtmodel import lang as gt
from gtmodel.compiler.causal import CausalFunction, flat_of
from gtmodel.identify import Regressor
from gtmodel.identify.excitation import ExcitationTask
from gtmodel.identify.excitation_basis import Basis, ClosedSpline, FourierSeries
from gtmodel.motion.follow import motion_function
from gtmodel.motion.guard import Guard, Margin, guard_of
from gtmodel.problem_files import python_models
from gtmodel.problem_files.base import Context, InputError
from gtmodel.robots.links import links_of

from .excitation_keys import ExcitationProblem

SHARP_M_S = 1e-6  # the sign of a velocity, beside which the smoothed one is judged


@dataclass(frozen=True, eq=False)
class Plan:
    """What an excitation problem means.

    Attributes:
        robot: with the file's own friction; its forces are bounded. inverse: its `motion_function`.
        task: the optimisation; its regressor has a smoothed sign.
        regressor: names, nominal values and units of what is identified. sharp: its ca.Function with the true sign.
        centre: (low, high) box of the places where random motions stand [m].
        keys: the key of each bounded row. times: rows of trajectory.csv [s].
    """

    robot: gt.Model
    inverse: CausalFunction
    task: ExcitationTask
    regressor: Regressor
    sharp: ca.Function
    centre: tuple[np.ndarray, np.ndarray]
    keys: list[str]
    times: np.ndarray


def plan_of(problem: ExcitationProblem, context: Context) -> Plan:
    """The plan of a problem. Raises InputError with one sentence and the key."""
    robot = problem.model(context)
    flat = flat_of(robot)
    for name in ("T", "q", "tau"):
        if flat.groups.get(name, ((), []))[0] != (3,):
            raise InputError(f"the robot must declare '{name}' as a vector of 3; it has {flat.top()}", "robot")
    guard = _guard(problem, robot)
    inverse = motion_function(robot, guard)
    regressor, smooth = _regressor(problem, context, problem.sign_smoothing_m_s)
    _, sharp = _regressor(problem, context, SHARP_M_S)
    if np.any(regressor.nominal == 0):
        name = regressor.names[int(np.argmin(np.abs(regressor.nominal)))]
        raise InputError(
            f"the nominal value of '{name}' is zero, and columns are scaled by nominal values; give a typical one "
            "under parameters, or leave it out",
            "identified",
        )
    rows, low, high = _rows(inverse, problem.limits.options().force)
    task = ExcitationTask(_basis(problem), rows, low, high, smooth, regressor.nominal, problem.search.criterion)
    keys = ["force_N"] * 3 + [margin.key for margin in guard.margins]
    return Plan(robot, inverse, task, regressor, sharp, _centre(problem), keys, _times(problem))


def _basis(problem: ExcitationProblem) -> Basis:
    motion = problem.motion
    if motion.family == "fourier":
        return FourierSeries(motion.period_s, motion.harmonics)
    return ClosedSpline(motion.period_s, motion.intervals)


def _guard(problem: ExcitationProblem, robot: gt.Model) -> Guard:
    """The margins of the limits, and the distance from the edge of reach."""
    links = links_of(robot)
    limits = problem.limits.options()
    guard, least = guard_of(limits, links), limits.link_along_guideway

    def along(part: str, i: int) -> Margin:
        def expression(m: Any) -> Any:
            arm = getattr(m.robot, part)[i]
            return gt.dot(arm.rod.b.r - arm.rod.a.r, arm.v) / gt.norm(arm.v) - least * m.metre

        return Margin("link_along_guideway_m", "m", expression)

    return Guard([*guard.margins, *(along(*link) for link in links)], guard.parameters)


def _rows(inverse: CausalFunction, force: float) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """(x, x', x''[, x''']) -> forces, then margins; and their bounds."""
    orders = [signal.pairs[0][1] for signal in inverse.inputs]
    x = [ca.SX.sym(n, 3) for n in ("x", "v", "a", "j")[: max(3, 1 + max(orders))]]
    found = inverse.casadi.call([x[k] for k in orders])
    rows = ca.vertcat(found[0], *found[3 : len(inverse.outputs)])
    extra = rows.numel() - 3
    return (
        ca.Function("rows", x, [rows], {"cse": True}),
        np.concatenate([np.full(3, -force), np.zeros(extra)]),
        np.concatenate([np.full(3, force), np.full(extra, np.inf)]),
    )


def _regressor(problem: ExcitationProblem, context: Context, velocity_scale: float) -> tuple[Regressor, ca.Function]:
    """The regressor of the motors' forces for a motion of T, friction smoothed over a velocity scale [m/s].

    A model in Python keeps its own smoothing: no key of it is known here.
    """
    chosen = problem
    if not python_models.is_reference(problem.robot):
        friction = problem.friction.model_copy(update={"velocity_scale_m_s": velocity_scale})
        chosen = problem.model_copy(update={"friction": friction})
    try:
        regressor = Regressor(chosen.model(context), problem.identified, known="T")
    except gt.ModelError as error:
        raise InputError(str(error), "identified") from error
    x = [ca.SX.sym(n, 3) for n in ("x", "v", "a")]
    Y = regressor.casadi.call([x[signal.pairs[0][1]] for signal in regressor.inputs])[0]
    return regressor, ca.Function("Y", x, [Y], {"cse": True})


def _centre(problem: ExcitationProblem) -> tuple[np.ndarray, np.ndarray]:
    motion = problem.motion
    low, high = np.array(motion.place_low_m), np.array(motion.place_high_m)
    if np.any(low > high):
        k = int(np.argmax(low > high))
        raise InputError(f"coordinate {k} has {low[k]:g} m below and {high[k]:g} m above", "motion.place_low_m")
    return low, high


def _times(problem: ExcitationProblem) -> np.ndarray:
    period, step = problem.motion.period_s, problem.sample_s
    count = round(period / step)
    if count < 1 or abs(count * step - period) > 1e-9 * period:
        raise InputError(f"{period:g} s are no multiple of sample_s = {step:g}", "motion.period_s")
    return np.linspace(0.0, period, count + 1)
