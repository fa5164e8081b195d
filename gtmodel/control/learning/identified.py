"""Identification of an axis, or of the tool alone, from a log by a subspace method, with checks of each fit."""

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
from .plants import SAMPLE_TIME, SampledSystem

if TYPE_CHECKING:
    from ...vibration import Record, SubspaceModel
else:
    Record = hint("gtmodel.vibration", "Record")
    SubspaceModel = hint("gtmodel.vibration", "SubspaceModel")

TAPS = 60  # of the pulse response used to find the delay
BEGINS = 0.05  # of its largest sample, where it begins
POOR = 1e-6  # relative singular value of the inputs below which a frequency is not excited
HIGHEST = 12  # model order
LEAST = 10  # samples per tap
EXPLAINED = 0.5  # least share of a signal's variance that a model must explain
JUMPS = 100.0  # times the median step from row to row
COLUMNS = "check columns, signs and units"
ACCELEROMETER = "check the accelerometer's sign, unit (m/s2 or g) and column"


def identified_axis(
    reference: Any, signals: Mapping[str, Any], sample_time: float = SAMPLE_TIME, order: int | None = None,
    delay: int | None = None,
) -> AxisPlant:  # fmt: skip
    """Identify an axis from one log: from its reference, including the learned input, to its measured signals.

    Args:
        reference: (N,) [m], exciting the loop and the tool, for example random. signals: "motor" and, if measured,
            "tool" [m] and "acceleration" [m/s2], each (N,). order: number of states for all signals together, without
            the delay; by default chosen on held-out samples. delay: samples; by default the beginning of the pulse
            response.

    The plant is checked before it is returned. It must explain at least half of the variance of each signal, on
    held-out samples and from the reference alone. The static gain of motor and tool must be 0.5 to 2. If both are in
    the log, the accelerometer must read 0.5 to 2 times the second derivative of the tool. Raises ArgumentError if a
    check fails, if signals do not match or do not move, and as `gtmodel.vibration.identify_subspace`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=300), 10)
    >>> log = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(3000).items()}
    >>> axis = learning.identified_axis(r, log)
    >>> [round(x, 2) for x in learning.ModelledRobot([axis]).mode(0)]
    [11.5, 0.05]
    """
    from ...vibration import Record

    u = np.asarray(reference, float)
    if "motor" not in signals:
        raise ArgumentError("has no 'motor', which is required", "signals")
    rows = {name: np.asarray(values, float) for name, values in signals.items()}
    for name, values in {"reference": u, **rows}.items():
        if values.shape != (len(u),) or not np.all(np.isfinite(values)) or not np.ptp(values) > 0:
            raise ArgumentError(f"'{name}' must be {len(u)} finite numbers that are not constant", "signals")
    late = min(begin(u, values) for values in rows.values()) if delay is None else delay
    if not 0 <= late < len(u):
        raise ArgumentError(f"expected a delay of 0 to {len(u) - 1} samples; found {late}", "delay")
    before = max(late - 1, 0)  # a model without feedthrough has a delay of one sample itself
    y = np.column_stack(list(rows.values()))
    scale = y.std(axis=0)
    record = Record(u[: len(u) - before], (y / scale)[before:], sample_time)
    model = _identified(record, order, feedthrough=late == 0)
    _explains(model, rows)
    system = model.system
    C, D = np.asarray(system.C, float) * scale[:, None], np.asarray(system.D, float) * scale[:, None]
    plant = AxisPlant(
        {
            name: delayed(SampledSystem(system.A, system.B, C[k : k + 1], D[k : k + 1], sample_time), before)
            for k, name in enumerate(rows)
        },
        sample_time,
    )
    _agrees(plant, u, rows)
    return plant


def _explains(model: SubspaceModel, rows: Mapping[str, np.ndarray]) -> None:
    """Raise ArgumentError if a model explains too little of an output in held-out samples."""
    names = list(rows)
    share = 1 - (1 - model.held_out_fit / 100) ** 2
    k = int(np.argmin(share))
    if not share[k] >= EXPLAINED:
        raise ArgumentError(
            _unexplained(names[k], float(share[k]), rows[names[k]], f"held-out samples, model of order {model.order}"),
            "signals",
        )


def _unexplained(name: str, share: float, values: np.ndarray, where: str) -> str:
    steps = np.abs(np.diff(values))
    k = int(np.argmax(steps))
    unit = "m/s2" if name == "acceleration" else "m"
    jump = f", which jumps by {steps[k]:.3g} {unit} after row {k}" if steps[k] > JUMPS * np.median(steps) else ""
    return (
        f"the reference explains {100 * max(share, 0.0):.0f} % of the variance of '{name}'{jump} ({where}); expected "
        f"{100 * EXPLAINED:.0f} % or more: {COLUMNS}, and whether the robot followed this reference; leave out a "
        "signal that is only noise, or excite more"
    )


