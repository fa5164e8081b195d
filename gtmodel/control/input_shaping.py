"""Input shaping: a weighted sum of delayed copies of a motion, so that a flexible mode is at rest at its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results import Trajectory
from ..results.interpolation import Natures, natures

Array = np.ndarray
AT_REST = 1e-6  # of the greatest speed: a motion from rest to rest begins and ends slower than this


@dataclass(frozen=True, eq=False)
class Shaper:
    """Impulses of `amplitudes` (n,), which sum to 1, at `times` (n,) [s], the first at 0.

    Call it with a trajectory and names of signals to get the shaped motion, the weighted sum of delayed copies. The
    shaped motion stays in the convex hull of the path, is at most as fast, and ends later by the time of the last
    impulse. Raises ValueError if the times do not increase from 0, or if amplitudes are negative or do not sum to 1.
    Source: Singer and Seering 1990, "Preshaping command inputs to reduce system vibration".

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
            raise ValueError("the times of a shaper must start at 0 and increase, with one amplitude each")
        if not abs(a.sum() - 1) <= 1e-12 or np.any(a < 0):
            raise ValueError(f"the amplitudes of a shaper must not be negative and must sum to 1; found {a.tolist()}")
        object.__setattr__(self, "times", t)
        object.__setattr__(self, "amplitudes", a)

    def residual(self, frequency_Hz: ArrayLike, damping: ArrayLike = 0.0) -> Array:
        """Return the residual vibration of a mode at the end of the shaped motion, as a fraction of that at the end of
        the unshaped motion: |sum a_i exp(-mu t_i)| exp(-zeta w t_n), mu = -zeta w + j w sqrt(1 - zeta^2)."""
        _, mu = _mode(frequency_Hz, damping)
        phasors = self.amplitudes * np.exp(-mu[..., None] * self.times)
        return np.abs(phasors.sum(axis=-1)) * np.exp(np.real(mu) * self.times[-1])

    def __call__(self, trajectory: Trajectory, signals: Sequence[str]) -> Trajectory:
        """Return the shaped signals of a motion from rest to rest, with its time step, longer by the last impulse.

        signals: names of positions and their derivatives, such as "T", "der(T)". Forces are not linear in these;
        compute them again from the shaped motion. Outside the motion, positions are constant and derivatives zero.
        Wrapped angles are unwrapped. Raises KeyError for an unknown signal. Raises ValueError if a velocity does not
        begin and end at zero, and for unit quaternions, unit vectors and rotation matrices, because a weighted sum of
        them is not one of them.
        """
        t = trajectory.time
        values: dict[str, Array] = {}
        kinds = natures(trajectory)
        step = float(np.min(np.diff(t)))
        end = t[-1] + self.times[-1]
        time = np.linspace(t[0], end, int(np.ceil((end - t[0]) / step)) + 1)
        for name in signals:
            _refuse_rotation(kinds, name)
            rows = trajectory(t, name)
            first_rate = name.startswith("der(") and not name.endswith(",2)")
            if first_rate and np.abs(rows[[0, -1]]).max() > AT_REST * np.abs(rows).max():
                raise ValueError(f"'{name}' does not begin and end at rest; shape a motion from rest to rest")
            values[name] = sum(
                (a * _held(time - d, t, rows, name) for a, d in zip(self.amplitudes, self.times, strict=True)),
                np.zeros((len(time), *rows.shape[1:])),
            )
        units = {name: trajectory.unit(name) for name in signals}
        return Trajectory(time, values, units, title=trajectory.title, synthetic=trajectory.synthetic)


def zero_vibration(frequency_Hz: float, damping: float = 0.0) -> Shaper:
    """Return the ZV shaper: two impulses, half a damped period apart, for a mode frequency [Hz] and damping ratio.

    The residual vibration is proportional to the frequency error. Raises ValueError if the frequency is not positive
    or the damping ratio is outside [0, 1).

    >>> shaper = gt.control.zero_vibration(5.0)
    >>> shaper.times.tolist(), shaper.amplitudes.tolist()
    ([0.0, 0.1], [0.5, 0.5])
    >>> shaper.residual([5.0, 5.5]).round(3).tolist()  # fraction of the unshaped vibration
    [0.0, 0.156]
    """
    return _shaper(frequency_Hz, damping, (1.0, 1.0))


