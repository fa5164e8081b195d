"""One function of a loaded library against Python: statuses, values bit for bit, guards."""

from __future__ import annotations

import ctypes

import numpy as np

from ...results import Check, at_least, at_most
from ...results.status import Status
from ..interface import Interface, interfaces, places
from ..points import awkward, draw, evaluate
from ..real import DOUBLE, FLOAT_TOLERANCE
from .box_points import box_points

BOX_POINTS = 200  # random ones, beside the corners
NEAR = 0.1  # typical sizes from a consistent point
FLAT = 1e-30  # a signal that is zero everywhere
MARKS = 3  # doubles behind the unknowns in the state of a function with Newton blocks


def compare(library: ctypes.CDLL, face: Interface, points: int, seed: int) -> tuple[dict[str, Check], int, int]:
    """Compare at random and at awkward points and in the box of validity, then with NaN and infinity in every input.

    Checks by name, how many points they rest on, and at how many of them there is a solution.
    """
    inside = box_points(face, BOX_POINTS, seed)
    inputs = np.concatenate([draw(face, points, seed), awkward(face), inside])
    expected, wanted = evaluate(face, inputs)
    outputs, status = call(library, face, inputs)
    ok = (wanted == Status.OK) & (status == Status.OK)
    different = np.any(outputs.view(face.real.bits) != expected.view(face.real.bits), axis=1) & ok
    touched = np.any(outputs != face.real.array(face.real.held), axis=1) & (status != Status.OK)
    refused, total, held = _not_finite(library, face, inputs[np.argmax(ok)])
    key = face.key
    checks = {
        f"{key}_values_different": at_most(int(different.sum()), 0, _detail(inputs, expected, outputs, different)),
        f"{key}_statuses_different": at_most(int(np.sum(wanted != status)), 0, _statuses(wanted, status)),
        f"{key}_points_ok": at_least(
            int(ok.sum()), 1, f"of {points} random points and {len(inputs) - points} awkward or in the box"
        ),
        f"{key}_not_finite_accepted": at_most(total - refused, 0, f"calls, of {total} with NaN or infinity"),
        f"{key}_outputs_not_held": at_most(
            int(touched.sum()) + total - held, 0, "calls that wrote outputs without GT_OK"
        ),
    }
    if face.box is not None:
        lost = int(np.sum(wanted[len(inputs) - len(inside) :] != Status.OK))
        checks[f"{key}_box_without_answer"] = at_most(lost, 0, f"of {len(inside)} points of the box")
    if face.real is not DOUBLE:
        checks |= _beside_double(face, points, seed)
    return checks, len(inputs), int(ok.sum())


def call(library: ctypes.CDLL, face: Interface, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (rows, m), HELD where none were written, and statuses (rows,) of the C function.

    Behind the inputs stands the state to start from, behind the outputs the new one, HELD where it is the old one
    after a call that failed.
    """
    function = library[face.symbol]
    function.argtypes = [ctypes.c_void_p] * (3 if face.newton else 2)
    function.restype = ctypes.c_int
    rows = len(inputs)
    real = face.real
    given = np.zeros((rows, max(1, face.input_size)), real.dtype)
    given[:, : face.input_size] = inputs[:, : face.input_size]
    outputs = np.full((rows, face.output_size), real.held, real.dtype)
    start = np.ascontiguousarray(inputs[:, face.input_size :], real.dtype)
    state = np.column_stack([start, np.zeros((rows, MARKS), real.dtype)]) if face.newton else np.zeros((rows, 0))
    places = [state, given, outputs] if face.newton else [given, outputs]
    status = np.zeros(rows, dtype=int)
    for n in range(rows):
        status[n] = function(*[place.ctypes.data + n * place.strides[0] for place in places])
    after = state[:, : start.shape[1]].astype(real.dtype)
    after[(after.view(real.bits) == start.view(real.bits)) & (status != Status.OK)[:, None]] = real.held
    return np.column_stack([outputs, after]), status


def _beside_double(face: Interface, points: int, seed: int) -> dict[str, Check]:
    """How far the function in float is from the same in double, over the range of each signal.

    Judged in the box of validity, or without one near consistent points: where a pose is nearly singular, no float
    is right. Newton in double starts from the solution in float, which it must confirm.
    """
    inputs = box_points(face, points, seed) if face.box is not None else draw(face, points, seed, NEAR)
    outputs, status = evaluate(face, inputs)
    inputs, outputs = inputs[status == Status.OK], outputs[status == Status.OK].astype(float)
    (wide,) = interfaces({face.key: face.function}, "double")
    exact, status = evaluate(
        wide, np.column_stack([inputs[:, : face.input_size], outputs[:, face.output_size :]]).astype(float)
    )
    also = status == Status.OK
    worst, where = 0.0, face.outputs[0].signal
    for part, m in places(face.outputs):
        far = np.max(np.abs(outputs[also, part] - exact[also, part]), initial=0.0)
        share = float(far / max(np.max(np.abs(exact[also, part]), initial=0.0), FLAT))
        worst, where = (share, m.signal) if share > worst else (worst, where)
    range_of = f"of the range of {where}, at {int(also.sum())} points"
    return {
        f"{face.key}_float_error": at_most(worst, FLOAT_TOLERANCE, range_of),
        f"{face.key}_float_only": at_most(int(np.sum(~also)), 0, "answers that double has not"),
    }


def _not_finite(library: ctypes.CDLL, face: Interface, good: np.ndarray) -> tuple[int, int, int]:
    """Calls refused as not finite, all calls, calls with outputs held: one NaN or infinity in each input."""
    bad = np.array([good] * (3 * len(good))).reshape(-1, len(good))
    for column in range(len(good)):
        bad[3 * column : 3 * column + 3, column] = np.nan, np.inf, -np.inf
    outputs, status = call(library, face, bad)
    return (
        int(np.sum(status == Status.NOT_FINITE)),
        len(bad),
        int(np.sum(np.all(outputs == face.real.array(face.real.held), axis=1))),
    )


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
