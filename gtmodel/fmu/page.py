"""documentation/index.html of a unit: what it takes and gives, its statuses, limits and origin."""

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
    Status.NOT_FINITE: ("Error for a number that is set; Discard for one that is computed", "the same"),
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
    """The page; `notes`: what the statuses of a step function mean. `box`: where it was checked to answer."""
    limited = ("least", "greatest") if table.parameters else ()
    variables = [
        (v.reference, v.name, v.unit, v.role, "" if v.start is None else v.start,
         *(_interval(v) if limited else ()), v.description)
        for v in table.variables
    ]  # fmt: skip
    statuses = [(s.c_name, s.message, *_STATUS.get(s, _DISCARD)) for s in Status if s is not Status.STALE_INPUT]
    about = [
        f"Made by gtmodel {__version__}. All numbers are in SI units, angles in radians.",
        "After anything but OK no value is written; the sentence comes through the log, category logStatusDiscard or "
        "logStatusError. After Discard from DoStep an FMI 3.0 unit is as before the call, as the standard asks; a "
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
        _rows(("reference", "name", "unit", "what it is", "start", *limited, "description"), variables),
        "<h2>Status</h2>\n",
        _rows(("status", "sentence", "model exchange", "co-simulation"), statuses),
    ]
    if box:
        rows = [(name, str([list(map(float, interval)) for interval in value])) for name, value in box.items()]
        parts += [
            "<h2>Box of validity</h2>\n<p>Inside it answers everywhere.</p>\n",
            _rows(("input", "intervals"), rows),
        ]
    if function is not None:
        names = {function.flat.variables[i].name for s in function.inputs for i, _ in s.pairs}
        folded = [q for q in function.flat.parameters if q.name not in names]
        parameters = [(q.name, repr(q.value), q.unit or "1") for q in folded]
        parts += ["<h2>Parameters, folded into the code</h2>\n", _rows(("name", "value", "unit"), parameters)]
    parts += ["<h2>Origin</h2>\n", _rows(("what", "value"), [("instantiation token", token), *hashes.items()])]
    return "".join([*parts, "</body>\n</html>\n"])


def _interval(v: FmuVariable) -> list[object]:
    return [x if math.isfinite(x) else "" for x in (v.least, v.most)]


def _inside(table: FmuTable) -> list[str]:
    lines = []
    if table.states:
        lines.append(
            f"Co-simulation inside: the method of Runge and Kutta in equal parts no longer than {table.step!r} s, "
            f"inputs held. Compared with half of that step over {table.stop!r} s from the start the largest error of "
            f"a state, over its size or one, is {table.error or 0.0:.1e}."
        )
    if table.parameters:
        names = ", ".join(table.variables[r].name for r in table.parameters)
        lines.append(
            f"Parameters of the model that can be set: {names}. In model exchange before and in initialization mode "
            "and in event mode, in co-simulation also between two steps; a number outside of its limits is an Error "
            "and the old value stays. States stay as they are, and so do start values, such as those of inputs that "
            "hold it: they belong to the start values of the parameters."
        )
    if table.parameters and table.states:
        lines.append(
            "The step of co-simulation inside was chosen at the start values of the parameters. Each part of it is "
            f"compared with two of half its length; where a state, over its size or one, is off by more than "
            f"{table.part_error!r}, as where friction is made sharper, DoStep ends with Discard: shorter steps have "
            "shorter parts."
        )
    if table.period:
        lines.append(
            f"It takes a sample at the start and every {table.period!r} s, with the inputs that are there then."
        )
    if table.remembers:
        lines.append(
            "It is solved by Newton from the last solution, which is part of the saved state: move the inputs in small "
            "steps. The parameters guess.* say where it begins."
        )
    if table.derivatives:
        lines.append(
            "Derivatives are exact; at a corner of a piecewise function they are those of the branch in force."
        )
    if table.hold:
        lines.append("Where there is no answer the outputs keep their last values and the output status is not 0.")
    return lines


def _rows(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    top = "".join(f"<th>{escaped(h)}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{escaped(str(c))}</td>" for c in row) + "</tr>\n" for row in rows)
    return f"<table>\n<tr>{top}</tr>\n{body}</table>\n"
