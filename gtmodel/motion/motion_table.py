"""The table study: several motions beside published numbers, such as Dressler 2012, Table 3.1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from ..results import ArgumentError, SolveStatus, Trajectory, Work, at_most
from ..results.door import study_function
from ..results.work import Progress, never, silent
from .motion_study import MotionStudy, solved
from .motion_table_result import MotionTable
from .planning import plan_of
from .table_row import TableRow

MEASURED = ("final_time_s", "energy", "saturation", "optima", "exported_final_time_s", "exported_peak_force_N")


@study_function
def table_study(
    rows: Sequence[TableRow],
    *,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> MotionTable:
    """Several optimal motions one after the other; ends at the first that is not solved.

    Args:
        rows: at least two; the last one is what the others are compared with.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError, before the first row is solved.

    >>> import gtmodel as gt
    >>> from gtmodel.motion import Cost, End, Limits, MotionMesh, MotionProblem, TableRow, table_study
    >>> ends = {"start": End([0.0, -0.9, 0.1]), "goal": End([0.2, -0.9, 0.2])}
    >>> robot, mesh = gt.robots.gantry_tau("l1_tape"), MotionMesh(elements=10)
    >>> asked = {"robot": robot, "limits": Limits(force=700.0), "mesh": mesh}
    >>> fast, thrifty = (MotionProblem(**ends, **asked, cost=Cost(energy=w)) for w in (0.0, 1e-5))
    >>> table_study([TableRow("fast", fast), TableRow("thrifty", thrifty)]).saving > 0
    True
    """
    if len(rows) < 2:
        raise ArgumentError(f"expected two rows or more; found {len(rows)}", "rows")
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    for n, row in enumerate(rows):
        try:
            plan_of(row.problem)
        except ArgumentError as error:
            where = f"rows[{n}].problem.{error.argument}" if error.argument else f"rows[{n}]"
            raise ArgumentError(error.message, where) from error
    done: list[MotionStudy] = []
    for n, row in enumerate(rows):
        work.progress(f"row {n + 1} of {len(rows)}: {row.name}", n / len(rows), None)
        done.append(solved(row.problem, work, number=n + 1))
        if not done[-1].status.converged:
            break
    return _study_of(rows, done, title)


def _study_of(rows: Sequence[TableRow], done: list[MotionStudy], title: str) -> MotionTable:
    first, last = done[0], done[-1]
    entries = []
    for row, s in zip(rows, done, strict=False):
        kept = {key: s.values.get(key) for key in MEASURED}
        entries.append({"name": row.name, "cost": s.objective, "iterations": s.attempt_iterations, **kept})
    if first.final_time is None or last.final_time is None or first.energy is None or last.energy is None:
        return MotionTable(
            status=last.status,
            message=f"row {len(done)}, {rows[len(done) - 1].name}: {last.message}",
            title=title, asked=rows, motions=done, entries=entries, trajectory=last.trajectory,
        )  # fmt: skip
    checks = {}
    for n, (row, s) in enumerate(zip(rows, done, strict=True), 1):
        checks |= {f"row_{n}_{name}": check for name, check in s.checks.items()}
        if row.most_iterations is not None:
            checks[f"row_{n}_iterations"] = at_most(s.attempt_iterations or 0, float(row.most_iterations))
    runs = [(row.name, s.trajectory) for row, s in zip(rows, done, strict=True) if s.trajectory is not None]
    reserved = [f"row {n}: {s.message}" for n, s in enumerate(done, 1) if s.message != first.message]
    return MotionTable(
        status=SolveStatus.SOLVED,
        message="; ".join([f"{len(done)} rows {first.message}", *reserved]),
        title=title,
        objective=first.objective,
        iterations=sum(s.iterations or 0 for s in done),
        checks=checks,
        trajectory=first.trajectory,
        asked=rows,
        motions=done,
        entries=entries,
        saving=1 - first.final_time / last.final_time,
        energy_ratio=first.energy / last.energy,
        figures={
            "paths": partial(_paths, runs),
            "forces": partial(_forces, runs, rows[0].problem.limits.force),
        },
        files={f"row_{n}_{name}": content for n, s in enumerate(done, 1) for name, content in s.files.items()},
        machine_files=[f"row_{n}_{name}" for n, s in enumerate(done, 1) for name in s.machine_files],
    )


def _paths(runs: list[tuple[str, Trajectory]]) -> Any:
    from ..plot.motion import space_figure

    return space_figure(runs)


def _forces(runs: list[tuple[str, Trajectory]], limit: float) -> Any:
    from ..plot.motion import force_figure

    return force_figure(runs, force_limit=limit)
