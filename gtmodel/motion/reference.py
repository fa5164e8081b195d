"""The exported motion for a controller: a sampled reference and a RAPID module (not tested on a controller)."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence

import numpy as np

from ..compiler.causal import compile_causal
from ..compiler.flat_cache import flat_of
from ..lang import Model
from ..optimize import Solution
from ..optimize.formulation.system import RateSystem
from ..optimize.solution import constants
from ..results import ArgumentError, Trajectory
from ..results.interpolation import CubicHermite
from ..results.table import csv_text
from .constraints import MotionConstraints
from .path_parametrization import sampled

WIDTH = 110
FARTHEST = 1e6  # mm or degrees: larger values are invalid; a num has single precision


def orientation(robot: Model) -> list[str]:
    """Return the name of the plate's quaternion, if the robot has one."""
    return ["e"] if "e" in flat_of(robot).groups else []


def poses(robot: Model, T: np.ndarray) -> np.ndarray:
    """Append the plate's quaternion to rows of T (n, 3) [m] if the plate rotates.

    Raises ArgumentError for rows out of reach.
    """
    turns = orientation(robot)
    if not turns or T.shape[1] == 7:
        return T
    e, status = compile_causal(robot, known="T", targets=turns)(T)
    if np.any(status != 0):
        raise ArgumentError(f"{np.count_nonzero(status)} targets are out of reach", "export.target")
    return np.hstack([T, e])


def comment(text: str) -> list[str]:
    """Return comment lines in ASCII."""
    plain = " ".join(text.split()).encode("ascii", "backslashreplace").decode("ascii")
    return [f"  ! {line}" for line in textwrap.wrap(plain, WIDTH)]


def module(
    name: str, notes: Sequence[str], declarations: Sequence[str], targets: str, rows: Sequence[str],
    procedure: Sequence[str],
) -> str:  # fmt: skip
    """Return a RAPID module with one procedure and the array `targets` of the robtargets `rows`.

    notes: comment paragraphs. declarations: data declarations. procedure: its lines, not indented.
    """
    lines = [
        f"MODULE {name}",
        *(line for note in notes for line in comment(note)),
        *(f"  {line}" for line in declarations),
        f"  LOCAL CONST robtarget {targets}{{{len(rows)}}} := [",
        *(f"    {row}{',' if k < len(rows) - 1 else ''}" for k, row in enumerate(rows)),
        "  ];",
        *(f"  {line}" for line in procedure),
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def number_text(value: float) -> str:
    """Format a num; single precision has at most nine significant digits."""
    return f"{value:.9g}"


def robtargets(T: np.ndarray, q: np.ndarray) -> list[str]:
    """Return a robtarget per row of T (n, 3) [m], or (n, 7) with the plate's quaternion.

    External axes: carts q (n, 3) [m] in mm, with rotary axes (n, 6) [rad] in degrees. Raises ArgumentError for numbers
    that are invalid in a target.
    """
    axes = np.hstack([1e3 * q[:, :3], np.degrees(q[:, 3:])])
    wrong = np.flatnonzero(~np.all(np.abs(np.hstack([1e3 * T[:, :3], axes])) < FARTHEST, axis=1))
    length = np.linalg.norm(T[:, 3:], axis=1)
    if T.shape[1] == 7:
        wrong = np.union1d(wrong, np.flatnonzero(~(np.abs(length - 1) < 1e-3)))
    if len(wrong):
        k = wrong[0]
        raise ArgumentError(
            f"target {k} is invalid: {T[k].tolist()} with the actuators {q[k].tolist()}; expected finite numbers and "
            "a unit quaternion",
            "targets",
        )
    orientation = T[:, 3:] / length[:, None] if T.shape[1] == 7 else []
    lines = []
    for k, (pose, actuators) in enumerate(zip(T, axes, strict=True)):
        x, carts = (_list(v[:3], 4) for v in (1e3 * pose, actuators))
        turn = _list(orientation[k], 9) if len(orientation) else "1, 0, 0, 0"
        rotary = _list(actuators[3:], 4) or "9E9, 9E9, 9E9"
        lines.append(f"[[{x}], [{turn}], [0, 0, 0, 0], [{carts}, {rotary}]]")
    return lines


def _list(values: np.ndarray, digits: int) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in np.round(values, digits) + 0.0)


