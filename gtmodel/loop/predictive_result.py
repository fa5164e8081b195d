"""Result of the law "predictive" beside computed torque: forces, limits, iterations, and what the plan could not do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from ..results import Check, Quantity, Row, at_least, at_most
from ..results.study import to_inherit
from .exchange import CYCLE_MS
from .loop_result import LoopStudy
from .predictive_law import PLAN_COUNTERS
from .process import COLUMNS, rows_of

if TYPE_CHECKING:
    from .build import GeneratedPlan
    from .one_run import Bench, OneRun

RESTED = 50  # cycles at rest before an error counts as an offset: 0.2 s
OFFSET_MM = 0.1  # largest offset at rest


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PredictiveLoop(LoopStudy):
    """Two runs of the loop on the same motion: computed torque, and an optimum in every cycle.

    Forces, and torques of joints, are those that the servo asks for; motors saturate at the limit. active: share of the
    cycles in whose plan a limit is active, by its name.
    """

    force_limit: Annotated[float | None, Quantity("N", "largest force of the motors; null: unlimited")] = None
    force_planned: Annotated[float | None, Quantity("N", "largest force of a plan; null: joints")] = None
    force_asked: Annotated[Sequence[float], Quantity("N", "largest force that the servo asked for, per run")] = ()
    torque_limit: Annotated[float | None, Quantity("N.m", "of joints: largest torque; null: unlimited")] = None
    torque_planned: Annotated[float | None, Quantity("N.m", "of joints: largest torque of a plan; null: carts")] = None
    torque_asked: Annotated[
        Sequence[float], Quantity("N.m", "of joints: largest torque that the servo asked for, per run")
    ] = ()
    beyond: Annotated[Sequence[float], Quantity("1", "share of the forces asked for beyond the limit, per run")] = ()
    offset: Annotated[
        Sequence[float | None], Quantity("mm", "largest mean error of T where the reference rests, per run")
    ] = ()
    prediction_error: Annotated[float, Quantity("mm", "rms of measured minus predicted positions of the axes")] = 0.0
    iterations_mean: Annotated[float, Quantity("", "mean iterations of a cycle")] = 0.0
    iterations_largest: Annotated[int, Quantity("", "largest number of iterations of a cycle")] = 0
    kkt_residual: Annotated[float, Quantity("1", "largest KKT residual of a solved cycle")] = 0.0
    active: Annotated[Mapping[str, float], Quantity("1", "share of cycles with an active limit, by its name")] = None  # type: ignore[assignment]
    unsolved: Annotated[int, Quantity("", "cycles without a solution, in which the plan was followed")] = 0
    unread: Annotated[int, Quantity("", "cycles without a usable reading, in which the plan was followed")] = 0
    refused: Annotated[int, Quantity("", "rows of goals that could not be used")] = 0
    skipped: Annotated[int, Quantity("", "cycles of the robot that the loop did not go through")] = 0
    spectral_radius: Annotated[
        float, Quantity("1", "spectral radius of a cycle near the targets, under the servo; below 1 the loop settles")
    ] = 0.0

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        what, unit = ("force", "N") if self.force_asked else ("torque", "N.m")
        asked_for, planned, limit = (
            (self.force_asked, self.force_planned, self.force_limit)
            if self.force_asked
            else (self.torque_asked, self.torque_planned, self.torque_limit)
        )
        if not self.runs or not asked_for:
            return super().rows
        rows = super().rows
        for run, asked, beyond, offset in zip(self.runs, asked_for, self.beyond, self.offset, strict=True):
            rows.append(Row(f"{run['label']}: largest {what} asked for", asked, unit))
            if limit is not None:
                rows.append(Row(f"{run['label']}: {what}s beyond {limit:g} {unit}", 100 * beyond, "%"))
            if offset is not None:
                rows.append(Row(f"{run['label']}: offset at rest", offset, "mm"))
        active = sorted(self.active.items(), key=lambda entry: -entry[1])
        counted = (self.unsolved, self.unread, self.refused, self.skipped)
        return [
            *rows,
            Row(f"largest {what} of a plan", planned, unit),
            Row("measured minus predicted, rms", self.prediction_error, "mm"),
            Row("iterations: mean, largest", f"{self.iterations_mean:.1f} {self.iterations_largest}"),
            Row("spectral radius of a cycle near the targets", self.spectral_radius),
            Row("largest KKT residual", self.kkt_residual),
            Row("limits active in the plan", ", ".join(f"{name} {100 * s:.0f} %" for name, s in active if s) or "none"),
            Row("cycles unsolved, unread, goals refused, cycles skipped", " ".join(map(str, counted))),
        ]


def goals_of(plan: GeneratedPlan, table: np.ndarray, axes: int) -> np.ndarray | str:
    """Return the rows of goals of a controller from those of a reference, or the name it lacks."""
    names = [*("q", "der(q)", "der(q,2)"), *("T", "der(T)", "der(T,2)")]
    sizes = [axes] * 3 + [3] * 3
    ends = np.cumsum([0, *sizes]).tolist()
    at = {name: (ends[k], sizes[k]) for k, name in enumerate(names)}
    columns = list[np.ndarray]()
    for name, _, size in plan.goals:
        if at.get(name, (0, 0))[1] != size:
            return name
        columns.append(table[:, at[name][0] : at[name][0] + size])
    return np.hstack(columns)


def quantities(bench: Bench, runs: Sequence[OneRun], plan: GeneratedPlan) -> tuple[dict[str, Any], dict[str, Check]]:
    """Return the further quantities of a `PredictiveLoop`, and its checks."""
    rows = rows_of(runs[-1].log)
    at = {name: rows[:, n] for n, name in enumerate(COLUMNS)}
    took = rows[at["iterations"] > 0]
    solved = took[np.diff(np.concatenate([[0.0], took[:, COLUMNS.index("plan_failed")]])) == 0.0]
    axes = bench.axes
    missed = np.stack([at[f"measured[{n}]"] - at[f"predicted[{n}]"] for n in range(axes)])
    planned = np.stack([np.abs(at[f"force[{n}]"]) for n in range(axes)])
    bits = took[:, COLUMNS.index("active")].astype(np.int64)
    limit = bench.disturbances.force_limit
    asked = [float(np.abs(one.forces_N).max(initial=0.0)) for one in runs]
    beyond = [float(np.mean(np.abs(one.forces_N) > (limit or np.inf))) if one.forces_N.size else 0.0 for one in runs]
    offsets = [_offset_mm(bench, one) for one in runs]
    what, largest = "torque" if bench.joints else "force", float(planned.max(initial=0.0))
    numbers: dict[str, Any] = {
        f"{what}_limit": limit, f"{what}_planned": largest, f"{what}_asked": asked, "beyond": beyond,
        "offset": offsets, "prediction_error": 1e3 * float(np.sqrt(np.mean(missed**2))) if missed.size else 0.0,
        "iterations_mean": float(np.mean(took[:, COLUMNS.index("iterations")])) if len(took) else 0.0,
        "iterations_largest": int(at["iterations"].max(initial=0)),
        "kkt_residual": float(solved[:, COLUMNS.index("kkt_residual")].max(initial=0.0)),
        "active": {name: float(np.mean(bits >> k & 1)) if len(bits) else 0.0 for k, name in enumerate(plan.limits)},
    }  # fmt: skip
    counted = [int(runs[-1].report[name]) for name in PLAN_COUNTERS]
    numbers |= dict(zip(("unsolved", "unread", "refused", "skipped"), counted, strict=True))
    checks = dict[str, Check]()
    if limit is not None:
        advice = "the plan asks for more than the motors have: lower the limits of the controller"
        checks[f"planned_{what}"] = at_most(largest, limit, advice)
    margin = bench.disturbances.force_margin
    if limit is not None and margin is not None:
        advice = "give the controller a lower limit, or the servo a softer damping"
        if bench.peer == "rsi":
            kept = float(np.max(bench.servo.kp_N_m)) * bench.stop.speed_m_s * 1e-3 * CYCLE_MS / 2
            advice = (
                "over RSI the servo receives no speeds, so it also holds the axes back within a cycle, by up to "
                f"kp v T / 2 = {kept:.3g}: allow this in force_margin, or give the controller a lower limit"
            )
        checks[f"asked_{what}"] = at_most(asked[-1], limit + margin, advice)
    if offsets[-1] is not None:
        advice = "the controller does not hold the goal: let it estimate a disturbance of each input"
        checks["offset_at_rest"] = at_most(offsets[-1], OFFSET_MM, advice)
    numbers["spectral_radius"] = plan.radius
    checks["spectral_radius"] = at_most(
        plan.radius, 1.0, "the loop does not settle: give more stages, or a cost after the horizon"
    )
    checks["solved_cycles"] = at_least(1.0 - counted[0] / max(1, len(took)), 0.99, "raise max_iterations")
    return numbers, checks


def _offset_mm(bench: Bench, one: OneRun) -> float | None:
    """Largest mean error of T over the cycles in which the reference has rested for a while; None: it never does."""
    T = bench.tcp_m[: len(one.tcp_m)]
    still = np.concatenate([[False], np.all(np.diff(T, axis=0) == 0.0, axis=1)])
    still &= np.abs(T - T[0]).max(axis=1) > 0.0  # at the start nothing was reached
    offsets, since, errors = list[float](), 0, list[np.ndarray]()
    for k in range(len(T) + 1):
        if k < len(T) and still[k]:
            since += 1
            if since > RESTED:
                errors.append(one.tcp_m[k] - T[k])
        else:
            if errors:
                offsets.append(float(np.linalg.norm(np.mean(errors, axis=0))))
            since, errors = 0, []
    return 1e3 * max(offsets) if offsets else None
