"""What a calibration reports, by name; and its checks."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler.causal import flat_of
from ...inference import Identifiability
from ...results import Check, at_most
from ..measured.poses import SplitPoses
from ..prediction import Prediction
from .findings import Found, verdict
from .movement import moved_too_far

LOOK = "the verdict in the table says what to look at"
SHOWN_PAIRS = 20
MANY = 0.1  # of the poses: so many outliers are seldom chance


def values_of(found: Found, accuracy: float | None) -> dict[str, Any]:
    """The quantities of a `CalibrationStudy`; accuracy [m]: what was wanted."""
    c, data = found.calibration, found.data
    sound, proven, sentences = verdict(found, accuracy)
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
        "link_errors": dict(c.link_errors),
        "held_out_link_rms": _link_rms(found),
        "held_out": _sizes(found.held_out.get(found.position)),
        "fitted": _sizes(found.fitted.get(found.position)),
        "a_priori": _sizes(found.a_priori.get(found.position)),
        "orientation": _sizes(told.get(data.pose.orientation or "")),
        "worst": None if head is None else _worst(data, head, lines, held),
        "principal": None if head is None else _principal(head),
        "identifiability_before": _told(found.before),
        "identifiability_after": None if found.after is None else _told(found.after),
        "correlated": [] if found.after is None else [list(p) for p in found.after.correlated[:SHOWN_PAIRS]],
        "outliers": [
            {"line": int(found.lines[o.pose]), "link": found.problem.labels[o.link], "residual_mm": 1e3 * o.residual,
             "times": o.times} for o in found.outliers
        ],
        "repeatability": found.repeatability,
        "sensitivity": _sensitivity(found),
        "numerics_sound": sound,
        "prediction_proven": proven,
        "verdict": sentences,
        "limits": _notes(found),
        "truth": _truth(found),
        "synthetic": data.synthetic,
    }  # fmt: skip


def checks_of(accuracy: float | None, found: Found) -> dict[str, Check]:
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
    if accuracy is not None and name in found.told[0]:
        mean = found.told[0][name].mean
        # what was fitted proves nothing
        proven = 1e3 * mean if found.held_out else np.nan
        checks["mean_error_mm"] = at_most(
            proven, 1e3 * accuracy, LOOK if found.held_out else "hold poses out to prove it"
        )
    return checks


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
    return dict(zip(found.problem.labels, rms.tolist(), strict=True))


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


def _told(i: Identifiability) -> dict[str, Any]:
    return {
        "rank": i.rank,
        "redundant": i.redundant,
        "ranks": {f"{t:.0e}": r for t, r in i.ranks.items()},
        "condition": i.condition,
        "observability": {f"O{k}": getattr(i.indices, f"o{k}") for k in range(1, 6)},
        "scaling": i.indices.scaling,
        "sentences": i.notes,
    }


def _sensitivity(found: Found) -> dict[str, dict[str, float]] | None:
    s = found.sensitivity
    if s is None:
        return None
    table = {}
    for k, name in enumerate(s.names):
        entry = {"position_mm": 1e3 * float(s.pose[found.position][k])}
        e = found.data.pose.orientation
        if e is not None and e in s.pose:
            entry["orientation_deg"] = float(np.degrees(s.pose[e][k]))
        table[name] = entry | {"cost_m4": float(s.cost[k])}
    return table


def _truth(found: Found) -> dict[str, float] | None:
    robot = found.data.source.truth
    if robot is None:
        return None
    own = {q.name: q.value for q in flat_of(robot).parameters}
    return {n: own[n] for n in found.calibration.values if n in own}
