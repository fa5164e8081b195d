"""Kind "compliance": how a robot gives way under load and weight, and its lowest frequencies, over its workspace."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Any

import numpy as np

from gtmodel.compliance import GROUPS, softest_and_stiffest
from gtmodel.kinematics.workspace import section_grid
from gtmodel.results import SolveStatus

from .base import Context, InputError, Outcome, Row, at_most
from .compliance_arm import ArmStudy
from .compliance_keys import VALUES, Schema
from .compliance_study import Found, LinkStudy, Study
from .sentences import listed

__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]

NAME = "compliance"

CHUNK = 2000  # poses between two looks at the clock
MOST_POINTS = 1e6
# relative: work of the load by C and by the springs; both are sums of a dozen products
WORK = 1e-9
WORDS = {"links": "rods", "joints": "ball joints", "drives": "drives", "carts": "bearings of the carts",
         "frame": "machine frame"}  # fmt: skip
MAPPED = {"softest_N_m": ("stiffness along the softest direction", 1e-6, "N/µm"),
          "deflection_m": ("deflection under the load", 1e6, "µm"),
          "frequency_Hz": ("lowest natural frequency", 1.0, "Hz")}  # fmt: skip


def solve(problem: Schema, context: Context) -> Outcome:
    """The reported pose, then the map."""
    if context.start is not None:
        raise InputError("--start: a map is computed from the beginning; leave it out")
    context.progress("equations", 0.05)
    study = _study(problem, context)
    pose = study(study.home[None])
    if pose.reason[0]:
        own = problem.arm is not None and problem.pose_m is None
        raise InputError(f"cannot be reported: {pose.reason[0]}", "arm.pose_deg" if own else "pose_m")
    grid = _grid(problem, study)
    parts, T = [], grid.points()
    for begin in range(0, len(T), CHUNK):
        context.progress("map", begin / len(T))
        if context.interrupted():
            return Outcome(status=SolveStatus.INTERRUPTED, message=SolveStatus.INTERRUPTED.sentence,
                           values=_pose_values(study, pose))  # fmt: skip
        parts.append(_columns(study(T[begin : begin + CHUNK]), problem))
    columns = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    return _outcome(problem, study, pose, grid, T, columns)


def explain(problem: Schema, context: Context) -> str:
    """The springs, and what was assumed."""
    study = _study(problem, context)
    grid = _grid(problem, study)
    lines = [f"{problem.title or NAME}: at ({listed(study.home)}) m, and on {grid.shape[0]} by {grid.shape[1]} points"]
    if isinstance(study, LinkStudy):
        lines.append("C = U^-1 (diag(1/k) + G diag(1/k_s) G') U^-T, U the unit vectors of the links as rows")
        for name, c in study.structure(study.at_home).by_group.items():
            given = c[c > 0]
            text = f"{1e-6 / given.max():.4g} to {1e-6 / given.min():.4g} MN/m or MN.m/rad" if given.size else "rigid"
            lines.append(f"  {WORDS[name]}: {text}")
    else:
        lines.append("C = J diag(1/k) J', springs in the joints alone")
    return "\n".join([*lines, *(f"  {sentence}" for sentence in study.assumptions)])


def _study(problem: Schema, context: Context) -> Study:
    given = [key for key in ("links", "arm") if getattr(problem, key) is not None]
    if len(given) != 1:
        raise InputError(
            "expected one of [links], for a parallel robot, and [arm], for a serial one",
            given[-1] if given else "links",
        )
    if problem.arm is not None:
        own = problem.model_fields_set, problem.section.model_fields_set
        useless = [k for k in ("carts", "frame", "frequencies") if k in own[0]]
        useless += [f"section.{k}" for k in ("along_m", "cone_deg") if k in own[1]]
        if useless:
            raise InputError("is for parallel robots; an [arm] gives way in its joints alone: leave it out", useless[0])
    model = problem.model(context)
    return ArmStudy(problem, model) if problem.arm is not None else LinkStudy(problem, model)


def _grid(problem: Schema, study: Study) -> Any:
    keys = problem.section
    low, high = study.window
    low = low if keys.low_m is None else np.array(keys.low_m)
    high = high if keys.high_m is None else np.array(keys.high_m)
    if np.any(low >= high):
        raise InputError("every lower limit must be less than its upper one", "section.high_m")
    if np.prod((high - low) / keys.step_m + 1) > MOST_POINTS:
        raise InputError("the grid would have more than a million points; take a larger step", "section.step_m")
    return section_grid(study.section, low, high, keys.step_m)


def _columns(found: Found, problem: Schema) -> dict[str, np.ndarray]:
    """By point of the map; NaN where there is none."""
    left_out = np.array([bool(r) for r in found.reason])
    stiffness, direction = softest_and_stiffest(np.where(left_out[:, None, None], np.nan, found.C[:, :3, :3]))
    columns = {
        "softest_N_m": stiffness[:, 0],
        "direction": direction[:, 0],
        "reason": np.array(found.reason, dtype=object),
    }
    if np.any(problem.load.force_N) or np.any(problem.load.moment_Nm):
        columns["deflection_m"] = np.where(left_out, np.nan, np.linalg.norm(found.moved[:, :3], axis=1))
    if found.frequencies is not None:
        columns["frequency_Hz"] = np.where(left_out, np.nan, found.frequencies[:, 0])
    return columns


def _pose_values(study: Study, pose: Found) -> dict[str, Any]:
    stiffness, directions = softest_and_stiffest(pose.C[:, :3, :3])
    d = pose.C.shape[1]
    return {
        "pose_m": study.home,
        "compliance": pose.C[0],
        "stiffness_N_m": stiffness[0],
        "directions": directions[0],
        "deflection_m": pose.moved[0, :3],
        "rotation_rad": pose.moved[0, 3:] if d > 3 else None,
        "sag_m": None if pose.sag is None else pose.sag[0, :3],
        "frequencies_Hz": None if pose.frequencies is None else pose.frequencies[0],
        "shares": None if pose.shares is None else {name: float(x[0]) for name, x in pose.shares.items()},
        "assumptions": study.assumptions,
    }


def _outcome(
    problem: Schema, study: Study, pose: Found, grid: Any, T: np.ndarray, columns: dict[str, np.ndarray]
) -> Outcome:
    load = np.array([*problem.load.force_N, *problem.load.moment_Nm])[: pose.C.shape[1]]
    work = float(load @ pose.moved[0]) / 2
    uv = study.section.coordinates(T)
    mapped = {name: columns[name] for name in MAPPED if name in columns}
    there = np.isfinite(mapped["softest_N_m"])
    extremes = {name: _extremes(values, uv) for name, values in mapped.items()} if there.any() else {}
    reasons = dict(sorted(Counter(r for r in columns["reason"] if r).items()))
    own = _pose_values(study, pose)
    values = {name: own.get(name) for name in VALUES} | {
        "work_J": work,
        "map": {"points": int(there.sum()), **extremes},
        "reasons": reasons,
    }
    by_C = float(load @ pose.C[0] @ load) / 2
    difference = abs(work - by_C) / by_C if by_C else 0.0
    symmetric = float(np.abs(pose.C[0] - pose.C[0].T).max() / np.abs(pose.C[0]).max())
    checks = {
        "work_by_two_roads": at_most(difference, WORK),
        "asymmetry": at_most(symmetric, WORK),
    }
    title = problem.title or f"{NAME} of {problem.robot}"
    shape = (len(grid.coordinates[0]), len(grid.coordinates[1]))
    figures: dict[str, Any] = {}
    if there.any():
        arrows = columns["direction"] @ np.stack([study.section.across, study.section.up], axis=1)
        for name in mapped:
            figures[name.rpartition("_")[0].removesuffix("_N")] = partial(
                _map_figure, study, grid, name, mapped[name].reshape(shape), title,
                arrows.reshape(*shape, 2) if name == "softest_N_m" else None,
            )  # fmt: skip
    if own["shares"] is not None:
        figures["shares"] = partial(_shares_figure, own["shares"], work, title)
    return Outcome(
        status=SolveStatus.SOLVED if there.any() else SolveStatus.INFEASIBLE,
        message=SolveStatus.SOLVED.sentence if there.any() else _empty(reasons),
        checks=checks,
        values=values,
        rows=_rows(values, load),
        figures=figures,
        files={"map.csv": _table(uv, T, mapped, there)} if there.any() else {},
    )


def _extremes(values: np.ndarray, uv: np.ndarray) -> dict[str, Any]:
    low, high = int(np.nanargmin(values)), int(np.nanargmax(values))
    return {"least": float(values[low]), "least_at_m": uv[low].tolist(), "greatest": float(values[high]),
            "greatest_at_m": uv[high].tolist()}  # fmt: skip


def _empty(reasons: dict[str, int]) -> str:
    most = max(reasons, key=lambda r: reasons[r])
    return f"no point of the section is reached; most often: {most}"


def _rows(values: dict[str, Any], load: np.ndarray) -> list[Row]:
    soft = values["stiffness_N_m"]
    rows = [
        Row("at the tool centre point", listed(values["pose_m"]), "m"),
        Row("stiffness, softest direction", soft[0] / 1e6, "N/um"),
        Row("along", listed(values["directions"][0])),
        Row("stiffness, stiffest direction", soft[-1] / 1e6, "N/um"),
    ]
    if np.any(load):
        rows.append(Row("deflection under the load", listed(1e6 * values["deflection_m"]), "um"))
        if values["rotation_rad"] is not None:
            rows.append(Row("rotation under it", listed(1e6 * values["rotation_rad"]), "urad"))
    if values["shares"] is not None:
        shares = ", ".join(f"{WORDS[k]} {100 * x:.0f} %" for k, x in values["shares"].items() if x > 0)
        rows.append(Row("what takes the work", shares))
    if values["sag_m"] is not None:
        rows.append(Row("deflection by all weights", listed(1e6 * values["sag_m"]), "um"))
        rows.append(Row("natural frequencies", listed(values["frequencies_Hz"]), "Hz"))
    for name, (words, scale, unit) in MAPPED.items():
        if name in values["map"]:
            e = values["map"][name]
            ends = (f"{scale * e[x]:.4g} at ({listed(e[f'{x}_at_m'])}) m" for x in ("least", "greatest"))
            rows.append(Row(f"over the section: {words}", " to ".join(ends), unit.replace("µ", "u")))
    rows += [Row(f"grid points left out: {reason}", count) for reason, count in values["reasons"].items()]
    return rows + [Row("assumed", sentence) for sentence in values["assumptions"]]


def _table(uv: np.ndarray, T: np.ndarray, mapped: dict[str, np.ndarray], there: np.ndarray) -> str:
    lines = [",".join(["u_m", "v_m", "x_m", "y_m", "z_m", *mapped])]
    for n in np.flatnonzero(there):
        lines.append(",".join([*(f"{x:.6g}" for x in (*uv[n], *T[n])), *(f"{c[n]:.6g}" for c in mapped.values())]))
    return "\n".join(lines) + "\n"


def _map_figure(study: Study, grid: Any, name: str, values: np.ndarray, title: str, arrows: Any) -> Any:
    from gtmodel.plot.compliance import map_figure

    words, scale, unit = MAPPED[name]
    u, v = grid.coordinates
    return map_figure(
        u, v, scale * values, label=f"{words} [{unit}]", marks=study.marks, directions=arrows,
        point=study.section.coordinates(study.home[None])[0], title=title, names=study.section.names,
    )  # fmt: skip


def _shares_figure(shares: dict[str, float], work: float, title: str) -> Any:
    from gtmodel.plot.compliance import shares_figure

    return shares_figure(
        {WORDS[k]: shares[k] for k in GROUPS}, title=f"{title}:\nwhat takes the {work:.3g} J of the load"
    )
