"""What stands beside an identification: published numbers, and the closed loop simulated with the identified ones."""

from __future__ import annotations

from typing import Any

from gtmodel.compiler.causal import flat_of
from gtmodel.identify.parameter_names import scalar_parameters
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files.base import Context, InputError, Outcome, Row

from . import closed_loop
from .identification_data import Recordings
from .identification_keys import Schema

VALUES = {
    "published": "relative difference from published numbers by name; of what was estimated; null where none are given",
    **{name: f"{text}; null without [closed_loop]" for name, text in closed_loop.VALUES.items()},
}


def check(problem: Schema, model: Model) -> None:
    """Raises InputError for a published number of no parameter, and for a closed loop without a log."""
    for name in problem.published:
        try:
            scalar_parameters(flat_of(model), [name])
        except ModelError as error:
            raise InputError(str(error), f"published.{name}") from error
    if problem.closed_loop is not None and problem.log is None:
        raise InputError("compares with measured motion; give a [log]", "closed_loop")


def beside(problem: Schema, outcome: Outcome, data: Recordings, context: Context) -> Outcome:
    """The outcome with what the problem asks to see beside it."""
    values: dict[str, Any] = {**outcome.values, **dict.fromkeys(VALUES)}
    found = values["parameters"]
    rows, checks, figures = list(outcome.rows), dict(outcome.checks), dict(outcome.figures)
    told_of = {name: told for name, told in problem.published.items() if name in found}
    if told_of:
        values["published"] = {name: found[name] / told - 1 for name, told in told_of.items() if told}
        for name, told in told_of.items():
            percent = "" if not told else f", {100 * values['published'][name]:+.2f} %"
            rows.append(Row(f"published {name}", f"{told:g}{percent}", values["units"].get(name, "")))
    section = problem.closed_loop
    if section is not None:
        numbers = {**problem.parameters, **found}
        runs = closed_loop.follow(
            section, numbers, data.fitted + data.held_out, problem.known, problem.targets, context
        )
        values |= closed_loop.values_of(runs)
        rows += closed_loop.rows_of(runs)
        checks |= closed_loop.checks_of(section, runs)
        title = f"{problem.title or problem.robot}: closed loop simulated from the reference"

        def figure() -> Any:
            from gtmodel.plot.closed_loop import closed_loop_figure

            return closed_loop_figure([(run.name, run.trajectory) for run in runs], title=title)

        figures["closed_loop"] = figure
    return outcome.with_(values=values, rows=rows, checks=checks, figures=figures)
