"""One function of a loaded library against Python: statuses, values bit for bit, guards."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np

from ..results.status import Status
from .interface import Interface
from .points import HELD, awkward, draw, evaluate
from .report import Check, at_least, at_most

MARKS = 3  # doubles behind the unknowns in the state of a function with Newton blocks


@dataclass(frozen=True)
class Comparison:
    """Checks of one function and how many points they rest on."""

    checks: list[Check]
    rows: int
    rows_ok: int


def compare(library: ctypes.CDLL, face: Interface, points: int, seed: int) -> Comparison:
    """Compare at random and at awkward points, then with NaN and infinity in every input."""
    inputs = np.concatenate([draw(face, points, seed), awkward(face)])
    expected, wanted = evaluate(face, inputs)
    outputs, status = call(library, face, inputs)
    ok = (wanted == Status.OK) & (status == Status.OK)
    different = np.any(outputs.view(np.int64) != expected.view(np.int64), axis=1) & ok
    touched = np.any(outputs != HELD, axis=1) & (status != Status.OK)
    refused, total, held = _not_finite(library, face, inputs[np.argmax(ok)])
    key = face.key
    checks = [
        at_most(f"{key}_values_different", int(different.sum()), detail=_detail(inputs, expected, outputs, different)),
        at_most(f"{key}_statuses_different", int(np.sum(wanted != status)), detail=_statuses(wanted, status)),
        at_least(f"{key}_points_ok", int(ok.sum()), 1, f"of {points} random and {len(inputs) - points} awkward points"),
        at_most(f"{key}_not_finite_accepted", total - refused, detail=f"calls, of {total} with NaN or infinity"),
        at_most(
            f"{key}_outputs_not_held",
            int(touched.sum()) + total - held,
            detail="calls that wrote outputs without GT_OK",
        ),
    ]
    return Comparison(checks, len(inputs), int(ok.sum()))


def call(library: ctypes.CDLL, face: Interface, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (rows, m), HELD where none were written, and statuses (rows,) of the C function.

    Behind the inputs stands the state to start from, behind the outputs the new one, HELD where it is the old one
    after a call that failed.
    """
    function = library[face.symbol]
    function.argtypes = [ctypes.c_void_p] * (3 if face.newton else 2)
    function.restype = ctypes.c_int
    rows = len(inputs)
    given = np.zeros((rows, max(1, face.input_size)))
    given[:, : face.input_size] = inputs[:, : face.input_size]
    outputs = np.full((rows, face.output_size), HELD)
    start = inputs[:, face.input_size :]
    state = np.column_stack([start, np.zeros((rows, MARKS))]) if face.newton else np.zeros((rows, 0))
    places = [state, given, outputs] if face.newton else [given, outputs]
    status = np.zeros(rows, dtype=int)
    for n in range(rows):
        status[n] = function(*[place.ctypes.data + n * place.strides[0] for place in places])
    after = state[:, : start.shape[1]].copy()
    after[(after.view(np.int64) == np.ascontiguousarray(start).view(np.int64)) & (status != Status.OK)[:, None]] = HELD
    return np.column_stack([outputs, after]), status


def _not_finite(library: ctypes.CDLL, face: Interface, good: np.ndarray) -> tuple[int, int, int]:
    """Calls refused as not finite, all calls, calls with outputs held: one NaN or infinity in each input."""
    bad = np.array([good] * (3 * len(good))).reshape(-1, len(good))
    for column in range(len(good)):
        bad[3 * column : 3 * column + 3, column] = np.nan, np.inf, -np.inf
    outputs, status = call(library, face, bad)
    return int(np.sum(status == Status.NOT_FINITE)), len(bad), int(np.sum(np.all(outputs == HELD, axis=1)))


def _detail(inputs: np.ndarray, expected: np.ndarray, outputs: np.ndarray, different: np.ndarray) -> str:
    if not different.any():
        return "bit for bit"
    row = int(np.argmax(different))
    scale = np.maximum(1.0, np.abs(expected[different]))
    worst = float(np.max(np.abs(outputs[different] - expected[different]) / scale))
    return f"largest relative difference {worst:.2g}; first at {inputs[row].tolist()}"


def _statuses(wanted: np.ndarray, status: np.ndarray) -> str:
    if np.array_equal(wanted, status):
        return ", ".join(f"{int(np.sum(status == s))} {s.c_name}" for s in Status if np.any(status == s))
    row = int(np.argmax(wanted != status))
    return f"Python says {Status(int(wanted[row])).c_name} where C returns {int(status[row])}"
