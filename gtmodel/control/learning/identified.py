"""An axis of a robot from a log, by a subspace method, and the tool alone; each fit is judged before it is used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._lazy import hint
from ...measurements.filters import second_derivative
from ...measurements.inspection.misread_columns import LEAST as LEAST_GAIN, MOST as MOST_GAIN, gain_off
from ...results import ArgumentError
from ...results.suspicion import Suspicion, alarms
from .axis import AxisPlant, delayed
from .plants import SAMPLE_TIME

if TYPE_CHECKING:
    from control import StateSpace

    from ...vibration import Record, SubspaceModel
else:
    StateSpace, Record = hint("control", "StateSpace"), hint("gtmodel.vibration", "Record")
    SubspaceModel = hint("gtmodel.vibration", "SubspaceModel")

TAPS = 60  # of the pulse response by which the delay is looked for
BEGINS = 0.05  # of its largest sample, at which it does
POOR = 1e-6  # of the largest singular value of the inputs: below, some frequency is missing
HIGHEST = 12  # order that is tried
LEAST = 10  # samples for each tap
EXPLAINED = 0.5  # of a signal's variance: a model that explains less says less of the signal than it leaves
JUMPS = 100.0  # times the median step from row to row
COLUMNS = "look at columns, signs and units"
ACCELEROMETER = "look at the accelerometer's sign, its unit (m/s2 or g) and its column"


def identified_axis(
    reference: Any, signals: Mapping[str, Any], sample_time: float = SAMPLE_TIME, order: int | None = None,
    delay: int | None = None,
) -> AxisPlant:  # fmt: skip
    """An axis from its reference, the learned input included, to what is measured of it, identified from one log.

    Args:
        reference: (N,) [m], one that excites the loop and the tool, such as a random one. signals: "motor", and where
            they were measured "tool" [m] and "acceleration" [m/s2], each (N,). order: states, of all signals together,
            the delay not counted; by the error on held-out samples if left out. delay: samples; where the pulse
            response begins if left out.

    The plant is judged before it is returned: of each signal it explains half of the variance or more, of samples that
    were held out and by the reference alone; motors and tool go at rest where the reference goes, 0.5 to 2 m per metre;
    and the accelerometer reads 0.5 to 2 times the second derivative of the tool, where both are in the log.
    Raises ArgumentError where one of these is not so, for signals that do not match or do not move, and as
    `gtmodel.vibration.identify_subspace`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=300), 10)
    >>> log = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(3000).items()}
    >>> axis = learning.identified_axis(r, log)
    >>> [round(x, 2) for x in learning.ModelledRobot([axis]).mode(0)]
    [11.5, 0.05]
    """
    import control

    from ...vibration import Record

    u = np.asarray(reference, float)
    if "motor" not in signals:
        raise ArgumentError("has no 'motor', from which every robot learns", "signals")
    rows = {name: np.asarray(values, float) for name, values in signals.items()}
    for name, values in {"reference": u, **rows}.items():
        if values.shape != (len(u),) or not np.all(np.isfinite(values)) or not np.ptp(values) > 0:
            raise ArgumentError(f"'{name}' is not {len(u)} finite numbers that move", "signals")
    late = min(begin(u, values) for values in rows.values()) if delay is None else delay
    if not 0 <= late < len(u):
        raise ArgumentError(f"expected a delay of 0 to {len(u) - 1} samples; found {late}", "delay")
    before = max(late - 1, 0)  # a model without feedthrough is a sample late itself
    y = np.column_stack(list(rows.values()))
    scale = y.std(axis=0)
    record = Record(u[: len(u) - before], (y / scale)[before:], sample_time)
    made = _identified(record, order, feedthrough=late == 0)
    _explains(made, rows)
    of = made.system
    C, D = np.asarray(of.C, float) * scale[:, None], np.asarray(of.D, float) * scale[:, None]
    plant = AxisPlant(
        {
            name: delayed(control.StateSpace(of.A, of.B, C[k : k + 1], D[k : k + 1], sample_time), before)
            for k, name in enumerate(rows)
        },
        sample_time,
    )
    _agrees(plant, u, rows)
    return plant


def _explains(made: SubspaceModel, rows: Mapping[str, np.ndarray]) -> None:
    """Raises ArgumentError where a model explains too little of one of its outputs in held-out samples."""
    names = list(rows)
    share = 1 - (1 - made.held_out_fit / 100) ** 2
    k = int(np.argmin(share))
    if not share[k] >= EXPLAINED:
        raise ArgumentError(
            _unexplained(
                names[k], float(share[k]), rows[names[k]], f"samples held out, by a model of order {made.order}"
            ),
            "signals",
        )


def _unexplained(name: str, share: float, values: np.ndarray, where: str) -> str:
    steps = np.abs(np.diff(values))
    k = int(np.argmax(steps))
    unit = "m/s2" if name == "acceleration" else "m"
    jump = f", which jumps by {steps[k]:.3g} {unit} behind row {k}" if steps[k] > JUMPS * np.median(steps) else ""
    return (
        f"the reference explains {100 * max(share, 0.0):.0f} % of the variance of '{name}'{jump} ({where}); expected "
        f"{100 * EXPLAINED:.0f} % or more: {COLUMNS}, and at whether the robot followed this reference; leave out a "
        "signal that is noise, or excite more"
    )


def _agrees(plant: AxisPlant, u: np.ndarray, rows: Mapping[str, np.ndarray]) -> None:
    """Raises ArgumentError where the log and a plant that was fitted to it do not belong together."""
    forced = {name: T(u) for name, T in plant.maps(len(u)).items()}
    for name, values in rows.items():
        # without the free motion, by which a model follows what no reference moved, such as hum
        share = 1 - float(np.var(values - forced[name]) / np.var(values))
        if not share >= EXPLAINED:
            raise ArgumentError(_unexplained(name, share, values, "all samples, without free motion"), "signals")
    for name in {"motor", "tool"} & set(rows):
        rest = float(plant.responses(np.zeros(1))[name][0].real)
        if not LEAST_GAIN <= rest <= MOST_GAIN:
            raise ArgumentError(
                f"at rest '{name}' goes by {rest:.3g} m for each metre of the reference; expected about 1: {COLUMNS}",
                "signals",
            )
    if {"tool", "acceleration"} <= set(rows):
        moved = second_derivative(forced["tool"], plant.sample_time)
        for alarm in alarms([accelerometer("", rows["acceleration"], rows["tool"], moved, plant.sample_time)]):
            raise ArgumentError(f"{alarm.evidence}; expected about 1: {alarm.remedy}", "signals")


def accelerometer(
    axis: str, felt: np.ndarray, tool: np.ndarray | None, moved: np.ndarray, sample_time: float
) -> Suspicion:
    """Whether an accelerometer reads (N,) [m/s2] what the tool (N,) [m] of the same log does, or the model where no
    tool was measured. moved: (N,) [m/s2] the tool's acceleration by the model; axis: in words, " of x"."""
    expected = moved if tool is None else second_derivative(tool, sample_time)
    of = "the tool's acceleration by the model" if tool is None else "the second derivative of the tool in the same log"
    return gain_off(
        felt, expected, moved, f"the accelerometer's reading{axis}", of, ACCELEROMETER, name="accelerometer"
    )


