"""From logs to rows of a regressor: one zero-phase filter on forces and regressor, ends cut, standstill left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from gtmodel.lang import ModelError
from gtmodel.lang.units import rate_unit
from gtmodel.measurements import (
    Session,
    ZeroPhase,
    cutoff_for,
    moving,
    offset_columns,
    position_noise,
)
from gtmodel.measurements.filters import WIDEST
from gtmodel.measurements.inspection.data_tests import Data, tested
from gtmodel.results import Status, Trajectory, TrajectoryError
from gtmodel.results.interpolation import smooth
from gtmodel.results.suspicion import alarms

from .options import Processing
from .regressor import Regressor

Array = np.ndarray

# of the cut-off's period: there white noise behind the filter has lost its correlation (first zero, at any sampling)
INDEPENDENT = 0.57
# cut-off of the prefilter over that of the filter: at a quarter of its cut-off it takes 1.5e-5, so that the sign of a
# velocity behind it is as sharp as the filter allows
WIDER = 4.0
NOISE_STEPS = 4 / 3  # three such steps are four standard deviations of the velocity
# three-point differences of a 2.5 Hz motion at 4 ms are 7e-4 off, as much as the noise of the masses; these 5e-7
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12
HALF = 2


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows for a fit: efforts (n, m) beside Y p + y0 with Y (n, m, p) and y0 (n, m), filtered alike.

    Of the parameters there are `names`, `nominal` (p,) and `units`, of the efforts `targets` (m,) and `effort_unit`; of
    each row `time` (n,) [s], `position` and `velocity` (n, k) and the efforts' rates `effort_rate` (n, m), filtered
    alike, of which a delay adds a share. `starts` are the rows where recordings begin. The processing had the cut-off
    `cutoff_Hz`, took `every` how many-th sample, with the `interval` [s] between rows, and left out the share `dropped`
    of the samples, those slower than `threshold` [`velocity_unit`]. `synthetic` is the log's own note; `signed` are
    names that may be negative although masses and friction may not. `target_units` (m,) are those of an arm with joints
    of both kinds, where the efforts have no common one; else empty.
    """

    names: tuple[str, ...]
    nominal: Array
    units: tuple[str, ...]
    targets: tuple[str, ...]
    effort_unit: str
    Y: Array
    y0: Array
    effort: Array
    time: Array
    position: Array
    velocity: Array
    starts: tuple[int, ...]
    cutoff_Hz: float
    every: int
    interval: float
    dropped: float
    threshold: float
    synthetic: str | None
    signed: tuple[str, ...] = ()
    velocity_unit: str = "m/s"
    effort_rate: Array | None = None
    target_units: tuple[str, ...] = ()

    @property
    def units_of_targets(self) -> tuple[str, ...]:
        """Unit of each target."""
        return self.target_units or (self.effort_unit,) * len(self.targets)

    @property
    def common_unit(self) -> str:
        """Of all targets in a picture; "SI" where each has its own."""
        return "SI" if self.target_units else self.effort_unit

    def __len__(self) -> int:
        return len(self.time)

    def columns(self, at: Sequence[int], size: Array) -> Array:
        """Columns (n, m, k) of some parameters, each target over its size (m,)."""
        return self.Y[:, :, at] / size[:, None]

    def part(self, k: int) -> Rows:
        """The rows of recording k, from 0, alone."""
        ends = [*self.starts, len(self)]
        return self.chosen(np.arange(ends[k], ends[k + 1]))

    def chosen(self, kept: Array) -> Rows:
        """Some of the rows by their places, in order; recordings begin where they did, as far as they are there."""
        starts = np.unique(np.searchsorted(kept, self.starts))
        arrays = ("Y", "y0", "effort", "time", "position", "velocity", "effort_rate")
        of_rows = {n: v[kept] for n in arrays if (v := getattr(self, n)) is not None}
        return replace(self, starts=tuple(int(k) for k in starts if k < len(kept)), **of_rows)

    @property
    def filter_sentence(self) -> str:
        """What was done, for tables."""
        return (
            f"zero-phase Butterworth low pass at {self.cutoff_Hz:.3g} Hz on efforts and regressor alike, "
            f"five-point differences, every {self.every}. row; {100 * self.dropped:.2g} % of the samples left out near "
            f"standstill, slower than {self.threshold:.2g} {self.velocity_unit}"
        )


