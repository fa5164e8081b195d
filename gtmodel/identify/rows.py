"""From logs to rows of a regressor: zero-phase filters, ends cut, rows near standstill dropped."""

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
from gtmodel.measurements.log import recordings_of
from gtmodel.results import Status, Trajectory, TrajectoryError
from gtmodel.results.interpolation import smooth
from gtmodel.results.suspicion import alarms

from .options import Processing
from .regressor import Regressor

Array = np.ndarray

# periods of the cut-off after which filtered white noise is uncorrelated (first zero, for any sampling)
INDEPENDENT = 0.57
# cut-off of the prefilter over that of the filter: the prefilter takes 1.5e-5 off signals at the filter's cut-off,
# so that the sign of a velocity stays as sharp as the filter allows
WIDER = 4.0
NOISE_STEPS = 4 / 3  # three such steps are four standard deviations of the velocity
# three-point differences of a 2.5 Hz motion at 4 ms are 7e-4 off, as much as the noise of the masses; these are 5e-7
# off
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12
HALF = 2


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows for a fit: efforts (n, m) and their model Y p + y0 with Y (n, m, p) and y0 (n, m), filtered alike.

    The parameters have `names`, `nominal` values (p,) and `units`, the efforts `targets` (m,) and `effort_unit`. Each
    row has a `time` (n,) [s], `position` and `velocity` (n, k), and the rates `effort_rate` (n, m) of the efforts,
    filtered alike; a delay adds a multiple of these. Recordings, and stretches between their gaps, begin at the rows
    `starts`; `too_short` stretches have no rows. `recording` (n,) numbers the recording of each row. The filter
    has the cut-off `cutoff_Hz`; only every `every`-th sample is used, so that rows are `interval` [s] apart; the share
    `dropped` of the samples is slower than `threshold` [`velocity_unit`]. `synthetic` is the note of a synthetic log.
    Parameters in `signed` may be negative even if masses and friction may not. `target_units` (m,) are the units of the
    efforts of an arm with revolute and prismatic joints; otherwise it is empty.
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
    too_short: int = 0
    recording: Array | None = None

    @property
    def units_of_targets(self) -> tuple[str, ...]:
        """Unit of each target."""
        return self.target_units or (self.effort_unit,) * len(self.targets)

    @property
    def common_unit(self) -> str:
        """Unit of all targets in a plot; "SI" if their units differ."""
        return "SI" if self.target_units else self.effort_unit

    def __len__(self) -> int:
        return len(self.time)

    def columns(self, at: Sequence[int], size: Array) -> Array:
        """Columns (n, m, k) of some parameters, each target divided by its size (m,)."""
        return self.Y[:, :, at] / size[:, None]

    def part(self, k: int) -> Rows:
        """The rows of recording `k`, counted from 0."""
        ends = [*self.starts, len(self)]
        return self.chosen(np.arange(ends[k], ends[k + 1]))

    def chosen(self, kept: Array) -> Rows:
        """The rows at these indices, in order; `starts` is adapted."""
        starts = np.unique(np.searchsorted(kept, self.starts))
        arrays = ("Y", "y0", "effort", "time", "position", "velocity", "effort_rate", "recording")
        selected = {n: v[kept] for n in arrays if (v := getattr(self, n)) is not None}
        return replace(self, starts=tuple(int(k) for k in starts if k < len(kept)), **selected)

    @property
    def filter_sentence(self) -> str:
        """Filter and selection of rows, as a sentence for tables."""
        rows = "every row" if self.every == 1 else f"one row in {self.every}"
        count = "one stretch" if self.too_short == 1 else f"{self.too_short} stretches"
        short = f"; {count} between gaps, too short for the filter, not used" if self.too_short else ""
        return (
            f"zero-phase Butterworth low pass at {self.cutoff_Hz:.3g} Hz on efforts and regressor alike, "
            f"five-point differences, {rows}; {100 * self.dropped:.2g} % of the samples dropped near "
            f"standstill, slower than {self.threshold:.2g} {self.velocity_unit}{short}"
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
    """Return the rows of one or several recordings of a plant.

    Position and efforts pass the same wide zero-phase filter, at four times the cut-off; it is omitted if the sampling
    is too slow for it. The regressor is evaluated at that position and its five-point differences. Then one narrow
    filter is applied to its columns and to the efforts. Both sides are thus filtered equally, and the narrow filter
    does not shift the sign of a velocity. The ends that the filters disturb are cut, and so are rows near standstill,
    where friction does not follow its law.

    Args:
        sessions: recordings, evenly sampled, with position, efforts and the other known variables of the regressor in
            the units of the model. The other variables pass the filter of the position.
        regressor: of the parameters to fit.
        processing: filter and selection of rows.
        known, targets: names of the measured position and efforts in the model.
        accept: "copied_rows" accepts recordings that contain a block twice.

    Raises ModelError if the regressor has no value (naming the time) or if all rows are too slow; TrajectoryError if a
    recording is too short for the filter, or contains a copy of its own or another recording's rows.

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
    ((64, 1, 3), (64, 1), 5.5, 26)
    """
    sessions = [sessions] if isinstance(sessions, Session) else list(sessions)
    for suspicion in alarms(tested(recorded(sessions, (known, targets)))):
        if suspicion.name not in accept:
            raise TrajectoryError(suspicion.refusal)
    sessions = [s._replace(trajectory=smooth(s.trajectory)) for s in sessions]
    processing = processing or Processing()
    cutoff = processing.cutoff
    if cutoff is None:
        cutoff = cutoff_of(sessions, known)
    low_pass = ZeroPhase(cutoff, processing.order)
    every = processing.every or max(1, round(INDEPENDENT / (cutoff * sessions[0].sample_time)))
    recordings = recordings_of(sessions)
    long = [len(s.trajectory) > 2 * sum(_margins(low_pass, s.sample_time)[:2]) for s in sessions]
    used = {number for number, enough in zip(recordings, long, strict=True) if enough}
    # a stretch between gaps may be too short, a whole recording not
    kept = [enough or number not in used for number, enough in zip(recordings, long, strict=True)]
    parts = [_rows(s, regressor, low_pass, every, processing, known, targets)
             for s, keep in zip(sessions, kept, strict=True) if keep]  # fmt: skip
    joined: dict[str, Any] = {k: np.concatenate([p[k] for p in parts]) for k in parts[0] if parts[0][k].ndim}
    counts = iter([len(p["time"]) for p in parts])
    lengths = [next(counts) if keep else 0 for keep in kept]
    threshold, unit = float(max(p["threshold"] for p in parts)), rate_unit(sessions[0].trajectory.unit(known))
    if not sum(lengths):
        raise ModelError(
            f"the log is at or near standstill all the time: '{known}' never moves faster than {threshold:.3g} "
            f"{unit} in all axes, {processing.mask_steps:g} position steps per sample; move faster, or lower mask_steps"
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
        too_short=kept.count(False),
        recording=np.repeat(recordings, lengths),
        **joined,
    )


def cutoff_of(sessions: Sequence[Session], known: str) -> float:
    """Return the cut-off [Hz] for some sessions, from the longest stretch of each recording."""
    longest = dict[int, Session]()
    for number, s in zip(recordings_of(sessions), sessions, strict=True):
        longest[number] = max(longest.get(number, s), s, key=lambda s: len(s.trajectory))
    return max(cutoff_for(s.trajectory[known], s.sample_time) for s in longest.values())


def recorded(sessions: Sequence[Session], signals: Sequence[str]) -> Data:
    """These signals of the recordings, the efforts last; positions may have been shifted by a constant."""
    if len({tuple(s.trajectory[n].shape[1:] for n in signals) for s in sessions}) > 1:
        return Data()  # the regressor reports wrong widths
    columns = {n: np.concatenate([s.trajectory[n] for s in sessions]) for n in signals}
    return Data(columns, signals[-1:], recordings=[(s.name, s.trajectory.time) for s in sessions])


def with_offsets(rows: Rows, signal: str, *, per_session: bool = True, drift: bool = False) -> Rows:
    """Return the rows with offsets of the measured efforts as further parameters, by recording or one for all.

    Without `drift` each stretch between gaps has its own, because offsets drift; a stretch without rows has none. With
    `drift` each recording has one, and a linear drift [effort/s] about its middle, such as "tau.drift[0]".

    They are named as by `Corrections`, such as "tau.offset[0] of session 2", and may be negative. An offset is the
    reading at zero effort. Free offsets widen the intervals of the other parameters.

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
    part = np.searchsorted(rows.starts, np.arange(n), side="right") - 1
    if drift and rows.recording is not None:
        part = rows.recording
    numbers, counts = np.unique(part, return_counts=True)
    labels = [f" of session {k + 1}" for k in numbers] if part[-1] else [""]

    def named(what: str, labels: Sequence[str]) -> list[str]:
        return [f"{signal}.{what}{f'[{i}]' if m > 1 else ''}{label}" for label in labels for i in range(m)]

    names = named("offset", labels if per_session else [""])
    sizes = counts.tolist()
    columns = offset_columns(sizes, m, per_session=per_session).reshape(n, m, -1)
    units = rows.units_of_targets * (len(names) // m)
    if drift:
        middle = [0.5 * (t[0] + t[-1]) for t in np.split(rows.time, np.cumsum(counts)[:-1])]
        since = rows.time - np.repeat(middle, counts)
        columns = np.concatenate([columns, offset_columns(sizes, m).reshape(n, m, -1) * since[:, None, None]], axis=2)
        names += named("drift", labels)
        units += tuple(f"{unit}/s" for unit in rows.units_of_targets) * len(counts)
    return replace(
        rows,
        names=(*rows.names, *names),
        nominal=np.concatenate([rows.nominal, np.zeros(len(names))]),
        units=(*rows.units, *units),
        Y=np.concatenate([rows.Y, columns], axis=2),
        signed=(*rows.signed, *names),
    )


def smallest_step(position: Array) -> float:
    """Smallest change between neighbouring samples [unit of the position]: the step of a quantised signal."""
    steps = np.abs(np.diff(position.reshape(len(position), -1), axis=0))
    return float(np.min(steps[steps > 1e-12 * np.max(steps, initial=0.0)], initial=np.inf))


def _noise_step(position: Array, low_pass: ZeroPhase | None, step: float) -> float:
    """Standard deviation of the velocity noise per sample: the position noise behind the filter."""
    kernel = np.ones(1) if low_pass is None else low_pass.kernel(step)
    rate, _ = velocity_and_acceleration(np.pad(kernel, 2 * HALF), 1.0)
    return position_noise(position) * float(np.linalg.norm(rate))


def _margins(low_pass: ZeroPhase, step: float) -> tuple[int, int, ZeroPhase | None]:
    """Rows that the filter and what precedes it cut off either end; the prefilter, None if sampling is too slow."""
    wide = ZeroPhase(WIDER * low_pass.cutoff_Hz, low_pass.order)
    if wide.cutoff_Hz >= WIDEST / step:
        return low_pass.end_rows(step), HALF, None
    return low_pass.end_rows(step), HALF + wide.end_rows(step), wide


def _rows(
    session: Session, regressor: Regressor, low_pass: ZeroPhase, every: int, how: Processing, known: str, targets: str
) -> dict[str, Array]:
    raw, step = session.trajectory, session.sample_time
    (cut, lead, wide), reach = _margins(low_pass, step), int(np.ceil(1 / (low_pass.cutoff_Hz * step)))
    if len(raw) <= 2 * (cut + lead):
        raise TrajectoryError(
            f"'{session.name}' lasts {raw.duration:g} s; the filter cuts {(cut + lead) * step:g} s off either end. "
            "Record more than twice that, or raise the cut-off"
        )
    position, effort = (raw[name] if wide is None else wide(raw[name], step) for name in (known, targets))
    quantum = how.position_step
    if quantum is None:
        quantum = max(smallest_step(raw[known]), NOISE_STEPS * _noise_step(raw[known], wide, step))
    rate, acceleration = velocity_and_acceleration(position, step)
    inside = slice(lead, len(raw) - lead)
    effort_rate, _ = velocity_and_acceleration(effort, step)
    time, position, effort, effort_rate = raw.time[inside], position[inside], effort[inside], effort_rate[inside]
    signals = {known: position, f"der({known})": rate[inside], f"der({known},2)": acceleration[inside]}
    signals |= {name: x[inside] for name, x in _further(raw, regressor, signals, wide, step)}
    values = regressor(*[signals[s.name] for s in regressor.inputs])
    bad = np.flatnonzero(values.status != Status.OK)
    if bad.size:
        raise ModelError(
            f"{session.name} at {time[bad[0]]:g} s: {Status(int(values.status[bad[0]])).message}; "
            "check the unit and the sign of the measured position"
        )
    n, m, p = values.Y.shape
    velocity = signals[f"der({known})"].reshape(n, -1)
    fast = moving(velocity, step, quantum if np.isfinite(quantum) else 0.0, how.mask_steps)
    # slower for longer than a period of the cut-off: at standstill, not reversing
    still = np.asarray(
        scipy.ndimage.binary_dilation(scipy.ndimage.binary_opening(~fast.rows, np.ones(reach)), iterations=reach),
        dtype=bool,
    )
    rows = np.arange(cut, n - cut, every)
    valid = (fast.rows & ~still)[rows]
    columns = values.Y.reshape(n, m * p)
    used = np.any(columns != 0, axis=0)  # a cart's friction enters one effort of three
    together = np.concatenate([columns[:, used], values.y0, effort.reshape(n, m), effort_rate.reshape(n, m)], axis=1)
    filtered, y0, efforts, rates = np.split(low_pass.every(together, step, every)[valid], [-3 * m, -2 * m, -m], axis=1)
    Y = np.zeros((len(filtered), m * p))
    Y[:, used] = filtered
    chosen = rows[valid]
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
    raw: Trajectory, regressor: Regressor, known: Mapping[str, Array], low_pass: ZeroPhase | None, step: float
) -> Iterator[tuple[str, Array]]:
    """Other inputs of the regressor from the same log: values and up to two rates."""
    for signal in regressor.inputs:
        if signal.name in known:
            continue
        name, _, order = signal.name.removeprefix("der(").removesuffix(")").partition(",")
        values = raw[name].reshape(len(raw), *signal.shape)
        values = values if low_pass is None else low_pass.linear(values, step)
        rates = velocity_and_acceleration(values, step)
        yield signal.name, values if signal.name == name else rates[int(order or 1) - 1]


def velocity_and_acceleration(position: Array, sample_time: float) -> tuple[Array, Array]:
    """Velocity and acceleration of rows (n, ...) by five-point central differences of fourth order.

    The two rows at either end repeat their neighbours; cut them.
    """
    rate, acceleration = (_correlated(position, w) for w in (FIRST, SECOND))
    return rate / sample_time, acceleration / sample_time**2


def _correlated(position: Array, weights: Array) -> Array:
    n = len(position)
    terms = [w * position[k : n - 2 * HALF + k] for k, w in enumerate(weights)]
    inner = np.sum(terms, axis=0)
    return np.concatenate([inner[:1]] * HALF + [inner] + [inner[-1:]] * HALF)
