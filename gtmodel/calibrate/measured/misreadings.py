"""Recognises misread measurements before the fit from the robot's own kinematics: units, signals, axes, quaternions,
columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from operator import itemgetter

import numpy as np
import scipy

from ...compiler.causal import CausalFunction, compile_causal, flat_of
from ...geometry.quaternions import angle_between, quaternion_of
from ...inference import over_noise
from ...lang import Model
from ...lang.source import ModelError
from ...lang.units import parse_unit
from ...measurements.inspection.misread_columns import (
    OtherReading,
    axes,
    compared,
    exchanges,
    in_order,
    mirrored,
    reversals,
    scalar_last,
    thousands,
)
from ...measurements.orientations import MATRIX, quaternions
from ...results import ArgumentError
from ...results.suspicion import Inspection, Suspicion
from ..calibration import Calibration, calibrate
from ..measurements import Measurements
from ..options import Choice
from ..prediction import Prediction
from ..problem import CalibrationProblem, prepare
from .column_checks import (
    CLOSE,
    NEARER,
    aligned,
    degrees_of_freedom,
    distance,
    length,
    other_scale,
    other_unit,
    stuck_columns,
    too_many_turns,
)
from .poses import SplitPoses

STEPS = 20  # of each fit; a few unknowns near their start values need fewer
POSES = 40  # number of poses checked: enough to distinguish one order from another


def misread_columns(
    problem: CalibrationProblem, lengths: Sequence[str] = (), columns: Sequence[str] = (), axes_of: str = ""
) -> Suspicion | None:
    """Look for another reading of the columns that closes the links much better; it states the residuals of both.

    `problem`: prepared with few free parameters, such as the frames and an offset per actuator, so that they cannot
    compensate for a wrong reading. `lengths`: signals that may be off by a factor of 1000. `columns`: names of the
    actuators' columns. `axes_of`: a position whose axes may be exchanged or reversed. Forward kinematics is not needed.
    Free frames must start nearer to the truth than a turn that renumbers the links.
    """
    m = problem.measurements
    rows = np.unique(np.linspace(0, len(m) - 1, min(POSES, len(m))).round().astype(int))
    problem, m = problem.on(m.part(rows)), m.part(rows)
    misfit = _misfit(problem, m, {})
    beyond = len(m) * len(problem.labels) - len(problem.unknowns.names)
    q = np.asarray(m.values[problem.actuators])
    names = columns or [f"{problem.actuators}[{k}]" for k in range(q.shape[1])]
    signal, values = problem.actuators, {name: np.asarray(m.values[name]) for name in m.values}
    readings = [in_order(names, _ordered(problem, m, misfit), signal), *reversals(names, [range(len(names))], signal)]
    readings += [r for name in lengths for r in thousands(name, values[name].shape[1])]
    readings += [scalar_last(name) for name in problem.closure.unit]
    readings += axes(axes_of, values[axes_of].shape[1]) if axes_of else []
    steps = len(names) * (len(names) - 1) - 1  # pairs of columns, and as many steps of the search

    def misfit_of(r: OtherReading) -> float:
        return _misfit(problem, m, {r.signal: r(values[r.signal])})

    best = compared(misfit, readings, misfit_of, beyond, nearer=NEARER, tests=steps)
    return (
        None
        if best.passed
        else best.suspicion(f"links miss by {length(misfit)} rms as declared, and by", length(best.left))
    )


def _ordered(problem: CalibrationProblem, m: Measurements, declared: float) -> list[int]:
    """The order of the actuators' columns: by assignment at the start values, then by exchanges that lower the misfit
    of the links."""
    columns = np.asarray(m.values[problem.actuators])

    def misfit(order: Sequence[int]) -> float:
        return _misfit(problem, m, {problem.actuators: columns[:, order]})

    assigned = _assigned(problem, m)
    best, order = min([(declared, list(range(columns.shape[1]))), (misfit(assigned), assigned)], key=itemgetter(0))
    while True:
        trials = []
        for a, b in combinations(range(len(order)), 2):
            trial = order.copy()
            trial[a], trial[b] = trial[b], trial[a]
            trials.append((misfit(trial), trial))
        least, trial = min(trials, default=(np.inf, order))
        if not least < best * (1 - 1e-9):
            return order
        best, order = least, trial


def _assigned(problem: CalibrationProblem, m: Measurements) -> list[int]:
    """The column for each actuator, chosen so that its links' errors vary least from pose to pose."""
    columns = np.asarray(m.values[problem.actuators])
    n = columns.shape[1]
    varied = np.empty((n, n))
    for k in range(n):
        for j in range(n):
            read = columns.copy()
            read[:, k] = columns[:, j]
            other = replace(m, values={**m.values, problem.actuators: read})
            varied[k, j] = np.sum(np.var(problem.on(other).residuals(), axis=0))
    return [int(j) for j in scipy.optimize.linear_sum_assignment(varied)[1]]