def rows_of(
    sessions: Session | Sequence[Session],
    regressor: Regressor,
    processing: Processing | None = None,
    known: str = "q",
    targets: str = "tau",
    *,
    accept: Sequence[str] = (),
) -> Rows:
    """Rows of one or several recordings of one plant.

    Position and efforts pass the same wide zero-phase filter (four times the cut-off; none where the sampling cannot
    carry it), the regressor is evaluated on that position and its five-point differences, and its columns and the
    efforts are low-passed by the same filter: what stands on both sides was filtered equally often, and the sign of a
    velocity was not shifted by the narrow one. The ends that the filters disturb are cut, and so are rows beside a
    standstill, where friction does not follow its law.

    Args:
        sessions: recordings, evenly sampled, with position and efforts in the units of the model, and whatever else
            the regressor takes as known: it passes the filter of the position.
        regressor: of the parameters to be fitted.
        processing: filter and selection of rows.
        known, targets: the measured position and efforts, by the model's names.
        accept: "copied_rows" takes recordings that hold a stretch twice.

    Raises ModelError where the regressor has no value (naming the time) or all rows are too slow; TrajectoryError where
    a recording is too short for the filter, or holds a copy of what another or itself has held before.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> rows = gt.identify.rows_of(gt.measurements.session_of(log), regressor)
    >>> rows.Y.shape, rows.effort.shape, round(rows.cutoff_Hz, 1), rows.every  # independent rows only
    ((58, 1, 3), (58, 1), 5.0, 28)
    """
    sessions = [sessions] if isinstance(sessions, Session) else list(sessions)
    for suspicion in alarms(tested(recorded(sessions, (known, targets)))):
        if suspicion.name not in accept:
            raise TrajectoryError(suspicion.refusal)
    sessions = [s._replace(trajectory=smooth(s.trajectory)) for s in sessions]
    processing = processing or Processing()
    cutoff = processing.cutoff
    if cutoff is None:
        cutoff = max(cutoff_for(s.trajectory[known], s.sample_time) for s in sessions)
    low_pass = ZeroPhase(cutoff, processing.order)
    every = processing.every or max(1, round(INDEPENDENT / (cutoff * sessions[0].sample_time)))
    parts = [_rows(s, regressor, low_pass, every, processing, known, targets) for s in sessions]
    joined: dict[str, Any] = {k: np.concatenate([p[k] for p in parts]) for k in parts[0] if parts[0][k].ndim}
    lengths = [len(p["time"]) for p in parts]
    threshold, unit = float(max(p["threshold"] for p in parts)), rate_unit(sessions[0].trajectory.unit(known))
    if not sum(lengths):
        raise ModelError(
            f"the log stands still, or nearly so, all the time: never are all of '{known}' faster than {threshold:.3g} "
            f"{unit}, {processing.mask_steps:g} steps of the position per sample; move faster, or lower mask_steps"
        )
    notes = list(dict.fromkeys(s.trajectory.synthetic for s in sessions if s.trajectory.synthetic))
    first = sessions[0]
    return Rows(
        regressor.names,
        regressor.nominal,
        regressor.units,
        regressor.columns,
        first.trajectory.unit(targets),
        starts=tuple(int(k) for k in np.cumsum([0, *lengths[:-1]])),
        cutoff_Hz=cutoff,
        every=every,
        interval=every * first.sample_time,
        dropped=float(np.mean([p["dropped"] for p in parts])),
        threshold=threshold,
        synthetic="; ".join(notes) or None,
        velocity_unit=unit,
        target_units=regressor.column_units,
        **joined,
    )