def zero_vibration_derivative(frequency_Hz: float, damping: float = 0.0) -> Shaper:
    """Return the ZVD shaper: three impulses over one damped period, for a mode frequency [Hz] and damping ratio.

    The residual vibration grows with the square of the frequency error, but the motion ends half a period later than
    with `zero_vibration`. Raises ValueError as `zero_vibration`.

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
    """Return the vibration amplitude [m] of a mass on a spring at the end of a base motion from rest to rest.

    Args:
        time: (n,) [s], increasing.
        velocity: (n,) or (n, d) [m/s] of the base, linear between the times.
        frequency_Hz, damping: natural frequency [Hz] and damping ratio of the mode, scalars or (f,).

    Returns (f, d), without the first axis for scalar frequency and damping, without the second for velocities (n,).
    The deflection x obeys x'' + 2 zeta w x' + w^2 x = -dv/dt and starts at rest. The amplitude is the envelope at the
    end, |mu integral v exp(-mu (t - t_end)) dt| / w_d, exact for piecewise linear velocities. Raises ValueError if the
    motion does not begin and end at rest, or if shapes do not fit.

    >>> time, velocity = [0.0, 0.2, 0.6, 0.8], [0.0, 1.0, 1.0, 0.0]  # a trapezoid
    >>> gt.control.residual_vibration(time, velocity, [4.0, 5.0]).round(5).tolist()  # none at 5 Hz: ramps of one period
    [0.0177, 0.0]
    """
    t, v = np.asarray(time, float), np.asarray(velocity, float)
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(v))):
        raise ValueError("times or velocities are not all finite; cut the motion there or repair it")
    if t.ndim != 1 or len(t) < 2 or v.ndim not in (1, 2) or len(v) != len(t) or not _ascending(t):
        raise ValueError(f"expected increasing times (n,) and velocities (n,) or (n, d); found {t.shape} and {v.shape}")
    rows = v.reshape(len(t), -1)
    if np.abs(rows[[0, -1]]).max() > AT_REST * max(np.abs(rows).max(), 1e-300):
        raise ValueError("the motion does not begin and end at rest; residual vibration needs a motion that does")
    w_d, mu = _mode(frequency_Hz, damping)
    flat = mu.reshape(-1, 1)
    h = np.diff(t)
    starts = np.exp(-flat * (t[:-1] - t[-1]))
    factor = np.exp(-flat * h)
    constant = (1 - factor) / flat
    linear = (constant - h * factor) / flat / h
    integral = (starts * (constant - linear)) @ rows[:-1] + (starts * linear) @ rows[1:]
    amplitude = np.abs(flat * integral) / w_d.reshape(-1, 1)
    return amplitude.reshape((*mu.shape, *v.shape[1:]))


def _ascending(t: Array) -> bool:
    return bool(np.all(np.isfinite(t)) and np.all(np.diff(t) > 0))


def _mode(frequency_Hz: ArrayLike, damping: ArrayLike) -> tuple[Array, Array]:
    """Damped frequency w_d [rad/s] and mu = -zeta w + j w_d. Raises ValueError for a mode that does not oscillate."""
    w, zeta = np.broadcast_arrays(2 * np.pi * np.asarray(frequency_Hz, float), np.asarray(damping, float))
    if np.any(~((w > 0) & np.isfinite(w))) or np.any(~((zeta >= 0) & (zeta < 1))):
        raise ValueError("a mode needs a frequency above 0 and a damping ratio from 0 to below 1")
    w_d = w * np.sqrt(1 - zeta**2)
    return w_d, -zeta * w + 1j * w_d


def _shaper(frequency_Hz: float, damping: float, binomial: tuple[float, ...]) -> Shaper:
    w_d, mu = _mode(frequency_Hz, damping)
    half = np.pi / float(w_d)
    weights = np.array(binomial) * np.exp(float(np.real(mu)) * half) ** np.arange(len(binomial))
    amplitudes = weights / weights.sum()
    return Shaper(half * np.arange(len(binomial)), amplitudes)


_ROTATIONS = {
    "quaternion": "a unit quaternion",
    "direction": "a unit vector",
    "matrix": "a rotation matrix",
}


def _refuse_rotation(kinds: Natures, name: str) -> None:
    """Raise ValueError if a signal, or the signal it derives from, is a unit quaternion or vector or a rotation."""
    names = [n.removeprefix("der(").removesuffix(")").removesuffix(",2") for n in (name, name.partition("[")[0])]
    for group, base in ((g, base) for g in kinds for base in names if base in g and kinds[g] in _ROTATIONS):
        raise ValueError(
            f"'{base}' is {_ROTATIONS[kinds[group]]}, which a weighted sum of delayed copies is not; shape an angle "
            "or a rotation vector relative to the initial pose, and compute the orientation from it"
        )


def _held(t: Array, time: Array, rows: Array, name: str) -> Array:
    """Rows at t by linear interpolation; outside, a position is constant and a derivative is zero."""
    flat = rows.reshape(len(time), -1)
    outside = dict(left=0.0, right=0.0) if name.startswith("der(") else {}
    columns = [np.interp(t, time, flat[:, k], **outside) for k in range(flat.shape[1])]
    return np.column_stack(columns).reshape(len(t), *rows.shape[1:])
