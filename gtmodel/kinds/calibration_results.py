"""What a calibration tells: values for programs, rows for people, checks."""

from __future__ import annotations

from typing import Any

import numpy as np

from gtmodel.calibrate.prediction import Prediction
from gtmodel.compiler.causal import flat_of
from gtmodel.inference import Identifiability
from gtmodel.problem_files.base import Check, Row, at_most

from .calibration_data import PoseData
from .calibration_findings import Found, verdict
from .calibration_keys import Schema
from .calibration_movement import moved_too_far

LOOK = "the verdict in the table says what to look at"

VALUES = {
    "parameters": "all geometric parameters of the closure equations by name, calibrated ones among them, in SI units",
    "unknowns": "for each unknown: name, unit, start, value, std and interval_95, null where the poses do not tell it; "
    "where residuals are no noise (intervals_hold false) interval_95 is null and std but what white noise would leave",
    "intervals_hold": "whether 95 % intervals are told; the notes say why not, or what they rest on beside noise",
    "colour_tested": "whether the poses are enough to test residuals for colour (wandering carts, drift)",
    "measurement": "estimated frames, scales, offsets and delays of the measurement by name, in SI units",
    "poses": "number of poses fitted and held out, and of places that were measured more than once",
    "link_errors_mm": "mean length error of each link over the fitted poses (Dressler 2012, eq. (5.13))",
    "held_out_link_rms_mm": "root mean square of each link's length errors on the held-out poses; null without any",
    "held_out_mm": "positioning error (5.5) of the held-out poses: mean, max, rms; null without any",
    "fitted_mm": "the same of the fitted poses",
    "a_priori_mm": "the same of the robot as it was before, on the held-out poses or the fitted ones",
    "orientation_deg": "angle between predicted and measured orientation of held-out poses; null where not measured",
    "worst": "the pose with the greatest error: line, measured position_m, error_mm and whether it was held_out",
    "principal": "rms error rms_mm along each principal direction, the least first, and the directions",
    "identifiability_before": "rank, redundant, condition, observability indices and sentences, before measuring",
    "identifiability_after": "the same at the solution, with the noise of the residuals",
    "correlated": "pairs of unknowns that correlate by more than 0.95",
    "outliers": "residuals far beyond the others of their link: line, link, residual_mm, times the robust deviation",
    "repeatability_mm": "rms distance of poses at the same actuators from their mean; null without any",
    "sensitivity": "sums (5.8) of changes by a small step of each unknown: position_mm, orientation_deg, cost_m4; null "
    "where the pose is not told",
    "numerics_sound": "whether the iteration arrived",
    "prediction_proven": "whether held-out poses are predicted as well as fitted ones; null without any",
    "verdict": "in words, with what it covers",
    "notes": "what limits the numbers, in words",
    "truth": "parameters of the robot that was made up; null for measured poses",
    "synthetic": "seed and noise of made-up poses; null for measured ones",
}
SHOWN_PAIRS = 20
MANY = 0.1  # of the poses: so many outliers are seldom chance
WORST_ROWS = 5
WEAK = "told no better than"  # of a combination, in words


def values_of(problem: Schema, found: Found) -> dict[str, Any]:
    """The kind's values."""
    c, data = found.calibration, found.data
    sound, proven, sentences = verdict(found, _accuracy(problem))
    told, lines, held = found.told
    own = {q.name for q in found.problem.closure.flat.parameters}
    head = told.get(found.position)
    return {
        "parameters": {n: v for n, v in c.values.items() if n in own},
        "unknowns": _unknowns(found),
        "intervals_hold": c.estimate is not None and found.confidence.holds,
        "colour_tested": c.estimate is not None and found.confidence.tested,
        "measurement": {n: v for n, v in c.values.items() if n not in own},
        "poses": {"fitted": len(found.lines), "held_out": len(found.lines_held_out), "repeated": len(data.repeated)},
        "link_errors_mm": {n: 1e3 * v for n, v in c.link_errors.items()},
        "held_out_link_rms_mm": _link_rms(found),
        "held_out_mm": _sizes(found.held_out.get(found.position)),
        "fitted_mm": _sizes(found.fitted.get(found.position)),
        "a_priori_mm": _sizes(found.a_priori.get(found.position)),
        "orientation_deg": _sizes(told.get(data.keys.orientation or ""), np.degrees(1.0)),
        "worst": None if head is None else _worst(data, head, lines, held),
        "principal": None if head is None else _principal(head),
        "identifiability_before": _told(found.before),
        "identifiability_after": None if found.after is None else _told(found.after),
        "correlated": [] if found.after is None else [list(p) for p in found.after.correlated[:SHOWN_PAIRS]],
        "outliers": [
            {"line": int(found.lines[o.pose]), "link": found.problem.labels[o.link], "residual_mm": 1e3 * o.residual,
             "times": o.times} for o in found.outliers
        ],
        "repeatability_mm": None if found.repeatability is None else 1e3 * found.repeatability,
        "sensitivity": _sensitivity(found),
        "numerics_sound": sound,
        "prediction_proven": proven,
        "verdict": sentences,
        "notes": _notes(found),
        "truth": _truth(found),
        "synthetic": data.synthetic,
    }  # fmt: skip


