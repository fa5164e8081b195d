"""Experiments: a frequency response at a pose, from records of hits or receptances in CSV files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...lang.units import UnitError, convert, parse_unit
from ...measurements.csv_table import CsvTable
from ...results import ArgumentError
from ...results.disk import path_of
from .frequency_response import ORDER, UNITS, FrequencyResponse, frequency_response
from .options import ModalFitting

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


def read_experiments(index: str | Path, fit: ModalFitting | None = None) -> list[Experiment]:
    """All experiments of an index file, in the order in which they first stand there.

    index: CSV file with the columns x [m], y [m], z [m], A [deg], direction and file; rows of the same pose and
    direction are hits of one experiment, unless a column experiment separates them. Files are looked for beside it,
    then in the working directory. fit: estimator and windows of hits. Raises ArgumentError.
    """
    path, fit = path_of(index, "index"), fit or ModalFitting()
    table = CsvTable(path)
    for name in (*_PLACE, "direction", "file"):
        if name not in table.names:
            raise ArgumentError(f"{table.where}: there is no column '{name}'; expected {_INDEX}")
    poses = np.column_stack([_si(table, name, unit) for name, unit in _PLACE.items()])
    names = table.texts("experiment") if "experiment" in table.names else [""] * len(poses)
    groups: dict[tuple[object, ...], list[tuple[str, str]]] = {}
    for k, (direction, file) in enumerate(zip(table.texts("direction"), table.texts("file"), strict=True)):
        where = f"{path.name} line {table.lines[k]}"
        if direction not in ("x", "y", "z"):
            raise ArgumentError(f"{where}: found the direction '{direction}'; expected x, y or z")
        groups.setdefault((*poses[k].tolist(), direction, names[k]), []).append((file, where))
    experiments = []
    for key, files in groups.items():
        paths = {name: _existing(name, path.parent, where) for name, where in files}
        response = _response(files, fit, paths)
        experiments.append(Experiment(np.array(key[:4], float), "xyz".index(str(key[4])), response, files[0][0], paths))
    return experiments


def _response(files: Sequence[tuple[str, str]], fit: ModalFitting, paths: Mapping[str, Path]) -> FrequencyResponse:
    """Of the hits of one experiment, or the one receptance."""
    tables = [CsvTable(paths[name]) for name, _ in files]
    (name, where), first = files[0], tables[0]
    try:
        if "frequency" in first.names:
            if len(files) > 1:
                raise ArgumentError(f"{where}: {name} is a frequency response; name one for each experiment")
            return _receptance(first, name)
        measures = next((m for m in ORDER if m in first.names), None)
        if measures is None or "force" not in first.names or "time" not in first.names:
            raise ArgumentError(f"{name}: expected the columns {_RECORD} (or velocity, displacement), or {_RESPONSE}")
        forces, responses, steps = [], [], []
        for (other, _), table in zip(files, tables, strict=True):
            if measures not in table.names or len(table.lines) != len(first.lines):
                raise ArgumentError(
                    f"{other}: hits of one experiment must have equal columns and lengths, as {name} has"
                )
            forces.append(_si(table, "force", "N"))
            responses.append(_si(table, measures, UNITS[measures]))
            steps.append(_step(_si(table, "time", "s"), other))
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


def _receptance(table: CsvTable, name: str) -> FrequencyResponse:
    if "real" not in table.names or "imaginary" not in table.names:
        raise ArgumentError(f"{name}: expected the columns {_RESPONSE}")
    f, unit = _si(table, "frequency", "Hz"), table.units[table.place("real")]
    try:
        order = next(
            (n for u, n in PER_FORCE.items() if parse_unit(u).dimension == parse_unit(unit or "m/N").dimension), None
        )
    except UnitError as error:
        raise ArgumentError(f"{name}, column 'real': {error}") from error
    if order is None:
        raise ArgumentError(f"{name}, column 'real': the unit {unit} is none of {', '.join(PER_FORCE)}")
    to = next(u for u, n in PER_FORCE.items() if n == order)
    H = _si(table, "real", to) + 1j * _si(table, "imaginary", to)
    return FrequencyResponse(f, H / (2j * np.pi * f) ** order)


def _si(table: CsvTable, name: str, unit: str) -> np.ndarray:
    own = table.units[table.place(name)]
    if not own:
        raise ArgumentError(f"{table.file}: the column '{name}' has no unit; write it as '{name} [{unit}]'")
    try:
        return np.asarray(convert(table.numbers(name), own, unit), float)
    except UnitError as error:
        raise ArgumentError(f"{table.where}, column '{name}': {error}") from error


def _step(t: np.ndarray, name: str) -> float:
    steps = np.diff(t)
    if len(t) < 16 or not steps[0] > 0 or np.ptp(steps) > JITTER * steps.mean():
        raise ArgumentError(f"{name}: the samples are not evenly spaced; expected 16 or more with steps within 0.1 %")
    return float((t[-1] - t[0]) / (len(t) - 1))


def _existing(name: str, folder: Path, where: str) -> Path:
    path = next((p for p in (folder / name, Path(name)) if p.is_file()), None)
    if path is None:
        raise ArgumentError(f"{where}: there is no file '{name}' in {folder} or here")
    return path
