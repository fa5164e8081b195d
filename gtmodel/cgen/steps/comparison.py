"""A step function of a loaded library against its twin: a run, step by step, state and outputs byte for byte."""

from __future__ import annotations

import ctypes

import numpy as np

from ...results import Check, at_least, at_most
from ...results.status import Status
from .function import StepFace
from .records import copied, dtype_of, record


class LoadedStep:
    """A step function of a library, on records."""

    def __init__(self, library: ctypes.CDLL, face: StepFace) -> None:
        self.face = face
        self._defaults, self._init, self._step = (library[f"{face.symbol}_{n}"] for n in ("defaults", "init", "step"))
        for f, count in ((self._defaults, 1), (self._init, 2), (self._step, 3)):
            f.argtypes, f.restype = [ctypes.c_void_p] * count, ctypes.c_int
        self._defaults.restype = None

    def defaults(self) -> np.ndarray:
        """The declared start."""
        start = record(self.face.function.start, self.face.real)
        self._defaults(start.ctypes.data)
        return start

    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """As `StepTwin.init`."""
        return Status(self._init(state.ctypes.data, start.ctypes.data))

    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """As `StepTwin.step`."""
        return Status(self._step(state.ctypes.data, inputs.ctypes.data, outputs.ctypes.data))


def compare_steps(library: ctypes.CDLL, face: StepFace, points: int, seed: int) -> tuple[dict[str, Check], int, int]:
    """A run of so many steps in both. Checks by name, how many steps, and how many of them ended well."""
    f, key, real = face.function, face.key, face.real
    twin, loaded = f.twin(real), LoadedStep(library, face)
    start, mine = face.started()
    theirs = copied(mine)
    other = loaded.defaults()
    begun = (twin.init(mine, start), loaded.init(theirs, other))
    inputs = f.examples(points, seed, real)
    out = np.zeros((2, 1), dtype_of(f.outputs, real))
    different = statuses = written = good = 0
    for row in inputs.reshape(-1, 1):
        before = theirs.tobytes(), out[1].tobytes()
        given = row.reshape(())
        codes = twin.step(mine, given, out[0].reshape(())), loaded.step(theirs, given, out[1].reshape(()))
        statuses += codes[0] != codes[1]
        different += mine.tobytes() != theirs.tobytes() or out[0].tobytes() != out[1].tobytes()
        written += codes[1] != Status.OK and before != (theirs.tobytes(), out[1].tobytes())
        good += codes[1] == Status.OK
    same = start.tobytes() == other.tobytes() and begun[0] == begun[1]
    checks = {
        f"{key}_starts_different": at_most(int(not same), 0, "the declared start"),
        f"{key}_steps_different": at_most(different, 0, f"of {points} steps, state and outputs byte for byte"),
        f"{key}_statuses_different": at_most(statuses, 0, f"of {points} steps"),
        f"{key}_steps_ok": at_least(good, 1, f"of {points} steps"),
        f"{key}_not_held": at_most(written, 0, "steps that wrote without GT_OK"),
    }
    return checks, points, good
