"""A robot's motion from one pose to another as an Optimization, and its straight-line guess."""

from __future__ import annotations

import re
from typing import Any

import casadi as ca
import numpy as np

from gtmodel import lang as gt
from gtmodel.compiler.causal import CausalFunction, flat_of
from gtmodel.results import Status, Trajectory

GUESS_TIME_S = 1.0
SHORTEST_TIME_S = 0.05  # a free final time needs a lower bound; no motion of these robots is shorter
_LINK = re.compile(r"(?P<part>\w+)\[(?P<index>\d+)\]\.rod\.a\.r")


def motion(
    robot: gt.Model,
    *,
    start: np.ndarray,
    goal: np.ndarray,
    start_rest: list[str],
    goal_rest: list[str],
    force: float,
    force_unit: float,
    weight_time: float,
    weight_energy: float,
    link_margin: float | None = None,
) -> gt.Optimization:
    """Minimise weight_time * T + weight_energy * int sum (tau / force_unit)^2 dt from start to goal.

    The robot must declare T (TCP position, m) and tau (motor forces, N). Rest lists name what vanishes at an
    end: "velocity", "acceleration". `along_guideway` are the components [m] of the links along their guideways,
    from cart to plate; they are kept above `link_margin`: at 0 the robot stands at the edge of its reach.
    """
    links = [(m["part"], int(m["index"])) for m in map(_LINK.fullmatch, link_names(robot)) if m]

    class Motion(gt.Optimization):
        robot: Any
        along_guideway: Any
        final_time = gt.free(GUESS_TIME_S, min=SHORTEST_TIME_S, unit="s")
        force_limit = gt.parameter(force, unit="N", positive=True)
        force_unit_N = gt.parameter(force_unit, unit="N", positive=True)
        from_T = gt.parameter(start, unit="m")
        to_T = gt.parameter(goal, unit="m")

        def equations(self) -> Any:
            for k, (part, i) in enumerate(links):
                link = getattr(self.robot, part)[i]
                yield self.along_guideway[k] == gt.dot(link.rod.b.r - link.rod.a.r, link.v) / gt.norm(link.v)

        def objective(self) -> Any:
            cost = weight_time * self.final_time
            if weight_energy:
                tau = self.robot.tau
                cost = cost + weight_energy * gt.integral(gt.dot(tau, tau) / self.force_unit_N**2)
            return cost

        def constraints(self) -> Any:
            T = self.robot.T
            yield gt.between(-self.force_limit, self.robot.tau, self.force_limit)
            yield T.at(self.start_time) == self.from_T
            yield T.at(self.final_time) == self.to_T
            for instant, rest in ((self.start_time, start_rest), (self.final_time, goal_rest)):
                for order, name in ((1, "velocity"), (2, "acceleration")):
                    if name in rest:
                        yield gt.der(T, order).at(instant) == 0

    declared: dict[str, Any] = {"robot": gt.part(robot)}
    if links:
        declared["along_guideway"] = gt.variable(len(links), unit="m", min=link_margin)
    return type("Motion", (Motion,), declared)()


def link_names(robot: gt.Model) -> list[str]:
    """Names of the cart joints of all links that run on a guideway of their own direction v."""
    flat = flat_of(robot)
    names = [name for name in flat.groups if _LINK.fullmatch(name)]
    return [name for name in names if name.removesuffix("rod.a.r") + "v" in flat.bindings]


def along_guideways(robot: gt.Model, T: np.ndarray, joints: list[np.ndarray]) -> np.ndarray:
    """Components [m] of the links along their guideways for a TCP position and cart joints in `link_names` order."""
    flat = flat_of(robot)
    directions = [flat.bindings[name.removesuffix("rod.a.r") + "v"] for name in link_names(robot)]
    if not directions:
        return np.zeros(0)
    v = np.array(ca.Function("v", [flat.p], [ca.horzcat(*directions)])(flat.p0)).T
    return np.sum((T - np.array(joints)) * v, axis=1) / np.linalg.norm(v, axis=1)


def line_guess(
    inverse_dynamics: CausalFunction, start: np.ndarray, goal: np.ndarray, force: float, rows: int = 201
) -> Trajectory:
    """Straight line with a trapezoidal profile (1/4, 1/2, 1/4) of 1 s; forces by inverse dynamics, clipped."""
    t = np.linspace(0.0, GUESS_TIME_S, rows)
    r = t / GUESS_TIME_S
    top = 4.0 / 3.0
    s = np.where(r < 0.25, 2 * top * r**2, np.where(r < 0.75, top * (r - 0.125), 1 - 2 * top * (1 - r) ** 2))
    ds = np.where(r < 0.25, 4 * top * r, np.where(r < 0.75, top, 4 * top * (1 - r))) / GUESS_TIME_S
    dds = np.where(r < 0.25, 4 * top, np.where(r < 0.75, 0.0, -4 * top)) / GUESS_TIME_S**2
    step = goal - start
    T, dT, ddT = start + s[:, None] * step, ds[:, None] * step, dds[:, None] * step
    tau, status = inverse_dynamics(T, dT, ddT)
    tau[status != Status.OK] = 0.0  # the line may leave the workspace; the optimum need not
    values = {"robot.T": T, "der(robot.T)": dT, "robot.tau": np.clip(tau, -force, force)}
    return Trajectory(t, values, {"robot.T": "m", "der(robot.T)": "m/s", "robot.tau": "N"})


def bare_guess(start: np.ndarray, goal: np.ndarray) -> Trajectory:
    """The straight line at constant speed, nothing said of velocities and forces."""
    return Trajectory([0.0, GUESS_TIME_S], {"robot.T": np.array([start, goal])}, {"robot.T": "m"})
