"""Inputs of a milling study, its evaluation at one place, and the best angle near a grid point by nonlinear
programming."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..compliance import arm_poses, translational_compliance
from ..kinematics import Chain, chain_of
from ..lang import Model
from ..results import ArgumentError
from ..results.refusal import naming
from .cutter import Cut, Cutter, immersion, tooth_frequency
from .deflection import Deflection, deflections, duration, samples_per_turn, static_index
from .forces import force_spectrum, to_world
from .options import MillingSearch, MillingTool
from .oscillators import Oscillators
from .pose_dynamics import AngleSweep, Dynamics, Given, angle_sweep, dynamics_of

SAMPLES = 96  # of a turn, at which the norm is bounded
HARMONICS = 16  # strongest harmonics of the spindle that are used
QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9}


@dataclass(frozen=True)
class Start:
    """Start of a refinement: angle, between low and high [rad], and speed of the spindle [1/s]."""

    angle: float
    low: float
    high: float
    speed: float


@dataclass(frozen=True)
class Refined:
    """A refined angle [rad] and speed of the spindle [1/s].

    steady_peak: largest norm of the steady deflection [m]. converged: of the solver. peak: dynamic index [m], NaN if it
    was not computed.
    """

    angle: float
    speed: float
    steady_peak: float
    converged: bool
    peak: float = np.nan


def refine(
    field: Any, spectrum: np.ndarray, starts: Sequence[Start], speed: tuple[float, float] | None = None
) -> list[Refined]:
    """Minimise the largest norm of the periodic deflection over the angle, and over the speed if it is free.

    field: CasADi function A -> m, c, k (3 each), world axes; spectrum (h + 1, 3): force by harmonics of the spindle,
    world coordinates; starts: initial values with limits of the angle, one result each; speed: least and greatest
    [1/s]; default: fixed to that of each start. One variable bounds the norm at SAMPLES angles (epigraph form) and is
    minimised. Raises ValueError for a start outside its limits or a speed that is not positive.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robots = gt.milling.Oscillators.with_damping_ratio([[350] * 3] * 2, [[2e6] * 3, [3e6] * 3], [[0.03] * 3] * 2)
    >>> table = gt.milling.AngleTable(np.radians([0.0, 60.0]), robots)
    >>> spectrum = gt.milling.force_spectrum(cutter, cut, 16) @ gt.milling.to_world(np.eye(3), feed=[1.0, 0.0, 0.0])
    >>> start = gt.milling.Start(angle=np.radians(30.0), low=0.0, high=np.radians(60.0), speed=25.0)
    >>> (best,) = gt.milling.refine(table.casadi_function(), spectrum, [start])
    >>> round(np.degrees(best.angle), 1), best.converged  # the stiffer end
    (np.float64(60.0), True)
    """
    for start in starts:
        low, high = speed or (start.speed, start.speed)
        if not start.low <= start.angle <= start.high or not 0 < low <= start.speed <= high:
            raise ValueError(
                f"the start at {np.rad2deg(start.angle):g} deg and {60 * start.speed:g} rpm is outside "
                f"{np.rad2deg(start.low):g} to {np.rad2deg(start.high):g} deg, {60 * low:g} to {60 * high:g} rpm"
            )
    v = ca.SX.sym("v", 3)  # angle [rad], spindle in 100 rad/s, bound on the squared norm [mm2]
    squares = 1e6 * _squared_norm(field, spectrum, v[0], 100 * v[1])
    level = ca.Function("level", [v], [ca.mmax(squares)])
    problem = {"x": v, "f": v[2], "g": squares - v[2]}
    solver = ca.nlpsol("refine", "ipopt", problem, {**QUIET, "error_on_fail": False})
    unit, refined = 2 * np.pi / 100, []
    for start in starts:
        low, high = speed or (start.speed, start.speed)
        x0 = [start.angle, unit * start.speed, 0.0]
        x0[2] = float(level(x0))
        ends = {"lbx": [start.low, unit * low, 0], "ubx": [start.high, unit * high, ca.inf]}
        best = np.asarray(solver(x0=x0, **ends, lbg=-ca.inf, ubg=0)["x"]).ravel()
        angle, turning = np.clip(best[0], start.low, start.high), np.clip(best[1] / unit, low, high)
        peak = 1e-3 * float(np.sqrt(float(level([angle, unit * turning, 0.0]))))
        refined.append(Refined(float(angle), float(turning), peak, bool(solver.stats()["success"])))
    return refined


def _squared_norm(field: Any, spectrum: np.ndarray, A: ca.SX, w: ca.SX) -> ca.SX:
    """Return |x|^2 [m2] at SAMPLES angles of the turn, from the strongest harmonics."""
    m, c, k = field(A)
    strongest = np.argsort(-np.abs(spectrum[1:]).max(axis=1), kind="stable")[:HARMONICS] + 1
    theta = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    x = ca.repmat((ca.DM(np.real(spectrum[0])) / k).T, SAMPLES, 1)
    for n in np.sort(strongest):
        stiff, damped = k - m * (n * w) ** 2, c * n * w
        size = stiff**2 + damped**2
        real, imaginary = ca.DM(np.real(spectrum[n])), ca.DM(np.imag(spectrum[n]))
        X, Y = (real * stiff + imaginary * damped) / size, (imaginary * stiff - real * damped) / size
        x += 2 * (ca.DM(np.cos(n * theta)) @ X.T - ca.DM(np.sin(n * theta)) @ Y.T)
    return ca.sum2(x**2)


SOFTEST_PA = 1e4  # least plausible cutting coefficient
LARGEST_M = 1.0  # largest plausible cutter and depths


@dataclass(frozen=True, eq=False)
class MillingTask:
    """Checked inputs of a study."""

    model: Any
    arm: Chain
    limits: np.ndarray
    cutter: Cutter
    cut: Cut
    speed: float
    feed: np.ndarray
    place: list[float]
    joint_compliance: np.ndarray
    tool: MillingTool
    search: MillingSearch
    title: str
    given: Given | None
    dynamics: Callable[..., Dynamics] | None
    whence: str | None  # description of the source of the dynamics

    @property
    def up(self) -> np.ndarray:
        """Direction (3,) against the tool axis, world coordinates."""
        return -np.array(self.tool.axis)

    @property
    def heading(self) -> str:
        """The title of pictures, with a remark if the dynamics are synthetic."""
        synthetic = self.whence and self.whence.partition("synthetic: ")[2]
        return (self.title or "milling") + (f"\n(synthetic dynamics: {synthetic})" if synthetic else "")


@dataclass(frozen=True, eq=False)
class MillingPlace:
    """One place of the tool: sweep; compliance, solution and static index [m] of each angle (NaN: unreachable) with the
    task's feed; and dynamics."""

    sweep: AngleSweep
    compliance: np.ndarray
    solution: np.ndarray
    static: np.ndarray
    dynamics: Dynamics | None

    def spread(self, value: np.ndarray) -> np.ndarray:
        """Return values of the rows with dynamics, by angle; NaN elsewhere."""
        values = np.full(len(self.sweep.angles), np.nan)
        if self.dynamics is not None:
            values[self.dynamics.rows] = value
        return values


