"""The compliance study: deflection of a robot under load and weight, and its lowest frequencies, over its workspace."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from .. import view
from ..kinematics.workspace import section_grid
from ..lang import Model
from ..results import ArgumentError, SolveStatus, Work, at_most
from ..results.options import Long, Within
from ..results.table import csv_text
from ..results.work import WorkOptions, study_function
from .cartesian import SprungArm, softest_and_stiffest
from .options import MAPPED, ArmSprings, Array, ComplianceMap, ComplianceStudy, Load, Springs, word
from .sprung_links import ComplianceAtPoses, Sprung, SprungLinks

CHUNK = 2000  # poses between two checks of time and stop
MOST_POINTS = 1e6
ARROW = 0.3  # half length of a direction in space, in distances of the points
# relative tolerance for the load's work from C and from the springs; both are sums of a dozen products
WORK = 1e-9


@study_function
def study(
    robot: Model,
    springs: Springs | ArmSprings,
    load: Load | None = None,
    *,
    pose: Annotated[Sequence[float] | None, Long(3)] = None,
    map: ComplianceMap | None = None,
    frequencies: Annotated[int, Within(least=1)] = 3,
    **work_options: Unpack[WorkOptions],
) -> ComplianceStudy:
    """Compute stiffness, deflection and natural frequencies of a robot at one pose and over a section.

    Args:
        robot: a parallel robot with links on carts, or a serial arm of six joints with named postures: a spherical
            wrist, or three parallel axes.
        springs: `Springs` of the parallel robot, or `ArmSprings` of the serial one.
        load: force [N] and moment [N.m] at the tool centre point, world coordinates; none if left out.
        pose: (3,) reported tool centre point [m]; the robot's home if left out.
        map: section across the guideways, or the vertical plane of an arm.
        frequencies: number of natural frequencies to report, if the robot has masses.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    If interrupted, the study holds the reported pose and no map. Raises ArgumentError, for example for a pose out of
    reach.

    >>> from gtmodel.compliance import ComplianceMap, Load, RodSprings, Springs, study
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = study(robot, Springs(RodSprings(stiffness=2e7)), Load(force=[0, 0, -100.0]), map=ComplianceMap(step=0.3))
    >>> (s.stiffness / 1e6).round(1)  # N/um, softest direction first
    array([ 4.1, 28.2, 87.7])
    >>> (1e6 * s.deflection).round(1)  # um
    array([  1.7, -10.1, -11.5])
    """
    work = Work(**work_options)
    work.progress("setting up the equations", 0.05)
    load, map = load or Load(), map or ComplianceMap()
    sprung = on_springs(robot, springs, load, pose, map, frequencies)
    computed = sprung(sprung.home[None])
    if computed.reason[0]:
        from_springs = isinstance(springs, ArmSprings) and pose is None
        raise ArgumentError(f"cannot be reported: {computed.reason[0]}", "springs.pose" if from_springs else "pose")
    grid = grid_of(sprung, map)
    work.keep(lambda: _interrupted(work.title, sprung, computed))
    parts, T = [], grid.points()
    for begin in range(0, len(T), CHUNK):
        work.step("computing the map", begin / len(T))
        parts.append(_columns(sprung(T[begin : begin + CHUNK]), load))
    columns = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    return _study_of(work.title, robot, sprung, computed, load, grid, T, columns)


def on_springs(
    robot: Model,
    springs: Springs | ArmSprings,
    load: Load,
    pose: Sequence[float] | None,
    map: ComplianceMap,
    frequencies: int,
) -> Sprung:
    """Attach springs to the robot. Raises ArgumentError."""
    if isinstance(springs, ArmSprings):
        return SprungArm(robot, springs, load, pose)
    return SprungLinks(robot, springs, load, pose, map, frequencies)


def grid_of(sprung: Sprung, map: ComplianceMap) -> Any:
    """The grid of the section. Raises ArgumentError."""
    low, high = map.window(*sprung.window, "map")
    if np.prod((high - low) / map.step + 1) > MOST_POINTS:
        raise ArgumentError("the grid would have more than a million points; use a larger step", "map.step")
    return section_grid(sprung.section, low, high, map.step)


def _columns(computed: ComplianceAtPoses, load: Load) -> dict[str, Array]:
    """Columns with one row per point of the map; NaN if there is no result."""
    left_out = np.array([bool(r) for r in computed.reason])
    stiffness, direction = softest_and_stiffest(np.where(left_out[:, None, None], np.nan, computed.C[:, :3, :3]))
    columns = {
        "softest_N_m": stiffness[:, 0],
        "direction": direction[:, 0],
        "reason": np.array(computed.reason, dtype=object),
    }
    if np.any(load.force) or np.any(load.moment):
        columns["deflection_m"] = np.where(left_out, np.nan, np.linalg.norm(computed.moved[:, :3], axis=1))
    if computed.frequencies is not None:
        columns["frequency_Hz"] = np.where(left_out, np.nan, computed.frequencies[:, 0])
    return columns


def _pose_values(sprung: Sprung, pose: ComplianceAtPoses) -> dict[str, Any]:
    stiffness, directions = softest_and_stiffest(pose.C[:, :3, :3])
    return {
        "pose": sprung.home,
        "compliance": pose.C[0],
        "stiffness": stiffness[0],
        "directions": directions[0],
        "deflection": pose.moved[0, :3],
        "rotation": pose.moved[0, 3:] if pose.C.shape[1] > 3 else None,
        "sag": None if pose.sag is None else pose.sag[0, :3],
        "frequencies": None if pose.frequencies is None else pose.frequencies[0],
        "shares": None if pose.shares is None else {name: float(x[0]) for name, x in pose.shares.items()},
        "assumptions": sprung.assumptions,
    }


def _interrupted(title: str, sprung: Sprung, pose: ComplianceAtPoses) -> ComplianceStudy:
    values = _pose_values(sprung, pose)
    return ComplianceStudy(status=SolveStatus.INTERRUPTED, title=title, **values, map={}, reasons={})


def _study_of(
    title: str, robot: Model, sprung: Sprung, pose: ComplianceAtPoses, options: Load, grid: Any, T: Array,
    columns: dict[str, Array],
) -> ComplianceStudy:  # fmt: skip
    load = np.array([*options.force, *options.moment])[: pose.C.shape[1]]
    work = float(load @ pose.moved[0]) / 2
    uv = sprung.section.coordinates(T)
    mapped = {name: columns[name] for name in MAPPED if name in columns}
    valid = np.isfinite(mapped["softest_N_m"])
    extremes = {name: _extremes(values, uv) for name, values in mapped.items()} if valid.any() else {}
    reasons = dict(sorted(Counter(r for r in columns["reason"] if r).items()))
    by_C = float(load @ pose.C[0] @ load) / 2
    values_at_pose = _pose_values(sprung, pose)
    drawn = partial(_map_in_space, robot, sprung.home, grid, T, columns, title or "compliance")
    over = {f"section_{_short(name)}": partial(drawn, name) for name in (mapped if valid.any() else ())}
    places = {"u_m": uv[:, 0], "v_m": uv[:, 1], "x_m": T[:, 0], "y_m": T[:, 1], "z_m": T[:, 2]}
    return ComplianceStudy(
        status=SolveStatus.SOLVED if valid.any() else SolveStatus.INFEASIBLE,
        message=f"{valid.sum()} of {len(valid)} points of the section computed" if valid.any() else _empty(reasons),
        title=title,
        checks={
            "work_cross_check": at_most(abs(work - by_C) / by_C if by_C else 0.0, WORK),
            "asymmetry": at_most(float(np.abs(pose.C[0] - pose.C[0].T).max() / np.abs(pose.C[0]).max()), WORK),
        },
        **values_at_pose,
        work=work,
        map={"points": int(valid.sum()), **extremes},
        reasons=reasons,
        scenes={**sprung.scenes(title or "compliance"), **over},
        figures=_figures(sprung, grid, columns, mapped, values_at_pose["shares"], work, title or "compliance"),
        files={"map.csv": csv_text({n: c[valid] for n, c in (places | mapped).items()})} if valid.any() else {},
    )


def _figures(
    sprung: Sprung, grid: Any, columns: dict[str, Array], mapped: dict[str, Array], shares: Any, work: float, title: str
) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    shape = (len(grid.coordinates[0]), len(grid.coordinates[1]))
    if np.isfinite(mapped["softest_N_m"]).any():
        arrows = columns["direction"] @ np.stack([sprung.section.across, sprung.section.up], axis=1)
        for name in mapped:
            figures[_short(name)] = partial(
                _map_figure, sprung, grid, name, mapped[name].reshape(shape), title,
                arrows.reshape(*shape, 2) if name == "softest_N_m" else None,
            )  # fmt: skip
    if shares is not None:
        figures["shares"] = partial(_shares_figure, shares, work, title)
    return figures


def _short(column: str) -> str:
    """Name of a map, from that of its column."""
    return column.rpartition("_")[0].removesuffix("_N")


def _extremes(values: Array, uv: Array) -> dict[str, Any]:
    low, high = int(np.nanargmin(values)), int(np.nanargmax(values))
    return {"least": float(values[low]), "least_at_m": uv[low].tolist(), "greatest": float(values[high]),
            "greatest_at_m": uv[high].tolist()}  # fmt: skip


def _empty(reasons: dict[str, int]) -> str:
    most = max(reasons, key=lambda r: reasons[r])
    return f"no point of the section can be reached; most frequent reason: {most}"


def _map_figure(sprung: Sprung, grid: Any, name: str, values: Array, title: str, arrows: Any) -> Any:
    from ..plot.compliance import map_figure

    words, scale, unit = MAPPED[name]
    u, v = grid.coordinates
    return map_figure(
        u, v, scale * values, label=f"{words} [{unit}]", marks=sprung.marks, directions=arrows,
        point=sprung.section.coordinates(sprung.home[None])[0], title=f"{title}: {words}", names=sprung.section.names,
    )  # fmt: skip


def _map_in_space(
    robot: Model, pose: Array, grid: Any, T: Array, columns: dict[str, Array], title: str, name: str
) -> view.RobotScene:
    """The robot at home, with the points of the section by a mapped quantity, and the softest directions."""
    words, scale, unit = MAPPED[name]
    u, v = grid.coordinates
    rows, note = view.thinned((len(u), len(v)))
    rows = rows[np.isfinite(columns[name][rows])]
    bodies = view.levels(T[rows], scale * columns[name][rows], words, unit)
    if name == "softest_N_m":
        half = ARROW * float(np.ptp(u)) / np.sqrt(len(rows)) * columns["direction"][rows]
        bodies.append(view.lines(T[rows] - half, T[rows] + half, name="softest direction", colour="#000000"))
        note = f"{note} Lines: the softest direction at each point.".strip()
    bodies.append(view.dots(pose[None], marker="cross", name="reported pose", colour="#d55e00"))
    return view.around(robot, bodies, title=f"{title}: {words}", note=note)


def _shares_figure(shares: dict[str, float], work: float, title: str) -> Any:
    from ..plot.compliance import shares_figure

    return shares_figure(
        {word(k): share for k, share in shares.items()}, title=f"{title}:\nshares of the load's work of {work:.3g} J"
    )
