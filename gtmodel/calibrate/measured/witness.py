"""Measurements that were read wrong, recognised before the fit by the robot's own forward kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...compiler.causal import CausalFunction, compile_causal, flat_of
from ...lang import Model, ModelError
from ...lang.units import parse_unit
from ...measurements.orders import orders
from ...results import ArgumentError
from ..calibration import calibrate
from ..choice import Choice
from ..prediction import Prediction
from ..problem import CalibrationProblem, prepare
from .column_checks import (
    CLOSE,
    NEARER,
    aligned,
    angle_sentence,
    distance,
    exchanged,
    length,
    nearest,
    other_columns,
    scale_sentence,
    signals_exchanged,
    stuck_columns,
    swapped_axes,
    unit_sentence,
)
from .misread_columns import misread_columns
from .poses import SplitPoses

MOST = 150  # poses that are looked at: enough to distinguish a metre from a millimetre
REACHED = 0.5  # share of the poses that the model must reach to be a witness
MISFIT = 2e-4  # of the robot's size: length errors of a fit above this are worth a look at other orders
TRIALS = 25  # iterations of a fit with other columns
TURNED = 0.2  # rad: orientations nearer to the model's are read right


@dataclass(frozen=True, eq=False)
class Witness:
    """The robot's model as it was before calibration, by forward kinematics; None where it has none."""

    forward: CausalFunction | None
    size: float

    def positions(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (n, 3), in the plane (n, 2), and quaternions (n, 4 or 0) of the rows (n,) that are reached."""
        assert self.forward is not None
        T, *e, status = self.forward(q)
        good = np.flatnonzero(np.asarray(status) == 0)
        return T[good], e[0][good] if e else np.zeros((len(good), 0)), good


def witness_of(model: Model, data: SplitPoses) -> Witness:
    """Of the signals that were measured."""
    pose = data.pose
    flat = flat_of(model)
    lengths = [abs(p.value) for p in flat.parameters if p.unit == "m" and np.isfinite(p.value)]
    size = max(lengths, default=1.0)
    if not data.whole:
        return Witness(None, size)
    targets = [n for n in (pose.position, pose.orientation) if n is not None and n in data.all.values]
    try:
        forward = compile_causal(model, known=[data.actuators], targets=targets)
    except ModelError:
        forward = None
    # a frame of the device is sought in space only
    if forward is not None and forward.outputs[0].shape not in (((3,),) if pose.device else ((2,), (3,))):
        forward = None
    return Witness(forward, size)


def recognise(data: SplitPoses, witness: Witness) -> tuple[np.ndarray, np.ndarray] | None:
    """The frame of the device (t, quaternion) by alignment with the model, None without a witness.

    Raises ArgumentError in one sentence with the numbers seen: wrong units, exchanged columns, swapped axes.
    """
    pose = data.pose
    _units(data, witness.size)
    if witness.forward is None:
        return None
    rows = np.unique(np.round(np.linspace(0, len(data.q) - 1, min(MOST, len(data.q)))).astype(int))
    q, T = data.q[rows], data.T[rows]
    predicted, e, good = witness.positions(q)

    def misfit(reached: np.ndarray, _: np.ndarray, at: np.ndarray, measured: np.ndarray = T) -> float:
        if len(at) < REACHED * len(T):
            return np.inf
        return aligned(measured[at], reached)[2] if pose.device else distance(measured[at], reached)

    names, groups = _columns(data)
    before = misfit(predicted, e, good)
    if q.shape == T.shape and before > CLOSE * witness.size:
        other = misfit(*witness.positions(T), q)
        _refuse(signals_exchanged(data.actuators, pose.position, before, other), data.actuators)
    _refuse(stuck_columns(names, data.q, before, witness.size), data.actuators)
    if len(good) >= REACHED * len(q) and len(good) > 3:
        _refuse(scale_sentence(pose.position, T[good], predicted), pose.position)
        _refuse(_upright(data, rows[good], e), pose.orientation or "")
    columns = None
    if before > CLOSE * witness.size:
        columns = other_columns(names, groups, q, before, lambda trial: misfit(*witness.positions(trial)))
    if len(good) < max(4, REACHED * len(q)):
        _refuse(None if columns is None else columns.message, data.actuators)
        if len(q) < 4:
            raise ArgumentError(
                f"found {len(q)} poses; expected at least 4, better several tens", f"poses.values.{data.actuators}"
            )
        raise ArgumentError(
            f"the robot's model reaches {len(good)} of {len(q)} poses with these actuators; check their units, order "
            "and zero, or the robot",
            f"poses.values.{data.actuators}",
        )
    axes = swapped_axes(pose.position, T[good], predicted, witness.size, pose.device)
    if columns is not None and (axes is None or columns.left < axes.left):
        _refuse(columns.message, data.actuators)
    elif axes is not None:
        _refuse(axes.message, pose.position)
    if pose.device:
        t, R, _ = aligned(T[good], predicted)
        return t, scipy.spatial.transform.Rotation.from_matrix(R).as_quat(scalar_first=True)
    return None


def recognise_sessions(data: SplitPoses, witness: Witness) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """recognise(), session by session where the device stood elsewhere in each: its frames, of one for all under "";
    empty without."""
    m, frames = data.all, {}
    for s in m.session_names if data.pose.device_per_session else ("",):
        rows = np.ones(len(m), bool) if m.sessions is None or not s else np.array([x == s for x in m.sessions])
        placed = recognise(
            replace(data, all=m.part(rows), lines=data.lines[rows], held_out=data.held_out[rows]), witness
        )
        if placed is not None:
            frames[s] = placed
    return frames


def a_priori(
    data: SplitPoses, witness: Witness, placed: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> Prediction | None:
    """Errors of the robot as it was at all poses, in its frame; NaN where it does not reach, None without a witness."""
    if witness.forward is None:
        return None
    q, T = data.q, data.T
    sessions = np.array(data.all.sessions if data.all.sessions is not None else [""] * len(T))
    T = np.array(T)
    for s, (t, u) in placed.items():
        rows = sessions == s if s else np.ones(len(T), bool)
        T[rows] = t + scipy.spatial.transform.Rotation.from_quat(u, scalar_first=True).apply(T[rows])
    predicted, _, good = witness.positions(q)
    errors = np.full(T.shape, np.nan)
    errors[good] = predicted - T[good]
    return Prediction(errors) if len(good) else None


def exchanged_after(data: SplitPoses, prepared: CalibrationProblem, fitted: float, size: float) -> str | None:
    """Where a fit is left with length errors of `fitted` rms [m] or did not end: whether it is of another order of the
    actuators' columns, by fits of all of them. Arms do not know their columns, residuals do."""
    if fitted <= MISFIT * size:
        return None
    names, groups = _columns(data)
    if data.pose.device or data.pose.target:
        # with nothing but the frames free no link can take up another's column, in whatever order they are
        own = [prepared.closure.flat.parameters[k].name for k in prepared.closure.touched]
        alone = prepare(prepared.closure.flat, prepared.measurements, Choice(fixed=own), actuators=prepared.actuators)
        sentence = misread_columns(alone, columns=names)
        if sentence is not None:
            return sentence
    m = data.fitted
    q = np.asarray(m.values[data.actuators])

    def left(order: list[int]) -> float:
        other = replace(m, values={**m.values, data.actuators: q[:, order]})
        try:
            c = calibrate(prepared.on(other), cost="length", limit=TRIALS)
        except (ModelError, ValueError):
            return np.inf
        return float(np.sqrt(np.mean(c.residuals**2)))

    best, order = nearest(fitted, left, orders(len(names), groups))
    if order is None:
        return None
    which, read = exchanged(names, order)
    before = f"{length(fitted)} rms" if np.isfinite(fitted) else "no solution"
    return (
        f"the columns {which} look exchanged: links are left with {before} as given and with {length(best)} rms when "
        f"read as {read}"
    )


def _units(data: SplitPoses, size: float) -> None:
    scaled = {c.signal for c in data.all.corrections if c.scale}
    for name, columns in data.columns.items():
        if name == data.pose.orientation or name in scaled or "(" in name:
            continue
        rows, units = np.asarray(data.all.values[name]), columns.units
        si = [parse_unit(u).si_text for u in units]
        lengths, angles = ([k for k, u in enumerate(si) if u == unit] for unit in ("m", "rad"))
        whole = name in (data.actuators, data.pose.position)
        if lengths and (whole or np.ptp(rows[:, lengths]) > size):  # heights of a level bed, one distance: hardly any
            _refuse(unit_sentence(name, rows[:, lengths], size, units[lengths[0]]), name)
        if angles:
            _refuse(angle_sentence(name, rows[:, angles], units[angles[0]]), name)


def _columns(data: SplitPoses) -> tuple[list[str], list[list[int]]]:
    """Names of the actuators' columns, and those of one unit."""
    names, units = data.columns[data.actuators].names, data.columns[data.actuators].units
    return list(names), [[k for k, unit in enumerate(units) if unit == u] for u in dict.fromkeys(units)]


def _upright(data: SplitPoses, rows: np.ndarray, predicted: np.ndarray) -> str | None:
    """Quaternions whose scalar stands last."""
    pose = data.pose
    if pose.orientation is None or pose.device or pose.target or not predicted.shape[1]:
        return None
    e = np.asarray(data.all.values[pose.orientation])[rows]
    given, rolled = (_turn(x, predicted) for x in (e, np.roll(e, 1, axis=1)))
    if given <= TURNED or rolled * NEARER > given:
        return None
    return (
        f"'{pose.orientation}' is {np.degrees(given):.3g} deg rms from the model's orientation as given and "
        f"{np.degrees(rolled):.3g} deg with its last column as the scalar; name the columns scalar first"
    )


def _turn(a: np.ndarray, b: np.ndarray) -> float:
    c = np.abs(np.sum(a * b, axis=1)) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return float(np.sqrt(np.mean((2 * np.arccos(np.minimum(c, 1.0))) ** 2)))


def _refuse(sentence: str | None, signal: str) -> None:
    if sentence is not None:
        raise ArgumentError(sentence, f"poses.values.{signal}")
