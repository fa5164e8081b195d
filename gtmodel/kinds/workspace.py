"""Kind "workspace": which tool centre points a robot reaches, and the cross-section and volume of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from gtmodel.kinematics.mechanism import Mechanism, home_figure
from gtmodel.kinematics.workspace import (
    REACHABLE,
    BallJointCones,
    Reach,
    SectionMap,
    Volume,
    map_section,
    map_volume,
)
from gtmodel.kinematics.workspace.volume import MOST
from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, Section, at_most
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.section_keys import SectionKeys
from gtmodel.problem_files.sentences import listed
from gtmodel.results import SolveStatus

from .workspace_limits import Angle, Beam, Bodies, Box, Limits, Point, limited_mechanism, limits_of, refuse_disordered

NAME = "workspace"

VALUES = {
    "area_m2": "area of the cross-section that is reached under all limits",
    "width_m": "its width",
    "height_m": "its height",
    "kinematic_area_m2": "area where the inverse kinematics has a solution, all limits left out but singularities",
    "kinematic_width_m": "its width",
    "kinematic_height_m": "its height",
    "cones": "for each angle of compare_cones_deg: angle_deg, area_m2, width_m, height_m under ball-joint cones alone",
    "guideway_rectangle_m2": "area of the upright rectangle that the guideways span in the section: the footprint",
    "area_ratio": "area_m2 to that footprint",
    "volume_m3": "volume of the workspace along the guideways; null without [volume]",
    "volume_error_m3": "its error as the sections tell it; null without [volume], and where none is reached",
    "volume_sections": "number of sections that were mapped for it",
    "volume_ratio": "volume_m3 to the footprint times the longest stroke of limits.actuators_m; null without them",
    "reasons": "number of grid points of the section by reason, the first limit that fails",
    "points": "for each of points_m: tcp_m, reachable, sentence",
    "on_edge": "whether the cross-section reaches the edge of the grid and is cut off there",
    "volume_on_edge": "whether the volume reaches the first or last section, or the edge of one; null without [volume]",
    "assumptions": "what was assumed about joints and bodies, in sentences",
}

# relative change of the area when the step is doubled: boundary crossings are bisected, the rest is of second order
CONVERGENCE = 0.01
FINER = "use a smaller section.step_m"
VOLUME = 0.01  # of the volume: its error by the sections, and its change when the step is doubled
# relative: the same polygons by cells and by loops
POLYGONS = 1e-9
MOST_POINTS = 2.5e7  # of a section, some 500 MB
FEW = 10  # steps across the section; a section not reached at so few points may be reached between them


class VolumeKeys(Section):
    """Sections between two positions along the guideways."""

    low_m: float = Field(description="first position along the guideways")
    high_m: float = Field(description="last position along the guideways")
    sections: int = Field(default=21, ge=2, le=10000, description="number of sections to begin with")
    tolerance: float = Field(
        default=VOLUME, gt=0, lt=1, description="of the volume; sections are added until their error is below"
    )
    most_sections: int = Field(default=MOST, ge=3, le=10000, description="number of sections at most")


class Schema(RobotProblem):
    """Workspace of a robot whose plate keeps its orientation or follows from T."""

    home_m: Point | None = Field(default=None, description="pose of the cone axes; the robot's own home if left out")
    compare_cones_deg: list[Angle] = Field(default=[], description="cones to report beside the limits in force")
    points_m: list[Point] = Field(default=[], description="points to judge one by one")
    section: SectionKeys = SectionKeys()
    volume: VolumeKeys | None = Field(default=None)
    limits: Limits = Limits()
    bodies: Bodies = Bodies()
    obstacles: list[Box] = Field(default=[], description="boxes that links and plate must not touch")
    beams: list[Beam] = Field(default=[], description="beams of the frame that links must not touch")


class _Stopped(Exception):
    """The work was interrupted."""


def solve(problem: Schema, context: Context) -> Outcome:
    """Map the section, with and without limits, then the volume."""
    if context.start is not None:
        raise InputError("--start: a workspace is mapped from the beginning; leave it out")
    robot = limited_mechanism(problem.model(context), problem.home_m, problem.bodies)
    reach = Reach(robot.inverse, limits_of(problem.limits, problem.bodies, problem.obstacles, problem.beams, robot))
    section = robot.section(problem.section.along_m)
    low, high = _window(problem, robot, section)
    step = problem.section.step_m

    def mapped(chosen: Reach, stage: str, size: float = step) -> SectionMap:
        def progress(fraction: float) -> bool:
            context.progress(stage, fraction)
            return context.interrupted()

        found = map_section(chosen, section, low, high, size, progress=progress)
        if not found.complete or context.interrupted():
            raise _Stopped
        return found

    singular = reach.limits[:1]
    bare, cones = None, {}
    try:
        bare = mapped(Reach(robot.inverse, singular), "inverse kinematics")
        for angle in problem.compare_cones_deg:
            cone = BallJointCones.about_home(robot.home, np.radians(angle))
            cones[angle] = mapped(Reach(robot.inverse, [*singular, cone]), f"cones of {angle:g} deg")
        main = mapped(reach, "workspace")
        coarse = mapped(reach, "coarse grid", 2 * step)
        volume = _volume(problem, context, reach, section, low, high)
    except _Stopped:
        finished = {} if bare is None else {f"kinematic_{key}": value for key, value in _sizes(bare).items()}
        finished |= {"cones": _cones(cones)} if cones else {}
        return Outcome(status=SolveStatus.INTERRUPTED, message=SolveStatus.INTERRUPTED.sentence, values=finished)
    return _outcome(problem, robot, reach, main, bare, cones, coarse, volume)


def explain(problem: Schema, context: Context) -> str:
    """The tests in their order, the section and the grid."""
    robot = limited_mechanism(problem.model(context), problem.home_m, problem.bodies)
    reach = Reach(robot.inverse, limits_of(problem.limits, problem.bodies, problem.obstacles, problem.beams, robot))
    section = robot.section(problem.section.along_m)
    low, high = _window(problem, robot, section)
    lines = [
        f"{problem.title or 'workspace'}: section orthogonal to ({listed(section.normal)}), through "
        f"({listed(section.origin)}) m",
        f"  u along ({listed(section.across)}) from {low[0]:.4g} to {high[0]:.4g} m, "
        f"v along ({listed(section.up)}) from {low[1]:.4g} to {high[1]:.4g} m, step {problem.section.step_m:g} m",
        "  a point is tested by, in this order:",
        "    inverse kinematics",
        *(f"    {limit.name}" for limit in reach.limits),
        *(f"  {sentence}" for sentence in reach.assumptions),
    ]
    return "\n".join(lines)


def _window(problem: Schema, robot: Mechanism, section: Any) -> tuple[np.ndarray, np.ndarray]:
    """The part of the section to look at: what all links can reach at most, unless the file says so."""
    keys = problem.section
    points = section.pierced(robot.anchors, robot.directions)
    low, high = robot.farthest(points)
    low = low if keys.low_m is None else np.array(keys.low_m)
    high = high if keys.high_m is None else np.array(keys.high_m)
    refuse_disordered(low, high, "section.high_m")
    if np.any(high - low <= keys.step_m):
        raise InputError(
            f"the section is {high[0] - low[0]:.4g} m by {high[1] - low[1]:.4g} m, so that no point lies within it; "
            f"take a step below {np.min(high - low):.3g} m",
            "section.step_m",
        )
    size = np.prod((high - low) / keys.step_m)
    if size > MOST_POINTS:
        raise InputError(f"the grid would have {size:.1e} points; take a larger step", "section.step_m")
    return low, high


def _volume(
    problem: Schema, context: Context, reach: Reach, section: Any, low: np.ndarray, high: np.ndarray
) -> Volume | None:
    keys = problem.volume
    if keys is None:
        return None
    if keys.low_m >= keys.high_m:
        raise InputError("the first position must be less than the last", "volume.high_m")
    home = float(section.origin @ section.normal)
    if keys.sections > keys.most_sections:
        raise InputError(f"is less than the {keys.sections} sections to begin with", "volume.most_sections")
    along = np.linspace(keys.low_m, keys.high_m, _to_begin_with(problem, section)) - home

    def progress(fraction: float) -> bool:
        context.progress("sections", fraction)
        return context.interrupted()

    volume = map_volume(
        reach, section, low, high, along, problem.section.step_m, tolerance=keys.tolerance / 2, most=keys.most_sections,
        coarse=True, progress=progress,
    )  # fmt: skip
    if not volume.complete:
        raise _Stopped
    return volume


def _to_begin_with(problem: Schema, section: Any) -> int:
    """Number of sections before any is added: as many as the file says, or so many that none of the obstacles fits
    between two of them."""
    keys = problem.volume
    assert keys is not None
    thin = [float(np.ptp(np.array([b.low_m, b.high_m]), axis=0) @ np.abs(section.normal)) for b in problem.obstacles]
    thin += [2 * b.radius_m + abs(float((np.array(b.to_m) - b.from_m) @ section.normal)) for b in problem.beams]
    thin = [t for t in thin if t > 0]
    enough = int(np.ceil((keys.high_m - keys.low_m) / min(thin))) + 1 if thin else 0
    return min(max(keys.sections, enough), keys.most_sections)


def _outcome(
    problem: Schema,
    robot: Mechanism,
    reach: Reach,
    main: SectionMap,
    bare: SectionMap,
    cones: dict[float, SectionMap],
    coarse: SectionMap,
    volume: Volume | None,
) -> Outcome:
    corners = main.section.pierced(robot.anchors, robot.directions)
    rectangle = float(np.prod(np.ptp(corners, axis=0)))
    region = main.region
    strokes = np.ptp(problem.limits.actuators_m or [[0.0, 0.0]], axis=1)
    length = float(np.max(strokes)) * float(np.linalg.norm(robot.directions, axis=1).max())
    points = [
        {"tcp_m": point, "reachable": reach(np.array(point)) == REACHABLE, "sentence": reach.diagnose(np.array(point))}
        for point in problem.points_m
    ]
    no_footprint = rectangle <= 0.0
    values = {
        **_sizes(main),
        **{f"kinematic_{key}": value for key, value in _sizes(bare).items()},
        "cones": _cones(cones),
        "guideway_rectangle_m2": rectangle,
        "area_ratio": None if no_footprint else region.area / rectangle,
        "volume_m3": None if volume is None else volume.volume,
        "volume_error_m3": None if volume is None or not np.isfinite(volume.error) else volume.error,
        "volume_sections": None if volume is None else len(volume.along),
        "volume_ratio": None if volume is None or no_footprint or not length else volume.volume / (rectangle * length),
        "reasons": reach.counts(main.codes),
        "points": points,
        "on_edge": region.on_edge,
        "volume_on_edge": None if volume is None else volume.on_edge,
        "assumptions": _assumptions(problem, robot, reach),
    }
    empty = region.area == 0.0
    checks = {} if empty else _checks(problem, main, coarse, volume)
    cuts = ["the cross-section reaches the edge of the grid and is cut there"] if region.on_edge else []
    if volume is not None and volume.on_edge:
        cuts.append("the volume reaches its first or last section, or the edge of one, and is cut there")
    message = "; ".join(cuts) or SolveStatus.SOLVED.sentence
    if empty:
        most = max(values["reasons"], key=values["reasons"].get)
        message = f"no point of the section is reached; most often: {most}"
        if min(len(main.u), len(main.v)) <= FEW:
            message += f"; it was looked at in {len(main.u)} by {len(main.v)} points only, try a smaller section.step_m"
    return Outcome(
        status=SolveStatus.INFEASIBLE if empty else SolveStatus.SOLVED,
        message=message,
        checks=checks,
        values=values,
        rows=[*_rows_of(values), *(Row("cut", sentence) for sentence in cuts)],
        figures={
            "section": lambda: _section_figure(problem, robot, main, bare, cones, len(reach.limits) > 1),
            "robot": lambda: home_figure(robot, [main.section.points(p) for p in main.region.loops], problem.title),
        },
        files={} if empty else {"boundary.csv": _boundary(main)},
    )


def _sizes(found: SectionMap) -> dict[str, float]:
    width, height = found.region.extent
    return {"area_m2": found.region.area, "width_m": float(width), "height_m": float(height)}


def _cones(cones: dict[float, SectionMap]) -> list[dict[str, float]]:
    return [{"angle_deg": angle, **_sizes(found)} for angle, found in cones.items()]


def _assumptions(problem: Schema, robot: Mechanism, reach: Reach) -> list[str]:
    compared = [BallJointCones.about_home(robot.home, np.radians(a)).assumes for a in problem.compare_cones_deg]
    return list(dict.fromkeys([*reach.assumptions, *compared]))


def _checks(problem: Schema, main: SectionMap, coarse: SectionMap, volume: Volume | None) -> dict[str, Check]:
    area = main.region.area
    change = abs(area - coarse.region.area) / area
    polygons = abs(main.region.area_within_loops - area) / area
    checks = {
        "area_change_at_double_step": at_most(change, CONVERGENCE, FINER),
        "area_within_boundary": at_most(polygons, POLYGONS, FINER),
    }
    if volume is None or problem.volume is None:
        return checks
    found, allowed = volume.volume, problem.volume.tolerance
    none = f"none of {len(volume.along)} sections is reached, {volume.widest:.3g} m apart; move volume.low_m and high_m"
    more = f"allow more than {problem.volume.most_sections} sections by volume.most_sections, or a narrower range"
    rough = abs(found - volume.coarse) / found if found else np.inf
    return checks | {
        "volume_error": at_most(volume.error / found if found else np.inf, allowed, more if found else none),
        "volume_change_at_double_step": at_most(rough, allowed, FINER if found else none),
    }


def _rows_of(values: dict[str, Any]) -> list[Row]:
    rows = [
        Row("cross-section reached", values["area_m2"], "m2"),
        Row("its width", values["width_m"], "m"),
        Row("its height", values["height_m"], "m"),
        Row("where inverse kinematics exists", values["kinematic_area_m2"], "m2"),
    ]
    for cone in values["cones"]:
        rows.append(Row(f"with cones of {cone['angle_deg']:g} deg alone", cone["area_m2"], "m2"))
    rows.append(Row("to the rectangle of the guideways", values["area_ratio"]))
    if values["volume_m3"] is not None:
        rows.append(Row("volume", values["volume_m3"], "m3"))
        rows.append(Row("  its error by the sections", values["volume_error_m3"], "m3"))
        rows.append(Row("  sections", values["volume_sections"]))
        rows.append(Row("to the box of guideways and strokes", values["volume_ratio"]))
    rows += [Row(f"grid points: {reason}", count) for reason, count in values["reasons"].items()]
    rows += [Row("point", point["sentence"]) for point in values["points"]]
    rows += [Row("assumed", sentence) for sentence in values["assumptions"]]
    return rows


def _boundary(main: SectionMap) -> str:
    lines = ["loop,u_m,v_m,x_m,y_m,z_m"]
    for k, loop in enumerate(main.region.loops):
        for uv, xyz in zip(loop, main.section.points(loop), strict=True):
            lines.append(",".join([str(k), *(f"{x:.9g}" for x in (*uv, *xyz))]))
    return "\n".join(lines) + "\n"


def _section_figure(
    problem: Schema,
    robot: Mechanism,
    main: SectionMap,
    bare: SectionMap,
    cones: dict[float, SectionMap],
    limited: bool,
) -> Any:
    from gtmodel.plot.workspace import section_figure

    layers = {f"ball-joint cones of {a:g} deg": found.region for a, found in cones.items()}
    if limited:
        layers["all limits of the file"] = main.region
    layers = dict(sorted(layers.items(), key=lambda layer: -layer[1].area))
    layers = {"inverse kinematics has a solution": bare.region, **layers}
    guideways = main.section.pierced(robot.anchors, robot.directions)
    return section_figure(layers, guideways, title=problem.title, names=main.section.names)
