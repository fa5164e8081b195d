"""A CSV file as lines of cells, for kinds that read one themselves; see `gtmodel.measurements.csv_lines`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gtmodel.measurements import csv_lines
from gtmodel.measurements.csv_lines import Line, number
from gtmodel.results import ArgumentError

from .base import InputError

__all__ = ["Line", "lines_of", "number", "refuse_twice"]


def lines_of(path: Path, header: str) -> tuple[Line, list[Line]]:
    """The header and the rows. Raises InputError."""
    try:
        return csv_lines.lines_of(path, header)
    except ArgumentError as error:
        raise InputError(error.sentence) from error


def refuse_twice(names: Sequence[str], where: str) -> None:
    """Raises InputError for a column name that is there twice."""
    try:
        csv_lines.refuse_twice(names, where)
    except ArgumentError as error:
        raise InputError(error.sentence) from error
