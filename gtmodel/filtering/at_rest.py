"""Initial state of a filter from a log at rest: attitude from gravity, gyro biases, and the noise of both sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.quaternions import quaternion_matrix, rpy_quaternion
from ..geometry.rotations import cross_matrix
from ..measurements.rest import motion_at_rest
from ..results.estimate import half_width
from ..results.refusal import ArgumentError
from .allan import LEAST, AllanFit, allan_fit

GRAVITY = 9.80665  # m/s2, standard; it differs by 0.3 % over the Earth
EARTH = 7.292e-5  # rad/s
RATE = 0.005  # rad/s, 0.3 deg/s: a unit whose block means differ by more is not at rest
FORCE = 0.05  # m/s2, 0.3 deg of gravity
LARGEST_BIAS = 0.1  # rad/s, 6 deg/s: larger than the bias of any gyro on a robot
LENGTH = 0.5  # m/s2 by which the mean may differ from gravity: accelerometer bias and scale error
AXES = "xyz"


@dataclass(frozen=True, eq=False)
class AtRest:
    """Initial state from a log at rest.

    attitude: unit quaternion, scalar first, body to a world whose z axis points up. attitude_covariance: covariance of
        its error, a rotation vector in the axes of the body [rad] (3, 3). gyro_bias, gyro_bias_deviation: bias and its
        standard deviation [rad/s] (3,).
    gyro, accelerometer: noise of each axis, from `allan_fit`. duration: length of the log [s].
    notes: sentences on what a log at rest cannot show.

    `InitialState({"Q": r.attitude, "bias": r.gyro_bias}, {"Q": r.attitude_covariance, "bias": r.gyro_bias_deviation})`.
    """

    attitude: np.ndarray
    attitude_covariance: np.ndarray
    gyro_bias: np.ndarray
    gyro_bias_deviation: np.ndarray
    gyro: tuple[AllanFit, ...]
    accelerometer: tuple[AllanFit, ...]
    duration: float
    notes: tuple[str, ...]

    @property
    def tilt_deviation(self) -> float:
        """Standard deviation of the tilt about the less certain horizontal axis [rad]."""
        up = quaternion_matrix(self.attitude)[2]
        level = np.eye(3) - np.outer(up, up)
        return float(np.sqrt(np.linalg.eigvalsh(level @ self.attitude_covariance @ level)[-1]))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the normal confidence limits of "gyro_bias[0]" to "gyro_bias[2]" [rad/s].

        Raises ArgumentError for another name.
        """
        names = [f"gyro_bias[{k}]" for k in range(3)]
        if name not in names:
            raise ArgumentError(f"'{name}' has no interval; expected one of {', '.join(names)}", "name")
        k, reach = names.index(name), half_width(level)
        value, deviation = float(self.gyro_bias[k]), float(self.gyro_bias_deviation[k])
        return value - reach * deviation, value + reach * deviation


