"""The workspace study: reachable tool centre points of a robot, in a cross-section and as a volume."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ... import view
from ...lang import Model
from ...results import ArgumentError, Check, SolveStatus, Work, at_most
from ...results.options import Long, Within
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from ..mechanism import home_figure
from ..section import CrossSection
from .limits import BallJointCones
from .options import DEGREE, Beam, Bodies, Box, Sections, WorkspaceLimits, WorkspaceStudy
from .reach import REACHABLE, Reach, WorkspaceTask, task_of
from .volume import SectionMap, Volume, map_section, map_volume

Array = np.ndarray

# relative change of the area if the step is doubled: second order, because boundary crossings are bisected
CONVERGENCE = 0.01
FINER = "use a smaller step of the section"
# relative difference of the area from cells and from boundary loops: rounding
POLYGONS = 1e-9
FEW = 10  # points across the section; with so few, a reachable area between the points may be missed


@study_function
def workspace_study(
    robot: Model,
    limits: WorkspaceLimits | None = None,
    *,
    home: Annotated[Sequence[float] | None, Long(3)] = None,
    section: CrossSection | None = None,
    volume: Sections | None = None,
    bodies: Bodies | None = None,
    obstacles: Sequence[Box] = (),
    beams: Sequence[Beam] = (),
    compare_cones: Annotated[Sequence[float], Within(above=0.0)] = (),
    points: Annotated[Sequence[Sequence[float]], Long(3)] = (),
    **work_options: Unpack[WorkOptions],
) -> WorkspaceStudy:
    """Compute the workspace of a robot under limits: cross-section, boundary, volume, and why points are unreachable.

    Args:
        robot: with links on guideways; the plate's orientation is constant or determined by T.
        limits: limits of the workspace; default: singularities only.
        home: (3,) home pose, which defines the axes of the joint cones [m]; default: the robot's home.
        section: position of the section, and its grid.
        volume: sections of the volume; default: no volume.
        bodies: sizes of links and plate. obstacles, beams: objects that they must not touch.
        compare_cones: half-angles of cones [rad]; each is mapped alone, for comparison.
        points: tool centre points (3,) [m] to test individually.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    After an interruption, the study contains the completed maps. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.kinematics.workspace import CrossSection, WorkspaceLimits
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = gt.kinematics.workspace_study(robot, WorkspaceLimits(cone=0.7), section=CrossSection(step=0.1))
    >>> s.area < s.kinematic_area
    True
    """
    work = Work(**work_options)
    limits, section, bodies = limits or WorkspaceLimits(), section or CrossSection(), bodies or Bodies()
    task = task_of(robot, limits, home, section, bodies, obstacles, beams)
    if volume is not None:
        _refuse_range(volume)
    maps = _Maps(task, section.step, work)
    singular = task.reach.limits[:1]
    bare, cones = None, {}
    try:
        bare = maps(Reach(task.robot.inverse, singular), "inverse kinematics")
        for angle in compare_cones:
            cone = BallJointCones.about_home(task.robot.home, angle)
            cones[angle] = maps(Reach(task.robot.inverse, [*singular, cone]), f"cones of {_degrees(angle):g} deg")
        main = maps(task.reach, "workspace")
        coarse = maps(task.reach, "coarse grid", 2 * section.step)
        solid = None if volume is None else maps.volume(volume, _initial_count(volume, task, obstacles, beams))
    except _Stopped:
        return WorkspaceStudy(
            status=SolveStatus.INTERRUPTED, title=work.title, cones=_cones(cones),
            **({} if bare is None else _sizes(bare, "kinematic_")),
        )  # fmt: skip
    return _study_of(work.title, task, limits, points, main, bare, cones, coarse, volume, solid, [*obstacles, *beams])


def _refuse_range(volume: Sections) -> None:
    if volume.low >= volume.high:
        raise ArgumentError("the first position must be less than the last", "volume.high")
    if volume.sections > volume.most_sections:
        raise ArgumentError(f"must be at least {volume.sections}, the number of sections", "volume.most_sections")


class _Stopped(Exception):
    """The work was interrupted."""


@dataclass(frozen=True)
class _Maps:
    """Maps one section or many; raises _Stopped."""

    task: WorkspaceTask
    step: float
    work: Work

    def __call__(self, reach: Reach, stage: str, step: float | None = None) -> SectionMap:
        t = self.task
        section_map = map_section(
            reach, t.section, t.low, t.high, step or self.step, progress=self.work.fractions(stage)
        )
        if not section_map.complete or self.work.interrupted():
            raise _Stopped
        return section_map

    def volume(self, options: Sections, count: int) -> Volume:
        t = self.task
        along = np.linspace(options.low, options.high, count) - float(t.section.origin @ t.section.normal)
        solid = map_volume(
            t.reach, t.section, t.low, t.high, along, self.step, tolerance=options.tolerance / 2,
            most=options.most_sections, coarse=True, progress=self.work.fractions("sections"),
        )  # fmt: skip
        if not solid.complete:
            raise _Stopped
        return solid


def _initial_count(volume: Sections, task: WorkspaceTask, boxes: Sequence[Box], beams: Sequence[Beam]) -> int:
    """Return the initial number of sections: at least `volume.sections`, and enough that no obstacle fits between two
    of them."""
    normal = task.section.normal
    widths = [float(np.ptp(np.array([b.low, b.high]), axis=0) @ np.abs(normal)) for b in boxes]
    widths += [2 * b.radius + abs(float((np.array(b.to) - b.from_) @ normal)) for b in beams]
    widths = [w for w in widths if w > 0]
    enough = int(np.ceil((volume.high - volume.low) / min(widths))) + 1 if widths else 0
    return min(max(volume.sections, enough), volume.most_sections)


def _study_of(
    title: str,
    task: WorkspaceTask,
    limits: WorkspaceLimits,
    points: Sequence[Sequence[float]],
    main: SectionMap,
    bare: SectionMap,
    cones: dict[float, SectionMap],
    coarse: SectionMap,
    volume: Sections | None,
    solid: Volume | None,
    obstacles: Sequence[Box | Beam],
) -> WorkspaceStudy:
    robot, reach, region = task.robot, task.reach, main.region
    rectangle = float(np.prod(np.ptp(main.section.pierced(robot.anchors, robot.directions), axis=0)))
    footprint = rectangle if rectangle > 0.0 else None
    strokes = np.ptp(limits.actuators or [[0.0, 0.0]], axis=1)
    length = float(np.max(strokes)) * float(np.linalg.norm(robot.directions, axis=1).max())
    cone_assumptions = [BallJointCones.about_home(robot.home, angle).assumes for angle in cones]
    reasons = reach.counts(main.codes)
    empty = region.area == 0.0
    study = WorkspaceStudy(
        status=SolveStatus.SOLVED,
        title=title,
        **_sizes(main),
        **_sizes(bare, "kinematic_"),
        cones=_cones(cones),
        guideway_rectangle=rectangle,
        area_ratio=region.area / footprint if footprint else None,
        **({} if solid is None else _volume_values(solid, footprint, length)),
        reasons=reasons,
        points=[
            {"tcp_m": p, "reachable": reach(np.array(p)) == REACHABLE, "sentence": reach.diagnose(np.array(p))}
            for p in points
        ],
        on_edge=region.on_edge,
        assumptions=list(dict.fromkeys([*reach.assumptions, *cone_assumptions])),
        scenes={"workspace": partial(_in_space, title, task, main, obstacles)},
        figures={
            "section": partial(_section_figure, title, task, main, bare, cones),
            "robot": lambda: home_figure(robot, [main.section.points(p) for p in region.loops], title),
        },
    )
    if empty:
        return study.with_(status=SolveStatus.INFEASIBLE, message=_empty_message(main, reasons))
    return study.with_(
        message="; ".join(study.cuts) or SolveStatus.SOLVED.message,
        checks=_checks(main, coarse, volume, solid),
        files={"boundary.csv": _boundary(main)},
    )


def _empty_message(main: SectionMap, reasons: Mapping[str, int]) -> str:
    reason = max(reasons, key=lambda r: reasons[r])
    message = f"no point of the section can be reached; most frequent reason: {reason}"
    if min(len(main.u), len(main.v)) <= FEW:
        message += f"; the grid has only {len(main.u)} by {len(main.v)} points; try a smaller step"
    return message


def _sizes(section_map: SectionMap, prefix: str = "") -> dict[str, Any]:
    width, height = section_map.region.extent
    return {f"{prefix}area": section_map.region.area, f"{prefix}width": float(width), f"{prefix}height": float(height)}


def _cones(cones: dict[float, SectionMap]) -> list[dict[str, float]]:
    units = {"area": "area_m2", "width": "width_m", "height": "height_m"}
    return [
        {"angle_deg": _degrees(angle), **{units[name]: x for name, x in _sizes(section_map).items()}}
        for angle, section_map in cones.items()
    ]


def _degrees(angle: float) -> float:
    """Return an angle [rad] in degrees, rounded for print."""
    return float(f"{angle / DEGREE:.12g}")


def _volume_values(solid: Volume, footprint: float | None, length: float) -> dict[str, Any]:
    return {
        "volume": solid.volume,
        "volume_error": solid.error if np.isfinite(solid.error) else None,
        "volume_sections": len(solid.along),
        "volume_ratio": solid.volume / (footprint * length) if footprint and length else None,
        "volume_on_edge": solid.on_edge,
    }


def _checks(main: SectionMap, coarse: SectionMap, volume: Sections | None, solid: Volume | None) -> dict[str, Check]:
    area = main.region.area
    change = abs(area - coarse.region.area) / area
    polygons = abs(main.region.area_within_loops - area) / area
    checks = {
        "area_change_at_double_step": at_most(change, CONVERGENCE, FINER),
        "area_within_boundary": at_most(polygons, POLYGONS, FINER),
    }
    if solid is None or volume is None:
        return checks
    size, allowed = solid.volume, volume.tolerance
    move = (
        f"no point of {len(solid.along)} sections, up to {solid.widest:.3g} m apart, can be reached; "
        "change volume.low_m and high_m"
    )
    add = f"increase volume.most_sections above {volume.most_sections}, or use a narrower range"
    rough = abs(size - solid.coarse) / size if size else np.inf
    return checks | {
        "volume_error": at_most(solid.error / size if size else np.inf, allowed, add if size else move),
        "volume_change_at_double_step": at_most(rough, allowed, FINER if size else move),
    }


def _boundary(main: SectionMap) -> str:
    loops = main.region.loops
    numbers = np.concatenate([np.full(len(loop), k) for k, loop in enumerate(loops)])
    uv = np.vstack(loops)
    columns = np.column_stack([numbers, uv, main.section.points(uv)]).T
    return csv_text(dict(zip(("loop", "u_m", "v_m", "x_m", "y_m", "z_m"), columns, strict=True)), digits=9)


def _in_space(
    title: str, task: WorkspaceTask, main: SectionMap, obstacles: Sequence[Box | Beam]
) -> view.RobotScene:  # fmt: skip
    """The robot at home, with obstacles, the points of the section by reason and the boundary of the reachable ones."""
    rows, note = view.thinned((len(main.u), len(main.v)))
    u, v = np.meshgrid(main.u, main.v, indexing="ij")
    T = main.section.points(np.column_stack([u.ravel(), v.ravel()])[rows])
    codes = main.codes.ravel()[rows].tolist()
    words = {code: "reachable" if code == REACHABLE else task.reach.message(code) for code in set(codes)}
    bodies = view.groups(T, [words[code] for code in codes])
    for loop in map(main.section.points, main.region.loops):
        bodies.append(view.lines(loop, np.roll(loop, -1, axis=0), name="boundary", colour="#000000"))
    bodies += [obstacle.body() for obstacle in obstacles]
    return view.around(task.robot.model, bodies, title=title, note=note)


def _section_figure(
    title: str, task: WorkspaceTask, main: SectionMap, bare: SectionMap, cones: dict[float, SectionMap]
) -> Any:
    from ...plot.workspace import section_figure

    layers = {f"ball-joint cones of {_degrees(a):g} deg": section_map.region for a, section_map in cones.items()}
    if len(task.reach.limits) > 1:
        layers["all limits"] = main.region
    layers = dict(sorted(layers.items(), key=lambda layer: -layer[1].area))
    layers = {"singularity limit alone": bare.region, **layers}
    guideways = main.section.pierced(task.robot.anchors, task.robot.directions)
    return section_figure(layers, guideways, title=title, names=main.section.names)
