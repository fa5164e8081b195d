"""Assembly modes of many poses in numbers, checks and tables, with the commanded mode of each."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.problem_files.base import Check, Outcome, Row, at_most
from gtmodel.results import SolveStatus
from gtmodel.results.status import ModesStatus

from .commanded_mode import COMMANDED, Judged

# scaled equations at a mode: rounding of some dozen terms of size one
RESIDUAL = 1e-12
# leg lengths over the size: rounding too, larger by the condition near a singularity
LEG_ERROR = 1e-12


def outcome(judged: Judged) -> Outcome:
    """Status, message, checks, values, table and modes.csv; pictures are the kind's own."""
    done = [i for i in range(len(judged.hands)) if judged.done(i)]
    each = [_pose_values(judged, i) for i in range(len(judged.hands))]
    values = _summary(judged, each, done)
    checks = _checks(judged, done)
    statuses = [r.status for r in judged.results]
    if ModesStatus.INTERRUPTED in statuses:
        status = SolveStatus.INTERRUPTED
    else:
        status = SolveStatus.SOLVED if all(s.ok for s in statuses) else SolveStatus.FAILED
    return Outcome(
        status=status,
        message=_message(judged, status, checks),
        checks=checks,
        values=values,
        rows=_rows_of_one(values, each[0]) if len(each) == 1 else _rows_of_many(values, each),
        files={"modes.csv": _csv(each)},
    )


def _pose_values(judged: Judged, i: int) -> dict[str, Any]:
    modes, hands = judged.results[i], judged.hands
    c = modes.certificate
    near = judged.commanded_nearest(i)
    mine = judged.commanded[i]
    return {
        "pose": i + 1,
        "status": modes.status.value,
        "message": judged.message(i),
        "found": c.found,
        "distinct": c.distinct,
        "certified": c.certified,
        "real": c.real,
        "conjugate_pairs": c.conjugate_pairs,
        "infinite": c.infinite,
        "multiple": c.multiple,
        "lost": c.lost,
        "retries": c.retries,
        "worst_residual": c.worst_residual,
        "worst_leg_error": judged.leg_error(i),
        "nearest_mm": 1e3 * c.nearest_distance,
        "nearest_deg": c.nearest_angle_deg,
        "commanded": None if mine is None else mine + 1,
        "commanded_nearest_mm": near[0],
        "commanded_nearest_deg": near[1],
        "q_m": hands.q[i, :3],
        "q_rad": hands.q[i, 3:],
        "tcp_m": hands.T[i],
        "quaternion": _quaternion(hands.R[i]),
        "modes": [
            {
                "mode": k + 1,
                "tcp_m": modes.T[k],
                "quaternion": modes.quaternion[k],
                "nearest_mode": int(modes.nearest_other[k]) + 1 or None,
                "nearest_mm": 1e3 * modes.nearest_distance[k],
                "nearest_deg": modes.nearest_angle_deg[k],
                "commanded": k == mine,
            }
            for k in range(c.real)
        ],
    }


def _quaternion(R: np.ndarray) -> np.ndarray:
    """Scalar first, that one positive; NaN for a rotation that is not known."""
    if not np.isfinite(R).all():
        return np.full(4, np.nan)
    return Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)


def _summary(judged: Judged, each: list[dict[str, Any]], done: list[int]) -> dict[str, Any]:
    def over(choose: Callable[[Sequence[Any]], Any], name: str) -> Any:
        return choose([each[i][name] for i in done]) if done else None

    counts = Counter(each[i]["real"] for i in done)
    near = _nearest(judged, each, done, "nearest")
    mine = _nearest(judged, each, done, "commanded_nearest")
    return {
        "poses": len(each),
        "whole": sum(r.status.ok for r in judged.results),
        **{name: over(min, name) for name in ("found", "distinct", "certified", "real")},
        "real_most": over(max, "real"),
        "real_counts": {str(n): counts[n] for n in sorted(counts)},
        "conjugate_pairs": over(min, "conjugate_pairs"),
        **{name: over(max, name) for name in ("infinite", "multiple", "lost")},
        "retries": over(sum, "retries"),
        "worst_residual": over(max, "worst_residual"),
        "worst_leg_error": over(max, "worst_leg_error"),
        "nearest_mm": near[0],
        "nearest_deg": near[1],
        "commanded": each[0]["commanded"] if len(each) == 1 else None,
        "commanded_nearest_mm": mine[0],
        "commanded_nearest_deg": mine[1],
        "modes": each[0]["modes"] if len(each) == 1 else [],
        "each": each,
    }


def _nearest(judged: Judged, each: list[dict[str, Any]], done: list[int], name: str) -> tuple[float, float]:
    """Of the pose where two modes are nearest, as `AssemblyModes` measures it; NaN where no pose has two."""

    def measure(i: int) -> float:
        distance = each[i][f"{name}_mm"] / (1e3 * judged.results[i].size)
        return math.hypot(distance, math.radians(each[i][f"{name}_deg"]))

    several = [i for i in done if math.isfinite(each[i][f"{name}_mm"])]
    if not several:
        return math.nan, math.nan
    best = min(several, key=measure)
    return each[best][f"{name}_mm"], each[best][f"{name}_deg"]


