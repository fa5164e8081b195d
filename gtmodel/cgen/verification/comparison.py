"""Comparison of one function or step function of a loaded library with Python: statuses, values bit for bit, guards,
points in the box of validity."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...results import Check, at_least, at_most
from ...results.check import failed_of, verdict
from ...results.status import Status
from ..interface import Interface, interfaces, places
from ..newton_stages import samples_of
from ..points import awkward, draw, evaluate, satisfying
from ..real import DOUBLE, FLOAT_TOLERANCE
from ..steps.function import StepFace, copied, dtype_of, record


@dataclass(frozen=True)
class CheckReport:
    """All checks of one folder by name. message: one sentence. rows: compared points by function; rows_ok: those with
    GT_OK."""

    checks: Mapping[str, Check]
    message: str
    rows: Mapping[str, int]
    rows_ok: Mapping[str, int]

    @property
    def passed(self) -> bool:
        """True if every check passed."""
        return not failed_of(self.checks)


def check_report(checks: Mapping[str, Check], rows: Mapping[str, int], rows_ok: Mapping[str, int]) -> CheckReport:
    """Return a report with the message that its checks imply."""
    failed = failed_of(checks)
    equal = (
        f"the C code equals Python bit for bit at {sum(rows_ok.values())} points, "
        f"and in the status at {sum(rows.values())}"
    )
    return CheckReport(checks, verdict(failed, len(checks)) if failed else equal, rows, rows_ok)


CORNERS = 64  # all corners for up to six inputs; else this number, drawn at random
STEPS = 25  # from home to a point of the box, for a function that follows its last solution


def box_points(face: Interface, rows: int, seed: int) -> np.ndarray:
    """Return inputs in the box (corners + rows, inputs), moved onto the conditions on known values and their rates;
    then, for a function with Newton blocks, the state after the inputs moved there from home in small steps.

    If a step has no solution, the state is that of the last step with one. Empty without a box.
    """
    if face.box is None:
        return np.zeros((0, face.input_size + face.state_size), face.real.dtype)
    low, high = np.array(face.box).reshape(-1, 2).T
    rng = np.random.default_rng(seed)
    n = len(low)
    if 2**n <= CORNERS:
        corners = np.array(list(itertools.product((0.0, 1.0), repeat=n)))
    else:
        corners = rng.integers(2, size=(CORNERS, n)).astype(float)
    inputs = low + (high - low) * np.concatenate([corners.reshape(-1, n), rng.random((rows, n))])
    pairs = [p for s in face.function.inputs for p in s.pairs]
    inputs = satisfying(face.function, pairs, inputs, low, high)
    if not face.newton:
        return face.real.array(inputs)
    home = samples_of(face.function, pairs)[0]
    state = np.tile([x for stage in face.newton for x in stage.home], (len(inputs), 1))
    moved = np.zeros((len(inputs), n))
    for step in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        moved = face.real.array(satisfying(face.function, pairs, home + step * (inputs - home)))
        values, _ = evaluate(face, np.column_stack([moved, face.real.array(state)]))
        reached = values[:, face.output_size :]
        state = np.where(np.isfinite(reached), reached, state)
    return np.column_stack([moved, face.real.array(state)])


BOX_POINTS = 200  # random points, in addition to the corners
NEAR = 0.1  # typical sizes from a consistent point
FLAT = 1e-30  # least range of a signal, for signals that are zero everywhere
MARKS = 3  # numbers of gt_newton_marks, after the unknowns in the state


def compare(library: ctypes.CDLL, face: Interface, points: int, seed: int) -> tuple[dict[str, Check], int, int]:
    """Compare at random points, awkward points and points in the box, then with NaN and infinity in every input.

    Returns the checks by name, the number of compared points, and how many of them have a solution.
    """
    inside = box_points(face, BOX_POINTS, seed)
    inputs = np.concatenate([draw(face, points, seed), awkward(face), inside])
    expected, expected_status = evaluate(face, inputs)
    outputs, status = call(library, face, inputs)
    ok = (expected_status == Status.OK) & (status == Status.OK)
    different = np.any(outputs.view(face.real.bits) != expected.view(face.real.bits), axis=1) & ok
    touched = np.any(outputs != face.real.array(face.real.held), axis=1) & (status != Status.OK)
    refused, total, held = _not_finite(library, face, inputs[np.argmax(ok)])
    key = face.key
    checks = {
        f"{key}_values_different": at_most(int(different.sum()), 0, _detail(inputs, expected, outputs, different)),
        f"{key}_statuses_different": at_most(
            int(np.sum(expected_status != status)), 0, _statuses(expected_status, status)
        ),
        f"{key}_points_ok": at_least(
            int(ok.sum()), 1, f"of {points} random points and {len(inputs) - points} awkward or in the box"
        ),
        f"{key}_not_finite_accepted": at_most(total - refused, 0, f"calls, of {total} with NaN or infinity"),
        f"{key}_outputs_not_held": at_most(
            int(touched.sum()) + total - held, 0, "calls that wrote outputs without GT_OK"
        ),
    }
    if face.box is not None:
        lost = int(np.sum(expected_status[len(inputs) - len(inside) :] != Status.OK))
        checks[f"{key}_box_without_answer"] = at_most(lost, 0, f"of {len(inside)} points of the box")
    if face.real is not DOUBLE:
        checks |= _beside_double(face, points, seed)
    return checks, len(inputs), int(ok.sum())


def call(library: ctypes.CDLL, face: Interface, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Call the C function for each row; return its outputs (rows, m) and statuses (rows,).

    An output that the function did not write is HELD, the value before the call.

    The start state follows the inputs, and the new state follows the outputs: HELD if a failed call left it unchanged.
    """
    function = library[face.symbol]
    function.argtypes = [ctypes.c_void_p] * (3 if face.newton else 2)
    function.restype = ctypes.c_int
    rows = len(inputs)
    real = face.real
    input_rows = np.zeros((rows, max(1, face.input_size)), real.dtype)
    input_rows[:, : face.input_size] = inputs[:, : face.input_size]
    outputs = np.full((rows, face.output_size), real.held, real.dtype)
    start = np.ascontiguousarray(inputs[:, face.input_size :], real.dtype)
    state = np.column_stack([start, np.zeros((rows, MARKS), real.dtype)]) if face.newton else np.zeros((rows, 0))
    buffers = [state, input_rows, outputs] if face.newton else [input_rows, outputs]
    status = np.zeros(rows, dtype=int)
    places = [range(b.ctypes.data, b.ctypes.data + b.nbytes + 1, b.strides[0] or 1)[:rows] for b in buffers]
    for n, addresses in enumerate(zip(*places, strict=True)):
        status[n] = function(*addresses)
    after = state[:, : start.shape[1]].astype(real.dtype)
    after[(after.view(real.bits) == start.view(real.bits)) & (status != Status.OK)[:, None]] = real.held
    return np.column_stack([outputs, after]), status


