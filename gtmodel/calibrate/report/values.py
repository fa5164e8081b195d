"""What a calibration reports, by name; and its checks."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler.causal import flat_of
from ...inference import Identifiability
from ...results import Check, at_most
from ..measured.poses import SplitPoses
from ..prediction import Prediction
from .findings import CalibrationFindings, verdict

LOOK = "the verdict in the table says what to look at"
SHOWN_PAIRS = 20
MANY = 0.1  # of the poses: so many outliers are seldom chance


def values_of(findings: CalibrationFindings, accuracy: float | None) -> dict[str, Any]:
    """The quantities of a `CalibrationStudy`, its estimate and its notes; accuracy [m]: what was wanted."""
    c, data = findings.calibration, findings.data
    sound, proven, sentences = verdict(findings, accuracy)
    errors, lines, held = findings.headline
    own = {q.name for q in findings.problem.closure.flat.parameters}
    intervals_hold = c.estimate is not None and findings.confidence.holds
    head = errors.get(findings.position)
    return {
        "parameters": {n: v for n, v in c.values.items() if n in own},
        "unknowns": _unknowns(findings),
        "estimate": findings.confidence.estimate if intervals_hold else None,
        "withheld": "" if intervals_hold else findings.confidence.withheld,
        "intervals_hold": intervals_hold,
        "colour_tested": c.estimate is not None and findings.confidence.tested,
        "measurement": {n: v for n, v in c.values.items() if n not in own},
        "poses": {
            "fitted": len(findings.lines), "held_out": len(findings.lines_held_out), "repeated": len(data.repeated),
        },
        "link_errors": dict(c.link_errors),
        "held_out_link_rms": _link_rms(findings),
        "held_out": _sizes(findings.held_out.get(findings.position)),
        "fitted": _sizes(findings.fitted.get(findings.position)),
        "a_priori": _sizes(findings.a_priori.get(findings.position)),
        "orientation": _sizes(errors.get(data.pose.orientation or "")),
        "worst": None if head is None else _worst(data, head, lines, held),
        "principal": None if head is None else _principal(head),
        "identifiability_before": _identifiability(findings.before),
        "identifiability_after": None if findings.after is None else _identifiability(findings.after),
        "correlated": [] if findings.after is None else [list(p) for p in findings.after.correlated[:SHOWN_PAIRS]],
        "outliers": [
            {"line": int(findings.lines[o.pose]), "link": findings.problem.labels[o.link],
             "residual_mm": 1e3 * o.residual, "times": o.times}
            for o in findings.outliers
        ],
        "repeatability": findings.repeatability,
        "sensitivity": _sensitivity(findings),
        "numerics_sound": sound,
        "prediction_proven": proven,
        "verdict": sentences,
        "notes": _notes(findings),
        "truth": _truth(findings),
        "synthetic": data.synthetic,
    }  # fmt: skip


def checks_of(accuracy: float | None, findings: CalibrationFindings) -> dict[str, Check]:
    """Prediction and, where it was asked for, the accuracy."""
    checks = {}
    name = findings.position
    judged = findings.judged
    if judged is not None:
        bound = judged.bound if np.isfinite(judged.bound) else None
        checks["held_out_over_fitted"] = Check(judged.ratio, bound, LOOK, judged=judged.passed)
    if findings.lost:
        checks["held_out_poses_lost"] = at_most(float(findings.lost), 0.0, LOOK)
    if findings.far:
        checks["moved_too_far"] = at_most(float(len(findings.far)), 0.0, LOOK)
    over = findings.over_noise
    if over is not None:
        checks["residuals_over_noise"] = Check(over.ratio, over.bound, LOOK, judged=over.passed)
    if accuracy is not None and name in findings.headline[0]:
        mean = findings.headline[0][name].mean
        # what was fitted proves nothing
        proven = 1e3 * mean if findings.held_out else np.nan
        checks["mean_error_mm"] = at_most(
            proven, 1e3 * accuracy, LOOK if findings.held_out else "hold poses out to prove it"
        )
    return checks


def _unknowns(findings: CalibrationFindings) -> list[dict[str, Any]]:
    c, u, estimate = findings.calibration, findings.problem.unknowns, findings.confidence.estimate
    listed = []
    for k, name in enumerate(u.names):
        entry = {"name": name, "unit": u.units[k] or "1", "start": float(u.start[k]), "value": float(c.x[k]),
                 "std": None, "interval_95": None}  # fmt: skip
        if estimate is not None and np.isfinite(estimate.std[k]):
            entry["std"] = float(estimate.std[k])
            if findings.confidence.holds:
                entry["interval_95"] = list(estimate.interval(name))
        listed.append(entry)
    return listed


def _notes(findings: CalibrationFindings) -> list[str]:
    c = findings.calibration
    if c.estimate is None:
        return [*findings.alarms.notes]
    intervals = [*findings.confidence.reasons, *findings.confidence.notes]
    notes = [*findings.priors, *c.estimate.notes, *intervals, *_crowded(findings), *findings.far]
    notes += findings.alarms.notes
    return list(dict.fromkeys(notes))  # two null directions may move the same names: one sentence


def _crowded(findings: CalibrationFindings) -> list[str]:
    """A sentence where so many poses hold outliers that they are hardly outliers."""
    N, bad = len(findings.lines), len({o.pose for o in findings.outliers})
    if bad <= MANY * N:
        return []
    return [
        f"{bad} of {N} poses ({bad / N:.0%}) hold outliers, so many are seldom chance: look at what they share, "
        "such as a place, a session or a lost target; a robust loss bears them only from start values near the robot"
    ]


def _link_rms(findings: CalibrationFindings) -> dict[str, float] | None:
    kept = findings.data.kept
    if kept is None or findings.problem.reading.latent.numel():
        return None
    rms = np.sqrt(np.mean(findings.calibration.on(kept) ** 2, axis=0))
    return dict(zip(findings.problem.labels, rms.tolist(), strict=True))


def _sizes(p: Prediction | None) -> dict[str, float] | None:
    return None if p is None else {"mean": p.mean, "max": p.greatest, "rms": p.rms}


def _worst(data: SplitPoses, head: Prediction, lines: np.ndarray, held: bool) -> dict[str, Any]:
    part = data.held_out if held else ~data.held_out
    T = data.T[part]
    k = head.worst
    return {"line": int(lines[k]), "position_m": T[k].tolist(), "error_mm": 1e3 * head.greatest, "held_out": held}


def _principal(head: Prediction) -> dict[str, Any]:
    sizes, directions = head.principal()
    return {"rms_mm": (1e3 * sizes).tolist(), "directions": directions.tolist()}


def _identifiability(i: Identifiability) -> dict[str, Any]:
    return {
        "rank": i.rank,
        "redundant": i.redundant,
        "ranks": {f"{t:.0e}": r for t, r in i.ranks.items()},
        "condition": i.condition,
        "observability": {f"O{k}": getattr(i.indices, f"o{k}") for k in range(1, 6)},
        "scaling": i.indices.scaling,
        "notes": i.notes,
    }


def _sensitivity(findings: CalibrationFindings) -> dict[str, dict[str, float]] | None:
    s = findings.sensitivity
    if s is None:
        return None
    table = {}
    for k, name in enumerate(s.names):
        entry = {"position_mm": 1e3 * float(s.pose[findings.position][k])}
        e = findings.data.pose.orientation
        if e is not None and e in s.pose:
            entry["orientation_deg"] = float(np.degrees(s.pose[e][k]))
        table[name] = entry | {"cost_m4": float(s.cost[k])}
    return table


def _truth(findings: CalibrationFindings) -> dict[str, float] | None:
    robot = findings.data.source.truth
    if robot is None:
        return None
    own = {q.name: q.value for q in flat_of(robot).parameters}
    return {n: own[n] for n in findings.calibration.values if n in own}
