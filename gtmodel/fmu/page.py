"""Write documentation/index.html of an FMU: its variables, statuses, limits and origin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from .._version import __version__
from ..compiler.causal import CausalFunction
from ..results.status import Status
from .content import escaped
from .table import FmuTable, FmuVariable

_STATUS = {
    Status.OK: ("OK", "OK"),
    Status.NOT_FINITE: ("Error for a set value; Discard for a computed one", "as in model exchange"),
}
_DISCARD = ("Discard: a solver takes a smaller step", "Discard from DoStep, with lastSuccessfulTime")


def page(
    table: FmuTable,
    token: str,
    function: CausalFunction | None,
    hashes: Mapping[str, str],
    box: Mapping[str, Sequence[Sequence[float]]],
    notes: Sequence[str] = (),
) -> str:
    """Return the page; `notes`: meaning of a step function's statuses. `box`: where the function was checked."""
    limited = ("least", "greatest") if table.parameters else ()
    variables = [
        (v.reference, v.name, v.unit, v.role, "" if v.start is None else v.start,
         *(_interval(v) if limited else ()), v.description)
        for v in table.variables
    ]  # fmt: skip
    statuses = [(s.c_name, s.message, *_STATUS.get(s, _DISCARD)) for s in Status if s is not Status.STALE_INPUT]
    about = [
        f"Made by gtmodel {__version__}. All numbers are in SI units, angles in radians.",
        "A call that does not return OK writes no value; the log has the message, in category logStatusDiscard or "
        "logStatusError. After Discard from DoStep an FMI 3.0 unit is as before the call, as the standard requires; a "
        "2.0 unit is at lastSuccessfulTime.",
        *_inside(table),
        *notes,
    ]
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>' + escaped(table.name) + "</title>\n"
        "<style>body{font-family:sans-serif;max-width:70em}td,th{padding:0 .8em;text-align:left;vertical-align:top}"
        "</style></head>\n<body>\n",
        f"<h1>{escaped(table.title)}</h1>\n",
        *[f"<p>{escaped(text)}</p>\n" for text in about],
        "<h2>Variables</h2>\n",
        _rows(("reference", "name", "unit", "role", "start", *limited, "description"), variables),
        "<h2>Status</h2>\n",
        _rows(("status", "message", "model exchange", "co-simulation"), statuses),
    ]
    if box:
        rows = [(name, str([list(map(float, interval)) for interval in value])) for name, value in box.items()]
        parts += [
            "<h2>Box of validity</h2>\n<p>Inside it the function never fails.</p>\n",
            _rows(("input", "intervals"), rows),
        ]
    if function is not None:
        names = {function.flat.variables[i].name for s in function.inputs for i, _ in s.pairs}
        folded = [q for q in function.flat.parameters if q.name not in names]
        parameters = [(q.name, repr(q.value), q.unit or "1") for q in folded]
        parts += ["<h2>Parameters, folded into the code</h2>\n", _rows(("name", "value", "unit"), parameters)]
    parts += ["<h2>Origin</h2>\n", _rows(("name", "value"), [("instantiation token", token), *hashes.items()])]
    return "".join([*parts, "</body>\n</html>\n"])


def _interval(v: FmuVariable) -> list[object]:
    return [x if math.isfinite(x) else "" for x in (v.least, v.most)]


def _inside(table: FmuTable) -> list[str]:
    lines = []
    if table.states:
        lines.append(
            f"Co-simulation uses fourth-order Runge-Kutta with equal inner steps of at most {table.step!r} s, inputs "
            f"held. Compared with half that step over {table.stop!r} s from the start, the largest error of a state, "
            f"relative to max(1, |state|), is {table.error or 0.0:.1e}."
        )
    if table.parameters:
        names = ", ".join(table.variables[r].name for r in table.parameters)
        lines.append(
            f"Settable model parameters: {names}. Model exchange accepts them before and in initialization mode and in "
            "event mode, co-simulation also between two steps. A value outside its limits is an Error, and the old "
            "value stays. Setting a parameter changes neither states nor start values, such as inputs that hold a "
            "pose: these belong to the start values of the parameters."
        )
    if table.parameters and table.states:
        lines.append(
            "The inner step of co-simulation was chosen at the start values of the parameters. The unit compares each "
            "inner step with two of half its length. If a state differs by more than "
            f"{table.part_error!r} relative to max(1, |state|), for example with sharper friction, DoStep returns "
            "Discard: try shorter communication steps."
        )
    if table.period:
        lines.append(
            f"The unit takes a sample at the start and every {table.period!r} s, with the inputs of that instant."
        )
    if table.remembers:
        lines.append(
            "Newton's method starts from the last solution, which is part of the saved state: change inputs in small "
            "steps. The parameters guess.* are its start values for the first solution."
        )
    if table.derivatives:
        lines.append("Derivatives are exact; at a corner of a piecewise function they belong to the active branch.")
    if table.hold:
        lines.append("If the function fails, the outputs keep their last values and the output status is not 0.")
    return lines


def _rows(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    top = "".join(f"<th>{escaped(h)}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{escaped(str(c))}</td>" for c in row) + "</tr>\n" for row in rows)
    return f"<table>\n<tr>{top}</tr>\n{body}</table>\n"
