"""The page of a study: one HTML file without requests to a network, the same bytes for the same result."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..check import Check, bound_in_words
from ..quantity import split
from ..refusal import ArgumentError
from ..table import number, quantity_rows
from ..versions import versions
from .drawing import Drawing, drawing_of

if TYPE_CHECKING:
    from ..study import Study

REPORT = "report.html"
MARK = '<meta name="generator" content="gtmodel">'
ENDS = 1000  # bytes at the beginning and, of a film, at the end in which gtmodel says that it wrote a file
LARGEST = 2_000_000  # bytes of a page, which is sent by mail
LONGEST = 240  # characters of a value in a table of keys
RIGHT, FAILED = ' class="n"', '<tr class="failed">'
RESIDUALS, FEW = "residuals_of_the_fit", 12  # fewer residuals show no distribution
VERDICT, ASSUMED = "verdict", "assumed"  # labels of rows that belong to other sections


def written_here(file: Path) -> bool:
    """Return True for a page, picture or film of gtmodel."""
    return file.is_file() and MARK.encode() in (content := file.read_bytes())[:ENDS] + content[-ENDS:]


@dataclass(frozen=True)
class PageTable:
    """A table of a page: column heads, and rows of texts and numbers; numbers get six digits."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Any]]


Part = str | list[str] | PageTable
"""A paragraph, a list of sentences, or a table."""
Sections = Mapping[str, Sequence[Part]]
"""Parts of a page by heading."""


@dataclass(frozen=True)
class Asked:
    """What a run was asked for, as a page shows it.

    title: of the page, if the study has none. what: kind of the study, in a line.
    remarks: paragraphs by the author of the problem.
    keys, defaults: rows (key, value, unit, description) of the keys that were set, and of those that were not.
    inputs: rows (what, file name, sha256). command: how to run it again.
    """

    title: str = ""
    what: str = ""
    keys: Sequence[Sequence[str]] = ()
    defaults: Sequence[Sequence[str]] = ()
    inputs: Sequence[Sequence[str]] = ()
    command: str = ""
    remarks: Sequence[str] = ()


