"""The stored start systems: random complex platforms with all their 40 solutions.

They are package data, written by ``python -m gtmodel.kinematics.assembly_modes.make_start_systems``.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .homotopy import HomotopyParameters
from .study import Array

FILE = Path(__file__).with_name("start_systems.json")


@dataclass(frozen=True)
class StartSystem:
    """A complex platform and its solutions z (40, 8), |z| = 1; seed: of the random numbers that made it."""

    seed: int
    parameters: HomotopyParameters
    z: Array


@functools.cache
def start_systems() -> tuple[StartSystem, ...]:
    """The stored start systems, in the order of their use.

    >>> from gtmodel.kinematics.assembly_modes import start_systems
    >>> start_systems()[0].z.shape  # 40 solutions in Study coordinates
    (40, 8)
    """
    return from_text(FILE.read_text(encoding="utf-8"))


def to_text(systems: tuple[StartSystem, ...]) -> str:
    """The file's text; every number with the digits that give it back exactly."""
    records = []
    for s in systems:
        arrays = {"A": s.parameters.A, "B": s.parameters.B, "c": s.parameters.c, "z": s.z}
        records.append({"seed": s.seed} | {k: _rows(np.asarray(v)) for k, v in arrays.items()})
    note = "made by python -m gtmodel.kinematics.assembly_modes.make_start_systems; per row: real parts, then imaginary"
    lines = [f'{{"note": {json.dumps(note)},', '"systems": [']
    for k, record in enumerate(records):
        body = []
        for name, value in record.items():
            if isinstance(value, list):
                value = "[\n" + ",\n".join(json.dumps(row) for row in value) + "\n]"
            body.append(f'"{name}": {value}')
        lines.append("{" + ",\n".join(body) + ("}" if k == len(records) - 1 else "},"))
    return "\n".join([*lines, "]}", ""])


def from_text(text: str) -> tuple[StartSystem, ...]:
    """Start systems from the file's text."""
    systems = []
    for record in json.loads(text)["systems"]:
        A, B, c, z = (_complex(record[k]) for k in ("A", "B", "c", "z"))
        systems.append(StartSystem(record["seed"], HomotopyParameters(A, B, c[0]), z))
    return tuple(systems)


def _rows(values: Array) -> list[list[float]]:
    values = np.atleast_2d(values)
    return np.concatenate([np.real(values), np.imag(values)], axis=1).tolist()


def _complex(rows: list[list[float]]) -> Array:
    values = np.asarray(rows)
    half = values.shape[1] // 2
    return values[:, :half] + 1j * values[:, half:]