def checks_of(problem: Schema, found: Found) -> dict[str, Check]:
    """Prediction and, where it was asked for, the accuracy."""
    checks = {}
    name = found.position
    judged = found.judged
    if judged is not None:
        bound = judged.bound if np.isfinite(judged.bound) else None
        checks["held_out_over_fitted"] = Check(judged.ratio, bound, LOOK, judged=judged.passed)
    if found.lost:
        checks["held_out_poses_lost"] = at_most(float(found.lost), 0.0, LOOK)
    far = moved_too_far(found.calibration)
    if far:
        checks["moved_too_far"] = at_most(float(len(far)), 0.0, LOOK)
    wanted = _accuracy(problem)
    if wanted is not None and name in found.told[0]:
        mean = found.told[0][name].mean
        # what was fitted proves nothing
        proven = 1e3 * mean if found.held_out else np.nan
        checks["mean_error_mm"] = at_most(
            proven, 1e3 * wanted, LOOK if found.held_out else "hold poses out to prove it"
        )
    return checks


def rows_of(values: dict[str, Any], found: Found) -> list[Row]:
    """The table that people see."""
    rows = []
    for u in values["unknowns"]:
        rows.append(Row(u["name"], u["value"], u["unit"]))
        if u["interval_95"] is not None:
            low, high = u["interval_95"]
            rows.append(Row("  95 %", f"{low:.7g} to {high:.7g}"))
        elif u["std"] is None:
            rows.append(Row("  95 %", "not told by these poses"))
        else:
            rows.append(Row("  std, were residuals noise", u["std"], u["unit"]))
    rows += [Row(f"mean length error of {n}", v, "mm") for n, v in values["link_errors_mm"].items()]
    for key, said in (("a_priori_mm", "before"), ("fitted_mm", "fitted poses"), ("held_out_mm", "held-out poses")):
        if values[key]:
            rows.append(Row(f"positioning error, {said}: mean", values[key]["mean"], "mm"))
            rows.append(Row("  greatest", values[key]["max"], "mm"))
    if values["worst"]:
        w = values["worst"]
        at = ", ".join(f"{x:.3f}" for x in w["position_m"])
        rows.append(Row("worst place", f"({at}) m, line {w['line']}: {w['error_mm']:.3g} mm"))
    if values["principal"]:
        for size, d in zip(values["principal"]["rms_mm"], values["principal"]["directions"], strict=True):
            rows.append(Row(f"rms along ({', '.join(f'{x:.2f}' for x in d)})", size, "mm"))
    if values["repeatability_mm"] is not None:
        rows.append(Row("repeatability, rms", values["repeatability_mm"], "mm"))
    if values["identifiability_after"]:
        told = values["identifiability_after"]["sentences"]
        rows += [Row("identifiability", s) for s in told if WEAK not in s]
        weak = sum(WEAK in s for s in told)
        if weak:
            rows.append(Row("identifiability", f"{weak} combinations are {WEAK} they were known; see result.json"))
    rows += [
        Row("outlier", f"line {o['line']}, {o['link']}: {o['residual_mm']:.3g} mm, {o['times']:.1f} deviations")
        for o in values["outliers"][:WORST_ROWS]
    ]
    rows += [Row("note", s) for s in values["notes"] if "do not determine" not in s]
    rows += [Row("verdict", s) for s in values["verdict"]]
    if values["synthetic"]:
        rows.append(Row("synthetic", values["synthetic"].partition(";")[0]))
    return rows


