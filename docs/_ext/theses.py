"""The directive `theses`: the rows of docs/theses.toml as tables, and how many there are of each verdict."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FILE = Path(__file__).parents[1] / "theses.toml"
VERDICTS = ("reproduced", "corrected", "refuted", "not checkable")


def groups() -> list[dict[str, Any]]:
    """The groups of the file, each with its rows."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))["group"]


def rows() -> list[dict[str, Any]]:
    """All rows."""
    return [row for group in groups() for row in group["row"]]


def lines() -> Iterator[str]:
    """The page's Markdown: counts, then a table for each group."""
    count = Counter(row["verdict"] for row in rows())
    yield from _table(["verdict", "rows"], [[v, count[v]] for v in VERDICTS] + [["all", count.total()]])
    for group in groups():
        yield from ("", f"## {group['title']}", "")
        yield from _table(["where", "what", "printed", "ours", "verdict", "shown by"], map(_cells, group["row"]))


def _cells(row: dict[str, Any]) -> list[str]:
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    numeric = not isinstance(row["printed"], str)
    within = row["verdict"] == "reproduced" and numeric and not isinstance(row["ours"], str) and row["tolerance"]
    return [
        row["where"],
        row["what"] + (f". *{row['note']}*" if row["note"] else ""),
        _shown(row["printed"], unit),
        _shown(row["ours"], unit) if "ours" in row else "",
        f"**{row['verdict']}**" + (f", within {100 * row['tolerance']:g} %" if within else ""),
        f"`{row['command']}`",
    ]


def _shown(value: Any, unit: str) -> str:
    if isinstance(value, str):
        return value
    return ", ".join(f"{x:g}" for x in (value if isinstance(value, list) else [value])) + unit


def _table(header: list[str], cells: Any) -> Iterator[str]:
    for line in [header, ["---"] * len(header), *cells]:
        yield "| " + " | ".join(str(cell).replace("|", "\\|").replace("<", "\\<") for cell in line) + " |"
