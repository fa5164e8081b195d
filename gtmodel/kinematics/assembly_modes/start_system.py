"""Stored start systems: random complex platforms with all their 40 solutions. To compute them again, run ``python -m
gtmodel.kinematics.assembly_modes.start_system [FILE]``."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .platform import MODES, Array, HomotopyParameters, basis, leg_rows, straight_line
from .tracker import SAME, projective_distance, refined, track

FILE = Path(__file__).with_name("start_systems.json")


@dataclass(frozen=True)
class StartSystem:
    """A complex platform and its solutions z (40, 8), |z| = 1; seed: of its random numbers."""

    seed: int
    parameters: HomotopyParameters
    z: Array


@functools.cache
def start_systems() -> tuple[StartSystem, ...]:
    """Return the stored start systems, in the order of their use.

    >>> from gtmodel.kinematics.assembly_modes import start_systems
    >>> start_systems()[0].z.shape  # 40 solutions in Study coordinates
    (40, 8)
    """
    return from_text(FILE.read_text(encoding="utf-8"))


def to_text(systems: tuple[StartSystem, ...]) -> str:
    """Return the text of the file, with numbers that are read back exactly."""
    records = []
    for s in systems:
        arrays = {"A": s.parameters.A, "B": s.parameters.B, "c": s.parameters.c, "z": s.z}
        records.append({"seed": s.seed, **{k: _rows(np.asarray(v)) for k, v in arrays.items()}})
    note = "made by python -m gtmodel.kinematics.assembly_modes.start_system; per row: real parts, then imaginary"
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
    """Return the start systems from the text of the file."""
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


BASE_SIZE = 0.7  # of the random base joints, as for a platform scaled by its leg length
PLATFORM_SIZE = 0.4  # of the random platform joints
LOOP_SIZE = 0.9  # distance of a loop's corners
MOST_LOOPS = 200


def random_start_system(seed: int) -> tuple[HomotopyParameters, Array]:
    """Return a random complex platform and its 40 solutions (40, 8), |z| = 1, reproducible by its seed.

    Raises RuntimeError if the monodromy loops do not find all 40.
    """
    random = np.random.default_rng(seed)

    def draw(*shape: int) -> Array:
        return (random.normal(size=shape) + 1j * random.normal(size=shape)) / np.sqrt(2)

    A, B = BASE_SIZE * draw(6, 3), PLATFORM_SIZE * draw(6, 3)
    x, y = draw(4), draw(4)
    y = y - (x @ y) / (x @ x) * x
    known = np.concatenate([x, y])[None]
    without_c = leg_rows(A, B, np.zeros(6, dtype=complex))
    c = -(without_c @ basis(known[0])) / (x @ x)
    start = HomotopyParameters(A, B, c)
    known = refined(start.system(), known)
    for _ in range(MOST_LOOPS):
        corners = [HomotopyParameters(A + LOOP_SIZE * draw(6, 3), B + LOOP_SIZE * draw(6, 3), c + LOOP_SIZE * draw(6))
                   for _ in range(2)]  # fmt: skip
        z = known
        for a, b in zip([start, *corners], [*corners, start], strict=True):
            to = HomotopyParameters(b.A[None], b.B[None], b.c[None])
            ends = track(straight_line(a, to), np.zeros(len(z), dtype=np.intp), z)
            z = ends.z[ends.arrived]
        for candidate in refined(start.system(), z):
            if np.all(projective_distance(known, candidate) > SAME):
                known = np.vstack([known, candidate])
        if len(known) == MODES:
            return start, known
    raise RuntimeError(f"{MOST_LOOPS} monodromy loops found {len(known)} of {MODES} solutions (seed {seed})")


SEEDS = (1, 2, 3)


def make(seeds: Sequence[int] = SEEDS) -> tuple[StartSystem, ...]:
    """Return one start system per seed, computed by monodromy in a few seconds. Raises RuntimeError if fewer than 40
    solutions are found."""
    return tuple(StartSystem(seed, *random_start_system(seed)) for seed in seeds)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    target.write_text(to_text(make()), encoding="utf-8")
    sys.stdout.write(f"{target}: {len(SEEDS)} start systems of 40 solutions each\n")