def _misfit(problem: CalibrationProblem, m: Measurements, read: dict[str, np.ndarray]) -> float:
    """Root mean square [m] of the links' errors after the fit; infinite if the fit fails."""
    try:
        other = problem.on(replace(m, values={**m.values, **read}))
        free = bool(other.unknowns.names)
        r = calibrate(other, confidence=False, limit=STEPS).residuals if free else other.residuals()
    except ModelError:
        return np.inf
    rms = float(np.sqrt(np.mean(r**2)))
    return rms if np.isfinite(rms) else np.inf


MOST = 150  # number of poses checked: enough to distinguish a metre from a millimetre
REACHED = 0.5  # share of the poses that the model must reach for a comparison
MISFIT = 2e-4  # of the robot's size: above these length errors, other orders of the columns are tried
RIGHT = 5e-3  # of the robot's size: if the declared order has no solution, another order with smaller errors is right
TRIALS = 25  # iterations of a fit with other columns
TURNED = 0.2  # rad: orientations nearer to the model's are read right


@dataclass(frozen=True, eq=False)
class Witness:
    """Forward kinematics of the robot's model before calibration; None if it has none."""

    forward: CausalFunction | None
    size: float

    def positions(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (n, 3), in the plane (n, 2), and quaternions (n, 4 or 0) of the reached rows (n,)."""
        assert self.forward is not None
        T, *e, status = self.forward(q)
        good = np.flatnonzero(np.asarray(status) == 0)
        if not e:
            return T[good], np.zeros((len(good), 0)), good
        rotations = e[0][good]
        return T[good], quaternions(rotations.reshape(-1, 9), MATRIX) if rotations.ndim == 3 else rotations, good


def witness_of(model: Model, data: SplitPoses) -> Witness:
    """Compile the forward kinematics for the measured signals."""
    pose = data.pose
    flat = flat_of(model)
    lengths = [abs(p.value) for p in flat.parameters if p.unit == "m" and np.isfinite(p.value)]
    size = max(lengths, default=1.0)
    if not data.whole:
        return Witness(None, size)
    turn = pose.orientation if pose.orientation in flat.groups else "R"
    measured = ((pose.position, pose.position), (pose.orientation, turn))
    targets = [variable for n, variable in measured if n is not None and variable is not None and n in data.all.values]
    try:
        forward = compile_causal(model, known=[data.actuators], targets=targets)
    except ModelError:
        forward = None
    # only a three-dimensional model can locate a device frame
    if forward is not None and forward.outputs[0].shape not in (((3,),) if pose.device else ((2,), (3,))):
        forward = None
    return Witness(forward, size)


def recognise(data: SplitPoses, witness: Witness, inspection: Inspection) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the frame of the device (t, quaternion) from alignment with the model; None without forward kinematics.

    Raises ArgumentError for wrong units, exchanged columns or swapped axes, in one sentence with numbers, unless the
    alarm is accepted.
    """
    pose = data.pose
    at_actuators, at_position = (f"poses.values.{n}" for n in (data.actuators, pose.position))
    _units(data, witness.size, inspection)
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
    before, beyond = misfit(predicted, e, good), degrees_of_freedom(len(T), T.shape[1], pose.device)

    def misfit_of(r: OtherReading) -> float:
        if not r.order:
            return misfit(*witness.positions(T), q)
        if r.signal:
            return misfit(predicted, e, good, r(T))
        return misfit(*witness.positions(r(q)))

    def other(readings: Sequence[OtherReading]) -> Suspicion | None:
        """The best other reading if poses are not near the model's; unreachable ones count as the robot's size."""
        if not readings or before <= CLOSE * witness.size:
            return None
        best = compared(min(before, witness.size), readings, misfit_of, beyond, nearer=NEARER)
        misfit_text = f"measured and predicted poses differ by {length(before)} rms as declared, and by"
        return best.suspicion(misfit_text, length(best.left))

    signals = [OtherReading("exchanged_signals", f"'{data.actuators}' and '{pose.position}' look exchanged",
                       "if their columns are exchanged")]  # fmt: skip
    inspection.refuse(other(signals if q.shape == T.shape else []), at_actuators)
    inspection.refuse(stuck_columns(names, data.q, before, witness.size), at_actuators)
    if len(good) >= REACHED * len(q) and len(good) > 3:
        inspection.refuse(other_scale(pose.position, T[good], predicted), at_position)
        inspection.refuse(_upright(data, rows[good], e), f"poses.values.{pose.orientation}")
    readings = [*exchanges(names, groups), *reversals(names, [*groups, range(len(names))])]
    reached = len(good) >= max(4, REACHED * len(q))
    if reached:
        k = T.shape[1]
        readings += [mirrored(pose.position, k)] if pose.device else axes(pose.position, k)
    suspicion = other(readings)
    swapped = suspicion is not None and suspicion.name == "swapped_axes"
    inspection.refuse(suspicion, at_position if swapped else at_actuators)
    if not reached:
        if len(q) < 4:
            raise ArgumentError(f"found {len(q)} poses; expected at least 4, preferably several tens", at_actuators)
        message = (
            f"the robot's model reaches {len(good)} of {len(q)} poses with these actuators; check their units, order "
            "and zero points, or the robot's parameters"
        )
        inspection.refuse(Suspicion("out_of_reach", message), at_actuators)
        return None
    if pose.device:
        t, R, _ = aligned(T[good], predicted)
        return t, quaternion_of(R)
    return None


def recognise_sessions(
    data: SplitPoses, witness: Witness, inspection: Inspection
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Apply recognise() per session if the device moved between sessions; a frame common to all has the key "".

    Empty without a device frame."""
    m, frames = data.all, {}
    for s in m.session_names if data.pose.device_per_session else ("",):
        rows = np.ones(len(m), bool) if m.sessions is None or not s else np.array([x == s for x in m.sessions])
        frame = recognise(
            replace(data, all=m.part(rows), lines=data.lines[rows], held_out=data.held_out[rows]), witness, inspection
        )
        if frame is not None:
            frames[s] = frame
    return frames


def a_priori(
    data: SplitPoses, witness: Witness, frames: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> Prediction | None:
    """Errors of the nominal robot at all poses, in its frame; NaN if out of reach, None without forward kinematics."""
    if witness.forward is None:
        return None
    q, T = data.q, data.T
    sessions = np.array(data.all.sessions if data.all.sessions is not None else [""] * len(T))
    T = np.array(T)
    for s, (t, u) in frames.items():
        rows = sessions == s if s else np.ones(len(T), bool)
        T[rows] = t + scipy.spatial.transform.Rotation.from_quat(u, scalar_first=True).apply(T[rows])
    predicted, _, good = witness.positions(q)
    errors = np.full(T.shape, np.nan)
    errors[good] = predicted - T[good]
    return Prediction(errors) if len(good) else None


def misread_by_lengths(data: SplitPoses, prepared: CalibrationProblem, witness: Witness) -> Suspicion | None:
    """Another interpretation of the columns, compared by the nominal lengths, for robots without forward kinematics."""
    if witness.forward is not None or prepared.implicit:
        return None
    alone = _alone(prepared)
    if _rms(alone.residuals()) <= CLOSE * witness.size and not data.pose.device:
        return None
    axes_of = "" if data.pose.device or data.pose.target else data.position
    return misread_columns(alone, [data.position], _columns(data)[0], axes_of)


def misread_after(data: SplitPoses, prepared: CalibrationProblem, c: Calibration, witness: Witness) -> Suspicion | None:
    """After a fit: look for another reading of the columns.

    For robots without forward kinematics, the test uses the nominal lengths, which no fit has adapted to the data. If a
    fit leaves length errors, fits with other orders of the actuators' columns are compared by their residuals. None if
    the errors are small for the robot's size or as large as the stated noise, and if chance may explain the difference
    because few degrees of freedom are left.
    """
    names, groups = _columns(data)
    misread = misread_by_lengths(data, prepared, witness)
    if misread is not None:
        return misread
    declared = _rms(c.residuals)
    if declared <= MISFIT * witness.size:
        return None
    if c.estimate is not None and c.estimate.known_noise and over_noise(c.estimate).passed:
        return None
    if witness.forward is not None and (data.pose.device or data.pose.target):
        misread = misread_columns(_alone(prepared), columns=names)
        if misread is not None:
            return misread
    m = data.fitted
    q = np.asarray(m.values[data.actuators])

    def misfit_of(r: OtherReading) -> float:
        other = replace(m, values={**m.values, data.actuators: r(q)})
        try:
            return _rms(calibrate(prepared.on(other), cost="length", limit=TRIALS, confidence=False).residuals)
        except (ModelError, ValueError):
            return np.inf

    readings = exchanges(names, groups)
    if not readings:
        return None
    best = compared(declared, readings, misfit_of, c.residuals.size - len(c.x), nearer=NEARER)
    # a fit that did not converge may have had a bad start: another order must then be right, not only nearer
    if not (c.status.ok or best.left <= RIGHT * witness.size):
        return None
    before = f"{length(declared)} rms" if np.isfinite(declared) else "no solution"
    return best.suspicion(f"links are left with {before} as declared, and with", f"{length(best.left)} rms")


def _alone(prepared: CalibrationProblem) -> CalibrationProblem:
    """The problem with only frames and offsets free, so that no link can adapt to another's column."""
    return prepare(prepared.closure.flat, prepared.measurements, Choice(free=[]), actuators=prepared.actuators)


def _rms(residuals: np.ndarray) -> float:
    rms = float(np.sqrt(np.mean(residuals**2)))
    return rms if np.isfinite(rms) else np.inf


def _units(data: SplitPoses, size: float, inspection: Inspection) -> None:
    scaled = {c.signal for c in data.all.corrections if c.scale}
    for name, columns in data.columns.items():
        if name == data.pose.orientation or name in scaled or "(" in name:
            continue
        rows, units = np.asarray(data.all.values[name]), columns.units
        si = [parse_unit(u).si_text for u in units]
        lengths, angles = ([k for k, u in enumerate(si) if u == unit] for unit in ("m", "rad"))
        whole = name in (data.actuators, data.pose.position)
        if lengths and (whole or np.ptp(rows[:, lengths]) > size):  # heights of a level bed hardly vary
            inspection.refuse(other_unit(name, rows[:, lengths], size, units[lengths[0]]), f"poses.values.{name}")
        if angles:
            inspection.refuse(too_many_turns(name, rows[:, angles], units[angles[0]]), f"poses.values.{name}")


def _columns(data: SplitPoses) -> tuple[list[str], list[list[int]]]:
    """Names of the actuators' columns, and their indices grouped by unit."""
    names, units = data.columns[data.actuators].names, data.columns[data.actuators].units
    return list(names), [[k for k, unit in enumerate(units) if unit == u] for u in dict.fromkeys(units)]


def _upright(data: SplitPoses, rows: np.ndarray, predicted: np.ndarray) -> Suspicion | None:
    """Check for quaternions with the scalar last."""
    pose = data.pose
    if pose.orientation is None or pose.device or pose.target or not predicted.shape[1]:
        return None
    e = np.asarray(data.all.values[pose.orientation])[rows]

    def turned(rows: np.ndarray) -> float:
        return float(np.sqrt(np.mean(angle_between(rows, predicted) ** 2)))

    misfit = turned(e)
    if misfit <= TURNED:
        return None
    best = compared(misfit, [scalar_last(pose.orientation)], lambda r: turned(r(e)), 3 * len(e), nearer=NEARER)
    misfit_text = f"measured and predicted orientations differ by {np.degrees(misfit):.3g} deg rms as declared, and by"
    return best.suspicion(misfit_text, f"{np.degrees(best.left):.3g} deg")
