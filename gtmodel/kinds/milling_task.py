"""Cutter, cut and arm of a milling problem, and its search over angles, places, feeds and speeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gtmodel.compliance import arm_poses, translational_compliance
from gtmodel.kinematics import WristPartition
from gtmodel.milling import (
    AngleSweep,
    Coefficients,
    Cut,
    Cutter,
    Deflection,
    Oscillators,
    Start,
    angle_sweep,
    deflections,
    force_spectrum,
    immersion,
    refine,
    static_index,
    to_world,
    tooth_frequency,
)  # fmt: skip
from gtmodel.milling.deflection import duration, samples_per_turn
from gtmodel.problem_files.base import Context, InputError

from .milling_dynamics import Dynamics, source
from .milling_keys import Schema

SOFTEST_PA = 1e4  # of cutting coefficients
LARGEST_M = 1.0  # of a cutter and its depths


@dataclass(frozen=True, eq=False)
class Task:
    """What a problem declares, ready to compute with."""

    model: Any
    arm: WristPartition
    limits: np.ndarray
    cutter: Cutter
    cut: Cut
    speed: float
    feed: np.ndarray
    up: np.ndarray
    dynamics: Callable[..., Dynamics] | None
    whence: str | None  # the dynamics come, in words


@dataclass(frozen=True, eq=False)
class Place:
    """One place of the tool: its sweep, indices (n,) by angle [m] of the task's feed, NaN where there is none, the
    solution behind each angle, and its dynamics."""

    sweep: AngleSweep
    compliance: np.ndarray
    solution: np.ndarray
    static: np.ndarray
    dynamics: Dynamics | None

    def spread(self, value: np.ndarray) -> np.ndarray:
        """Values of the rows with dynamics, by angle; NaN elsewhere."""
        found = np.full(len(self.sweep.angles), np.nan)
        if self.dynamics is not None:
            found[self.dynamics.rows] = value
        return found


def task_of(problem: Schema, context: Context) -> Task:
    """Raises InputError with the key of what is wrong."""
    c, k = problem.cutter, problem.cut
    coefficients = Coefficients(c.K_te_N_m, c.K_tc_Pa, c.K_re_N_m, c.K_rc_Pa, c.K_ae_N_m, c.K_ac_Pa)
    angles = None if c.tooth_angles_deg is None else np.deg2rad(c.tooth_angles_deg)
    runout = None if c.runout_m is None else np.array(c.runout_m)
    _plausible(problem)
    cutter = _made(
        lambda: Cutter(c.diameter_m, c.teeth, coefficients, np.deg2rad(c.helix_deg), angles, runout), "cutter"
    )
    cut = _made(lambda: Cut(k.mode, k.radial_depth_m, k.axial_depth_m, k.feed_per_tooth_m), "cut")
    _made(lambda: immersion(cut.mode, cut.radial_depth, cutter.diameter), "cut.radial_depth_m")
    for n, rpm in enumerate([k.speed_rpm, *problem.search.speeds_rpm]):
        key = "cut.speed_rpm" if n == 0 else f"search.speeds_rpm[{n - 1}]"
        _made(lambda rpm=rpm: tooth_frequency(rpm / 60, cutter.teeth), key)
        _made(lambda rpm=rpm: samples_per_turn(rpm / 60, cutter.teeth, duration(rpm / 60)), key)
    up = -np.array(problem.tool.axis)
    for n, feed in enumerate([k.feed_direction, *problem.search.feed_directions]):
        key = "cut.feed_direction" if n == 0 else f"search.feed_directions[{n - 1}]"
        _made(lambda feed=feed: to_world(np.zeros(3), feed, up), key)
    model: Any = problem.model(context)
    limits = getattr(model, "joint_limits", None)
    if problem.limits_deg is not None:
        limits = np.deg2rad(np.array(_six(problem.limits_deg)))
    if limits is None:
        raise InputError("is missing; expected lower and upper limit of six joints, in deg", "limits_deg")
    try:
        arm = WristPartition.of(model.origins, model.axes)
    except (ValueError, AttributeError) as error:
        raise InputError(f"expected a serial arm with a spherical wrist such as kr500; {error}", "robot") from error
    return Task(model, arm, limits, cutter, cut, k.speed_rpm / 60, np.array(k.feed_direction), up,
                *source(problem, context))  # fmt: skip


def _plausible(problem: Schema) -> None:
    """Raises InputError for millimetres in place of metres and N/mm2 in place of pascals."""
    c, k = problem.cutter, problem.cut
    if 0 <= c.K_tc_Pa < SOFTEST_PA:
        raise InputError(
            f"is {c.K_tc_Pa:g} Pa; the softest foam takes more than {SOFTEST_PA:g} Pa: 1 N/mm2 is 1e6 pascals",
            "cutter.K_tc_Pa",
        )
    lengths = {
        "cutter.diameter_m": (c.diameter_m, LARGEST_M), "cut.radial_depth_m": (k.radial_depth_m, LARGEST_M),
        "cut.axial_depth_m": (k.axial_depth_m, LARGEST_M),
        "cut.feed_per_tooth_m": (k.feed_per_tooth_m, c.diameter_m / 2),
    }  # fmt: skip
    for key, (value, most) in lengths.items():
        if value >= most:
            raise InputError(f"is {value:g} m; expected less than {most:g} m, so give metres, not millimetres", key)


def title_of(problem: Schema, task: Task) -> str:
    """For pictures; says where dynamics are made up."""
    made_up = task.whence and task.whence.partition("synthetic: ")[2]
    return (problem.title or "milling") + (f"\n(synthetic dynamics: {made_up})" if made_up else "")


def place_of(problem: Schema, task: Task, place: list[float], feed: Any = None) -> Place:
    """Sweep, static index and dynamics at one place. Raises ValueError where no angle is reachable."""
    n = max(2, round(360 / problem.search.step_deg) + 1)
    angles = np.linspace(-np.pi, np.pi, n)
    tool = problem.tool
    sweep = sweep_of(problem, task, place, angles)
    if not sweep.reachable.any():
        why = "joint limits forbid every angle" if sweep.in_reach.any() else "it is out of reach"
        raise ValueError(f"the tool cannot stand at {_list(place)} m at any angle: {why}; move the work or the tool")
    poses = arm_poses(task.model, sweep.q, tool.tcp_m)
    C = translational_compliance(poses.J, 1e-6 / np.array(problem.joint_stiffness_MNm_rad))
    feed = task.feed if feed is None else feed
    static, solution = sweep.least(static_index(C, task.cutter, task.cut, feed, up=task.up))
    by_angle = np.full((n, 3, 3), np.nan)
    by_angle[sweep.reachable] = C[solution[sweep.reachable]]
    branch = np.where(solution >= 0, sweep.branch[solution], -1)
    dynamics = None
    if task.dynamics is not None:
        dynamics = task.dynamics(sweep.angles, sweep.reachable, by_angle, branch, np.array(place))
    return Place(sweep, by_angle, solution, static, dynamics)


def sweep_of(problem: Schema, task: Task, place: Any, angles: Any) -> AngleSweep:
    """All branches over angles [rad]. Raises InputError for a direction without length."""
    t = problem.tool
    try:
        return angle_sweep(
            task.arm, task.limits, place, axis=t.axis, tool=t.tcp_m, spindle=t.spindle, angles=angles,
            zero=float(np.deg2rad(t.zero_deg)),
        )  # fmt: skip
    except ValueError as error:
        raise InputError(str(error), "tool") from error


def deflections_of(task: Task, dynamics: Dynamics, *, speed: float | None = None, feed: Any = None) -> Deflection:
    """Of all angles with dynamics, of the task's speed and feed unless given."""
    return deflections(
        dynamics.oscillators, task.cutter, task.cut, task.speed if speed is None else speed,
        task.feed if feed is None else feed, up=task.up,
    )  # fmt: skip


