"""Kind "trajectory_table": several motions beside published numbers, such as Dressler 2012, Table 3.1."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from gtmodel.problem_files.base import Context, InputError, Outcome, Row, Section, at_most
from gtmodel.problem_files.load import validate
from gtmodel.problem_files.path_keys import PATH_ARGUMENTS
from gtmodel.problem_files.settings import apply
from gtmodel.results import SolveStatus, Trajectory

from . import trajectory
from .motion_planning import plan_of
from .trajectory_keys import TrajectoryProblem

NAME = "trajectory_table"
ARGUMENTS = PATH_ARGUMENTS

VALUES = {
    "rows": "one entry per row: name, cost, iterations, final_time_s, energy, saturation, optima, exported values",
    "saving": "time that the first row saves against the last, as a share of the last",
    "energy_ratio": "energy of the first row over that of the last",
}

MEASURED = ("final_time_s", "energy", "saturation", "optima", "exported_final_time_s", "exported_peak_force_N")


class Published(Section):
    """What a source prints for a row; compared by eye, never a check: its poses and limits are unpublished."""

    final_time_s: float = Field(description="final time")
    energy: float = Field(description="energy, in the source's own unit")
    iterations: int = Field(description="number of iterations")


class TableRow(Section):
    """One motion: what it changes of the problem."""

    name: str = Field(description="what the row is called")
    set: dict[str, Any] = Field({}, description='keys that this row changes, such as {"cost.energy" = 0.01}')
    most_iterations: int | None = Field(None, description="bound on the iterations of the attempt that found it")
    published: Published | None = Field(None, description="what the source prints")


class Schema(TrajectoryProblem):
    """Several optimal motions of one robot, one row each."""

    row: list[TableRow] = Field(min_length=2, description="the rows; the last one is what the others are compared with")


def solve(problem: Schema, context: Context) -> Outcome:
    """Solve row by row; ends at the first that is not solved."""
    if context.start is not None:
        raise InputError("--start: a table begins each row at its own guess")
    problems = [_row_problem(problem, n) for n in range(len(problem.row))]
    for n, one in enumerate(problems):
        try:
            plan_of(one, context)
        except InputError as error:
            raise error.within("", f"row[{n}]") from error
    done: list[Outcome] = []
    for n, one in enumerate(problems):
        context.progress(f"row {n + 1} of {len(problems)}: {problem.row[n].name}", n / len(problems), None)
        done.append(trajectory.solve(one, context))
        if not done[-1].status.converged:
            break
    return _outcome(problem, done)


def explain(problem: Schema, context: Context) -> str:
    """Each row as its kind explains it."""
    parts = []
    for n, row in enumerate(problem.row):
        parts.append(f"{row.name}\n{trajectory.explain(_row_problem(problem, n), context)}")
    return "\n\n".join(parts)


def _row_problem(problem: Schema, n: int) -> TrajectoryProblem:
    data = problem.model_dump(mode="json", exclude={"row"}, exclude_unset=True) | {"kind": "trajectory"}
    row = problem.row[n]
    try:
        changed = apply(data, [f"{key}={_text(value)}" for key, value in row.set.items()])
        return validate(trajectory.Schema, changed | {"title": row.name})
    except InputError as error:
        raise InputError(str(error), f"row[{n}].set") from error


def _text(value: Any) -> str:
    """A value as TOML."""
    import tomli_w

    return tomli_w.dumps({"value": value}).partition("=")[2].strip()


def _outcome(problem: Schema, done: list[Outcome]) -> Outcome:
    last = done[-1]
    entries = []
    for row, o in zip(problem.row, done, strict=False):
        kept = {key: o.values.get(key) for key in MEASURED}
        entries.append(
            {"name": row.name, "cost": o.objective, "iterations": o.values.get("attempt_iterations"), **kept}
        )
    if not last.status.converged:
        return Outcome(
            status=last.status,
            message=f"row {len(done)}, {problem.row[len(done) - 1].name}: {last.message}",
            values={"rows": entries},
            trajectory=last.trajectory,
        )
    first, final = done[0].values, last.values
    saving = 1 - first["final_time_s"] / final["final_time_s"]
    checks: dict[str, Any] = {}
    for n, (row, o) in enumerate(zip(problem.row, done, strict=True), 1):
        checks |= {f"row_{n}_{name}": check for name, check in o.checks.items()}
        if row.most_iterations is not None:
            checks[f"row_{n}_iterations"] = at_most(o.values["attempt_iterations"], float(row.most_iterations))
    runs = [(row.name, o.trajectory) for row, o in zip(problem.row, done, strict=True) if o.trajectory is not None]
    reserved = [f"row {n}: {o.message}" for n, o in enumerate(done, 1) if o.message != done[0].message]
    common = done[0].message
    return Outcome(
        status=SolveStatus.SOLVED,
        message="; ".join([f"{len(done)} rows {common}", *reserved]),
        objective=done[0].objective,
        iterations=sum(o.iterations or 0 for o in done),
        checks=checks,
        values={"rows": entries, "saving": saving, "energy_ratio": first["energy"] / final["energy"]},
        trajectory=done[0].trajectory,
        rows=_rows(problem, done, saving, first["energy"] / final["energy"]),
        figures={"paths": lambda: _figure(runs), "forces": lambda: _forces(problem, runs)},
        files={f"row_{n}_{name}": content for n, o in enumerate(done, 1) for name, content in o.files.items()},
        machine_files=[f"row_{n}_{name}" for n, o in enumerate(done, 1) for name in o.machine_files],
    )


def _rows(problem: Schema, done: list[Outcome], saving: float, ratio: float) -> list[Row]:
    rows: list[Row] = []
    for row, o in zip(problem.row, done, strict=True):
        told = row.published

        def beside(value: Any) -> str:
            return "" if value is None else f"published {value:g}"

        rows += [
            Row(f"{row.name}: final time [s]", o.values["final_time_s"], beside(told and told.final_time_s)),
            Row(f"{row.name}: energy [s]", o.values["energy"], beside(told and told.energy)),
            Row(f"{row.name}: iterations", o.values["attempt_iterations"], beside(told and told.iterations)),
            Row(f"{row.name}: motors at their limit [%]", " ".join(f"{100 * x:.0f}" for x in o.values["saturation"])),
        ]
        if len(o.values["optima"]) > 1:
            rows.append(Row(f"{row.name}: optima", " ".join(f"{x:.6f}" for x in o.values["optima"])))
    return [
        *rows,
        Row(f"{problem.row[0].name} saves", 100 * saving, f"% of the time of {problem.row[-1].name}"),
        Row("and takes", ratio, "times its energy"),
    ]


def _figure(runs: list[tuple[str, Trajectory]]) -> Any:
    from gtmodel.plot.motion import space_figure

    return space_figure(runs)


def _forces(problem: Schema, runs: list[tuple[str, Trajectory]]) -> Any:
    from gtmodel.plot.motion import force_figure

    return force_figure(runs, force_limit=problem.limits.force_N)