def task_of(
    robot: Model, cutter: Cutter, cut: Cut, *, place: Sequence[float], speed: float, feed: Sequence[float],
    joint_stiffness: Sequence[float], dynamics: Given | None, tool: MillingTool, search: MillingSearch,
    limits: Sequence[Sequence[float]] | None, source: str, title: str,
) -> MillingTask:  # fmt: skip
    """Check the inputs of a study. Raises ArgumentError."""
    _plausible(cutter, cut)
    with naming("cut.radial_depth", ValueError):
        immersion(cut.mode, cut.radial_depth, cutter.diameter)
    for n, turns in enumerate([speed, *search.speeds]):
        name = "speed" if n == 0 else f"search.speeds[{n - 1}]"
        with naming(name, ValueError):
            tooth_frequency(turns, cutter.teeth)
            samples_per_turn(turns, cutter.teeth, duration(turns))
    up = -np.array(tool.axis)
    for n, direction in enumerate([feed, *search.feed_directions]):
        name = "feed" if n == 0 else f"search.feed_directions[{n - 1}]"
        with naming(name, ValueError):
            to_world(np.zeros(3), direction, up)
    model: Any = robot
    arm = chain_of(model, named=True)
    joint_limits = getattr(model, "joint_limits", None)
    if limits is not None:
        joint_limits = np.array(_six(limits), float)
    if joint_limits is None:
        raise ArgumentError("is missing; expected lower and upper limits of six joints", "limits")
    stiffness = np.array(joint_stiffness, float)
    compliance = 1e-6 / (stiffness / 1e6)  # tables have 1e-6 / 3.93, which differs from 1 / 3.93e6 by rounding
    return MillingTask(
        model, arm, joint_limits, cutter, cut, speed, np.array(feed, float), list(place), compliance, tool, search,
        title, dynamics, *dynamics_of(dynamics, source),
    )  # fmt: skip


def _plausible(cutter: Cutter, cut: Cut) -> None:
    """Raise ArgumentError for values that are probably in millimetres instead of metres, or N/mm2 instead of Pa."""
    K_tc = cutter.coefficients.K_tc
    if 0 <= K_tc < SOFTEST_PA:
        raise ArgumentError(
            f"is {K_tc:g} Pa; expected more than {SOFTEST_PA:g} Pa, as for the softest foam: 1 N/mm2 is 1e6 Pa",
            "cutter.coefficients.K_tc",
        )
    lengths = {
        "cutter.diameter": (cutter.diameter, LARGEST_M), "cut.radial_depth": (cut.radial_depth, LARGEST_M),
        "cut.axial_depth": (cut.axial_depth, LARGEST_M),
        "cut.feed_per_tooth": (cut.feed_per_tooth, cutter.diameter / 2),
    }  # fmt: skip
    for name, (value, most) in lengths.items():
        if value >= most:
            raise ArgumentError(f"is {value:g} m; expected less than {most:g} m: use metres, not millimetres", name)


