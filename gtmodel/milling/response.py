"""Deflection under a given force by exact discretisation: matrix exponential once, then a recursion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..linear.state_space import held, ramped, second_order
from .cutter import tooth_frequency
from .oscillators import Oscillators

HOLDS = ("zero", "linear")


def responses(oscillators: Oscillators, F: ArrayLike, step: float, *, hold: str = "linear") -> Iterator[np.ndarray]:
    """Displacements x (t, 3) [m] of each pose under a force F (t, 3) [N], world coordinates, sampled every `step` [s];
    from rest.

    Exact for a force that is constant ("zero") or straight ("linear") between its samples: errors are of first and
    of second order in the step for other forces. Raises ValueError for another hold, shape or step, and for a force
    that is not finite.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> F = np.tile([100.0, 0.0, 0.0], (4001, 1))  # a step of 100 N
    >>> x = next(iter(gt.milling.responses(robot, F, step=1e-3)))  # of the first pose
    >>> (1e6 * x[-1]).round(1)  # [um]: F / k once it is at rest
    array([50.,  0.,  0.])
    """
    if hold not in HOLDS:
        raise ValueError(f"the hold is '{hold}'; expected one of {', '.join(HOLDS)}")
    F = checked_force(F, step)
    o = oscillators
    m, c, k = (x[..., None, None] for x in (o.m, o.c, o.k))
    A, B, _ = second_order(m, c, k, np.ones((1, 1)))
    b, a, start = recursion(A, B, step, hold)
    rows = np.ascontiguousarray(F.T)
    for pose in range(len(oscillators)):
        x = np.empty_like(rows)
        for j in range(3):
            x[j], _ = scipy.signal.lfilter(b[pose, j], a[pose, j], rows[j], zi=start[pose, j] * rows[j, 0])
        yield x.T


def checked_force(F: ArrayLike, step: float) -> np.ndarray:
    """F (t, 3) as an array. Raises ValueError for another shape, a number that is not finite, or no step."""
    F = np.asarray(F, float)
    if F.ndim != 2 or F.shape[1] != 3 or len(F) < 2:
        raise ValueError(f"the force has the shape {F.shape}; expected (t, 3) with two times or more")
    if not np.all(np.isfinite(F)):
        raise ValueError("the force holds a number that is not finite; expected finite numbers")
    if not step > 0:
        raise ValueError(f"the step is {step:g} s; expected more than 0")
    return F


def recursion(A: np.ndarray, B: np.ndarray, step: float, hold: str = "linear") -> tuple[np.ndarray, ...]:
    """Of s' = A s + B u, A (..., 2, 2), B (..., 2, 1): coefficients b, a (..., 3) of the first state's recursion in u,
    and the initial state (..., 2) of the filter per first input for which s starts at zero."""
    if hold == "linear":
        D, now, later = ramped(A, B, step)
    else:
        D, now = held(A, B, step)
        later = np.zeros_like(now)
    now, later = now[..., 0], later[..., 0]
    trace, det = D[..., 0, 0] + D[..., 1, 1], np.linalg.det(D)
    # Cayley-Hamilton: x[+2] - trace x[+1] + det x = (D - trace) B u and so on
    back = D[..., 0, :] - trace[..., None] * [1.0, 0.0]
    b = np.stack([later[..., 0], now[..., 0] + (back * later).sum(-1), (back * now).sum(-1)], axis=-1)
    a = np.stack([np.ones_like(trace), -trace, det], axis=-1)
    # rest at the first sample, whatever the input is there
    start = np.stack([-b[..., 0], now[..., 0] - b[..., 1]], axis=-1)
    return b, a, start


def steady_state(oscillators: Oscillators, spectrum: np.ndarray, speed: float, samples: int = 512) -> np.ndarray:
    """Displacements (n, samples, 3) [m] over one turn of the spindle at `speed` [1/s], all transients gone.

    spectrum (h + 1, 3): Fourier coefficients of the force in world coordinates by harmonics of the spindle. Raises
    ValueError for a speed that is not positive, a spectrum that is not finite, or fewer samples than twice the
    harmonics.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> axes = gt.milling.to_world(np.eye(3), feed=[1.0, 0.0, 0.0])
    >>> spectrum = gt.milling.force_spectrum(cutter, cut, harmonics=100) @ axes
    >>> x = gt.milling.steady_state(robot, spectrum, speed=25.0)
    >>> x.shape, round(1e3 * np.linalg.norm(x, axis=2).max(), 3)  # [mm]
    ((1, 512, 3), np.float64(0.028))
    """
    tooth_frequency(speed, 1)
    if not np.all(np.isfinite(spectrum)):
        raise ValueError("the spectrum holds a number that is not finite; expected finite numbers")
    n = np.arange(len(spectrum))
    if samples <= 2 * n[-1]:
        raise ValueError(f"{samples} samples cannot show {n[-1]} harmonics; expected more than {2 * n[-1]}")
    x = oscillators.receptance(2 * np.pi * speed * n) * spectrum
    return np.fft.irfft(x, samples, axis=1) * samples