def page(study: Study, asked: Asked | None = None, result: str = "") -> str:
    """Return the page of a study. asked: what it was asked for, if it is known. result: sha256 of its result.json."""
    asked = asked or Asked()
    figures = _figures(study)
    drawings = {name: drawing_of(draw, f"p{k}") for k, (name, draw) in enumerate(figures.items())}
    parts = _parts(study, asked, result, drawings)
    for name in sorted(drawings, key=lambda n: (-len(drawings[n].svg), n)):
        if len("".join(parts).encode()) <= LARGEST:
            break
        drawings[name] = drawing_of(figures[name], f"p{list(figures).index(name)}", pixels=True)
        parts = _parts(study, asked, result, drawings)
    title = escape(study.title or asked.title or type(study).__name__)
    style, script = (Path(__file__).with_name(name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    head = f'{MARK}<meta charset="utf-8"><title>{title}</title><meta name="viewport" content="width=device-width">'
    body = "\n".join([f"<h1>{title}</h1>", *parts])
    after = f"<script>\n{script}</script>" if drawings else ""
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head>{head}<style>\n{style}</style></head><body>\n{body}\n{after}'
        "</body></html>\n"
    )


def _figures(study: Study) -> Mapping[str, Callable[[], Any]]:
    """The pictures of a study, and those of its residuals that every fit needs."""
    fit = study.estimate
    if study.draws_residuals or fit is None or len(fit.residuals) < FEW or not np.ptp(fit.residuals) > 0:
        return study.figures
    tests = import_module("gtmodel.inference.residuals")  # by name: results must not depend on gtmodel.inference
    return {**study.figures, RESIDUALS: partial(tests.draw_fit, fit, study.title)}


def _parts(study: Study, asked: Asked, result: str, drawings: Mapping[str, Drawing]) -> list[str]:
    rows = quantity_rows(study)
    numbers = [(label, value, "" if unit == "1" else unit) for label, value, unit in rows
               if label.strip() not in (VERDICT, ASSUMED)]  # fmt: skip
    return [
        *_verdict(study, [value for label, value, _ in rows if label.strip() == VERDICT]),
        *_section("What was asked", [asked.what, *asked.remarks, *_keys(asked.keys)]),
        *_checks(study.checks),
        *_section("Result", [PageTable(("quantity", "value", "unit"), numbers)]),
        *_section("Notes", [list(study.notes)] if study.notes else []),
        *_pictures(study, drawings),
        *_in_space(study),
        *(line for heading, content in study.sections.items() for line in _section(heading, content)),
        *_assumed(asked, [value for label, value, _ in rows if label == ASSUMED]),
        *_section("Versions and files", [PageTable(("what", "name or version", "sha256"), _origin(asked, result))]),
        *_again(asked),
    ]


def _origin(asked: Asked, result: str) -> list[Sequence[str]]:
    files = [*asked.inputs, *([("result", "result.json", result)] if result else [])]
    return [*files, *((name, version, "") for name, version in versions().items() if name != "platform")]


def _verdict(study: Study, rows: Sequence[str]) -> list[str]:
    word = study.done if study.status.ok else study.status.value
    sound = "good" if study.status.ok else "bad"
    sentences = [s for s in (study.message, *rows) if s != study.status.message] or [study.message]
    lines = [f'<div class="box {sound}"><b>{escape(word.replace("_", " "))}</b>{_list(sentences)}</div>']
    made = study.values.get("synthetic")
    made = made.removeprefix("synthetic, ") if isinstance(made, str) else made
    return [*lines, f'<p class="made">Synthetic data: {escape(made)}</p>'] if isinstance(made, str) and made else lines


def _section(heading: str, content: Sequence[Part]) -> list[str]:
    """Lines of a section; none if it is empty."""
    shown = [_part(part) for part in content if part and not (isinstance(part, PageTable) and not part.rows)]
    return [f"<h2>{escape(heading)}</h2>", *shown] if shown else []


def _part(part: Part) -> str:
    if isinstance(part, str):
        return f"<p>{escape(' '.join(part.split()))}</p>"
    return _table(part) if isinstance(part, PageTable) else _list(part)


def _list(sentences: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(s)}</li>' for s in sentences)}</ul>"


def _table(table: PageTable) -> str:
    used = [k for k, head in enumerate(table.heads) if any(str(row[k]) for row in table.rows)]
    numeric = {k for k in used if all(isinstance(row[k], (int, float)) for row in table.rows)}
    top = "".join(f"<th{RIGHT if k in numeric else ''}>{escape(table.heads[k])}</th>" for k in used)
    lines = ["<tr>" + "".join(_cell(row[k], k in numeric) for k in used) + "</tr>" for row in table.rows]
    return f"<table><tr>{top}</tr>{''.join(lines)}</table>"


def _cell(value: Any, right: bool = False) -> str:
    if isinstance(value, (bool, str)):
        return f"<td>{escape(number(value))}</td>"
    shown = re.sub(r"\b(nan|inf)\b", "none", number(value))
    return f"<td{RIGHT if right else ''}>{escape(shown)}</td>"


def _keys(rows: Sequence[Sequence[str]]) -> list[Part]:
    short = [(key, value if len(value) <= LONGEST else f"{value[:LONGEST]} …", *more) for key, value, *more in rows]
    return [PageTable(("key", "value", "unit", "meaning"), short)] if short else []


def _checks(checks: Mapping[str, Check]) -> list[str]:
    if not checks:
        return []
    lines = [f"<table><tr><th>check</th><th{RIGHT}>value</th><th>unit</th><th>bound</th><th>verdict</th></tr>"]
    for name, check in checks.items():
        stem, unit = split(name)
        bound = bound_in_words(check) if check.compares else ""
        verdict = "passed" if check.passed else ": ".join(filter(None, ("FAILED", check.advice)))
        cells = [
            _cell(stem.replace("_", " ")),
            _cell(float(check.value), right=True),
            _cell(unit),
            _cell(bound),
            _cell(verdict),
        ]
        lines.append(f"{'<tr>' if check.passed else FAILED}{''.join(cells)}</tr>")
    return ["<h2>Checks</h2>", "".join(lines) + "</table>"]


def _pictures(study: Study, drawings: Mapping[str, Drawing]) -> list[str]:
    lines = ["<h2>Pictures</h2>"] if drawings else []
    for name, drawing in drawings.items():
        caption = escape(study.captions.get(name, name.replace("_", " ")))
        svg = drawing.svg.replace("<svg", f'<svg role="img" tabindex="0" aria-label="{caption}"', 1)
        data = json.dumps(drawing.panels, ensure_ascii=False, separators=(",", ":")).replace("</", "<\\/")
        lines.append(
            f'<figure>{svg}<div class="read"></div><figcaption>{caption}</figcaption>'
            f'<script type="application/json">{data}</script></figure>'
        )
    if drawings:
        how = "A value: move the pointer over a curve. Zoom: the buttons, or + and - once the picture is selected."
        lines.append(f'<p class="read">{how}</p>')
    return lines


def _in_space(study: Study) -> list[str]:
    """The robot with its motion, to be turned and played within the page."""
    lines = ["<h2>In space</h2>"] if study.scenes else []
    for name in study.scenes:
        try:
            lines.append(study.view(name)._repr_html_())
        except ArgumentError as error:  # such as a motion beyond the reach, which a failed check reports
            lines.append(_part(f"Not drawn: {error.message}."))
    return lines


def _assumed(asked: Asked, sentences: list[str]) -> list[str]:
    lines = [_list(sentences)] if sentences else []
    if asked.defaults:
        table = "".join(map(_part, _keys(asked.defaults)))
        keys = f"Keys that the problem does not set, with their defaults: {len(asked.defaults)}"
        lines.append(f"<details><summary>{keys}</summary>{table}</details>")
    return ["<h2>What is assumed</h2>", *lines] if lines else []


def _again(asked: Asked) -> list[str]:
    return ["<h2>How to run it again</h2>", f"<pre>{escape(asked.command)}</pre>"] if asked.command else []