def place_of(task: MillingTask, place: Sequence[float]) -> MillingPlace:
    """Compute sweep, static index and dynamics at one place. Raises ArgumentError, also if no angle is reachable."""
    n = max(2, round(2 * np.pi / task.search.step) + 1)
    sweep = sweep_of(task, place, np.linspace(-np.pi, np.pi, n))
    if not sweep.reachable.any():
        reason = "joint limits forbid every angle" if sweep.in_reach.any() else "it is out of reach"
        message = f"the tool cannot reach {_list(place)} m at any angle: {reason}; move the work or the tool"
        raise ArgumentError(message, "place")
    try:
        poses = arm_poses(task.model, sweep.q, task.tool.tcp)
        C = translational_compliance(poses.J, task.joint_compliance)
        index = static_index(C, task.cutter, task.cut, task.feed, up=task.up)
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(str(error), "place") from error
    static, solution = sweep.least(index)
    by_angle = np.full((n, 3, 3), np.nan)
    by_angle[sweep.reachable] = C[solution[sweep.reachable]]
    branch = np.where(solution >= 0, sweep.branch[solution], -1)
    dynamics = None
    if task.dynamics is not None:
        dynamics = task.dynamics(sweep.angles, sweep.reachable, by_angle, branch, np.array(place))
    return MillingPlace(sweep, by_angle, solution, static, dynamics)


def sweep_of(task: MillingTask, place: Any, angles: Any) -> AngleSweep:
    """Return all branches at angles [rad]. Raises ArgumentError for a zero direction."""
    t = task.tool
    with naming("tool", ValueError):
        return angle_sweep(
            task.arm, task.limits, place, axis=t.axis, tool=t.tcp, spindle=t.spindle, angles=angles, zero=t.zero
        )


def deflections_of(
    task: MillingTask, oscillators: Oscillators, *, speed: float | None = None, feed: Any = None
) -> Deflection:
    """Return the deflections of all poses of the oscillators; speed, feed: default those of the task."""
    return deflections(
        oscillators, task.cutter, task.cut, task.speed if speed is None else speed,
        task.feed if feed is None else feed, up=task.up,
    )  # fmt: skip


def refined(
    task: MillingTask, place: MillingPlace, peak: np.ndarray, speed: tuple[float, float] | None = None
) -> list[Refined]:
    """Refine the best `search.refine` grid angles with an NLP that minimises the steady part of the dynamic index.

    speed: least and greatest [1/s] of a free speed; the angle is then free over the whole interval of known dynamics.
    Returns only angles that some branch reaches. peak (n,): dynamic index on the grid.
    """
    dynamics = place.dynamics
    assert dynamics is not None
    spectrum = force_spectrum(task.cutter, task.cut, 60 * task.cutter.teeth)
    world = to_world(np.real(spectrum), task.feed, task.up) + 1j * to_world(np.imag(spectrum), task.feed, task.up)
    angles, rows = place.sweep.angles, []
    step = 2 * (angles[1] - angles[0])
    starts: dict[Any, list[Start]] = {}  # one NLP for all starts on the same curve
    for row in _minima(peak)[: task.search.refine]:
        try:
            curve, low, high = dynamics.smooth(row)
        except ValueError:
            continue  # an isolated angle cannot be refined
        # shift by whole turns to where the curve is known
        shifted = angles[row] if low <= angles[row] <= high else low + (angles[row] - low) % (2 * np.pi)
        angle = float(np.clip(shifted, low, high))
        ends = (max(low, angle - step), min(high, angle + step)) if speed is None else (low, high)
        begin = task.speed if speed is None else float(np.clip(task.speed, *speed))
        starts.setdefault(curve, []).append(Start(angle, *ends, begin))
    for best in [b for curve, begin in starts.items() for b in refine(curve, world, begin, speed)]:
        sweep = sweep_of(task, task.place, [best.angle])
        if sweep.reachable[0]:
            d = deflections_of(task, dynamics.at(best.angle), speed=best.speed)
            rows.append(replace(best, peak=float(d.peak[0])))
    return rows


def _minima(value: np.ndarray) -> list[int]:
    """Return the rows of local minima, least first; neighbours without a value count as higher."""
    padded = np.concatenate([[np.inf], np.where(np.isfinite(value), value, np.inf), [np.inf]])
    low = np.isfinite(value) & (padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:])
    rows = np.flatnonzero(low)
    return [int(r) for r in rows[np.argsort(value[rows], kind="stable")]]


def _six(limits: Sequence[Sequence[float]]) -> Sequence[Sequence[float]]:
    if len(limits) != 6 or any(len(row) != 2 or row[0] >= row[1] for row in limits):
        raise ArgumentError("expected six pairs of lower and upper limit", "limits")
    return limits


def _list(numbers: Any) -> str:
    return ", ".join(f"{x:.4g}" for x in numbers)
