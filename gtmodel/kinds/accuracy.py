"""Kind "accuracy": the greatest positioning error over a section, from errors of carts and links."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel.compiler.causal import compile_causal
from gtmodel.inference import FALSE_ALARM
from gtmodel.kinematics.accuracy import (
    SIGNS,
    ErrorCase,
    ErrorMap,
    ForwardWithLengths,
    base_point_cloud,
    common_point,
    exact_corners,
    largest,
    length_cloud,
    map_errors,
    parallelepiped,
)
from gtmodel.kinematics.mechanism import Mechanism, home_figure, mechanism_of
from gtmodel.kinematics.section import Section as Plane
from gtmodel.problem_files import section_keys
from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, Section, at_least, at_most
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.section_keys import Pair
from gtmodel.problem_files.sentences import listed
from gtmodel.results import SolveStatus, Status

from .accuracy_cases import Case, describe, errors_of, method_of

NAME = "accuracy"

VALUES = {
    "cases": "for each case: name, errors, method; over the rectangle min_um, max_um, their places min_at_m, max_at_m "
    "in (u, v), centre_um and nearest_guideway to the maximum (from 1); reached_min_um and reached_max_um over all "
    "that is reached; monte_carlo_um and its corner_um at the place of the maximum; and shape, the parallelepiped at "
    "the centre: link_angles_deg, pyramid_angles_deg, faces_um2, longest_diagonal_um",
    "window_m": "the rectangle that the numbers are about: least and greatest (u, v)",
    "guideways_m": "where the guideways pierce the section, (u, v)",
    "section": "the section: a point of it, and its normal",
    "points": "number of grid points in the rectangle, and how many of them have no error, by reason",
}

# relative difference of first-order and exact corners: errors over link lengths, some 1e-4, magnified some times
EXACT = 1e-3
# closed form and Newton for the same corner [m]: rounding of lengths of metres
TWO_ROADS = 1e-9
# a draw may exceed the first-order corners by second-order terms only
ABOVE = 1.001
NEAR = 0.1  # of the corner: how near the farthest draw of many comes at least, or what so few come, see _nearest()


class SectionKeys(section_keys.SectionKeys):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x."""

    step_m: PositiveFloat = Field(default=0.05, description="of the grid")
    low_m: Pair | None = Field(default=None, description="least (u, v); of the guideways if left out")


class MonteCarlo(Section):
    """Synthetic errors beside the corners."""

    samples: int = Field(default=20000, ge=100, le=1000000, description="draws for each case")
    seed: int = Field(default=1, ge=0, description="of the random numbers")


class Schema(RobotProblem):
    """Accuracy of a three-link robot."""

    section: SectionKeys = SectionKeys()
    method: Literal["support", "projection"] = Field(
        default="support",
        description="how ellipsoids become corners: exact first-order bound, or the iteration of Dressler 2012, A.2",
    )
    cases: list[Case] = Field(min_length=1, description="errors to look at, one after the other")
    monte_carlo: MonteCarlo = MonteCarlo()

    def resolved(self) -> list[Case]:
        """The cases, each with its method."""
        return [case.model_copy(update={"method": case.method or self.method}) for case in self.cases]


@dataclass
class _Study:
    """What is common to all cases."""

    robot: Mechanism
    plane: Plane
    corners: np.ndarray  # (3, 2) of the guideways
    low: np.ndarray
    high: np.ndarray
    u: np.ndarray
    v: np.ndarray
    T: np.ndarray
    window: np.ndarray  # (n,) which points lie in the rectangle


@dataclass
class _Found:
    """One case with its results."""

    case: Case
    errors: ErrorCase
    map: ErrorMap
    values: dict[str, Any]
    checks: dict[str, Check]


