"""One function of a loaded library against Python, step functions too: statuses, values bit for bit, guards, at
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
    """All checks of one folder by name. `message` is one sentence; `rows` and `rows_ok` count compared points by
    function."""

    checks: Mapping[str, Check]
    message: str
    rows: Mapping[str, int]
    rows_ok: Mapping[str, int]

    @property
    def passed(self) -> bool:
        """True when every check passed."""
        return not failed_of(self.checks)


def check_report(checks: Mapping[str, Check], rows: Mapping[str, int], rows_ok: Mapping[str, int]) -> CheckReport:
    """A report with the sentence that its checks imply."""
    failed = failed_of(checks)
    equal = (
        f"the C code equals Python bit for bit at {sum(rows_ok.values())} points, "
        f"and in the status at {sum(rows.values())}"
    )
    return CheckReport(checks, verdict(failed, len(checks)) if failed else equal, rows, rows_ok)


CORNERS = 64  # all of up to six inputs; of more, so many drawn at random
STEPS = 25  # from home to a point of the box, for a function that follows its last solution


def box_points(face: Interface, rows: int, seed: int) -> np.ndarray:
    """Inputs in the box (corners + rows, inputs), moved onto the conditions on known values and on their
    rates; behind them the state that a function with Newton blocks has when it was led there from home in small steps.

    Where it cannot be led, the state is the last one that was reached. Empty without a box.
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
    here = np.zeros((len(inputs), n))
    for step in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        here = face.real.array(satisfying(face.function, pairs, home + step * (inputs - home)))
        values, _ = evaluate(face, np.column_stack([here, face.real.array(state)]))
        reached = values[:, face.output_size :]
        state = np.where(np.isfinite(reached), reached, state)
    return np.column_stack([here, face.real.array(state)])


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