def _beside_double(face: Interface, points: int, seed: int) -> dict[str, Check]:
    """Checks of the difference between float and double, as a fraction of the range of each signal.

    The points are in the box of validity or, without a box, near consistent points, because float has no accuracy near
    singular poses. Newton's method in double starts from the solution in float and must confirm it.
    """
    inputs = box_points(face, points, seed) if face.box is not None else draw(face, points, seed, NEAR)
    outputs, status = evaluate(face, inputs)
    inputs, outputs = inputs[status == Status.OK], outputs[status == Status.OK].astype(float)
    (wide,) = interfaces({face.key: face.function}, "double")
    exact, status = evaluate(
        wide, np.column_stack([inputs[:, : face.input_size], outputs[:, face.output_size :]]).astype(float)
    )
    both_ok = status == Status.OK
    worst, where = 0.0, face.outputs[0].signal
    for part, m in places(face.outputs):
        error = np.max(np.abs(outputs[both_ok, part] - exact[both_ok, part]), initial=0.0)
        share = float(error / max(np.max(np.abs(exact[both_ok, part]), initial=0.0), FLAT))
        worst, where = (share, m.signal) if share > worst else (worst, where)
    range_of = f"of the range of {where}, at {int(both_ok.sum())} points"
    return {
        f"{face.key}_float_error": at_most(worst, FLOAT_TOLERANCE, range_of),
        f"{face.key}_float_only": at_most(
            int(np.sum(~both_ok)), 0, "points with a solution in float but not in double"
        ),
    }


def _not_finite(library: ctypes.CDLL, face: Interface, good: np.ndarray) -> tuple[int, int, int]:
    """Put NaN or infinity into one input at a time. Returns the numbers of calls with NOT_FINITE, of all calls, and of
    calls that held the outputs."""
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


def _statuses(expected: np.ndarray, status: np.ndarray) -> str:
    if np.array_equal(expected, status):
        return ", ".join(f"{int(np.sum(status == s))} {s.c_name}" for s in Status if np.any(status == s))
    row = int(np.argmax(expected != status))
    return f"Python says {Status(int(expected[row])).c_name} where C returns {int(status[row])}"


class LoadedStep:
    """A step function of a loaded library, called with records."""

    def __init__(self, library: ctypes.CDLL, face: StepFace) -> None:
        self.face = face
        self._defaults, self._init, self._step = (library[f"{face.symbol}_{n}"] for n in ("defaults", "init", "step"))
        for f, count in ((self._defaults, 1), (self._init, 2), (self._step, 3)):
            f.argtypes, f.restype = [ctypes.c_void_p] * count, ctypes.c_int
        self._defaults.restype = None

    def defaults(self) -> np.ndarray:
        """Return the declared start."""
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
    """Run `points` steps in C and in Python. Returns the checks by name, the number of steps, and of steps with OK."""
    f, key, real = face.function, face.key, face.real
    twin, loaded = f.twin(real), LoadedStep(library, face)
    start, python_state = face.started()
    c_state = copied(python_state)
    other = loaded.defaults()
    begun = (twin.init(python_state, start), loaded.init(c_state, other))
    inputs = f.examples(points, seed, real)
    out = np.zeros((2, 1), dtype_of(f.outputs, real))
    different_steps = different_statuses = unheld = good = 0
    for row in inputs.reshape(-1, 1):
        before = c_state.tobytes(), out[1].tobytes()
        record_in = row.reshape(())
        codes = (
            twin.step(python_state, record_in, out[0].reshape(())),
            loaded.step(c_state, record_in, out[1].reshape(())),
        )
        different_statuses += codes[0] != codes[1]
        different_steps += python_state.tobytes() != c_state.tobytes() or out[0].tobytes() != out[1].tobytes()
        unheld += codes[1] != Status.OK and before != (c_state.tobytes(), out[1].tobytes())
        good += codes[1] == Status.OK
    same = start.tobytes() == other.tobytes() and begun[0] == begun[1]
    checks = {
        f"{key}_starts_different": at_most(int(not same), 0, "the declared start"),
        f"{key}_steps_different": at_most(different_steps, 0, f"of {points} steps, state and outputs byte for byte"),
        f"{key}_statuses_different": at_most(different_statuses, 0, f"of {points} steps"),
        f"{key}_steps_ok": at_least(good, 1, f"of {points} steps"),
        f"{key}_not_held": at_most(unheld, 0, "steps that wrote without GT_OK"),
    }
    return checks, points, good
