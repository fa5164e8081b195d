"""Zero-phase low pass, central differences, decimation, and where a velocity is far from zero."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from ..lang.units import rate_unit
from ..results.interpolation import nature_of, natures, rotation_rows, rotations_again, smooth, smooth_rows
from ..results.trajectory import Trajectory
from ..results.trajectory_checks import Array, TrajectoryError
from .log import Session

BAND_FACTOR = 2.5  # cut-off over excitation band; 2 to 3 leaves the motion and takes most of the noise
BAND_SHARE = 0.999  # of the velocity's power
ORDER = 4
FLOOR = (0.25, 0.4)  # of the sampling rate: where the noise of the position is looked for
BEYOND = 10.0  # the sum of n periodogram values of noise scatters by 1/sqrt(n) of itself
DIFFERENCES, MEDIAN = 6, 0.6745  # the median of a normal variable's size over its standard deviation
WIDEST = 0.4  # of the sampling rate: four fifths of half of it
# the slowest pole of the filter decays as exp(-2 pi f_c sin(pi / 8) t) at order four: 1e-3 after 2.9 / f_c
SETTLING_PERIODS = 3.0
SMOOTH = 5  # degree of the spline through the samples: four continuous derivatives, accelerations without corners


@dataclass(frozen=True)
class ZeroPhase:
    """Butterworth low pass, run forth and back: no phase, amplitude |H|^2, which is one half at the cut-off.

    Args:
        cutoff_Hz: of one pass [Hz].
        order: of one pass.

    Called with rows (n,) or (n, k) and their sample time [s] it returns them filtered: rows that are an orientation or
    a direction stay one, and with unit="rad" wrapped angles are unwrapped. `linear` takes all rows as plain numbers.

    >>> low_pass = gt.measurements.ZeroPhase(20.0)
    >>> low_pass.amplitude(np.array([5.0, 20.0, 60.0]), sample_time=0.004).round(3).tolist()
    [1.0, 0.5, 0.0]
    """

    cutoff_Hz: float
    order: int = ORDER

    def __call__(self, rows: Array, sample_time: float, unit: str = "1") -> Array:
        """Filtered rows, (n,) or (n, k), sampled at sample_time [s]; `unit` is their SI unit.

        Quaternions, directions and rotation matrices are recognised by their lengths where the unit is "1", wrapped
        angles where it is "rad". Raises TrajectoryError for a cut-off that the sampling cannot carry, for too few rows,
        and for a turn of more than 90 deg from row to row.
        """
        rows = np.asarray(rows, dtype=float)
        nature = nature_of(rows, unit)
        rows = smooth_rows(sample_time * np.arange(len(rows), dtype=float), rows, nature, nature or "")
        return rotation_rows(self.linear(rows, sample_time), nature)

    def linear(self, rows: Array, sample_time: float) -> Array:
        """Filtered rows (n, ...) of plain numbers, each by itself. Raises as the call does."""
        rows = np.asarray(rows, dtype=float)
        need = 3 * (2 * math.ceil(self.order / 2) + 1)
        if len(rows) <= need:
            raise TrajectoryError(f"there are {len(rows)} rows to filter; expected more than {need}")
        return np.asarray(scipy.signal.sosfiltfilt(self._sections(sample_time), rows, axis=0))

    def amplitude(self, frequency_Hz: float | Array, sample_time: float) -> Array:
        """By how much a sine of that frequency comes out smaller (both passes)."""
        turn = 2 * np.pi * np.atleast_1d(frequency_Hz) * sample_time
        _, response = scipy.signal.sosfreqz(self._sections(sample_time), worN=turn)
        return np.square(np.abs(np.asarray(response)), dtype=float)

    def end_rows(self, sample_time: float) -> int:
        """Rows at either end that the ends of the record disturb: three periods of the cut-off."""
        return math.ceil(SETTLING_PERIODS / (self.cutoff_Hz * sample_time))

    def kernel(self, sample_time: float) -> Array:
        """Its symmetric impulse response (2 end_rows + 1,), cut there and summing to one."""
        reach = self.end_rows(sample_time)
        impulse = np.zeros(6 * reach + 1)
        impulse[3 * reach] = 1.0
        weights = self.linear(impulse, sample_time)[2 * reach : 4 * reach + 1]
        weights = weights + weights[::-1]  # the edges far off leave 1e-8 of a phase
        return weights / weights.sum()

    def every(self, rows: Array, sample_time: float, every: int) -> Array:
        """Weighted means of rows (n, k) by `kernel` at rows end_rows, end_rows + every, ... < n - end_rows only.

        No value is invented beyond the ends, and rows that are not asked for cost nothing.
        """
        weights = self.kernel(sample_time)
        count = -(-(len(rows) - len(weights) + 1) // every)
        if count < 1:
            return np.zeros((0, *rows.shape[1:]))
        first = len(weights) - 1  # of the full convolution without missing rows; upfirdn gives multiples of `every`
        late = -first % every
        filtered = scipy.signal.upfirdn(np.concatenate([np.zeros(late), weights]), rows, 1, every, axis=0)
        begin = (first + late) // every
        return np.asarray(filtered[begin : begin + count])

    def _sections(self, sample_time: float) -> Array:
        half = 0.5 / sample_time
        if not 0 < self.cutoff_Hz < half:
            raise TrajectoryError(
                f"the cut-off is {self.cutoff_Hz:g} Hz; expected between 0 and half the sampling rate, {half:g} Hz"
            )
        return _butterworth(self.order, self.cutoff_Hz, 1 / sample_time)


@lru_cache(maxsize=32)
def _butterworth(order: int, cutoff_Hz: float, rate_Hz: float) -> Array:
    return np.asarray(scipy.signal.butter(order, cutoff_Hz, fs=rate_Hz, output="sos"), dtype=float)


def excitation_band(position: Array, sample_time: float, share: float = BAND_SHARE) -> float:
    """Frequency [Hz] below which the velocity has that share of its power.

    Args:
        position: (n,) or (n, k), evenly sampled.
        sample_time: [s].
        share: of the power of the velocity.

    White noise of the position is left out of the power: its floor is what the upper frequencies show. Raises
    TrajectoryError where nothing moves, or nothing beyond the noise.

    >>> t = 0.004 * np.arange(1000)
    >>> q = np.sin(2 * np.pi * 0.5 * t) + 0.1 * np.sin(2 * np.pi * 3.0 * t)
    >>> gt.measurements.excitation_band(q, 0.004)
    3.0
    """
    velocity = derivative(position, sample_time)
    power = np.abs(np.fft.rfft(velocity - velocity.mean(axis=0), axis=0)) ** 2
    power = power.reshape(len(power), -1).sum(axis=1)
    frequency = np.fft.rfftfreq(len(velocity), sample_time)
    transfer = np.sin(2 * np.pi * frequency * sample_time) ** 2  # of central differences
    upper = (frequency > FLOOR[0] / sample_time) & (frequency < FLOOR[1] / sample_time)
    noise = transfer * (np.median(power[upper] / transfer[upper]) if upper.any() else 0.0)
    total = np.cumsum(power - noise)
    if not np.max(total) > 0:
        raise TrajectoryError("nothing moves, so there is no band of excitation; give the cut-off of the filter")
    if np.max(total) < BEYOND / np.sqrt(len(power)) * noise.sum():
        raise TrajectoryError("nothing moves beyond the noise of the position; give the cut-off of the filter")
    return float(frequency[np.argmax(total >= share * np.max(total))])


def position_noise(position: Array) -> float:
    """Standard deviation of white noise on a smooth motion (n,) or (n, k), in its unit; of columns the largest.

    It comes from sixth differences, in which nothing of a smooth motion is left, by their median, which single events
    do not move. Fewer than seven rows give 0.

    >>> t = 0.004 * np.arange(2000)
    >>> noise = 1e-4 * np.random.default_rng(2).standard_normal(2000)  # synthetic: seed 2
    >>> round(gt.measurements.position_noise(np.sin(3 * t) + noise), 5)
    0.0001
    """
    if len(position) <= DIFFERENCES:
        return 0.0
    left = np.abs(np.diff(np.asarray(position, dtype=float), n=DIFFERENCES, axis=0)).reshape(
        len(position) - DIFFERENCES, -1
    )
    return float(np.max(np.median(left, axis=0))) / (MEDIAN * math.sqrt(math.comb(2 * DIFFERENCES, DIFFERENCES)))


def cutoff_for(position: Array, sample_time: float, factor: float = BAND_FACTOR) -> float:
    """Cut-off [Hz] of a low pass for a motion: `factor` times its excitation band, at most 0.4 times the sampling rate.

    position: (n,) or (n, k), evenly sampled at sample_time [s]. Raises TrajectoryError as `excitation_band` does.

    >>> t = 0.004 * np.arange(1000)
    >>> q = np.sin(2 * np.pi * 0.5 * t) + 0.1 * np.sin(2 * np.pi * 3.0 * t)
    >>> gt.measurements.cutoff_for(q, 0.004)
    7.5
    """
    return min(factor * excitation_band(position, sample_time), WIDEST / sample_time)


def derivative(rows: Array, sample_time: float) -> Array:
    """Central differences of rows (n,) or (n, k) at sample_time [s]; one-sided at the ends, all of second order.

    Raises TrajectoryError for fewer than three rows.

    >>> t = 0.1 * np.arange(5)
    >>> gt.measurements.derivative(t**2, 0.1).round(9).tolist()  # 2 t
    [0.0, 0.2, 0.4, 0.6, 0.8]
    """
    if len(rows) < 3:
        raise TrajectoryError(f"there are {len(rows)} rows to differentiate; expected at least 3")
    return np.gradient(np.asarray(rows, dtype=float), sample_time, axis=0, edge_order=2)


def second_derivative(rows: Array, sample_time: float) -> Array:
    """Central second differences of rows (n,) or (n, k), sampled at sample_time [s], of second order.

    The end rows repeat their neighbours. Raises TrajectoryError for fewer than three rows.

    >>> t = 0.1 * np.arange(5)
    >>> gt.measurements.second_derivative(t**3, 0.1).round(9).tolist()  # 6 t inside
    [0.6, 0.6, 1.2, 1.8, 1.8]
    """
    if len(rows) < 3:
        raise TrajectoryError(f"there are {len(rows)} rows to differentiate; expected at least 3")
    inner = np.diff(np.asarray(rows, dtype=float), n=2, axis=0) / sample_time**2
    return np.concatenate([inner[:1], inner, inner[-1:]])


def motion(session: Session, position: str, low_pass: ZeroPhase | None) -> Trajectory:
    """The session as a motion: its signals with "der(POSITION)" and "der(POSITION,2)", the filter's ends cut off.

    Args:
        session: as `read_log` or `session_of` gives it.
        position: name of the signal to differentiate.
        low_pass: acts on every signal alike, position and forces, so that no phase or amplitude comes between them.
            None leaves the rows as they are, for regressors that are filtered together with the force afterwards: exact
            for columns linear in velocity and acceleration, and right for the sign of a velocity.

    Wrapped angles are unwrapped, and of orientations the rows stay orientations and the sign of a quaternion does not
    jump. Raises TrajectoryError for a recording that is too short for the filter, and where it is not clear which way
    a signal turns from row to row.

    >>> t = 0.004 * np.arange(1000)
    >>> log = gt.Trajectory(t, {"q": np.sin(2 * t)}, {"q": "m"})
    >>> session = gt.measurements.session_of(log)
    >>> moved = gt.measurements.motion(session, "q", gt.measurements.ZeroPhase(20.0))
    >>> moved.names, moved.unit("der(q,2)"), len(moved)
    (('q', 'der(q)', 'der(q,2)'), 'm/s2', 924)
    """
    of = natures(session.trajectory)
    raw, step = smooth(session.trajectory, of), session.sample_time
    rows = {name: raw[name] for name in raw.names}
    if low_pass is not None:
        rows = rotations_again({name: low_pass.linear(row, step) for name, row in rows.items()}, of)
    unit = raw.unit(position)
    first, second = f"der({position})", f"der({position},2)"
    rows[first], rows[second] = derivative(rows[position], step), second_derivative(rows[position], step)
    cut = 1 if low_pass is None else low_pass.end_rows(step)
    if 2 * cut + 3 > len(raw):
        raise TrajectoryError(
            f"'{session.name}' lasts {raw.duration:g} s; expected more than twice the {cut * step:g} s that the filter "
            "cuts off at either end, so record longer or raise the cut-off"
        )
    inside = slice(cut, len(raw) - cut)
    units = {**raw.units, first: rate_unit(unit), second: rate_unit(unit, 2)}
    return Trajectory(
        raw.time[inside],
        {name: value[inside] for name, value in rows.items()},
        units,
        title=raw.title,
        provenance=raw.provenance,
        synthetic=raw.synthetic,
    )


def decimate(trajectory: Trajectory, every: int) -> Trajectory:
    """Every n-th row of signals that are low-passed already.

    Raises TrajectoryError where fewer than three rows would be left.

    >>> log = gt.Trajectory(0.004 * np.arange(101), {"q": np.arange(101.0)}, {"q": "m"})
    >>> len(gt.measurements.decimate(log, 10))
    11
    """
    left = len(trajectory) // max(every, 1)
    if every < 1 or left < 3:
        raise TrajectoryError(f"every {every}th of {len(trajectory)} rows; expected a whole number that leaves three")
    return trajectory.resample(trajectory.time[::every])


class Moving(NamedTuple):
    """Where all velocities are beyond their thresholds: (n,) rows, the threshold [unit of velocity], share dropped."""

    rows: np.ndarray
    threshold: float
    dropped: float


def moving(velocity: Array, sample_time: float, step: float, steps: float = 3.0) -> Moving:
    """Rows in which every velocity is so large that its sign is known: at least `steps` quantisation steps per sample.

    Args:
        velocity: (n,) or (n, k).
        sample_time: [s].
        step: quantisation of the position, in its unit.

    Returns `Moving`: the rows (n,) as booleans, the threshold, and the share that is dropped.

    >>> kept = gt.measurements.moving(np.array([0.0, 0.01, -0.2]), sample_time=0.004, step=1e-5)
    >>> kept.rows.tolist(), round(kept.threshold, 6)  # m/s
    ([False, True, True], 0.0075)
    """
    threshold = steps * step / sample_time
    fast = np.abs(np.asarray(velocity).reshape(len(velocity), -1)) >= threshold
    rows = np.asarray(fast.all(axis=1))
    return Moving(rows, threshold, float(1 - rows.mean()))


def smooth_motion(time: Array, position: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration at the samples, of the smooth curve through them.

    Args:
        time: (n,) [s], ascending, n >= 6.
        position: (n, axes), exact samples such as those of a reference; noise would be amplified.

    The curve is a spline of degree five: what a simulated motion is taken to be between its samples.

    >>> t = np.linspace(0.0, 1.0, 51)
    >>> q, dq, ddq = gt.measurements.smooth_motion(t, t[:, None] ** 3)
    >>> ddq[[10, 25, 50], 0].round(6).tolist()  # 6 t
    [1.2, 3.0, 6.0]
    """
    spline = scipy.interpolate.make_interp_spline(time, position, k=SMOOTH)
    return position, spline.derivative(1)(time), spline.derivative(2)(time)