ROUND_OFF = 1e-9  # of sample times
COLUMNS = (("T", "m"), ("der(T)", "m/s"), ("der(T,2)", "m/s2"), ("q", "m"), ("der(q)", "m/s"), ("tau", "N"))


def grid(final_time: float, step: float) -> np.ndarray:
    """Return the instants 0, step, 2 step, ... up to the first at or after the end."""
    return step * np.arange(int(np.ceil(final_time / step - ROUND_OFF)) + 1)


def at_rest(
    robot: Model, guard: MotionConstraints, final_time: float, step: float, moving: Callable[[np.ndarray], Trajectory]
) -> Trajectory:
    """Return the motion at multiples of `step` [s]; after its end the robot rests at the final position."""
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
    """Return a function that evaluates a re-simulated motion at any instant: cubic between its rows.

    If forces are the control they are constant per element: the force is that of the next row, and the acceleration
    follows from it. order: derivative of the motion that is the control, None for forces. solution: the re-simulated
    solution.
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
    """Return the accelerations as a function of T, T' and tau.

    They come from the solution's equations if T and T' are the states and these have a closed form, else from the
    robot's forward dynamics.
    """
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
            rows, values = np.hstack([x, v])[:, states], force[:, forces]
            return system.at(rows, values, np.zeros((n, 0)), P, np.zeros(n))[0][:, back]

        return by_system
    forward = compile_causal(robot, known="tau", targets="der(T,2)", prefer="T")

    def by_robot(x: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
        values = {("T", 0): x, ("T", 1): v, ("tau", 0): force}
        return forward(*(values["T" if "T" in s.name else "tau", s.pairs[0][1]] for s in forward.inputs))[0]

    return by_robot


def reference_text(reference: Trajectory, title: str) -> str:
    """Return reference.csv: a comment line, a header with units, one row per sample; for Trajectory.from_csv."""
    columns = {"time [s]": reference.time}
    for name, unit in COLUMNS:
        for k in range(3):
            head = f"{name}[{k}] [{unit}]"
            columns[f'"{head}"' if "," in head else head] = reference[name][:, k]
    return csv_text(columns, digits=12, notes=[f"title: {title}"] if title else [])


def rapid_text(robot: Model, reference: Trajectory, title: str, number: int | None = None) -> str:
    """Return a RAPID module: robtargets in mm, carts as external axes a, b, c in mm, one timed MoveL per target.

    The orientation is the plate's, [1, 0, 0, 0] if it does not rotate. number: distinguishes the modules of several
    motions, which may be loaded together.
    """
    step = float(reference.time[1] - reference.time[0]) if len(reference) > 1 else 0.0
    suffix = "" if number is None else str(number)
    return module(
        f"GtMotion{suffix}",
        [
            title or "optimal motion",
            "Written by gtmodel; not tested on a controller. Check workspace, work object and tool first.",
            f"Positions in mm; external axes a, b, c are the carts in mm; one target every {step:g} s, the first at "
            "the start.",
        ],
        [f"LOCAL CONST num GtStep := {number_text(step)};", f"LOCAL CONST num GtCount := {len(reference)};"],
        "GtTargets",
        robtargets(poses(robot, reference["T"]), reference["q"]),
        [
            f"PROC GtMove{suffix}(PERS tooldata tool, PERS wobjdata wobj)",
            "  MoveL GtTargets{1}, v100, fine, tool \\WObj:=wobj;",
            "  FOR i FROM 2 TO GtCount - 1 DO",
            "    MoveL GtTargets{i}, v1000 \\T:=GtStep, z1, tool \\WObj:=wobj;",
            "  ENDFOR",
            "  MoveL GtTargets{GtCount}, v1000 \\T:=GtStep, fine, tool \\WObj:=wobj;",
            "ENDPROC",
        ],
    )
