"""Experiments: a frequency response at a pose, from records of hits or receptances in CSV files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...lang.units import UnitError, convert, parse_unit
from ...measurements import csv_lines
from ...results import ArgumentError
from .frequency_response import ORDER, UNITS, FrequencyResponse, frequency_response
from .options import Fit

_HEAD = re.compile(r"(?P<name>\S+)(\s+\[(?P<unit>[^\[\]]+)\])?")
_PLACE = {"x": "m", "y": "m", "z": "m", "A": "rad"}
_INDEX = "x [m],y [m],z [m],A [deg],direction,file"
_RECORD = "time [s],force [N],acceleration [m/s2]"
_RESPONSE = "frequency [Hz],real [m/N],imaginary [m/N]"
JITTER = 1e-3  # of the sample time
PER_FORCE = {"m/N": 0, "m/(N.s)": 1, "m/(N.s2)": 2}  # receptance, mobility, inertance: orders of s


@dataclass(frozen=True, eq=False)
class Experiment:
    """A frequency response at a pose (4,), x, y, z [m] and A [rad], in x, y or z (`direction` 0, 1, 2).

    source: for messages; files: those that were read, by their names in the index.
    """

    pose: np.ndarray
    direction: int
    response: FrequencyResponse
    source: str
    files: Mapping[str, Path] = field(default_factory=dict)


def read_experiments(index: str | Path, fit: Fit | None = None) -> list[Experiment]:
    """All experiments of an index file, in the order in which they first stand there.

    index: CSV file with the columns x [m], y [m], z [m], A [deg], direction and file; rows of the same pose and
    direction are hits of one experiment, unless a column experiment tells them apart. Files are looked for beside it,
    then in the working directory. fit: estimator and windows of hits. Raises ArgumentError.
    """
    path, fit = Path(index), fit or Fit()
    head, rows = csv_lines.lines_of(path, _INDEX)
    columns = _columns(head[1], f"{path.name} line {head[0]}")
    for name in (*_PLACE, "direction", "file"):
        if name not in columns:
            raise ArgumentError(f"{path.name} line {head[0]}: there is no column '{name}'; expected {_INDEX}")
    groups: dict[tuple[object, ...], list[tuple[str, str]]] = {}
    for line, cells in rows:
        where = f"{path.name} line {line}"
        if len(cells) != len(head[1]):
            raise ArgumentError(f"{where}: found {len(cells)} cells; expected {len(head[1])}")
        pose = tuple(_number(cells, columns, name, unit, where) for name, unit in _PLACE.items())
        direction = cells[columns["direction"][0]]
        if direction not in ("x", "y", "z"):
            raise ArgumentError(f"{where}: found the direction '{direction}'; expected x, y or z")
        name = cells[columns["experiment"][0]] if "experiment" in columns else ""
        groups.setdefault((*pose, direction, name), []).append((cells[columns["file"][0]], where))
    if not groups:
        raise ArgumentError(f"{path.name} has a header but no rows")
    found = []
    for key, files in groups.items():
        paths = {name: _found(name, path.parent, where) for name, where in files}
        response = _response(files, fit, paths)
        found.append(Experiment(np.array(key[:4], float), "xyz".index(str(key[4])), response, files[0][0], paths))
    return found


def _response(files: Sequence[tuple[str, str]], fit: Fit, paths: Mapping[str, Path]) -> FrequencyResponse:
    """Of the hits of one experiment, or the one receptance."""
    tables = [_table(paths[name]) for name, _ in files]
    (name, where), (columns, values) = files[0], tables[0]
    try:
        if "frequency" in columns:
            if len(files) > 1:
                raise ArgumentError(f"{where}: {name} is a frequency response; name one for each experiment")
            return _receptance(columns, values, name)
        measures = next((m for m in ORDER if m in columns), None)
        if measures is None or "force" not in columns or "time" not in columns:
            raise ArgumentError(f"{name}: expected the columns {_RECORD} (or velocity, displacement), or {_RESPONSE}")
        forces, responses, steps = [], [], []
        for (other, _), (heads, numbers) in zip(files, tables, strict=True):
            if measures not in heads or len(numbers) != len(values):
                raise ArgumentError(
                    f"{other}: hits of one experiment must have equal columns and lengths, as {name} has"
                )
            steps.append(_step(_si(heads, numbers, "time", "s", other), other))
            forces.append(_si(heads, numbers, "force", "N", other))
            responses.append(_si(heads, numbers, measures, UNITS[measures], other))
        if np.ptp(steps) > JITTER * steps[0]:
            raise ArgumentError(f"{name}: the hits of this experiment were sampled at different rates")
        return frequency_response(
            forces, responses, 1 / steps[0], measures=measures, estimator=fit.estimator,  # pyright: ignore[reportArgumentType]
            force_window=fit.force_window, decay=fit.decay,
        )  # fmt: skip
    except ArgumentError:
        raise
    except ValueError as error:
        raise ArgumentError(f"{name}: {error}") from error


def _receptance(columns: dict[str, tuple[int, str]], values: np.ndarray, name: str) -> FrequencyResponse:
    if "real" not in columns or "imaginary" not in columns:
        raise ArgumentError(f"{name}: expected the columns {_RESPONSE}")
    f = _si(columns, values, "frequency", "Hz", name)
    unit = columns["real"][1]
    try:
        order = next(
            (n for u, n in PER_FORCE.items() if parse_unit(u).dimension == parse_unit(unit or "m/N").dimension), None
        )
    except UnitError as error:
        raise ArgumentError(f"{name}, column 'real': {error}") from error
    if order is None:
        raise ArgumentError(f"{name}, column 'real': the unit {unit} is none of {', '.join(PER_FORCE)}")
    to = next(u for u, n in PER_FORCE.items() if n == order)
    H = _si(columns, values, "real", to, name) + 1j * _si(columns, values, "imaginary", to, name)
    return FrequencyResponse(f, H / (2j * np.pi * f) ** order)


def _table(path: Path) -> tuple[dict[str, tuple[int, str]], np.ndarray]:
    (line, head), rows = csv_lines.lines_of(path, _RECORD)
    columns = _columns(head, f"{path.name} line {line}")
    numbers = np.empty((len(rows), len(head)))
    for k, (n, cells) in enumerate(rows):
        try:
            numbers[k] = [csv_lines.number(c) for c in cells]
        except ValueError:
            raise ArgumentError(
                f"{path.name} line {n}: expected {len(head)} numbers; found {', '.join(cells)}"
            ) from None
    return columns, numbers


def _columns(head: Sequence[str], where: str) -> dict[str, tuple[int, str]]:
    matches = [_HEAD.fullmatch(cell) for cell in head]
    names = [m["name"] if m else "" for m in matches]
    csv_lines.refuse_twice(names, where)
    return {m["name"]: (k, m["unit"] or "") for k, m in enumerate(matches) if m}


def _si(columns: dict[str, tuple[int, str]], values: np.ndarray, name: str, unit: str, file: str) -> np.ndarray:
    place, own = columns[name]
    if not own:
        raise ArgumentError(f"{file}: the column '{name}' has no unit; write it as '{name} [{unit}]'")
    try:
        return np.asarray(convert(values[:, place], own, unit), float)
    except UnitError as error:
        raise ArgumentError(f"{file}, column '{name}': {error}") from error


def _number(cells: list[str], columns: dict[str, tuple[int, str]], name: str, unit: str, where: str) -> float:
    place, own = columns[name]
    try:
        value = csv_lines.number(cells[place])
    except ValueError:
        raise ArgumentError(f"{where}, column '{name}': found '{cells[place]}'; expected a number") from None
    return float(_si({name: (0, own)}, np.array([[value]]), name, unit, where)[0])


def _step(t: np.ndarray, name: str) -> float:
    steps = np.diff(t)
    if len(t) < 16 or not steps[0] > 0 or np.ptp(steps) > JITTER * steps.mean():
        raise ArgumentError(f"{name}: the samples are not evenly spaced; expected 16 or more with steps within 0.1 %")
    return float((t[-1] - t[0]) / (len(t) - 1))


def _found(name: str, folder: Path, where: str) -> Path:
    path = next((p for p in (folder / name, Path(name)) if p.is_file()), None)
    if path is None:
        raise ArgumentError(f"{where}: there is no file '{name}' in {folder} or here")
    return path
