"""Recordings of a gyro and reference orientations, instants of samples stamped on arrival, synthetic recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ...results.refusal import ArgumentError
from ...results.trajectory import Trajectory
from .conventions import DEGREE
from .gyro_path import RateCorrection, gyro_path
from .options import SyntheticAttitude


def sampled_instants(stamps: np.ndarray, period: float) -> np.ndarray:
    """Estimate the sampling instants (n,) of an evenly sampled sensor from arrival stamps (n,), up to the least delay.

    Samples are one period apart, and each arrives after its sampling instant, so no sampling instant is later than any
    later arrival minus the periods in between. The result is the latest instants that satisfy this condition. The
    instants are even while samples wait in a buffer, and jump where samples were lost.

    period: of the sensor by its own clock [s]; a slightly short value does no harm. Raises ArgumentError if it is not
    above zero, and for stamps that go back.

    >>> taken = 0.01 * np.arange(7)
    >>> arrived = np.maximum.accumulate(taken + [0.0, 0.004, 0.0, 0.027, 0.017, 0.007, 0.0])  # three waited
    >>> gt.filtering.sampled_instants(arrived, 0.01).round(6).tolist()
    [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
    """
    stamps = np.asarray(stamps, float)
    if not period > 0:
        raise ArgumentError(f"expected more than 0 s; found {period}", "period")
    if np.any(np.diff(stamps) < 0):
        row = int(np.argmax(np.diff(stamps) < 0)) + 1
        raise ArgumentError(f"the stamps go back in row {row}; drop such rows first", "stamps")
    even = period * np.arange(len(stamps))
    return even + np.minimum.accumulate((stamps - even)[::-1])[::-1]


FINE = 1e-3  # s, steps of the synthetic motion, linear in between
PERSISTENCE = 2.0  # s, correlation time of the synthetic gyro's relative error
BUFFERED = 3.6  # s of buffered rows at the start of reading
READ = 0.0025  # s to read one buffered row
PAUSE = 0.012  # s for which reading stops at each reference
COUNT = 2000 / 2**15  # deg/s
TRUE_TURN = (0.02, -0.03, 0.065)  # rad, from the sensor to the body
TRUE_STRETCH = ((1.02, 0.004, -0.006), (0.004, 1.005, 0.008), (-0.006, 0.008, 0.99))
TRUE_BIAS = (2e-3, -1e-3, 1.5e-3)  # rad/s


@dataclass(frozen=True, eq=False)
class AttitudeRecording:
    """Recording of an inertial unit and of a device that measures orientation, each with its own clock.

    gyro: "rate" (n, 3), and "acceleration" (n, 3) and "temperature" (n,) [K] if available. reference: "quaternion"
    (k, 4) of unit length. Stamps may be uneven.
    Signals with the unit "1" are raw: the study finds their units; others are in rad/s and m/s2.

    Raises ArgumentError if a signal is missing or has another shape.

    >>> made = gt.filtering.synthetic_attitude().recording
    >>> bare = gt.filtering.AttitudeRecording(made.gyro.select(["rate"]), made.reference)
    >>> bare.gyro.names
    ('rate',)
    """

    gyro: Trajectory
    reference: Trajectory

    def __post_init__(self) -> None:
        expected = [(self.gyro, "gyro", "rate", 3), (self.reference, "reference", "quaternion", 4)]
        if "acceleration" in self.gyro.names:
            expected.append((self.gyro, "gyro", "acceleration", 3))
        for trajectory, argument, name, size in expected:
            if name not in trajectory.names:
                names = ", ".join(trajectory.names)
                raise ArgumentError(f"expected a signal '{name}'; found {names}", argument)
            if trajectory[name].shape[1:] != (size,):
                raise ArgumentError(f"expected '{name}' (n, {size}); found shape {trajectory[name].shape}", argument)
        warm = self.gyro.select(["temperature"]) if "temperature" in self.gyro.names else None
        if warm is not None and (warm["temperature"].ndim != 1 or warm.unit("temperature") != "K"):
            raise ArgumentError("expected 'temperature' (n,) in K", "gyro")
        if self.gyro.unit("rate") not in ("1", "rad/s"):
            raise ArgumentError(f"expected 'rate' in rad/s, or 1 for raw; found {self.gyro.unit('rate')}", "gyro")


@dataclass(frozen=True, eq=False)
class SyntheticTruth:
    """A synthetic recording with its true gyro correction."""

    recording: AttitudeRecording
    correction: RateCorrection


def synthetic_attitude(options: SyntheticAttitude | None = None) -> SyntheticTruth:
    """Make a synthetic recording with its truth: gyro in deg/s, quaternions scalar first, world to body.

    >>> made = gt.filtering.synthetic_attitude(gt.filtering.SyntheticAttitude(duration=8.0))
    >>> made.recording.gyro["rate"].shape[1], made.recording.reference.unit("quaternion"), made.correction.offset
    (3, '1', 0.002)
    """
    o = options or SyntheticAttitude()
    rng = np.random.default_rng(o.seed)
    fine = np.arange(-BUFFERED - 0.1, o.duration + 0.2, FINE)
    rate = _motion(fine, rng)
    matrix = Rotation.from_rotvec(TRUE_TURN).as_matrix() @ np.array(TRUE_STRETCH)
    drift = np.full(3, o.drift)
    truth = RateCorrection(matrix, np.array(TRUE_BIAS), o.offset, (matrix @ drift)[None][: int(bool(o.drift))])
    taken = np.arange(-BUFFERED, o.duration, o.sample_period)
    reference_time = _exchanges(o, rng)
    stamps = _arrivals(taken, reference_time - o.offset, rng)
    rows = np.ones(len(taken), bool)
    rows[rng.choice(np.arange(len(taken) // 3, len(taken) - 1), o.lost, replace=False)] = False
    rows &= stamps <= o.duration
    error = o.relative * _slow_noise(fine, rng) * np.linalg.norm(rate, axis=1)[:, None]
    read = np.column_stack([np.interp(taken, fine, (rate + error)[:, k]) for k in range(3)])
    read = (read + truth.bias) @ np.linalg.inv(matrix).T + o.noise * rng.standard_normal(read.shape)
    read += np.outer(taken, drift)
    none = RateCorrection(np.eye(3), np.zeros(3))
    body = gyro_path(fine, rate, np.sort(np.concatenate([fine[:1], taken])), none).turn[1:]
    up = (Rotation.from_rotvec(TRUE_TURN).inv() * body.inv()).apply([0.0, 0.0, 1.0])
    acceleration = up + 2e-3 * rng.standard_normal(up.shape)
    t = reference_time - o.offset
    quaternion = gyro_path(fine, rate, np.concatenate([fine[:1], t]), none).turn[1:].inv().as_quat(scalar_first=True)
    synthetic = (
        f"synthetic, seed {o.seed}: relative error of the gyro {o.relative:g}, noise {o.noise / DEGREE:.3g} deg/s, "
        f"stamps of the references in steps of {o.resolution:g} s"
        + (f", drift of the gyro {o.drift / DEGREE:.3g} deg/s2" if o.drift else "")
    )
    gyro = Trajectory(
        stamps[rows], {"rate": (np.round(read / DEGREE / COUNT) * COUNT)[rows], "acceleration": acceleration[rows]},
        synthetic=synthetic,
    )  # fmt: skip
    stamped = np.round(np.round(reference_time / o.resolution) * o.resolution, 9)
    reference = Trajectory(stamped, {"quaternion": np.round(quaternion, 6)}, synthetic=synthetic)
    return SyntheticTruth(AttitudeRecording(gyro, reference), truth)


def _motion(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rates of the body (n, 3): rotations of one to three seconds about drifting axes, with rests in between."""
    rate, begin = np.zeros((len(time), 3)), 0.8
    while begin < time[-1] - 1.0:
        length, peak = rng.uniform(0.9, 2.6), rng.uniform(1.8, 6.0)
        axes = rng.standard_normal((2, 3))
        u = (time - begin) / length
        moving = (u > 0) & (u < 1)
        ramp = np.clip(np.minimum(u, 1 - u) / 0.2, 0, 1)[moving]
        axis = axes[0] + np.outer(np.sin(np.pi * u[moving]), axes[1])
        speed = peak / np.sqrt(length) * np.sin(np.pi / 2 * ramp) ** 2
        rate[moving] = speed[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)
        begin += length + rng.uniform(0.4, 0.7)
    return rate


def _slow_noise(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Ornstein-Uhlenbeck processes (n, 3) of variance one."""
    keep = np.exp(-FINE / PERSISTENCE)
    white = np.sqrt(1 - keep**2) * rng.standard_normal((len(time), 3))
    white[0] /= np.sqrt(1 - keep**2)
    for k in range(1, len(white)):
        white[k] += keep * white[k - 1]
    return white


def _exchanges(o: SyntheticAttitude, rng: np.random.Generator) -> np.ndarray:
    """Instants of the reference orientations, by the reference's clock: even, with longer pauses and jitter."""
    pauses = rng.choice([0.0, 0.4, 1.0], int(2 * o.duration / o.reference_period), p=[0.93, 0.04, 0.03])
    time = 0.03 + np.cumsum(o.reference_period * (1 + pauses + 0.03 * rng.standard_normal(len(pauses))))
    return time[time < o.duration - 0.05]


def _arrivals(taken: np.ndarray, exchanges: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Arrival times of rows taken at these instants, read one after the other."""
    stamps, free = np.empty(len(taken)), 0.0
    blocked = iter(exchanges)
    pause = next(blocked, np.inf)
    for k, instant in enumerate(taken):
        ready = max(instant + 3e-4 * rng.random(), free)
        while ready > pause:
            ready = max(ready, pause + PAUSE)
            pause = next(blocked, np.inf)
        stamps[k], free = ready, ready + READ * (1 + 0.05 * rng.random())
    return stamps