def _identified(record: Record, order: int | None, feedthrough: bool) -> SubspaceModel:
    """The model of the order that is asked for; else of the best stable one: high orders follow noise, some of them to
    poles outside the circle."""
    from ...vibration import identify_subspace

    for largest in [HIGHEST] if order is not None else range(HIGHEST, 0, -1):
        try:
            return identify_subspace(record, order=order, largest=largest, feedthrough=feedthrough)
        except ArgumentError as error:
            if order is not None or largest == 1 or "unstable" not in error.message:
                raise
    raise AssertionError


def begin(reference: Any, motor: Any) -> int:
    """The sample at which the pulse response from (N,) to (N,) begins, by least squares.

    Raises ArgumentError for a log too short, and for a reference that does not excite.

    >>> r = np.random.default_rng(1).normal(size=2000)
    >>> gt.control.learning.begin(r, np.append(np.zeros(7), r[:-7]))
    7
    """
    u, z = np.asarray(reference, float), np.asarray(motor, float)
    if len(u) < LEAST * TAPS:
        raise ArgumentError(
            f"the log has {len(u)} samples; {LEAST * TAPS} or more say where a response begins", "motor"
        )
    g, rank, _ = pulses(u, z)
    if rank < TAPS + 1:
        raise ArgumentError(
            "the reference excites too few frequencies to show a delay; record a random one, or give the delay", "delay"
        )
    return int(np.argmax(np.abs(g) > BEGINS * np.abs(g).max()))


def pulses(u: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, int, float]:
    """The pulse response (TAPS,) from u (N,) to z (N,) and a constant by least squares, the rank of its equations, and
    the share of the variance of z that it explains."""
    # what came before the log is not known, so its first rows count as inputs only
    rows = np.lib.stride_tricks.sliding_window_view(u, TAPS)[:, ::-1]
    columns, seen = np.column_stack([rows, np.ones(len(rows))]), z[TAPS - 1 :]
    g, _, rank, _ = np.linalg.lstsq(columns, seen, rcond=POOR)
    spread = float(np.var(seen))
    return g[:TAPS], int(rank), 1 - float(np.var(seen - columns @ g)) / spread if spread > 0 else 0.0


def identified_tool(motor: Any, tool: Any, sample_time: float = SAMPLE_TIME, order: int | None = None) -> StateSpace:
    """The model from the motor side to the tool that `ExtendedKalman` takes, identified from one log.

    Args:
        motor, tool: (N,) [m], under an input that excites both, such as a random one. order: of the model; chosen by
            the error on held-out samples if left out.

    The input is the mean of this sample and the next one: held alone the motor side would be half a sample late, which
    is more than the tool's own error. Raises ArgumentError where the model explains less than half of the variance of
    the tool, of samples that were held out, and as `gtmodel.vibration.identify_subspace`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=200), 10)
    >>> log = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(2000).items()}
    >>> model = learning.identified_tool(log["motor"], log["tool"], order=3)
    >>> model.ninputs, model.nstates
    (2, 3)
    """
    import control

    from ...vibration import Record

    at, z = np.asarray(motor, float), np.asarray(tool, float)
    made = _identified(Record((at[:-1] + at[1:]) / 2, z[:-1], sample_time), order, feedthrough=False)
    _explains(made, {"tool": z})
    of = made.system
    half = np.asarray(of.B, float) / 2
    return control.StateSpace(of.A, np.hstack([half, half]), of.C, np.zeros((1, 2)), sample_time)
