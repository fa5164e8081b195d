"""Zero-phase low pass, central differences, decimation, and detection of rows in motion."""

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

BAND_FACTOR = 2.5  # cut-off over excitation band; 2 to 3 keeps the motion and removes most of the noise
BAND_SHARE = 0.999  # of the velocity's power
ORDER = 4
FLOOR = (0.25, 0.4)  # range of frequencies, over the sampling rate, from which the position noise is estimated
ABOVE = 24.0  # times the expected power of noise at one frequency: chance exceeds it with a probability of 1e-6
BEYOND = 10.0  # threshold in units of 1/sqrt(n), the relative scatter of the sum of n periodogram values of noise
DIFFERENCES, MEDIAN = 6, 0.6745  # order; median of the absolute value of a standard normal variable
WIDEST = 0.4  # largest cut-off over the sampling rate
# the slowest pole of the filter decays as exp(-2 pi f_c sin(pi / 8) t) at order four: 1e-3 after 2.9 / f_c
SETTLING_PERIODS = 3.0
SMOOTH = 5  # degree of the interpolating spline: four continuous derivatives


@dataclass(frozen=True)
class ZeroPhase:
    """Butterworth low pass run forward and backward: zero phase, amplitude |H|^2, one half at the cut-off frequency.

    Args:
        cutoff_Hz: cut-off frequency of one pass [Hz].
        order: order of one pass.

    Called with rows (n,) or (n, k) and their sample time [s], it returns the filtered rows. Orientations and directions
    remain valid, and with unit="rad" wrapped angles are unwrapped. `linear` treats all rows as plain numbers.

    >>> low_pass = gt.measurements.ZeroPhase(20.0)
    >>> low_pass.amplitude(np.array([5.0, 20.0, 60.0]), sample_time=0.004).round(3).tolist()
    [1.0, 0.5, 0.0]
    """

    cutoff_Hz: float
    order: int = ORDER

    def __call__(self, rows: Array, sample_time: float, unit: str = "1") -> Array:
        """Return filtered rows, (n,) or (n, k), sampled at sample_time [s]; `unit` is their SI unit.

        With unit "1", quaternions, directions and rotation matrices are recognised by their lengths; with unit "rad",
        wrapped angles. Raises TrajectoryError if the cut-off exceeds half the sampling rate, if there are too few rows,
        and for a rotation of more than 90 deg between two rows.
        """
        rows = np.asarray(rows, dtype=float)
        nature = nature_of(rows, unit)
        rows = smooth_rows(sample_time * np.arange(len(rows), dtype=float), rows, nature, nature or "")
        return rotation_rows(self.linear(rows, sample_time), nature)

    def linear(self, rows: Array, sample_time: float) -> Array:
        """Return filtered rows (n, ...) of plain numbers, each column separately. Raises as the call does."""
        rows = np.asarray(rows, dtype=float)
        need = 3 * (2 * math.ceil(self.order / 2) + 1)
        if len(rows) <= need:
            raise TrajectoryError(f"there are {len(rows)} rows to filter; expected more than {need}")
        return np.asarray(scipy.signal.sosfiltfilt(self._sections(sample_time), rows, axis=0))

    def amplitude(self, frequency_Hz: float | Array, sample_time: float) -> Array:
        """Return the amplitude ratio of both passes at a frequency."""
        turn = 2 * np.pi * np.atleast_1d(frequency_Hz) * sample_time
        _, response = scipy.signal.sosfreqz(self._sections(sample_time), worN=turn)
        return np.square(np.abs(np.asarray(response)), dtype=float)

    def end_rows(self, sample_time: float) -> int:
        """Return the number of rows at either end with transients of the filter: three periods of the cut-off."""
        return math.ceil(SETTLING_PERIODS / (self.cutoff_Hz * sample_time))

    def kernel(self, sample_time: float) -> Array:
        """Return the symmetric impulse response (2 end_rows + 1,), truncated and normalised to sum one."""
        reach = self.end_rows(sample_time)
        impulse = np.zeros(6 * reach + 1)
        impulse[3 * reach] = 1.0
        weights = self.linear(impulse, sample_time)[2 * reach : 4 * reach + 1]
        weights = weights + weights[::-1]  # the ends of the impulse record leave an asymmetry of 1e-8
        return weights / weights.sum()

    def every(self, rows: Array, sample_time: float, every: int) -> Array:
        """Filter rows (n, k) with `kernel`, only at rows end_rows, end_rows + every, ... < n - end_rows.

        The data are not extrapolated beyond their ends.
        """
        weights = self.kernel(sample_time)
        count = -(-(len(rows) - len(weights) + 1) // every)
        if count < 1:
            return np.zeros((0, *rows.shape[1:]))
        first = len(weights) - 1  # first complete row of the full convolution; upfirdn returns multiples of `every`
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
    """Return the frequency [Hz] below which the velocity has the given share of its power.

    Args:
        position: (n,) or (n, k), evenly sampled.
        sample_time: [s].
        share: share of the power of the velocity.

    The velocity is continued by its mirror image, so that a motion may begin and end at any speed. Only frequencies
    count at which the power exceeds that of white position noise, estimated at high frequencies, so far that chance
    does not explain it: the band ends where the spectrum of the motion falls into the noise. Raises TrajectoryError if
    nothing moves, or if the motion is not larger than the noise.

    >>> t = 0.004 * np.arange(1000)
    >>> q = np.sin(2 * np.pi * 0.5 * t) + 0.1 * np.sin(2 * np.pi * 3.0 * t)
    >>> gt.measurements.excitation_band(q, 0.004)
    3.0
    """
    velocity = derivative(position, sample_time)
    velocity = (velocity - velocity.mean(axis=0)).reshape(len(velocity), -1)
    # the cosine transform of the mirrored velocity; each coefficient has one degree of freedom
    power = scipy.fft.dct(velocity, axis=0) ** 2
    frequency = np.arange(len(power)) / (2 * len(power) * sample_time)
    transfer = np.sin(2 * np.pi * frequency * sample_time)[:, None] ** 2  # of central differences
    upper = (frequency > FLOOR[0] / sample_time) & (frequency < FLOOR[1] / sample_time)
    level = np.median(power[upper] / transfer[upper], axis=0) / MEDIAN**2 if upper.any() else 0.0
    noise = transfer * level
    if not np.max(power) > 0:
        raise TrajectoryError("nothing moves, so there is no excitation band; set the cut-off of the filter")
    motion = np.where(power > ABOVE * noise, power - noise, 0.0).sum(axis=1)
    if not np.max(motion) > 0 or motion.sum() < BEYOND / np.sqrt(len(power)) * noise.sum():
        raise TrajectoryError("the motion does not exceed the position noise; set the cut-off of the filter")
    total = np.cumsum(motion)
    return float(frequency[np.argmax(total >= share * total[-1])])


def position_noise(position: Array) -> float:
    """Return the standard deviation of the white noise on a smooth motion (n,) or (n, k); the largest of the columns.

    It is estimated from the median of the absolute sixth differences: these remove the smooth motion, and the median is
    robust against single events. Fewer than seven rows give 0.

    >>> t = 0.004 * np.arange(2000)
    >>> noise = 1e-4 * np.random.default_rng(2).standard_normal(2000)  # synthetic: seed 2
    >>> round(gt.measurements.position_noise(np.sin(3 * t) + noise), 5)
    0.0001
    """
    if len(position) <= DIFFERENCES:
        return 0.0
    sixth = np.abs(np.diff(np.asarray(position, dtype=float), n=DIFFERENCES, axis=0))
    median = np.median(sixth.reshape(len(sixth), -1), axis=0)
    return float(np.max(median)) / (MEDIAN * math.sqrt(math.comb(2 * DIFFERENCES, DIFFERENCES)))


def cutoff_for(position: Array, sample_time: float, factor: float = BAND_FACTOR) -> float:
    """Return the cut-off frequency [Hz] for a motion: `factor` times its excitation band, at most 0.4 sampling rates.

    position: (n,) or (n, k), evenly sampled at sample_time [s]. Raises TrajectoryError as `excitation_band` does.

    >>> t = 0.004 * np.arange(1000)
    >>> q = np.sin(2 * np.pi * 0.5 * t) + 0.1 * np.sin(2 * np.pi * 3.0 * t)
    >>> gt.measurements.cutoff_for(q, 0.004)
    7.5
    """
    return min(factor * excitation_band(position, sample_time), WIDEST / sample_time)


def derivative(rows: Array, sample_time: float) -> Array:
    """Return central differences of rows (n,) or (n, k) at sample_time [s]; one-sided at the ends, all second order.

    Raises TrajectoryError for fewer than three rows.

    >>> t = 0.1 * np.arange(5)
    >>> gt.measurements.derivative(t**2, 0.1).round(9).tolist()  # 2 t
    [0.0, 0.2, 0.4, 0.6, 0.8]
    """
    if len(rows) < 3:
        raise TrajectoryError(f"there are {len(rows)} rows to differentiate; expected at least 3")
    return np.gradient(np.asarray(rows, dtype=float), sample_time, axis=0, edge_order=2)


def second_derivative(rows: Array, sample_time: float) -> Array:
    """Return central second differences of rows (n,) or (n, k) at sample_time [s], of second order.

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
    """Return the signals of a session with "der(POSITION)" and "der(POSITION,2)", without the transients at the ends.

    Args:
        session: a session from `read_log` or `session_of`.
        position: name of the signal to differentiate.
        low_pass: filter for all signals, position and forces alike, so that it adds no relative phase or amplitude.
            None does not filter: use this if regressor and force are filtered together afterwards, which is exact for
            columns linear in velocity and acceleration and keeps the sign of a velocity.

    Wrapped angles are unwrapped, orientations remain valid, and the sign of a quaternion does not jump. Raises
    TrajectoryError if the recording is too short for the filter, or if the sense of rotation between two rows is
    ambiguous.

    >>> t = 0.004 * np.arange(1000)
    >>> log = gt.Trajectory(t, {"q": np.sin(2 * t)}, {"q": "m"})
    >>> session = gt.measurements.session_of(log)
    >>> moved = gt.measurements.motion(session, "q", gt.measurements.ZeroPhase(20.0))
    >>> moved.names, moved.unit("der(q,2)"), len(moved)
    (('q', 'der(q)', 'der(q,2)'), 'm/s2', 924)
    """
    kinds = natures(session.trajectory)
    raw, step = smooth(session.trajectory, kinds), session.sample_time
    rows = {name: raw[name] for name in raw.names}
    if low_pass is not None:
        rows = rotations_again({name: low_pass.linear(row, step) for name, row in rows.items()}, kinds)
    unit = raw.unit(position)
    first, second = f"der({position})", f"der({position},2)"
    rows[first], rows[second] = derivative(rows[position], step), second_derivative(rows[position], step)
    cut = 1 if low_pass is None else low_pass.end_rows(step)
    if 2 * cut + 3 > len(raw):
        raise TrajectoryError(
            f"'{session.name}' lasts {raw.duration:g} s; expected more than twice the transient of the filter, "
            f"{cut * step:g} s; record longer or raise the cut-off"
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
    """Return every n-th row of signals that have already been low-pass filtered.

    Raises TrajectoryError if fewer than three rows would remain.

    >>> log = gt.Trajectory(0.004 * np.arange(101), {"q": np.arange(101.0)}, {"q": "m"})
    >>> len(gt.measurements.decimate(log, 10))
    11
    """
    if every < 1 or len(trajectory) // every < 3:
        raise TrajectoryError(f"every = {every} of {len(trajectory)} rows; expected a whole number that leaves 3 rows")
    return trajectory.resample(trajectory.time[::every])


class Moving(NamedTuple):
    """Rows in motion: (n,) booleans, the threshold [unit of velocity], and the share of the other rows."""

    rows: np.ndarray
    threshold: float
    dropped: float


def moving(velocity: Array, sample_time: float, step: float, steps: float = 3.0) -> Moving:
    """Find the rows in which all velocities have a certain sign: at least `steps` quantisation steps per sample.

    Args:
        velocity: (n,) or (n, k).
        sample_time: [s].
        step: quantisation of the position, in its unit.

    Returns the rows (n,) as booleans, the threshold, and the share of rows dropped.

    >>> kept = gt.measurements.moving(np.array([0.0, 0.01, -0.2]), sample_time=0.004, step=1e-5)
    >>> kept.rows.tolist(), round(kept.threshold, 6)  # m/s
    ([False, True, True], 0.0075)
    """
    threshold = steps * step / sample_time
    fast = np.abs(np.asarray(velocity).reshape(len(velocity), -1)) >= threshold
    rows = np.asarray(fast.all(axis=1))
    return Moving(rows, threshold, float(1 - rows.mean()))


def smooth_motion(time: Array, position: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration at the samples, from a quintic spline through them.

    Args:
        time: (n,) [s], ascending, n >= 6.
        position: (n, axes), exact samples such as a reference; noise would be amplified.

    A simulated motion follows this curve between its samples.

    >>> t = np.linspace(0.0, 1.0, 51)
    >>> q, dq, ddq = gt.measurements.smooth_motion(t, t[:, None] ** 3)
    >>> ddq[[10, 25, 50], 0].round(6).tolist()  # 6 t
    [1.2, 3.0, 6.0]
    """
    spline = scipy.interpolate.make_interp_spline(time, position, k=SMOOTH)
    return position, spline.derivative(1)(time), spline.derivative(2)(time)