def solve(problem: Schema, context: Context) -> Outcome:
    """Map every case over all that is reached, and test it by other roads."""
    if context.start is not None:
        raise InputError("--start: an accuracy map is computed from the beginning; leave it out")
    study = _study(problem, context)
    found = []
    for k, case in enumerate(problem.resolved()):
        errors = errors_of(case, k, study.robot)

        def progress(fraction: float, name: str = case.name) -> bool:
            context.progress(name, fraction)
            return context.interrupted()

        errors_map = map_errors(errors, _base_points(study.robot), study.T, progress=progress)
        if not errors_map.complete or context.interrupted():
            return Outcome(
                status=SolveStatus.INTERRUPTED,
                message=SolveStatus.INTERRUPTED.sentence,
                values={"cases": [f.values for f in found]},
            )
        good = study.window & (errors_map.status == Status.OK)
        if not good.any():
            reasons = _reasons(errors_map.status[study.window])
            most = max(reasons, key=lambda reason: reasons[reason])
            return Outcome(
                status=SolveStatus.INFEASIBLE, message=f"no point of the rectangle has an error; most often: {most}"
            )
        found.append(_judge(problem, study, case, errors, errors_map, good))
    return _outcome(problem, study, found)


def explain(problem: Schema, context: Context) -> str:
    """The section, the rectangle, and each case with its method."""
    study = _study(problem, context)
    lines = [
        f"{problem.title or 'accuracy'}: section orthogonal to ({listed(study.plane.normal)}), through "
        f"({listed(study.plane.origin)}) m",
        f"  rectangle from (u, v) = ({listed(study.low)}) to ({listed(study.high)}) m, "
        f"step {problem.section.step_m:g} m",
    ]
    for k, case in enumerate(problem.resolved()):
        errors_of(case, k, study.robot)
        lines.append(f"  {case.name}: {describe(case)}")
    lines.append(f"  beside them {problem.monte_carlo.samples} synthetic draws, seed {problem.monte_carlo.seed}")
    return "\n".join(lines)


def _study(problem: Schema, context: Context) -> _Study:
    robot = mechanism_of(problem.model(context))
    if len(robot.lengths) != 3 or not robot.length_names:
        raise InputError(
            f"accuracy is defined for three links with lengths of their own; found {len(robot.lengths)}", "robot"
        )
    words = [_word(case.name) for case in problem.cases]
    for k, word in enumerate(words):
        if word in words[:k]:
            raise InputError(
                f"two cases are called '{problem.cases[k].name}'; give them different names", f"cases[{k}].name"
            )
    keys = problem.section
    plane = robot.section(keys.along_m)
    corners = plane.pierced(robot.anchors, robot.directions)
    low = corners.min(axis=0) if keys.low_m is None else np.array(keys.low_m)
    high = corners.max(axis=0) if keys.high_m is None else np.array(keys.high_m)
    if np.any(low >= high):
        raise InputError("every lower limit must be less than its upper one", "section.high_m")
    least, greatest = robot.farthest(corners)
    outer_low, outer_high = np.minimum(low, least), np.maximum(high, greatest)
    u, v = (_through(low[k], high[k], outer_low[k], outer_high[k], keys.step_m) for k in range(2))
    if len(u) * len(v) > 1e7:
        raise InputError(f"the grid would have {len(u) * len(v):.1e} points; take a larger step", "section.step_m")
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    rounding = 1e-9 * keys.step_m
    window = np.all((uv >= low - rounding) & (uv <= high + rounding), axis=1)
    return _Study(robot, plane, corners, low, high, u, v, plane.points(uv), window)


def _through(low: float, high: float, outer_low: float, outer_high: float, step: float) -> np.ndarray:
    """Evenly spaced values with low and high among them, on to the outer ones."""
    count = max(1, int(np.ceil((high - low) / step - 1e-9)))
    size = (high - low) / count
    first, last = int(np.floor((outer_low - low) / size)), int(np.ceil((outer_high - low) / size))
    return low + size * np.arange(first, last + 1)


