"""An excitation of a robot as a task: rows that are bounded, regressors, the place where motions are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ... import lang as gt
from ...compiler.causal import CausalFunction, flat_of
from ...inference import negligible
from ...motion.constraints import Constraint, MotionConstraints, guard_of
from ...motion.links import motion_function
from ...motion.options import Limits
from ...results import ArgumentError, naming
from ...robots.links import links_of
from ..regressor import Regressor
from .basis import Basis, ClosedSpline, FourierSeries
from .information import Criterion
from .options import Family, IdentificationExperiment
from .sampled import ExcitationTask

SHARP = 1e-6  # m/s: the sign of a velocity, beside which the smoothed one is judged


@dataclass(frozen=True, eq=False)
class ExcitationPlan:
    """What an excitation is searched with.

    Attributes:
        limits, experiment: as asked for.
        robot: with its own friction; its forces are bounded. inverse: its `motion_function`.
        task: the optimisation; its regressor has a smoothed sign.
        regressor: names, nominal values and units of what is identified. sharp: its ca.Function with the true sign.
        centre: (low, high) box of the places where random motions stand [m].
        keys: the name of each bounded row. times: rows of the trajectory [s].
    """

    limits: Limits
    experiment: IdentificationExperiment
    robot: gt.Model
    inverse: CausalFunction
    task: ExcitationTask
    regressor: Regressor
    sharp: ca.Function
    centre: tuple[np.ndarray, np.ndarray]
    keys: list[str]
    times: np.ndarray


def plan_of(
    robot: gt.Model, motion: Family, limits: Limits, experiment: IdentificationExperiment, criterion: Criterion
) -> ExcitationPlan:
    """The plan for a robot. Raises ArgumentError."""
    flat = flat_of(robot)
    for name in ("T", "q", "tau"):
        if flat.groups.get(name, ((), []))[0] != (3,):
            raise ArgumentError(f"the robot must declare '{name}' as a vector of 3; it has {flat.top()}", "robot")
    guard = _guard(limits, robot)
    inverse = motion_function(robot, guard)
    regressor, smooth = _regressor(robot, experiment.identified, experiment.sign_smoothing)
    _, sharp = _regressor(robot, experiment.identified, SHARP)
    if np.any(negligible(regressor.nominal, regressor.units)):
        name = regressor.names[int(np.argmin(np.abs(regressor.nominal)))]
        raise ArgumentError(
            f"the nominal value of '{name}' is zero, and columns are scaled by nominal values; give a typical one "
            "under parameters, or leave it out",
            "experiment.identified",
        )
    rows, low, high = _rows(inverse, limits.force)
    task = ExcitationTask(_basis(motion), rows, low, high, smooth, regressor.nominal, criterion)
    keys = ["force_N"] * 3 + [margin.key for margin in guard.margins]
    times = _times(motion, experiment)
    return ExcitationPlan(limits, experiment, robot, inverse, task, regressor, sharp, _centre(motion), keys, times)


def _basis(motion: Family) -> Basis:
    if motion.family == "fourier":
        return FourierSeries(motion.period, motion.harmonics)
    return ClosedSpline(motion.period, motion.intervals)


def _guard(limits: Limits, robot: gt.Model) -> MotionConstraints:
    """The margins of the limits, and the distance from the edge of reach."""
    links = links_of(robot)
    guard, least = guard_of(limits, links), limits.link_along_guideway

    def along(part: str, i: int) -> Constraint:
        def expression(m: Any) -> Any:
            arm = getattr(m.robot, part)[i]
            return gt.dot(arm.rod.b.r - arm.rod.a.r, arm.v) / gt.norm(arm.v) - least * m.metre

        return Constraint("link_along_guideway_m", "m", expression)

    return MotionConstraints([*guard.margins, *(along(*link) for link in links)], guard.parameters)


def _rows(inverse: CausalFunction, force: float) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """(x, x', x''[, x''']) -> forces, then margins; and their bounds."""
    orders = [signal.pairs[0][1] for signal in inverse.inputs]
    x = [ca.SX.sym(n, 3) for n in ("x", "v", "a", "j")[: max(3, 1 + max(orders))]]
    outputs = inverse.casadi.call([x[k] for k in orders])
    names = [signal.name for signal in inverse.outputs]
    rows = ca.vertcat(outputs[0], *[outputs[k] for k, name in enumerate(names) if name == "margin"])
    extra = rows.numel() - 3
    return (
        ca.Function("rows", x, [rows], {"cse": True}),
        np.concatenate([np.full(3, -force), np.zeros(extra)]),
        np.concatenate([np.full(3, force), np.full(extra, np.inf)]),
    )


def _regressor(robot: gt.Model, identified: list[str], velocity_scale: float) -> tuple[Regressor, ca.Function]:
    """The regressor of the motors' forces for a motion of T, friction smoothed over a velocity scale [m/s]."""
    try:
        chosen = robot.with_(velocity_scale=velocity_scale)
    except gt.ModelError:
        chosen = robot  # which has no such parameter keeps its own smoothing
    with naming("experiment.identified", gt.ModelError):
        regressor = Regressor(chosen, identified, known="T")
    x = [ca.SX.sym(n, 3) for n in ("x", "v", "a")]
    Y = regressor.casadi.call([x[signal.pairs[0][1]] for signal in regressor.inputs])[0]
    return regressor, ca.Function("Y", x, [Y], {"cse": True})


def _centre(motion: Family) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.array(motion.place_low), np.array(motion.place_high)
    if np.any(low > high):
        k = int(np.argmax(low > high))
        raise ArgumentError(f"coordinate {k} has {low[k]:g} m below and {high[k]:g} m above", "motion.place_low")
    return low, high


def _times(motion: Family, experiment: IdentificationExperiment) -> np.ndarray:
    period, step = motion.period, experiment.sample
    count = round(period / step)
    if count < 1 or abs(count * step - period) > 1e-9 * period:
        raise ArgumentError(f"{period:g} s are no multiple of the sample time {step:g} s", "motion.period")
    return np.linspace(0.0, period, count + 1)