def replace_oscillators(dynamics: Dynamics, oscillators: Oscillators) -> Dynamics:
    """The same dynamics with these oscillators in place of the grid's."""
    return Dynamics(np.arange(len(oscillators)), oscillators, dynamics.at, dynamics.smooth)


class Better(NamedTuple):
    """What the NLP made of a grid angle: angle [rad], spindle speed [1/s], dynamic index [m], whether it converged."""

    angle: float
    speed: float
    peak: float
    converged: bool


def refined(
    problem: Schema, task: Task, place: Place, peak: np.ndarray, speed: tuple[float, float] | None = None
) -> list[Better]:
    """The best `search.refine` grid angles after the NLP, which minimises the steady part of the dynamic index.

    speed: least and greatest [1/s] where it is free; then the angle is too, as far as it is reachable without a gap
    and known. Only angles that some branch reaches are given back. peak (n,): dynamic index on the grid.
    """
    dynamics = place.dynamics
    assert dynamics is not None
    spectrum = force_spectrum(task.cutter, task.cut, 60 * task.cutter.teeth)
    world = to_world(np.real(spectrum), task.feed, task.up) + 1j * to_world(np.imag(spectrum), task.feed, task.up)
    angles, found = place.sweep.angles, []
    step = 2 * (angles[1] - angles[0])
    starts: dict[Any, list[Start]] = {}  # one NLP for all starts on the same curve
    for row in _minima(peak)[: problem.search.refine]:
        try:
            curve, low, high = dynamics.smooth(row)
        except ValueError:
            continue  # an angle that stands alone has nothing to be refined on
        # the same angle, by whole turns, where the curve is known
        turned = angles[row] if low <= angles[row] <= high else low + (angles[row] - low) % (2 * np.pi)
        at = float(np.clip(turned, low, high))
        ends = (max(low, at - step), min(high, at + step)) if speed is None else (low, high)
        begin = task.speed if speed is None else float(np.clip(task.speed, *speed))
        starts.setdefault(curve, []).append(Start(at, *ends, begin))
    for best in [b for curve, begin in starts.items() for b in refine(curve, world, begin, speed)]:
        held = sweep_of(problem, task, problem.place_m, [best.angle])
        if held.reachable[0]:
            d = deflections(dynamics.at(best.angle), task.cutter, task.cut, best.speed, task.feed, up=task.up)
            found.append(Better(best.angle, best.speed, float(d.peak[0]), best.converged))
    return found


def _minima(value: np.ndarray) -> list[int]:
    """Rows of local minima, least first; neighbours without a value count as higher."""
    padded = np.concatenate([[np.inf], np.where(np.isfinite(value), value, np.inf), [np.inf]])
    low = np.isfinite(value) & (padded[1:-1] <= padded[:-2]) & (padded[1:-1] <= padded[2:])
    rows = np.flatnonzero(low)
    return [int(r) for r in rows[np.argsort(value[rows], kind="stable")]]


def _made(make: Callable[[], Any], key: str) -> Any:
    try:
        return make()
    except ValueError as error:
        raise InputError(str(error), key) from error


def _six(limits: list[list[float]]) -> list[list[float]]:
    if len(limits) != 6 or any(len(row) != 2 or row[0] >= row[1] for row in limits):
        raise InputError("expected six pairs, lower limit before upper, in deg", "limits_deg")
    return limits


def _list(numbers: Any) -> str:
    return ", ".join(f"{x:.4g}" for x in numbers)
