"""Outlying poses of a calibration, fitted or held out: their errors, in which column, and sentences on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...lang import ModelError
from ...measurements.inspection.residual_tests import outliers
from ...results.suspicion import RUN_LEVEL
from ..calibration import calibrate
from ..prediction import OF_POSES, Prediction

if TYPE_CHECKING:
    from .findings import CalibrationFindings

BULK = 5.0  # times the median size: larger errors do not count for the covariance of the errors
ENOUGH = 20  # held-out poses that are tested for outliers
MANY = 0.1  # of the poses: more outliers are seldom chance
SHOWN = 5  # most lines that a sentence names
ROUND_OFF = 1e-9  # m: smaller errors are no outliers, whatever the others are


@dataclass(frozen=True)
class FarPose:
    """An outlying pose. `row`: of all poses. `error`: predicted less measured position [m], by a fit without the
    outlying poses. `others`: median error [m] of the other poses. `times`: error of the pose over its standard
    deviation."""

    row: int
    held_out: bool
    error: np.ndarray
    others: float
    times: float

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.error))

    @property
    def worst(self) -> int:
        """Component with the largest error."""
        return int(np.argmax(np.abs(self.error)))


def far_poses(f: CalibrationFindings) -> list[FarPose]:
    """Outlying poses of measured positions, one entry each, the farthest first.

    The fitted ones are those of `f.outliers`; held-out ones are tested against each other."""
    name = f.position
    if not f.data.whole or name not in f.fitted:
        return []
    fitted, held = np.flatnonzero(~f.data.held_out), np.flatnonzero(f.data.held_out)
    times = {int(fitted[o.pose]): o.times for o in reversed(f.outliers)}  # the largest of each pose
    errors = np.full(f.data.T.shape, np.nan)
    errors[fitted] = f.fitted[name].errors
    if name in f.held_out and f.left_out is None:
        errors[held] = f.held_out[name].errors
    if times:
        rows = np.arange(len(errors)) if f.refitted is None else fitted
        clean = _without(f, list(times), rows)
        errors[rows] = errors[rows] if clean is None else clean
    if f.left_out is None:
        times |= {int(held[k]): t for k, t in _beyond(errors, errors[held]).items()}
    sizes = np.linalg.norm(errors, axis=1)
    others = np.delete(sizes, list(times))
    typical = float(np.nanmedian(others)) if np.any(np.isfinite(others)) else np.nan
    far = [
        FarPose(k, bool(f.data.held_out[k]), errors[k], max(typical, ROUND_OFF), t)
        for k, t in times.items()
        if sizes[k] > ROUND_OFF
    ]
    return sorted(far, key=lambda p: (-p.size, p.row))


def _without(f: CalibrationFindings, outlying: Sequence[int], rows: np.ndarray) -> np.ndarray | None:
    """Errors of the poses in `rows` by a fit without the outlying ones; None if these do not influence the fit, or if
    there is no such fit."""
    c = f.calibration
    if f.loss != "linear" or f.beside or c.problem.beside or not len(c.x):
        return None
    keep = ~f.data.held_out
    keep[list(outlying)] = False
    try:
        start = c.problem.unknowns.named(c.x)
        clean = calibrate(c.problem.on(f.data.all.part(keep)), cost=c.cost, start=start, confidence=False)
        return clean.positioning_errors(f.data.all.part(rows))[f.position] if clean.status.ok else None
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return None


def _beyond(errors: np.ndarray, held: np.ndarray) -> dict[int, float]:
    """Rows of outliers among the held-out errors (M, k), and their sizes in standard deviations."""
    sizes = np.linalg.norm(errors, axis=1)
    bulk = errors[sizes <= BULK * np.nanmedian(sizes)] if np.any(np.isfinite(sizes)) else errors[:0]
    if len(held) < ENOUGH or len(bulk) < ENOUGH:
        return {}
    S = bulk.T @ bulk / len(bulk)
    if not np.linalg.eigvalsh(S)[0] > 0:
        return {}
    tested = outliers(np.linalg.solve(np.linalg.cholesky(S), held.T).T)
    return {int(k): float(tested.times[k]) for k in tested.beyond(RUN_LEVEL / OF_POSES / 2)}


def columns_of(f: CalibrationFindings) -> list[str]:
    """Names of the columns of the measured position in the file."""
    axes = f.data.T.shape[1]
    columns = f.data.columns[f.position].names if f.position in f.data.columns else ()
    return list(columns) if len(columns) == axes else [f"{f.position}[{k}]" for k in range(axes)]


def named(f: CalibrationFindings, rows: Sequence[int]) -> str:
    """Words for some of the poses: "line 42", "lines 7, 42 and 3 more"; "pose 4" if they come from no file."""
    word = "line" if f.data.all.places is not None else "pose"
    lines = sorted(int(f.data.lines[k]) for k in rows)
    if len(lines) == 1:
        return f"{word} {lines[0]}" + (", held out" if f.data.held_out[rows[0]] else "")
    more = f" and {len(lines) - SHOWN} more" if len(lines) > SHOWN else ""
    return f"{word}s {', '.join(map(str, lines[:SHOWN]))}{more}"


def sentence(f: CalibrationFindings, far: Sequence[FarPose]) -> str:
    """The outlying poses for the verdict, with what to do about them; empty if there are none."""
    if not far:
        return ""
    rows, poses = [p.row for p in far], len(f.data.lines)
    times = f"{far[0].size / far[0].others:.3g} times the typical error"
    size = f"{1e3 * far[0].size:.3g} mm, {times}"
    if len(far) > MANY * poses:
        return f"{len(far)} of {poses} poses are off by up to {size}, too many for chance: look for what they share"
    them = "it" if len(far) == 1 else "them"
    if len(far) == 1:
        said = f"one pose, {named(f, rows)}, is off by {size}"
    else:
        said = f"{len(far)} poses, {named(f, rows)}, are off by up to {size}"
    weight = "; the robust loss gives little weight to fitted ones" if f.loss != "linear" else ""
    return f"{said}: measure {them} again or {_left_out(f, far, them)}{weight}"


def _left_out(f: CalibrationFindings, far: Sequence[FarPose], them: str) -> str:
    own_file = f.data.source.held_out is not None
    if f.data.all.places is None or (own_file and any(p.held_out for p in far)):
        return f"leave {them} out of the {'file' if f.data.all.places is not None else 'measurements'}"
    lines = sorted({*f.data.source.left_out, *(int(f.data.lines[p.row]) for p in far)})
    return f"leave {them} out with measurements.leave_out = {lines}"


def largest(f: CalibrationFindings) -> list[tuple[str, int, np.ndarray]]:
    """Part (fitted, held out), row of all poses, and error (k,) [m] of the largest error of each part."""
    found = []
    for part, rows, errors in (
        ("fitted", np.flatnonzero(~f.data.held_out), f.fitted), ("held out", np.flatnonzero(f.unseen), f.held_out),
    ):  # fmt: skip
        prediction: Prediction | None = errors.get(f.position)
        if prediction is not None:
            found.append((part, int(rows[prediction.worst]), prediction.errors[prediction.worst]))
    return found
