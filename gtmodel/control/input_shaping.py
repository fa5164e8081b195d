"""Input shaping: a motion made of delayed parts of itself, so that a flexible mode is at rest when it ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results import Trajectory
from ..results.interpolation import Natures, natures

Array = np.ndarray
AT_REST = 1e-6  # of the greatest speed: a motion that begins or ends faster is not from rest to rest


@dataclass(frozen=True, eq=False)
class Shaper:
    """Impulses of `amplitudes` (n,), which sum to 1, at `times` (n,) [s], the first at 0.

    Called with a trajectory and names of signals it gives the shaped motion: that of the sum of delayed parts. It stays
    in the convex hull of the path, ends later by the time of the last impulse, and is no faster than the motion. Raises
    ValueError for times that do not ascend from 0 and for amplitudes that are negative or do not sum to 1. Singer and
    Seering 1990, "Preshaping command inputs to reduce system vibration".

    >>> shaper = gt.control.zero_vibration(5.0)  # Hz
    >>> motion = gt.Trajectory([0.0, 0.5, 1.0], {"der(T)": [0.0, 1.0, 0.0]}, {"der(T)": "m/s"})
    >>> shaped = shaper(motion, ["der(T)"])
    >>> round(shaped.duration, 3)  # half a period of the mode longer
    1.1
    """

    times: Array
    amplitudes: Array

    def __post_init__(self) -> None:
        t, a = np.asarray(self.times, float), np.asarray(self.amplitudes, float)
        if t.shape != a.shape or t.ndim != 1 or not len(t) or t[0] != 0 or not _ascending(t):
            raise ValueError("times of a shaper begin at 0 and ascend, with one amplitude each")
        if not abs(a.sum() - 1) <= 1e-12 or np.any(a < 0):
            raise ValueError(f"amplitudes of a shaper are not negative and sum to 1; found {a.tolist()}")
        object.__setattr__(self, "times", t)
        object.__setattr__(self, "amplitudes", a)

    def residual(self, frequency_Hz: ArrayLike, damping: ArrayLike = 0.0) -> Array:
        """Vibration that is left of a mode, when the shaped motion ends, in parts of the unshaped one when that ends:
        |sum a_i exp(-mu t_i)| exp(-zeta w t_n), mu = -zeta w + j w sqrt(1 - zeta^2)."""
        _, mu = _mode(frequency_Hz, damping)
        phasors = self.amplitudes * np.exp(-mu[..., None] * self.times)
        return np.abs(phasors.sum(axis=-1)) * np.exp(np.real(mu) * self.times[-1])

    def __call__(self, trajectory: Trajectory, signals: Sequence[str]) -> Trajectory:
        """The shaped signals of a motion from rest to rest, on its own time step, longer by the last impulse.

        signals: positions and their derivatives by name, such as "T", "der(T)"; forces are not linear in these and are
        to be computed anew. Before and after the motion, positions stand and derivatives are zero; wrapped angles are
        unwrapped. Raises KeyError for a signal that is not there and ValueError for a derivative that does not begin
        and end at zero speed, and for a unit quaternion, another direction of unit length or a rotation matrix: sums of
        them are none.
        """
        t = trajectory.time
        values: dict[str, Array] = {}
        of = natures(trajectory)
        step = float(np.min(np.diff(t)))
        end = t[-1] + self.times[-1]
        new = np.linspace(t[0], end, int(np.ceil((end - t[0]) / step)) + 1)
        for name in signals:
            _refuse_rotation(of, name)
            rows = trajectory(t, name)
            first_rate = name.startswith("der(") and not name.endswith(",2)")
            if first_rate and np.abs(rows[[0, -1]]).max() > AT_REST * np.abs(rows).max():
                raise ValueError(f"'{name}' does not begin and end at rest; shape a motion from rest to rest")
            values[name] = sum(
                (a * _held(new - d, t, rows, name) for a, d in zip(self.amplitudes, self.times, strict=True)),
                np.zeros((len(new), *rows.shape[1:])),
            )
        units = {name: trajectory.unit(name) for name in signals}
        return Trajectory(new, values, units, title=trajectory.title, synthetic=trajectory.synthetic)


def zero_vibration(frequency_Hz: float, damping: float = 0.0) -> Shaper:
    """ZV shaper: two impulses, half a damped period apart, cancel a mode of this frequency [Hz] and damping ratio.

    What is left grows in proportion to an error of the frequency. Raises ValueError for a frequency that is not
    positive and for a damping ratio outside [0, 1).

    >>> shaper = gt.control.zero_vibration(5.0)
    >>> shaper.times.tolist(), shaper.amplitudes.tolist()
    ([0.0, 0.1], [0.5, 0.5])
    >>> shaper.residual([5.0, 5.5]).round(3).tolist()  # parts of the unshaped vibration
    [0.0, 0.156]
    """
    return _shaper(frequency_Hz, damping, (1.0, 1.0))


def zero_vibration_derivative(frequency_Hz: float, damping: float = 0.0) -> Shaper:
    """ZVD shaper: three impulses over a damped period cancel a mode of this frequency [Hz] and damping ratio.

    What is left grows with the square of an error of the frequency; in return the motion ends half a period later than
    with `zero_vibration`. Raises ValueError as that does.

    >>> shaper = gt.control.zero_vibration_derivative(5.0)
    >>> shaper.amplitudes.tolist()
    [0.25, 0.5, 0.25]
    >>> shaper.residual([5.0, 5.5]).round(3).tolist()
    [0.0, 0.024]
    """
    return _shaper(frequency_Hz, damping, (1.0, 2.0, 1.0))


def residual_vibration(
    time: ArrayLike, velocity: ArrayLike, frequency_Hz: ArrayLike, damping: ArrayLike = 0.0
) -> Array:
    """Amplitude [m] at which a mass on a spring, carried along a motion from rest to rest, swings when this ends.

    Args:
        time: (n,) [s], ascending.
        velocity: (n,) or (n, d) [m/s] of what carries the spring, linear between the times.
        frequency_Hz, damping: natural frequency [Hz] and damping ratio of the mode, scalars or (f,).

    Returns (f, d); the first axis is left out for a scalar frequency and damping, the second for velocities (n,). The
    deflection x obeys x'' + 2 zeta w x' + w^2 x = -dv/dt and is at rest at first; the amplitude is that of its envelope
    at the end, |mu integral v exp(-mu (t - t_end)) dt| / w_d, exact for what is linear between times. Raises ValueError
    for a motion that does not begin and end at rest, and for other shapes.

    >>> time, velocity = [0.0, 0.2, 0.6, 0.8], [0.0, 1.0, 1.0, 0.0]  # a trapezoid
    >>> gt.control.residual_vibration(time, velocity, [4.0, 5.0]).round(5).tolist()  # none at 5 Hz: ramps of one period
    [0.0177, 0.0]
    """
    t, v = np.asarray(time, float), np.asarray(velocity, float)
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(v))):
        raise ValueError("times and velocities hold numbers that are not finite; cut the motion there or repair it")
    if t.ndim != 1 or len(t) < 2 or v.ndim not in (1, 2) or len(v) != len(t) or not _ascending(t):
        raise ValueError(
            f"expected times (n,) that ascend and velocities (n,) or (n, d); found {t.shape} and {v.shape}"
        )
    rows = v.reshape(len(t), -1)
    if np.abs(rows[[0, -1]]).max() > AT_REST * max(np.abs(rows).max(), 1e-300):
        raise ValueError("the motion does not begin and end at rest; residual vibration is defined for motions that do")
    w_d, mu = _mode(frequency_Hz, damping)
    flat = mu.reshape(-1, 1)
    h = np.diff(t)
    at = np.exp(-flat * (t[:-1] - t[-1]))  # at the beginning of each interval
    grown = np.exp(-flat * h)
    constant = (1 - grown) / flat
    linear = (constant - h * grown) / flat / h
    integral = (at * (constant - linear)) @ rows[:-1] + (at * linear) @ rows[1:]
    amplitude = np.abs(flat * integral) / w_d.reshape(-1, 1)
    return amplitude.reshape((*mu.shape, *v.shape[1:]))


def _ascending(t: Array) -> bool:
    return bool(np.all(np.isfinite(t)) and np.all(np.diff(t) > 0))


def _mode(frequency_Hz: ArrayLike, damping: ArrayLike) -> tuple[Array, Array]:
    """Damped frequency w_d [rad/s] and mu = -zeta w + j w_d. Raises ValueError for what does not swing."""
    w, zeta = np.broadcast_arrays(2 * np.pi * np.asarray(frequency_Hz, float), np.asarray(damping, float))
    if np.any(~((w > 0) & np.isfinite(w))) or np.any(~((zeta >= 0) & (zeta < 1))):
        raise ValueError("a mode that swings has a frequency above 0 and a damping ratio from 0 to below 1")
    w_d = w * np.sqrt(1 - zeta**2)
    return w_d, -zeta * w + 1j * w_d


def _shaper(frequency_Hz: float, damping: float, binomial: tuple[float, ...]) -> Shaper:
    w_d, mu = _mode(frequency_Hz, damping)
    half = np.pi / float(w_d)
    weights = np.array(binomial) * np.exp(float(np.real(mu)) * half) ** np.arange(len(binomial))
    amplitudes = weights / weights.sum()
    return Shaper(half * np.arange(len(binomial)), amplitudes)


_ROTATIONS = {
    "quaternion": "of length 1 at every time, as a unit quaternion",
    "direction": "of length 1 at every time, as a direction",
    "matrix": "a rotation matrix",
}


def _refuse_rotation(of: Natures, name: str) -> None:
    """Raises ValueError for rows, or derivatives or entries of rows, that lie on a sphere or are rotation matrices."""
    names = [n.removeprefix("der(").removesuffix(")").removesuffix(",2") for n in (name, name.partition("[")[0])]
    for group, base in ((group, base) for group in of for base in names if base in group and of[group] in _ROTATIONS):
        raise ValueError(
            f"'{base}' is {_ROTATIONS[of[group]]}, and the sum of delayed parts of it would be none; shape an "
            "angle or a rotation vector from the pose at the start, and make the orientation of that"
        )


def _held(t: Array, time: Array, rows: Array, name: str) -> Array:
    """Rows at t by linear interpolation; a position stands before and after, a derivative is zero."""
    flat = rows.reshape(len(time), -1)
    outside = dict(left=0.0, right=0.0) if name.startswith("der(") else {}
    columns = [np.interp(t, time, flat[:, k], **outside) for k in range(flat.shape[1])]
    return np.column_stack(columns).reshape(len(t), *rows.shape[1:])