def recorded(sessions: Sequence[Session], signals: Sequence[str]) -> Data:
    """These signals of the recordings, the last of them the efforts: positions may have been moved by a constant."""
    if len({tuple(s.trajectory[n].shape[1:] for n in signals) for s in sessions}) > 1:
        return Data()  # what evaluates them says what is wrong with their widths
    columns = {n: np.concatenate([s.trajectory[n] for s in sessions]) for n in signals}
    return Data(columns, signals[-1:], recordings=[(s.name, s.trajectory.time) for s in sessions])


def with_offsets(rows: Rows, signal: str, *, per_session: bool = True) -> Rows:
    """The rows with offsets of the measured efforts as further parameters, each recording's own or one for all.

    They are named as by `Corrections`, "tau.offset[0] of session 2", and may be negative. An offset is what the reading
    shows when the effort is zero. How well the motion determines them is in their intervals, and what they cost is in
    the intervals of the others.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> rows = gt.identify.rows_of(gt.measurements.session_of(log), regressor)
    >>> gt.identify.identify(gt.identify.with_offsets(rows, "tau")).estimate.names
    ('m', 'd', 'c', 'tau.offset')
    """
    n, m = rows.effort.shape
    lengths = np.diff([*rows.starts, n])
    count = len(lengths) if per_session else 1
    names = [
        f"{signal}.offset{f'[{i}]' if m > 1 else ''}{f' of session {k + 1}' if count > 1 else ''}"
        for k in range(count)
        for i in range(m)
    ]
    columns = offset_columns(lengths.tolist(), m, per_session=per_session).reshape(n, m, len(names))
    return replace(
        rows,
        names=(*rows.names, *names),
        nominal=np.concatenate([rows.nominal, np.zeros(len(names))]),
        units=(*rows.units, *rows.units_of_targets * count),
        Y=np.concatenate([rows.Y, columns], axis=2),
        signed=(*rows.signed, *names),
    )


def smallest_step(position: Array) -> float:
    """Smallest change between two neighbouring samples [unit of the position]: the step of a quantised one."""
    steps = np.abs(np.diff(position.reshape(len(position), -1), axis=0))
    return float(np.min(steps[steps > 1e-12 * np.max(steps, initial=0.0)], initial=np.inf))


def _noise_step(position: Array, low_pass: ZeroPhase | None, step: float) -> float:
    """Standard deviation of the velocity's noise per sample: what that of the position leaves behind the filter."""
    kernel = np.ones(1) if low_pass is None else low_pass.kernel(step)
    rate, _ = velocity_and_acceleration(np.pad(kernel, 2 * HALF), 1.0)
    return position_noise(position) * float(np.linalg.norm(rate))