def _agrees(plant: AxisPlant, u: np.ndarray, rows: Mapping[str, np.ndarray]) -> None:
    """Raise ArgumentError if a fitted plant contradicts its log."""
    forced = {name: T(u) for name, T in plant.maps(len(u)).items()}
    for name, values in rows.items():
        # without the free motion, with which a model can fit motion not caused by the reference, such as hum
        share = 1 - float(np.var(values - forced[name]) / np.var(values))
        if not share >= EXPLAINED:
            raise ArgumentError(_unexplained(name, share, values, "all samples, without free motion"), "signals")
    for name in {"motor", "tool"} & set(rows):
        rest = float(plant.responses(np.zeros(1))[name][0].real)
        if not LEAST_GAIN <= rest <= MOST_GAIN:
            raise ArgumentError(
                f"the static gain from the reference to '{name}' is {rest:.3g}; expected about 1: {COLUMNS}",
                "signals",
            )
    if {"tool", "acceleration"} <= set(rows):
        moved = second_derivative(forced["tool"], plant.sample_time)
        for alarm in alarms([accelerometer("", rows["acceleration"], rows["tool"], moved, plant.sample_time)]):
            raise ArgumentError(f"{alarm.evidence}; expected about 1: {alarm.remedy}", "signals")


def accelerometer(
    axis: str, felt: np.ndarray, tool: np.ndarray | None, moved: np.ndarray, sample_time: float
) -> Suspicion:
    """Test whether an accelerometer (N,) [m/s2] agrees with the tool (N,) [m] of the same log, or with the model if no
    tool was measured. moved: (N,) [m/s2] the tool's acceleration by the model; axis: for the message, as in " of x"."""
    expected = moved if tool is None else second_derivative(tool, sample_time)
    source = "the tool's acceleration by the model" if tool is None else "the second derivative of the measured tool"
    return gain_off(
        felt, expected, moved, f"the accelerometer's reading{axis}", source, ACCELEROMETER, name="accelerometer"
    )


def _identified(record: Record, order: int | None, feedthrough: bool) -> SubspaceModel:
    """The model of the given order, or of the best order with a stable model: high orders fit noise and may be
    unstable."""
    from ...vibration import identify_subspace

    for largest in [HIGHEST] if order is not None else range(HIGHEST, 0, -1):
        try:
            return identify_subspace(record, order=order, largest=largest, feedthrough=feedthrough)
        except ArgumentError as error:
            if order is not None or largest == 1 or "unstable" not in error.message:
                raise
    raise AssertionError


def begin(reference: Any, motor: Any) -> int:
    """Return the sample at which the pulse response from reference (N,) to motor (N,) begins, by least squares.

    Raises ArgumentError if the log is too short or the reference excites too few frequencies.

    >>> r = np.random.default_rng(1).normal(size=2000)
    >>> gt.control.learning.begin(r, np.append(np.zeros(7), r[:-7]))
    7
    """
    u, z = np.asarray(reference, float), np.asarray(motor, float)
    if len(u) < LEAST * TAPS:
        raise ArgumentError(
            f"the log has {len(u)} samples; {LEAST * TAPS} or more are needed to find the delay", "motor"
        )
    g, rank, _ = pulses(u, z)
    if rank < TAPS + 1:
        raise ArgumentError(
            "the reference excites too few frequencies to find the delay; use a random one, or set the delay", "delay"
        )
    return int(np.argmax(np.abs(g) > BEGINS * np.abs(g).max()))


def pulses(u: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, int, float]:
    """Return the least-squares pulse response (TAPS,) from u (N,) to z (N,), fitted with a constant, the rank of the
    equations, and the explained share of the variance of z."""
    # inputs before the log are unknown, so its first rows are used only as inputs
    rows = np.lib.stride_tricks.sliding_window_view(u, TAPS)[:, ::-1]
    columns, output = np.column_stack([rows, np.ones(len(rows))]), z[TAPS - 1 :]
    g, _, rank, _ = np.linalg.lstsq(columns, output, rcond=POOR)
    spread = float(np.var(output))
    return g[:TAPS], int(rank), 1 - float(np.var(output - columns @ g)) / spread if spread > 0 else 0.0


def identified_tool(motor: Any, tool: Any, sample_time: float = SAMPLE_TIME, order: int | None = None) -> SampledSystem:
    """Identify the model from the motor side to the tool for `ExtendedKalman`, from one log.

    Args:
        motor, tool: (N,) [m], under an input that excites both, for example random. order: of the model; by default
            chosen on held-out samples.

    The input is the mean of this sample and the next: a zero-order hold would delay the motor side by half a sample,
    more than the tool's own error. Raises ArgumentError if the model explains less than half of the variance of the
    tool on held-out samples, and as `gtmodel.vibration.identify_subspace`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=200), 10)
    >>> log = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(2000).items()}
    >>> model = learning.identified_tool(log["motor"], log["tool"], order=3)
    >>> model.ninputs, model.nstates
    (2, 3)
    """
    from ...vibration import Record

    zc, z = np.asarray(motor, float), np.asarray(tool, float)
    model = _identified(Record((zc[:-1] + zc[1:]) / 2, z[:-1], sample_time), order, feedthrough=False)
    _explains(model, {"tool": z})
    half = np.asarray(model.system.B, float) / 2
    return SampledSystem(
        model.system.A, np.hstack([half, half]), model.system.C, np.zeros((1, 2)), sample_time
    )  # fmt: skip
