"""Kind "milling": where to mill, by static and dynamic deflection over the angle about the spindle."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel.milling import Oscillators, mode_coupling, spectral_radius, stability_lobes
from gtmodel.milling.deflection import SECONDS
from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, at_most
from gtmodel.results import SolveStatus

from . import milling_compensation, milling_pictures, milling_printed
from .milling_keys import Schema
from .milling_search import Found, search
from .milling_task import deflections_of, place_of, replace_oscillators, task_of

NAME = "milling"
SHALLOWER = "the cut chatters: take less depth or another speed"
DECAYED = 0.05  # of a transient: less is not worth a word

VALUES = {
    "reachable_deg": "runs of the angle that some branch reaches within the joint limits: first and last of each",
    "static_angle_deg": "of the least static index among all reachable angles",
    "static_index_mm": "there, under the peak force; for ranking, not for millimetres",
    "static_choice_deg": "of the least static index among angles with dynamics, or as given; null without dynamics",
    "dynamic_angle_deg": "of the least dynamic index, refined; null without dynamics",
    "dynamic_index_mm": "there: largest deflection over two seconds from rest",
    "dynamic_mean_mm": "there: mean deflection without transients",
    "static_choice_index_mm": "dynamic index of the static choice",
    "ratio": "the latter over the least dynamic index on the grid",
    "refined": "after the NLP: angle [deg], dynamic index [mm], whether it converged; best grid angle first",
    "free_speed": "angle [deg], speed [rpm] and dynamic index [mm] of an NLP over both; null without speed_range_rpm",
    "combinations": "least dynamic index by place, feed direction and speed, with its angle [deg]",
    "change_1_Hz_percent": "of the dynamic index where all modes are 1 Hz lower, and higher",
    "mode_coupling": "verdict in words",
    "spectral_radius": "of the linear model with regeneration at the dynamic angle; below 1 stable; null: too slow",
    "guideline": "the answer in sentences",
    "compensation_rms_mm": "error of the tool by offset: none, static, dynamic, and dynamic within the bandwidth",
    "printed_mean_mm": "predicted means of the twelve printed tests, by feed direction",
    "dynamics": "where the dynamics come from",
}


def solve(problem: Schema, context: Context) -> Outcome:
    """Reachable angles, static index, dynamic index, the best after refinement, and what to do."""
    context.progress("kinematics", 0.1)
    task = task_of(problem, context)
    try:
        place = place_of(problem, task, problem.place_m)
    except ValueError as error:
        raise error if isinstance(error, InputError) else InputError(str(error), "place_m") from error
    found = Found(task, place)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the search")
    if place.dynamics is not None:
        search(problem, context, found)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped in the search")
    return _outcome(problem, found)


def explain(problem: Schema, context: Context) -> str:
    """What will be compared."""
    s = problem.search
    task = task_of(problem, context)
    lag = np.rad2deg(task.cutter.lag(task.cut.axial_depth))
    counts = [1 + len(x) for x in (s.places_m, s.feed_directions, s.speeds_rpm)]
    return "\n".join(
        [
            f"{problem.title or NAME}: {round(360 / s.step_deg) + 1} angles, {counts[0]} places, {counts[1]} feeds, "
            f"{counts[2]} speeds",
            f"{task.cut.mode} milling with {task.cutter.teeth} teeth at {task.speed * task.cutter.teeth:.4g} Hz; the "
            f"helix lags by {lag:.3g} deg over the depth",
            "forces by Cvitanic 2021, eqs. (12)-(17); static index |K^-1 F_peak| (18), dynamic index max |x(t)| (19)",
            f"dynamics: {task.whence or 'none, static index only'}",
        ]
    )


def _outcome(problem: Schema, f: Found) -> Outcome:
    task, place = f.task, f.place
    angles = np.rad2deg(place.sweep.angles)
    best = int(np.nanargmin(place.static))
    runs = _runs(angles, place.sweep.reachable)
    values: dict[str, Any] = dict.fromkeys(VALUES)
    values |= {
        "reachable_deg": runs,
        "static_angle_deg": angles[best],
        "static_index_mm": 1e3 * place.static[best],
        "dynamics": task.whence,
    }
    rows = [
        Row("reachable angles", ", ".join(f"{a:.4g} to {b:.4g}" for a, b in runs), "deg"),
        Row("least static index (18)", f"{1e3 * place.static[best]:.3g} at {angles[best]:.4g} deg", "mm"),
    ]
    checks: dict[str, Check] = {}
    figures: dict[str, Any] = {"angle": lambda: milling_pictures.angle(problem, f)}
    files: dict[str, str | bytes] = {}
    if place.dynamics is not None:
        _dynamic(problem, f, values, rows, checks, figures)
        if problem.compensation is not None:
            milling_compensation.add(problem, task, place.dynamics.at(f.angle), values, rows, checks, figures, files)
    elif problem.lobes is not None or problem.compensation is not None:
        key = "lobes" if problem.lobes is not None else "compensation"
        raise InputError("needs dynamics; give [[oscillator]], [modal] or oscillator_field", key)
    if problem.printed_tests:
        printed = milling_printed.printed_tests()
        rows += milling_printed.rows(printed)
        checks |= milling_printed.checks(printed)
        values["printed_mean_mm"] = {name: mean.tolist() for name, mean in printed.mean_mm.items()}
        figures["printed_tests"] = lambda: milling_pictures.printed_tests(printed)
    message = f"{int(place.sweep.reachable.sum())} of {len(angles)} angles reachable"
    objective = None if np.isnan(f.index) else 1e3 * f.index
    return Outcome(status=SolveStatus.SOLVED, message=message, objective=objective, checks=checks, values=values,
                   rows=rows, figures=figures, files=files, machine_files=(milling_compensation.FILE,))  # fmt: skip


def _dynamic(
    problem: Schema, f: Found, values: dict[str, Any], rows: list[Row], checks: dict[str, Check],
    figures: dict[str, Any],
) -> None:  # fmt: skip
    """What the dynamics add to the report."""
    task, found = f.task, f.findings
    assert found is not None and f.place.dynamics is not None
    angles = np.rad2deg(found.angles)
    s_row, _ = found.choices
    here = f.place.dynamics.at(f.angle)
    chosen = deflections_of(task, replace_oscillators(f.place.dynamics, here))
    coupling = mode_coupling(here, task.cutter, task.cut, task.feed, up=task.up)
    try:
        radius = spectral_radius(here, task.cutter, task.cut, task.speed, task.feed, up=task.up)
        chatter = f"{'none' if radius < 1 else 'to be expected'}: spectral radius {radius:.3f}"
        # at 1 the tool swings on for ever
        checks["spectral_radius"] = at_most(radius, float(np.nextafter(1.0, 0.0)), SHALLOWER)
    except ValueError as error:
        radius, chatter = None, f"not told: {error}"
    if task.cutter.runout is not None:
        chatter += "; without the runout that is declared"
    values |= {
        "static_choice_deg": angles[s_row],
        "dynamic_angle_deg": np.rad2deg(f.angle),
        "dynamic_index_mm": 1e3 * f.index,
        "dynamic_mean_mm": 1e3 * chosen.mean[0],
        "static_choice_index_mm": 1e3 * f.peak[s_row],
        "ratio": found.ratio,
        "refined": [[np.rad2deg(b.angle), 1e3 * b.peak, b.converged] for b in f.refined],
        "free_speed": f.freed and [np.rad2deg(f.freed.angle), 60 * f.freed.speed, 1e3 * f.freed.peak],
        "combinations": f.combinations,
        "change_1_Hz_percent": [100 * x for x in found.change],
        "mode_coupling": coupling.sentence,
        "spectral_radius": radius,
        "guideline": f.said,
    }
    rows += [
        Row("static choice", f"{angles[s_row]:.4g}, {_whence(problem, f)}", "deg"),
        Row("least dynamic index (19)", f"{1e3 * f.index:.3g} at {np.rad2deg(f.angle):.4g} deg", "mm"),
        Row("there, mean deflection", 1e3 * chosen.mean[0], "mm"),
        *_transients(here),
        *(
            []
            if f.freed is None
            else [
                Row(
                    "with the speed free",
                    f"{1e3 * f.freed.peak:.3g} at {np.rad2deg(f.freed.angle):.4g} deg and {60 * f.freed.speed:.4g} rpm",
                    "mm",
                )
            ]
        ),
        *(Row("guideline", sentence) for sentence in f.said),
        Row("mode coupling", coupling.sentence),
        Row("regenerative chatter", chatter),
        Row("dynamics", task.whence),
        *_known(angles, f),
        *(Row(*_combined(c)) for c in f.combinations if len(f.combinations) > 1),
    ]
    if problem.lobes is not None:
        low, high = problem.lobes.from_rpm, problem.lobes.to_rpm
        if low >= high:
            raise InputError(f"is {high:g}; expected more than from_rpm, {low:g}", "lobes.to_rpm")
        k = problem.cut
        lobes = stability_lobes(here, task.cutter, k.mode, k.radial_depth_m, task.feed, up=task.up)
        depth = float(lobes.depth_at([task.speed])[0])
        shown = f"{1e3 * depth:.3g}" if np.isfinite(depth) else "no limit below 1000"
        rows.append(Row("proven stable depth at this speed", shown, "mm"))
        figures["lobes"] = lambda: milling_pictures.lobes_of(problem, task, lobes)


def _transients(here: Oscillators) -> list[Row]:
    """Whether two seconds from rest show the steady deflection."""
    rate = (np.pi * 2 * here.frequency * here.damping_ratio)[0]
    axis = int(np.argmin(rate))
    left = float(np.exp(-rate[axis] * SECONDS))
    if left < DECAYED:
        return []
    return [Row("not steady", f"after {SECONDS:g} s {100 * left:.0f} % of the transient along {'xyz'[axis]} is left: "
                "near a mode deflections keep growing beyond the index and the mean")]  # fmt: skip


def _known(angles: np.ndarray, f: Found) -> list[Row]:
    """Where dynamics are known, if not at every reachable angle."""
    there = np.isfinite(f.peak)
    if there.sum() == f.place.sweep.reachable.sum():
        return []
    said = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in _runs(angles, there))
    return [Row("angles with known dynamics", f"{said}; other reachable angles are judged by stiffness alone", "deg")]


def _whence(problem: Schema, f: Found) -> str:
    if problem.search.static_choice_deg is not None:
        return "given"
    return "least static index" + (
        "" if np.isfinite(f.peak[np.nanargmin(f.place.static)]) else " where dynamics are known"
    )


def _combined(c: dict[str, Any]) -> tuple[str, str, str]:
    where = ", ".join(f"{x:.4g}" for x in c["place_m"])
    if "reason" in c:
        return f"at ({where}) m", c["reason"], ""
    feed = ", ".join(f"{x:g}" for x in c["feed_direction"])
    label = f"{c['speed_rpm']:.5g} rpm, feed ({feed}), at ({where}) m"
    return label, f"{c['index_mm']:.3g} at {c['angle_deg']:.4g} deg", "mm"


def _runs(angles: np.ndarray, there: np.ndarray) -> list[list[float]]:
    edges = np.diff(np.concatenate([[0], there, [0]]).astype(int))
    ends = zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
    return [[float(angles[a]), float(angles[b - 1])] for a, b in ends]


__all__ = ["NAME", "VALUES", "Schema", "explain", "solve"]
