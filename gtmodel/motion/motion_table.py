"""The table study: several motions beside published numbers, such as Dressler 2012, Table 3.1."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from ..results import ArgumentError, Quantity, Row, SolveStatus, Study, Trajectory, Work, at_most
from ..results.door import study_function
from ..results.options import Options, Unit
from ..results.work import Progress, never, silent
from .motion_study import MotionStudy, solved
from .planning import plan_of
from .problem import MotionProblem

MEASURED = ("final_time_s", "energy", "saturation", "optima", "exported_final_time_s", "exported_peak_force_N")


@dataclass(frozen=True)
class Published(Options):
    """Numbers that a source prints for a row of the table. They stand beside the computed ones and are never a check,
    because the poses and limits of the source are unpublished.

    >>> printed = gt.motion.Published(final_time=0.89, energy=27.0, iterations=36)
    >>> ends = {"start": gt.motion.End([0.0, -0.9, 0.1]), "goal": gt.motion.End([0.9, -0.9, 0.45])}
    >>> robot, limits = gt.robots.gantry_tau("l1_tape"), gt.motion.Limits(force=700.0)
    >>> problem = gt.motion.MotionProblem(robot=robot, limits=limits, **ends)
    >>> gt.motion.TableRow("time-optimal", problem, published=printed).published.final_time
    0.89
    """

    final_time: Annotated[float, Unit("s"), "final time"]
    energy: Annotated[float, "energy, in the source's own unit"]
    iterations: Annotated[int, "number of iterations"]


@dataclass(frozen=True)
class TableRow:
    """One motion of a table.

    name: what the row is called. problem: the motion. most_iterations: bound on the iterations of the attempt that
    found the motion; a check fails where it takes more. published: what a source prints.
    """

    name: str
    problem: MotionProblem
    most_iterations: int | None = None
    published: Published | None = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MotionTable(Study):
    """Several optimal motions beside each other; `motions` are their studies up to the first that was not solved."""

    asked: Sequence[TableRow]
    motions: Sequence[MotionStudy]
    entries: Annotated[
        Sequence[Mapping[str, Any]],
        Quantity(
            "",
            "one entry per row: name, cost, iterations, final_time_s, energy, saturation, optima, exported values",
            key="rows",
        ),
    ]
    saving: Annotated[
        float | None, Quantity("", "time that the first row saves against the last, as a share of the last")
    ] = None
    energy_ratio: Annotated[
        float | None, Quantity("", "energy of the first row over that of the last")
    ] = None  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.saving is None or self.energy_ratio is None:
            return []
        rows: list[Row] = []
        for row, s in zip(self.asked, self.motions, strict=True):
            printed = row.published
            rows += [
                Row(f"{row.name}: final time [s]", s.final_time, _beside(printed and printed.final_time)),
                Row(f"{row.name}: energy [s]", s.energy, _beside(printed and printed.energy)),
                Row(f"{row.name}: iterations", s.attempt_iterations, _beside(printed and printed.iterations)),
                Row(f"{row.name}: motors at their limit [%]", " ".join(f"{100 * x:.0f}" for x in s.saturation or ())),
            ]
            if len(s.optima or ()) > 1:
                rows.append(Row(f"{row.name}: optima", " ".join(f"{x:.6f}" for x in s.optima or ())))
        return [
            *rows,
            Row(f"{self.asked[0].name} saves", 100 * self.saving, f"% of the time of {self.asked[-1].name}"),
            Row("and takes", self.energy_ratio, "times its energy"),
        ]


def _beside(value: float | None) -> str:
    return "" if value is None else f"published {value:g}"


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
        done.append(solved(row.problem, work))
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