def from_rest(
    gyro: Any,
    accelerometer: Any,
    period: float,
    *,
    gravity: float = GRAVITY,
    accelerometer_bias: float = 0.0,
    heading: float = 0.0,
    heading_deviation: float = np.pi,
    still_rate: float = RATE,
    still_force: float = FORCE,
    largest_bias: float = LARGEST_BIAS,
) -> AtRest:
    """Estimate attitude, gyro bias and sensor noise from a log of an inertial unit at rest.

    Args:
        gyro: rates [rad/s] (n, 3). accelerometer: specific force [m/s2] (n, 3); at rest it points up.
        period: sampling period [s].
        gravity: [m/s2]. accelerometer_bias: standard deviation of the bias of each axis [m/s2]; it tilts the attitude
            by bias over gravity, and a log at rest does not show it.
        heading, heading_deviation: heading of the body's x axis about the vertical and its standard deviation [rad],
            from another source.
        still_rate, still_force: allowed difference between the mean of a sixteenth of the log and the mean of the
            whole log, beyond its noise [rad/s, m/s2].
        largest_bias: largest plausible gyro bias [rad/s]; a larger mean is taken as a rotation.

    Raises ArgumentError for shapes that do not fit, and for a log that is not at rest; the message says where it moves
    and by how much.

    >>> rng = np.random.default_rng(0)  # synthetic: seed 0, 10 s at 100 Hz, tilted by 0.1 rad about x
    >>> gyro = [0.01, -0.02, 0.0] + 2e-3 * rng.standard_normal((1000, 3))
    >>> force = 9.80665 * np.array([0.0, np.sin(0.1), np.cos(0.1)]) + 0.02 * rng.standard_normal((1000, 3))
    >>> rest = gt.filtering.from_rest(gyro, force, 0.01)
    >>> (2 * rest.attitude[1]).round(3), rest.gyro_bias[:2].round(3).tolist()
    (np.float64(0.1), [0.01, -0.02])
    >>> rest.notes[0]
    'gravity does not show the heading: it is 0 rad as given, with a deviation of 3.14 rad'
    """
    w, f = (_rows(v, name) for v, name in ((gyro, "gyro"), (accelerometer, "accelerometer")))
    if len(w) != len(f):
        raise ArgumentError(f"expected both sensors to have as many rows; found {len(w)} and {len(f)}", "accelerometer")
    if not period > 0:
        raise ArgumentError(f"expected more than 0 s; found {period}", "period")
    _require_still(w, period, still_rate, "gyro", "rad/s")
    _require_still(f, period, still_force, "accelerometer", "m/s2")
    force, bias = f.mean(axis=0), w.mean(axis=0)
    length = float(np.linalg.norm(force))
    if abs(length - gravity) > LENGTH:
        hint = "its unit looks like g, not m/s2" if abs(length - 1) < 0.1 else "it accelerates, or its scale is wrong"
        raise ArgumentError(
            f"at rest an accelerometer reads gravity, {gravity:.6g} m/s2; the mean of this log is {length:.4g}: {hint}",
            "accelerometer",
        )
    k = int(np.argmax(np.abs(bias)))
    if abs(bias[k]) > largest_bias:
        raise ArgumentError(
            f"the log is not at rest: the gyro reads {bias[k]:.3g} rad/s about {AXES[k]} on average, more than the "
            f"largest bias of {largest_bias:g} rad/s; is it in deg/s?",
            "gyro",
        )
    duration = len(w) * period
    noise_w, noise_f = (tuple(allan_fit(v[:, k], period) for k in range(3)) for v in (w, f))
    up = force / length
    spread = np.array([n.mean_deviation(duration) ** 2 for n in noise_f]) + accelerometer_bias**2
    across = cross_matrix(up)
    tilt = across @ np.diag(spread) @ across.T / length**2
    deviation = np.array([n.mean_deviation(duration) for n in noise_w])
    return AtRest(
        _attitude(up, heading), tilt + heading_deviation**2 * np.outer(up, up), bias, deviation, noise_w, noise_f,
        duration, _notes(noise_w, noise_f, deviation, accelerometer_bias, gravity, heading, heading_deviation),
    )  # fmt: skip


def _notes(
    gyro: tuple[AllanFit, ...],
    accelerometer: tuple[AllanFit, ...],
    deviation: np.ndarray,
    accelerometer_bias: float,
    gravity: float,
    heading: float,
    heading_deviation: float,
) -> tuple[str, ...]:
    notes = [
        f"gravity does not show the heading: it is {heading:.3g} rad as given, with a deviation of "
        f"{heading_deviation:.3g} rad"
    ]
    if accelerometer_bias == 0.0:
        notes.append(
            "the accelerometer bias is assumed to be zero; each 0.01 m/s2 of it across gravity tilts the attitude by "
            f"{np.degrees(0.01 / gravity):.2g} deg, and rest in one attitude does not show it"
        )
    notes.append("a steady rotation about the vertical cannot be distinguished from a gyro bias")
    if deviation.min() < EARTH:
        notes.append(
            f"the gyro bias is known better than the rotation of the Earth, {EARTH:.3g} rad/s, which it includes"
        )
    for name, fits in (("gyro", gyro), ("accelerometer", accelerometer)):
        notes += [f"{name} {axis}: {note}" for axis, fit in zip(AXES, fits, strict=True) for note in fit.notes]
    return tuple(notes)


def _rows(values: Any, name: str) -> np.ndarray:
    rows = np.asarray(values, float)
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) < LEAST:
        raise ArgumentError(f"expected (n, 3) samples, at least {LEAST}; found shape {rows.shape}", name)
    if not np.all(np.isfinite(rows)):
        raise ArgumentError(f"{int(np.sum(~np.isfinite(rows)))} numbers are not finite; cut the log", name)
    return rows


def _require_still(rows: np.ndarray, period: float, still: float, name: str, unit: str) -> None:
    """Raise ArgumentError if the mean of a block differs from the mean of the log by `still` more than its noise."""
    motion, _ = motion_at_rest(rows, still)
    if motion is not None:
        raise ArgumentError(
            f"the log is not at rest: from {period * motion.begin:.3g} to {period * motion.end:.3g} s the {name} reads "
            f"{motion.difference:+.3g} {unit} off its mean along {AXES[motion.component]}, more than its noise plus "
            f"{still:g} {unit}; cut the log",
            name,
        )


def _attitude(up: np.ndarray, heading: float) -> np.ndarray:
    """Unit quaternion, body to world, from the up direction in the axes of the body and the heading of its x axis."""
    return rpy_quaternion(np.arctan2(up[1], up[2]), -np.arcsin(np.clip(up[0], -1.0, 1.0)), heading)