def _base_points(robot: Mechanism) -> Any:
    def found(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses = robot.inverse(T)
        return poses.a, poses.status

    return found


def _judge(problem: Schema, study: _Study, case: Case, errors: ErrorCase, found: ErrorMap, good: np.ndarray) -> _Found:
    """Values of one case, and its corners by the robot's equations, by Newton, and by drawing."""
    robot, T = study.robot, study.T
    where = np.flatnonzero(good)
    top, least = where[np.argmax(found.error[good])], where[np.argmin(found.error[good])]
    reached = found.error[found.status == Status.OK]
    centre = study.plane.points(((study.low + study.high) / 2)[None])
    poses = robot.inverse(np.concatenate([T[[top]], centre]))
    corners, _ = errors.corners(poses.a, poses.T)
    at = largest(corners)
    top_uv = study.plane.coordinates(T[[top]])[0]
    half = errors.half_widths(poses.directions)
    draws = problem.monte_carlo
    arguments = (poses.a[0], poses.T[0], robot.lengths)
    try:
        if errors.ellipsoids is None:
            cloud = length_cloud(*arguments, half[0], draws.samples, draws.seed)
        else:
            cloud = base_point_cloud(*arguments, errors.ellipsoids, draws.samples, draws.seed)
        drawn = float(np.linalg.norm(cloud, axis=1).max())
    except ValueError:  # too close to a singularity: the check fails and says so
        drawn = np.nan
    shape = parallelepiped(poses.directions[1:], half[1:])
    values = {
        "name": case.name,
        "errors": describe(case),
        "method": method_of(case),
        "min_um": 1e6 * float(found.error[least]),
        "min_at_m": study.plane.coordinates(T[[least]])[0].tolist(),
        "max_um": 1e6 * float(found.error[top]),
        "max_at_m": top_uv.tolist(),
        "nearest_guideway": 1 + int(np.argmin(np.linalg.norm(study.corners - top_uv, axis=1))),
        "centre_um": 1e6 * float(at[1]),
        "reached_min_um": 1e6 * float(reached.min()),
        "reached_max_um": 1e6 * float(reached.max()),
        "monte_carlo_um": 1e6 * drawn,
        "corner_um": 1e6 * float(at[0]),
        "shape": {
            "link_angles_deg": np.degrees(shape.link_angles[0]).tolist(),
            "pyramid_angles_deg": np.degrees(shape.pyramid_angles[0]).tolist(),
            "faces_um2": (1e12 * shape.faces[0]).tolist(),
            "longest_diagonal_um": 1e6 * float(shape.longest[0]),
        },
    }
    checks = _checks(study, errors, found, good, drawn / float(at[0]), draws.samples)
    return _Found(case, errors, found, values, {f"{_word(case.name)}_{name}": check for name, check in checks.items()})


def _checks(
    study: _Study, errors: ErrorCase, found: ErrorMap, good: np.ndarray, drawn: float, samples: int
) -> dict[str, Check]:
    robot = study.robot
    forward = ForwardWithLengths(compile_causal(robot.model, known="q", targets="T"), robot.length_names)
    poses = robot.inverse(study.T[good])
    half = errors.half_widths(poses.directions)
    exact, status = exact_corners(forward, poses.q, poses.a, robot.lengths, half)
    newton, met = common_point(
        np.repeat(poses.a, 8, axis=0),
        (robot.lengths + half[:, None] * SIGNS).reshape(-1, 3),
        np.repeat(poses.T, 8, axis=0),
    )
    checks = {}
    all_found = not status.any() and not met.any()
    roads = float(np.max(np.abs(exact - newton.reshape(exact.shape)))) if all_found else np.inf
    checks["closed_form_against_newton_m"] = at_most(roads, TWO_ROADS)
    if errors.ellipsoids is None or errors.method == "support":
        greatest = largest(exact - poses.T[:, None])
        difference = float(np.max(np.abs(found.error[good] / greatest - 1.0))) if all_found else np.inf
        checks["first_order_against_exact"] = at_most(
            difference,
            EXACT,
            "the errors are too large for a first-order analysis, or the rectangle too near to a singular pose",
        )
        least = 1 - max(NEAR, _nearest(samples))
        within = at_most(drawn, ABOVE)
        checks["monte_carlo_to_corner"] = at_least(drawn, least, "raise samples") if drawn < least else within
    return checks


def _nearest(samples: int) -> float:
    """Share of the corner's error that the farthest of so many draws lacks at most, but for a false alarm.

    Each arm's error is drawn evenly from -r to r. With three that count alike, a draw is within the share d of one of
    the two opposite corners with the probability 2 (3 d)^3 / 48.
    """
    return float(np.cbrt(24 * -np.log(FALSE_ALARM) / samples) / 3)


def _outcome(problem: Schema, study: _Study, found: list[_Found]) -> Outcome:
    missing = _reasons(found[0].map.status[study.window])
    values = {
        "cases": [f.values for f in found],
        "window_m": [study.low.tolist(), study.high.tolist()],
        "guideways_m": study.corners.tolist(),
        "section": {"point_m": study.plane.origin.tolist(), "normal": study.plane.normal.tolist()},
        "points": {"in_rectangle": int(study.window.sum()), "without_error": missing},
    }
    checks = {name: check for f in found for name, check in f.checks.items()}
    rows = [Row("rectangle from (u, v)", listed(study.low), "m"), Row("to", listed(study.high), "m")]
    for f in found:
        rows += _rows(f.values)
    message = SolveStatus.SOLVED.sentence
    status = SolveStatus.SOLVED
    lost = [f.case.name for f in found if any(not math.isfinite(check.value) for check in f.checks.values())]
    if lost:
        # the numbers of the first order stand, but no other road leads to them
        status = SolveStatus.FAILED
        message = (
            f"{' and '.join(lost)}: at some points of the rectangle a robot with the greatest errors cannot be "
            "assembled; the errors are too large, or the rectangle too near to the edge of what is reached"
        )
    shape = (len(study.u), len(study.v))
    figures = {f"error_{k + 1}": partial(_error_figure, problem, study, f, shape) for k, f in enumerate(found)}
    figures["faces"] = partial(_faces_figure, problem, study, found)
    low, high = study.low, study.high
    rectangle = study.plane.points(np.array([low, [high[0], low[1]], high, [low[0], high[1]]]))
    figures["robot"] = partial(home_figure, study.robot, [rectangle], problem.title)
    return Outcome(
        status=status, message=message, checks=checks, values=values, rows=rows, figures=figures,
        files={"errors.csv": _table(study, found)},
    )  # fmt: skip


def _rows(values: dict[str, Any]) -> list[Row]:
    name = values["name"]
    u, v = values["max_at_m"]
    return [
        Row(f"{name}: corners by", values["method"]),
        Row(f"{name}: least error in the rectangle", values["min_um"], "um"),
        Row(f"{name}: greatest", values["max_um"], "um"),
        Row(f"{name}: at (u, v)", f"{u:.4g}, {v:.4g}", "m"),
        Row(f"{name}: nearest guideway", values["nearest_guideway"]),
        Row(f"{name}: in the centre", values["centre_um"], "um"),
        Row(f"{name}: over all that is reached, least", values["reached_min_um"], "um"),
        Row(f"{name}: over all that is reached, greatest", values["reached_max_um"], "um"),
        Row(f"{name}: synthetic draws at the greatest", values["monte_carlo_um"], "um"),
    ]


def _word(name: str) -> str:
    return "_".join(re.findall(r"\w+", name)) or "case"


def _reasons(status: np.ndarray) -> dict[str, int]:
    found = np.bincount(np.asarray(status, dtype=int))
    return {Status(code).sentence: int(n) for code, n in enumerate(found) if n and code != Status.OK}


def _table(study: _Study, found: list[_Found]) -> str:
    """Points of the rectangle with the error of every case; empty where there is none."""
    names = [f"error_{k + 1}_um" for k in range(len(found))]
    lines = [",".join(["u_m", "v_m", "x_m", "y_m", "z_m", *names])]
    uv = study.plane.coordinates(study.T)
    for n in np.flatnonzero(study.window):
        errors = [1e6 * f.map.error[n] for f in found]
        cells = [f"{x:.9g}" for x in (*uv[n], *study.T[n])] + [f"{e:.6g}" if np.isfinite(e) else "" for e in errors]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _error_figure(problem: Schema, study: _Study, f: _Found, shape: tuple[int, int]) -> Any:
    from gtmodel.plot.accuracy import error_figure

    title = f"{problem.title or 'accuracy'}: {f.case.name}, {method_of(f.case)}"
    error = f.map.error.reshape(shape)
    return error_figure(
        study.u, study.v, error, study.corners, window=(study.low, study.high), title=title, names=study.plane.names
    )


def _faces_figure(problem: Schema, study: _Study, found: list[_Found]) -> Any:
    from gtmodel.plot.accuracy import faces_figure

    s = np.linspace(0.0, 1.0, 101)
    uv = study.low + s[:, None] * (study.high - study.low)
    T = study.plane.points(uv)
    faces = {f.case.name: map_errors(f.errors, _base_points(study.robot), T).faces for f in found}
    title = "faces of the error's parallelepiped, along the rising diagonal of the rectangle"
    return faces_figure(s * float(np.linalg.norm(study.high - study.low)), faces, title=title)
