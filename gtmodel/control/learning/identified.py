"""The axes of a robot from a log, by a subspace method: from the reference to what is measured, and the tool alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._lazy import hint
from ...results import ArgumentError
from .axis import AxisPlant, delayed
from .plants import SAMPLE_TIME

if TYPE_CHECKING:
    from control import StateSpace

    from ...vibration import Record
else:
    StateSpace, Record = hint("control", "StateSpace"), hint("gtmodel.vibration", "Record")

TAPS = 60  # of the pulse response by which the delay is looked for
BEGINS = 0.05  # of its largest sample, at which it does
POOR = 1e-6  # of the largest singular value of the inputs: below, some frequency is missing
HIGHEST = 12  # order that is tried
LEAST = 10  # samples for each tap


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

    Raises ArgumentError for signals that do not match or do not move, and as `gtmodel.vibration.identify_subspace`.

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
    C, D = np.asarray(made.C, float) * scale[:, None], np.asarray(made.D, float) * scale[:, None]
    return AxisPlant(
        {
            name: delayed(control.StateSpace(made.A, made.B, C[k : k + 1], D[k : k + 1], sample_time), before)
            for k, name in enumerate(rows)
        },
        sample_time,
    )


def _identified(record: Record, order: int | None, feedthrough: bool) -> StateSpace:
    """The model of the order that is asked for; else of the best stable one: high orders follow noise, some of them to
    poles outside the circle."""
    from ...vibration import identify_subspace

    for largest in [HIGHEST] if order is not None else range(HIGHEST, 0, -1):
        try:
            return identify_subspace(record, order=order, largest=largest, feedthrough=feedthrough).system
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
    # what came before the log is not known, so its first rows count as inputs only
    rows = np.lib.stride_tricks.sliding_window_view(u, TAPS)[:, ::-1]
    columns = np.column_stack([rows, np.ones(len(rows))])
    g, _, rank, _ = np.linalg.lstsq(columns, z[TAPS - 1 :], rcond=POOR)
    g = g[:TAPS]
    if rank < TAPS + 1:
        raise ArgumentError(
            "the reference excites too few frequencies to show a delay; record a random one, or give the delay", "delay"
        )
    return int(np.argmax(np.abs(g) > BEGINS * np.abs(g).max()))


def identified_tool(motor: Any, tool: Any, sample_time: float = SAMPLE_TIME, order: int | None = None) -> StateSpace:
    """The model from the motor side to the tool that `ExtendedKalman` takes, identified from one log.

    Args:
        motor, tool: (N,) [m], under an input that excites both, such as a random one. order: of the model; chosen by
            the error on held-out samples if left out.

    The input is the mean of this sample and the next one: held alone the motor side would be half a sample late, which
    is more than the tool's own error. Raises ArgumentError as `gtmodel.vibration.identify_subspace`.

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
    half = np.asarray(made.B, float) / 2
    return control.StateSpace(made.A, np.hstack([half, half]), made.C, np.zeros((1, 2)), sample_time)