def _rows(
    session: Session, regressor: Regressor, low_pass: ZeroPhase, every: int, how: Processing, known: str, targets: str
) -> dict[str, Array]:
    raw, step = session.trajectory, session.sample_time
    cut, lead, reach = low_pass.end_rows(step), HALF, int(np.ceil(1 / (low_pass.cutoff_Hz * step)))
    wide = ZeroPhase(WIDER * low_pass.cutoff_Hz, low_pass.order)
    prefiltered = wide.cutoff_Hz < WIDEST / step
    lead += wide.end_rows(step) if prefiltered else 0
    if len(raw) <= 2 * (cut + lead):
        raise TrajectoryError(
            f"'{session.name}' lasts {raw.duration:g} s; expected more than twice the {(cut + lead) * step:g} s that "
            "the filter cuts off at either end, so record longer or raise the cut-off"
        )
    position, effort = (wide(raw[name], step) if prefiltered else raw[name] for name in (known, targets))
    quantum = how.position_step
    if quantum is None:
        quantum = max(
            smallest_step(raw[known]), NOISE_STEPS * _noise_step(raw[known], wide if prefiltered else None, step)
        )
    rate, acceleration = velocity_and_acceleration(position, step)
    inside = slice(lead, len(raw) - lead)
    effort_rate, _ = velocity_and_acceleration(effort, step)
    time, position, effort, effort_rate = raw.time[inside], position[inside], effort[inside], effort_rate[inside]
    given = {known: position, f"der({known})": rate[inside], f"der({known},2)": acceleration[inside]}
    given |= {name: x[inside] for name, x in _further(raw, regressor, given, wide if prefiltered else None, step)}
    values = regressor(*[given[s.name] for s in regressor.inputs])
    bad = np.flatnonzero(values.status != Status.OK)
    if bad.size:
        raise ModelError(
            f"{session.name} at {time[bad[0]]:g} s: {Status(int(values.status[bad[0]])).message}; "
            "check the unit and the sign of the measured position"
        )
    n, m, p = values.Y.shape
    velocity = given[f"der({known})"].reshape(n, -1)
    fast = moving(velocity, step, quantum if np.isfinite(quantum) else 0.0, how.mask_steps)
    # slower for longer than a period of the cut-off: standing still, not turning round
    still = np.asarray(
        scipy.ndimage.binary_dilation(scipy.ndimage.binary_opening(~fast.rows, np.ones(reach)), iterations=reach),
        dtype=bool,
    )
    rows = np.arange(cut, n - cut, every)
    kept = (fast.rows & ~still)[rows]
    columns = values.Y.reshape(n, m * p)
    used = np.any(columns != 0, axis=0)  # a cart's friction enters one effort of three
    together = np.concatenate([columns[:, used], values.y0, effort.reshape(n, m), effort_rate.reshape(n, m)], axis=1)
    filtered, y0, efforts, rates = np.split(low_pass.every(together, step, every)[kept], [-3 * m, -2 * m, -m], axis=1)
    Y = np.zeros((len(filtered), m * p))
    Y[:, used] = filtered
    chosen = rows[kept]
    return {
        "Y": Y.reshape(-1, m, p),
        "y0": y0,
        "effort": efforts,
        "effort_rate": rates,
        "time": time[chosen],
        "position": position.reshape(n, -1)[chosen],
        "velocity": velocity[chosen],
        "dropped": np.array(1 - len(chosen) / max(1, len(rows))),
        "threshold": np.array(fast.threshold),
    }


def _further(
    raw: Trajectory, regressor: Regressor, given: Mapping[str, Array], low_pass: ZeroPhase | None, step: float
) -> Iterator[tuple[str, Array]]:
    """What a regressor takes besides the position and its rates, from the same log: values and up to two rates."""
    for signal in regressor.inputs:
        if signal.name in given:
            continue
        name, _, order = signal.name.removeprefix("der(").removesuffix(")").partition(",")
        values = raw[name].reshape(len(raw), *signal.shape)
        values = values if low_pass is None else low_pass.linear(values, step)
        rates = velocity_and_acceleration(values, step)
        yield signal.name, values if signal.name == name else rates[int(order or 1) - 1]


def velocity_and_acceleration(position: Array, sample_time: float) -> tuple[Array, Array]:
    """Velocity and acceleration of rows (n, ...) by five-point central differences of fourth order.

    The two rows at either end repeat their neighbours and are to be cut.
    """
    rate, acceleration = (_correlated(position, w) for w in (FIRST, SECOND))
    return rate / sample_time, acceleration / sample_time**2


def _correlated(position: Array, weights: Array) -> Array:
    n = len(position)
    terms = [w * position[k : n - 2 * HALF + k] for k, w in enumerate(weights)]
    inner = np.sum(terms, axis=0)
    return np.concatenate([inner[:1]] * HALF + [inner] + [inner[-1:]] * HALF)
