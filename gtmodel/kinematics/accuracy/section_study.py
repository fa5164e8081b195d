"""The accuracy study: the largest positioning error over a section, from errors of carts and links."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial
from typing import Any, Unpack

import numpy as np

from ... import view
from ...lang import Model
from ...results import ArgumentError, SolveStatus, Status, Work
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from ..mechanism import home_figure, mechanism_of
from .case import ErrorRegion, JudgedCase, errors_of, judged, with_method
from .corners import Array, ErrorMap, Method, map_errors
from .options import AccuracyStudy, ErrorSection, LinkErrors, MonteCarloDraws

MOST_POINTS = 1e7
BOXES = 7  # along each side of the rectangle in space
DIAGONAL = 101  # points on the rectangle's diagonal, along which the face areas are drawn


@study_function
def accuracy_study(
    robot: Model,
    cases: Sequence[LinkErrors],
    *,
    section: ErrorSection | None = None,
    method: Method = "support",
    monte_carlo: MonteCarloDraws | None = None,
    **work_options: Unpack[WorkOptions],
) -> AccuracyStudy:
    """Compute the largest positioning error of a robot with three links over a rectangle of a cross-section.

    Args:
        robot: three links on guideways, each with its own length parameter.
        cases: errors to evaluate, each with a unique name.
        section: the section and its rectangle; default: the rectangle spanned by the guideways.
        method: how corners are computed from ellipsoids, for cases without a method: "support", the exact first-order
            bound, or "projection", the iteration of Dressler 2012, A.2.
        monte_carlo: options of the Monte Carlo cross-check.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The corners of every case are cross-checked with the robot's equations, Newton's method and Monte Carlo samples.
    After an interruption, the study contains the completed cases. Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.kinematics.accuracy import ErrorSection, LinkErrors
    >>> robot = gt.robots.gantry_tau("d1_nominal")
    >>> carts = LinkErrors("carts", along=[11e-6, 58e-6, 19e-6], across=[28e-6, 38e-6, 47e-6])
    >>> s = gt.kinematics.accuracy_study(robot, [carts], section=ErrorSection(step=0.2))
    >>> s.cases[0]["nearest_guideway"]
    2
    """
    work = Work(**work_options)
    draws = monte_carlo or MonteCarloDraws()
    region = region_of(robot, cases, section or ErrorSection())
    resolved = with_method(list(cases), method)
    errors = [errors_of(case, k, region.robot) for k, case in enumerate(resolved)]
    cases_judged: list[JudgedCase] = []
    for case, error in zip(resolved, errors, strict=True):
        mapped = map_errors(error, region.base_points, region.T, progress=work.fractions(case.name))
        if not mapped.complete or work.interrupted():
            return _study(region, work.title, cases_judged, SolveStatus.INTERRUPTED, SolveStatus.INTERRUPTED.message)
        good = region.window & (mapped.status == Status.OK)
        if not good.any():
            reasons = _reasons(mapped.status[region.window])
            most = max(reasons, key=lambda reason: reasons[reason])
            message = f"no point of the rectangle has a result; most frequent reason: {most}"
            return _study(region, work.title, cases_judged, SolveStatus.INFEASIBLE, message)
        cases_judged.append(judged(region, case, _word(case.name), error, mapped, good, draws))
    return _study_of(region, work.title, cases_judged)


def region_of(model: Model, cases: Sequence[LinkErrors], section: ErrorSection) -> ErrorRegion:
    """Return the robot, its section and the grid. Raises ArgumentError, also if two cases have the same name."""
    robot = mechanism_of(model)
    if len(robot.lengths) != 3 or not robot.length_names:
        raise ArgumentError(
            f"the accuracy study needs three links with length parameters; found {len(robot.lengths)} links", "robot"
        )
    if not cases:
        raise ArgumentError("no case; give at least one", "cases")
    words = [_word(case.name) for case in cases]
    for k, word in enumerate(words):
        if word in words[:k]:
            raise ArgumentError(
                f"two cases have the name '{cases[k].name}'; give them different names", f"cases[{k}].name"
            )
    plane = robot.section(section.along)
    corners = plane.pierced(robot.anchors, robot.directions)
    low, high = section.window(corners.min(axis=0), corners.max(axis=0))
    least, greatest = robot.farthest(corners)
    outer_low, outer_high = np.minimum(low, least), np.maximum(high, greatest)
    u, v = (_through(low[k], high[k], outer_low[k], outer_high[k], section.step) for k in range(2))
    if len(u) * len(v) > MOST_POINTS:
        raise ArgumentError(f"the grid would have {len(u) * len(v):.1e} points; use a larger step", "section.step")
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    rounding = 1e-9 * section.step
    window = np.all((uv >= low - rounding) & (uv <= high + rounding), axis=1)
    return ErrorRegion(robot, plane, corners, low, high, u, v, plane.points(uv), window)


def _through(low: float, high: float, outer_low: float, outer_high: float, step: float) -> Array:
    """Return evenly spaced values that include low and high and extend to the outer limits."""
    count = max(1, int(np.ceil((high - low) / step - 1e-9)))
    size = (high - low) / count
    first, last = int(np.floor((outer_low - low) / size)), int(np.ceil((outer_high - low) / size))
    return low + size * np.arange(first, last + 1)


def _study_of(region: ErrorRegion, title: str, judged_cases: list[JudgedCase]) -> AccuracyStudy:
    status, message = SolveStatus.SOLVED, SolveStatus.SOLVED.message
    unchecked = [
        f.values["name"] for f in judged_cases if any(not math.isfinite(check.value) for check in f.checks.values())
    ]
    if unchecked:  # the first-order results exist, but a cross-check has no result
        status = SolveStatus.FAILED
        message = (
            f"{' and '.join(unchecked)}: at some points of the rectangle a robot with the largest errors cannot be "
            "assembled; the errors are too large, or the rectangle is too close to the boundary of the workspace"
        )
    figures: dict[str, Any] = {
        f"error_{k + 1}": partial(_error_figure, region, title, f) for k, f in enumerate(judged_cases)
    }
    figures["faces"] = partial(_faces_figure, region, title, judged_cases)
    low, high = region.low, region.high
    rectangle = region.plane.points(np.array([low, [high[0], low[1]], high, [low[0], high[1]]]))
    figures["robot"] = partial(home_figure, region.robot, [rectangle], title)
    checks = {name: check for f in judged_cases for name, check in f.checks.items()}
    scenes = {f"error_{k + 1}": partial(_in_space, region, title, f) for k, f in enumerate(judged_cases)}
    files = {"errors.csv": _table(region, [f.map for f in judged_cases])}
    return _study(
        region, title, judged_cases, status, message, checks=checks, figures=figures, scenes=scenes, files=files
    )


def _study(
    region: ErrorRegion, title: str, judged_cases: list[JudgedCase], status: SolveStatus, message: str, **more: Any
) -> AccuracyStudy:
    missing = _reasons(judged_cases[0].map.status[region.window]) if judged_cases else {}
    return AccuracyStudy(
        status=status,
        message=message,
        title=title,
        cases=[f.values for f in judged_cases],
        window=np.array([region.low, region.high]),
        guideways=region.corners,
        section={"point_m": region.plane.origin.tolist(), "normal": region.plane.normal.tolist()},
        points={"in_rectangle": int(region.window.sum()), "without_error": missing},
        **more,
    )


def _word(name: str) -> str:
    return "_".join(re.findall(r"\w+", name)) or "case"


def _reasons(status: Array) -> dict[str, int]:
    counts = np.bincount(np.asarray(status, dtype=int))
    return {Status(code).message: int(n) for code, n in enumerate(counts) if n and code != Status.OK}


def _table(region: ErrorRegion, maps: list[ErrorMap]) -> str:
    """Return a CSV table of the points in the rectangle with the error of every case, empty without a result."""
    inside = region.window
    uv, T = region.plane.coordinates(region.T)[inside], region.T[inside]
    coordinates = {"u_m": uv[:, 0], "v_m": uv[:, 1], "x_m": T[:, 0], "y_m": T[:, 1], "z_m": T[:, 2]}
    errors = {f"error_{k + 1}_um": 1e6 * error_map.error[inside] for k, error_map in enumerate(maps)}
    return csv_text(coordinates | errors, dict.fromkeys(coordinates, 9) | dict.fromkeys(errors, 6))


def _in_space(region: ErrorRegion, title: str, f: JudgedCase) -> view.RobotScene:
    """The robot at home, the points of the rectangle by their largest error, and all possible errors at some of
    them."""
    rows, thin = view.thinned((len(region.u), len(region.v)))
    rows = rows[region.window[rows]]
    marks = view.levels(region.T[rows], 1e6 * f.map.error[rows], "largest error", "µm")
    u, v = (np.linspace(low, high, BOXES) for low, high in zip(region.low, region.high, strict=True))
    T = region.plane.points(np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2))
    boxes, note = view.error_boxes(T, f.errors.corners(region.base_points(T)[0], T)[0])
    name = f"{title or 'accuracy'}: {f.values['name']}"
    return view.around(region.robot.model, [*marks, *boxes], title=name, note=f"{note} {thin}".strip())


def _error_figure(region: ErrorRegion, title: str, f: JudgedCase) -> Any:
    from ...plot.workspace import error_figure

    error = f.map.error.reshape(len(region.u), len(region.v))
    return error_figure(
        region.u, region.v, error, region.corners, window=(region.low, region.high),
        title=f"{title or 'accuracy'}: largest error, {f.values['name']},\nfrom {f.values['method']}",
        names=region.plane.names,
    )  # fmt: skip


def _faces_figure(region: ErrorRegion, title: str, judged_cases: list[JudgedCase]) -> Any:
    from ...plot.workspace import faces_figure

    s = np.linspace(0.0, 1.0, DIAGONAL)
    T = region.plane.points(region.low + s[:, None] * (region.high - region.low))
    faces = {f.values["name"]: map_errors(f.errors, region.base_points, T).faces for f in judged_cases}
    subject = "face areas of the error parallelepiped,\nalong the rising diagonal of the rectangle"
    return faces_figure(
        s * float(np.linalg.norm(region.high - region.low)), faces, title=f"{title or 'accuracy'}: {subject}"
    )
