"""The exported motion for a controller: a sampled reference and a RAPID module."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..compiler.causal import compile_causal
from ..lang import Model
from ..optimize import Solution
from ..optimize.formulation.system import RateSystem
from ..optimize.solution import constants
from ..results import Trajectory
from ..results.interpolation import CubicHermite
from ..results.table import csv_text
from . import rapid
from .constraints import MotionConstraints
from .path_parametrization import sampled

ROUND_OFF = 1e-9  # of sample times
COLUMNS = (("T", "m"), ("der(T)", "m/s"), ("der(T,2)", "m/s2"), ("q", "m"), ("der(q)", "m/s"), ("tau", "N"))


def grid(final_time: float, step: float) -> np.ndarray:
    """Instants 0, step, 2 step ... up to the first at or after the end."""
    return step * np.arange(int(np.ceil(final_time / step - ROUND_OFF)) + 1)


def at_rest(
    robot: Model, guard: MotionConstraints, final_time: float, step: float, moving: Callable[[np.ndarray], Trajectory]
) -> Trajectory:
    """The motion at multiples of `step` [s]; from its end on the robot stands where the motion ends."""
    times = grid(final_time, step)
    on_the_way = times[times < final_time * (1 - ROUND_OFF)]
    run = moving(on_the_way)
    last = moving(np.array([np.nextafter(final_time, 0.0)]))["T"]
    still = times[len(on_the_way) :]
    zero = np.zeros((len(still), 3))
    end = sampled(robot, still, np.repeat(last, len(still), axis=0), zero, zero, guard)
    values = {name: np.concatenate([run[name], end[name]]) for name, _ in COLUMNS}
    return Trajectory(times, values, dict(COLUMNS))


Accelerations = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # of rows of T, T' and tau


def between_rows(
    robot: Model, guard: MotionConstraints, order: int | None, run: Trajectory, solution: Solution
) -> Callable[[np.ndarray], Trajectory]:
    """A re-simulated motion at any instant: cubic between its rows; the force is that of the row after the instant
    where forces are the control, constant per element, and the acceleration follows from it.

    order: of the derivative of the motion that is the control, None where forces are. solution: what was re-simulated.
    """
    T, dT = run["T"], run["der(T)"]
    curve = CubicHermite(run.time, T, dT)
    by_force = accelerations_of(robot, solution) if order is None else None

    def moving(times: np.ndarray) -> Trajectory:
        x, v = curve(times), curve(times, 1)
        row = np.maximum(np.searchsorted(run.time, times, side="left"), 1)
        row = np.minimum(row, len(run) - 1)
        if by_force is not None:
            a = by_force(x, v, run["tau"][row])
        elif order == 3:
            a = np.stack([np.interp(times, run.time, c) for c in run["der(T,2)"].T], axis=1)
        else:
            a = run["der(T,2)"][row]
        return sampled(robot, times, x, v, a, guard)

    return moving


def accelerations_of(robot: Model, solution: Solution) -> Accelerations:
    """By the equations that the solution is re-simulated with, where T and T' are their states and all has a closed
    form; else by forward dynamics of the robot."""
    problem, system = solution.problem, RateSystem.of(solution.problem)
    T, tau = (problem.flat.groups[f"robot.{name}"][1] for name in ("T", "tau"))
    pairs = [(i, order) for order in (0, 1) for i in T]
    if (
        sorted(pairs) == sorted(problem.state_pairs)
        and sorted(tau) == sorted(problem.control_indices)
        and not system.count
    ):
        states = [pairs.index(pair) for pair in problem.state_pairs]
        forces = [tau.index(i) for i in problem.control_indices]
        back = [problem.state_pairs.index((i, 1)) for i in T]
        P = constants(solution.nlp, solution.x)

        def by_system(x: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
            n = len(x)
            rows, given = np.hstack([x, v])[:, states], force[:, forces]
            return system.at(rows, given, np.zeros((n, 0)), P, np.zeros(n))[0][:, back]

        return by_system
    forward = compile_causal(robot, known="tau", targets="der(T,2)", prefer="T")

    def by_robot(x: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
        given = {("T", 0): x, ("T", 1): v, ("tau", 0): force}
        return forward(*(given["T" if "T" in s.name else "tau", s.pairs[0][1]] for s in forward.inputs))[0]

    return by_robot


def reference_text(reference: Trajectory, title: str) -> str:
    """reference.csv: a comment line, a header with units, one row per sample; as Trajectory.from_csv reads it."""
    columns = {"time [s]": reference.time}
    for name, unit in COLUMNS:
        for k in range(3):
            head = f"{name}[{k}] [{unit}]"
            columns[f'"{head}"' if "," in head else head] = reference[name][:, k]
    return csv_text(columns, digits=12, notes=[f"title: {title}"] if title else [])


def rapid_text(robot: Model, reference: Trajectory, title: str, number: int | None = None) -> str:
    """A RAPID module: robtargets in mm, carts as external axes a, b, c in mm, one MoveL with its time per target.

    The orientation is that of the plate; [1, 0, 0, 0] where it does not turn. number: of one motion of several, whose
    modules may all be loaded at once.
    """
    step = float(reference.time[1] - reference.time[0]) if len(reference) > 1 else 0.0
    more = "" if number is None else str(number)
    return rapid.module(
        f"GtMotion{more}",
        [
            title or "optimal motion",
            "Written by gtmodel; tested against no controller. Check workspace, work object and tool first.",
            f"Positions in mm; external axes a, b, c are the carts in mm; one target every {step:g} s, the first at "
            "the start.",
        ],
        [f"LOCAL CONST num GtStep := {rapid.number(step)};", f"LOCAL CONST num GtCount := {len(reference)};"],
        "GtTargets",
        rapid.robtargets(rapid.poses(robot, reference["T"]), reference["q"]),
        [
            f"PROC GtMove{more}(PERS tooldata tool, PERS wobjdata wobj)",
            "  MoveL GtTargets{1}, v100, fine, tool \\WObj:=wobj;",
            "  FOR i FROM 2 TO GtCount - 1 DO",
            "    MoveL GtTargets{i}, v1000 \\T:=GtStep, z1, tool \\WObj:=wobj;",
            "  ENDFOR",
            "  MoveL GtTargets{GtCount}, v1000 \\T:=GtStep, fine, tool \\WObj:=wobj;",
            "ENDPROC",
        ],
    )