def _checks(judged: Judged, done: list[int]) -> dict[str, Check]:
    certificates = [judged.results[i].certificate for i in done]
    if not certificates:
        return {}
    numbers = {
        "residual": (max(c.worst_residual for c in certificates), RESIDUAL),
        "leg_error": (max(judged.leg_error(i) for i in done), LEG_ERROR),
        "not_distinct": (float(max(c.found - c.distinct for c in certificates)), 0.0),
        "without_conjugate": (float(max(c.found - c.real - 2 * c.conjugate_pairs for c in certificates)), 0.0),
        "lost": (float(max(c.lost for c in certificates)), 0.0),
    }
    errors = [judged.errors[i] for i in done if not math.isnan(judged.errors[i])]
    if errors:
        numbers["commanded_error"] = (max(errors), COMMANDED)
    return {name: at_most(value, bound) for name, (value, bound) in numbers.items()}


def _message(judged: Judged, status: SolveStatus, checks: dict[str, Check]) -> str:
    n = len(judged.hands)
    if status is SolveStatus.INTERRUPTED:
        return f"{status.sentence}; {sum(map(judged.done, range(n)))} of {n} poses were searched"
    if status is SolveStatus.FAILED:
        bad = [i for i in range(n) if not judged.results[i].status.ok]
        head = f"pose {bad[0] + 1}: " if n > 1 else ""
        more = f"; {len(bad)} of {n} poses are not whole" if n > 1 else ""
        return f"{head}{judged.message(bad[0])}{more}"
    text = judged.results[0].message if n == 1 else f"all finite modes of {n} poses were found"
    lacking = [i for i in range(n) if judged.hands.q.shape[1] and math.isnan(judged.errors[i])]
    if lacking and n == 1:
        real = judged.results[0].certificate.real
        text += "; no real one: the links cannot be assembled at these carts" if real == 0 else ""
        text += f"; Newton reached none of the {real} real ones from home" if real else ""
    elif lacking:
        text += f"; Newton found no pose for {len(lacking)} of them"
    return text


def _rows_of_one(values: dict[str, Any], pose: dict[str, Any]) -> list[Row]:
    rows = [
        Row("modes found, distinct, certified", f"{pose['found']}, {pose['distinct']}, {pose['certified']}", "of 40"),
        Row("real", pose["real"]),
        Row("conjugate pairs", pose["conjugate_pairs"]),
        Row("at infinity, multiple, lost", f"{pose['infinite']}, {pose['multiple']}, {pose['lost']}", "paths"),
        Row("tracked again", pose["retries"], "paths"),
        Row("worst residual", pose["worst_residual"]),
        Row("worst error of a leg, relative", pose["worst_leg_error"]),
        *_near_rows("nearest two real modes", pose["nearest_mm"], pose["nearest_deg"]),
        Row("commanded mode", "none" if pose["commanded"] is None else pose["commanded"]),
        *_near_rows("nearest to the commanded", pose["commanded_nearest_mm"], pose["commanded_nearest_deg"]),
    ]
    for mode in values["modes"]:
        mark = " (commanded)" if mode["commanded"] else ""
        rows.append(Row(f"mode {mode['mode']}{mark}", ", ".join(f"{x:.4f}" for x in mode["tcp_m"]), "m"))
    return rows


def _near_rows(label: str, mm: float, deg: float) -> list[Row]:
    if not math.isfinite(mm):
        return []
    return [Row(label, mm, "mm"), Row(f"{label}, angle", deg, "deg")]


def _rows_of_many(values: dict[str, Any], each: list[dict[str, Any]]) -> list[Row]:
    return [
        Row("poses", values["poses"]),
        Row("with a whole set of modes", values["whole"]),
        *(Row(f"with {count} real modes", poses) for count, poses in values["real_counts"].items()),
        Row("with the commanded pose among them", sum(pose["commanded"] is not None for pose in each)),
        Row("tracked again", values["retries"], "paths"),
        Row("worst residual", values["worst_residual"]),
        Row("worst error of a leg, relative", values["worst_leg_error"]),
        *_near_rows("nearest two real modes", values["nearest_mm"], values["nearest_deg"]),
        *_near_rows("nearest to a commanded one", values["commanded_nearest_mm"], values["commanded_nearest_deg"]),
    ]


def _csv(each: list[dict[str, Any]]) -> str:
    """One line per real mode."""
    lines = ["pose,mode,x_m,y_m,z_m,e0,e1,e2,e3,commanded,nearest_mode,nearest_mm,nearest_deg"]
    for pose in each:
        for mode in pose["modes"]:
            numbers = [repr(float(x)) for x in (*mode["tcp_m"], *mode["quaternion"])]
            near = [f"{mode[name]:.9g}" if math.isfinite(mode[name]) else "" for name in ("nearest_mm", "nearest_deg")]
            cells = [pose["pose"], mode["mode"], *numbers, int(mode["commanded"]), mode["nearest_mode"] or "", *near]
            lines.append(",".join(map(str, cells)))
    return "\n".join(lines) + "\n"