def _accuracy(problem: Schema) -> float | None:
    return None if problem.accuracy_mm is None else 1e-3 * problem.accuracy_mm


def _unknowns(found: Found) -> list[dict[str, Any]]:
    c, u, told = found.calibration, found.problem.unknowns, found.confidence.estimate
    listed = []
    for k, name in enumerate(u.names):
        entry = {"name": name, "unit": u.units[k] or "1", "start": float(u.start[k]), "value": float(c.x[k]),
                 "std": None, "interval_95": None}  # fmt: skip
        if told is not None and np.isfinite(told.std[k]):
            entry["std"] = float(told.std[k])
            if found.confidence.holds:
                entry["interval_95"] = list(told.interval(name))
        listed.append(entry)
    return listed


def _notes(found: Found) -> list[str]:
    c = found.calibration
    if c.estimate is None:
        return []
    intervals = [*found.confidence.reasons, *found.confidence.remarks]
    return [*found.priors, *c.estimate.notes, *intervals, *_crowded(found), *moved_too_far(c)]


def _crowded(found: Found) -> list[str]:
    """A sentence where so many poses hold outliers that they are hardly outliers."""
    N, bad = len(found.lines), len({o.pose for o in found.outliers})
    if bad <= MANY * N:
        return []
    return [
        f"{bad} of {N} poses ({bad / N:.0%}) hold outliers, so many are seldom chance: look at what they share, "
        "such as a place, a session or a lost target; a robust loss bears them only from start values near the robot"
    ]


def _link_rms(found: Found) -> dict[str, float] | None:
    kept = found.data.kept
    if kept is None or found.problem.reading.latent.numel():
        return None
    rms = np.sqrt(np.mean(found.calibration.on(kept) ** 2, axis=0))
    return dict(zip(found.problem.labels, (1e3 * rms).tolist(), strict=True))


def _sizes(p: Prediction | None, factor: float = 1e3) -> dict[str, float] | None:
    return None if p is None else {"mean": factor * p.mean, "max": factor * p.greatest, "rms": factor * p.rms}


def _worst(data: PoseData, head: Prediction, lines: np.ndarray, held: bool) -> dict[str, Any]:
    part = data.held_out if held else ~data.held_out
    T = np.asarray(data.all.values[data.keys.position])[part]
    k = head.worst
    return {"line": int(lines[k]), "position_m": T[k].tolist(), "error_mm": 1e3 * head.greatest, "held_out": held}


def _principal(head: Prediction) -> dict[str, Any]:
    sizes, directions = head.principal()
    return {"rms_mm": (1e3 * sizes).tolist(), "directions": directions.tolist()}


def _told(i: Identifiability) -> dict[str, Any]:
    return {
        "rank": i.rank,
        "redundant": i.redundant,
        "ranks": {f"{t:.0e}": r for t, r in i.ranks.items()},
        "condition": i.condition,
        "observability": {f"O{k}": getattr(i.indices, f"o{k}") for k in range(1, 6)},
        "scaling": i.indices.scaling,
        "sentences": i.sentences(),
    }


def _sensitivity(found: Found) -> dict[str, dict[str, float]] | None:
    s = found.sensitivity
    if s is None:
        return None
    table = {}
    for k, name in enumerate(s.names):
        entry = {"position_mm": 1e3 * float(s.pose[found.position][k])}
        e = found.data.keys.orientation
        if e is not None and e in s.pose:
            entry["orientation_deg"] = float(np.degrees(s.pose[e][k]))
        table[name] = entry | {"cost_m4": float(s.cost[k])}
    return table


def _truth(found: Found) -> dict[str, float] | None:
    robot = found.data.truth
    if robot is None:
        return None
    own = {q.name: q.value for q in flat_of(robot).parameters}
    return {n: own[n] for n in found.calibration.values if n in own}
