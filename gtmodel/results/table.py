"""Tables of studies for terminals, texts and notebooks, and tables of columns as CSV."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .check import Check, bound_in_words
from .pictures import png
from .plain_table import plain
from .quantity import split
from .status import SolveStatus

if TYPE_CHECKING:
    from .study import Study

Columns = Mapping[str, Sequence[Any] | np.ndarray]

HEAD = ("quantity", "value", "unit", "")


def cells(study: Study, brief: bool = False) -> list[tuple[str, str, str, str]]:
    """Return rows of quantity, value, unit and verdict: status, iterations, quantities, notes, checks.

    brief: count the checks that passed in one row and list only those that failed.
    """
    status = study.done if study.status is SolveStatus.SOLVED else study.status.value
    rows = [("status", status, "", "")]
    rows += [(label, number(value), unit, "") for label, value, unit in quantity_rows(study)]
    rows += [("note", note, "", "") for note in study.notes]
    passed = sum(check.passed for check in study.checks.values())
    if brief and passed:
        rows.append(("checks passed", str(passed), "", ""))
    for name, check in study.checks.items():
        if brief and check.passed:
            continue
        stem, unit = split(name)
        rows.append((stem.replace("_", " "), number(_value(check)), unit, _verdict(check)))
    return rows


def quantity_rows(study: Study) -> list[tuple[str, Any, str]]:
    """Return the rows of label, value and unit: iterations, and the quantities."""
    rows: list[tuple[str, Any, str]] = []
    if study.iterations is not None:
        rows.append(("iterations", study.iterations, ""))
    for label, value, *unit in study.rows or _of_values(study):
        rows.append((label, value, str(unit[0]) if unit else ""))
    return rows


def _value(check: Check) -> float | None:
    return check.value if math.isfinite(check.value) else None


def _verdict(check: Check) -> str:
    bound = f" ({bound_in_words(check)})" if check.compares else ""
    return f"{'passed' if check.passed else 'FAILED'}{bound}"


def _of_values(study: Study) -> Iterator[tuple[str, Any, str]]:
    for name, value in study.values.items():
        if name == "notes" and list(value or ()) == list(study.notes):
            continue  # notes have their own rows
        stem, unit = split(name)
        yield stem.replace("_", " "), value, unit


def text(study: Study) -> str:
    """Return the whole study as text."""
    message = [] if study.message in (study.status.message, study.status.value) else ["", study.message]
    return "\n".join([plain(HEAD, cells(study), study.title), *message])


def html(study: Study) -> str:
    """Return the table and, if matplotlib is installed, the first picture, for a notebook."""
    from html import escape  # here: its table of entities is for pages alone

    lines = [f"<b>{escape(study.title)}</b>"] if study.title else []
    lines.append("<table><tr>" + "".join(f"<th>{h}</th>" for h in HEAD) + "</tr>")
    for row in cells(study):
        lines.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>")
    lines.append("</table>")
    if study.message != study.status.message:
        lines.append(f"<p>{escape(study.message)}</p>")
    return "\n".join([*lines, *_picture(study)])


def _picture(study: Study) -> list[str]:
    if not study.figures:
        return []
    try:
        content = png(study.figures[next(iter(study.figures))])
    except ImportError:
        return []
    return [f'<img src="data:image/png;base64,{base64.b64encode(content).decode()}"/>']


def number(value: Any) -> str:
    """Return a value as text: six digits, lists separated by commas."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (str, int)):
        return str(value)
    if isinstance(value, Mapping):
        return ", ".join(f"{k} = {number(v)}" for k, v in value.items())
    if hasattr(value, "tolist"):
        return number(value.tolist())
    if isinstance(value, (list, tuple)):
        return ", ".join(number(v) for v in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def csv_text(columns: Columns, digits: int | Mapping[str, int | str] = 6, notes: Sequence[str] = ()) -> str:
    """Return columns (n,) as CSV with their names, which contain the units. digits: significant digits, or digits or a
    format such as ".4f" by column. NaN gives an empty cell. `notes`: comment lines above."""
    specs = [digits if isinstance(digits, int) else digits.get(name, "") for name in columns]
    forms = [f".{spec}g" if isinstance(spec, int) else spec for spec in specs]
    lines = [*(f"# {' '.join(note.split())}" for note in notes), ",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(_csv_cell(x, form) for x, form in zip(row, forms, strict=True)))
    return "\n".join(lines) + "\n"


def _csv_cell(x: Any, form: str) -> str:
    return x if isinstance(x, str) else "" if np.isnan(x) else f"{x:{form}}"
