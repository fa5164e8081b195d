"""Where the frequency response of a loop meets the negative real axis, and where it has a size of one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from .loop import DelayedLoop

EVEN = 1200  # frequencies up to the Nyquist frequency
LOW = 200  # more of them, by equal ratios, towards zero
LOWEST = 1e-6  # of the Nyquist frequency
TURN = 24  # about each resonance, by equal turns of it
EXACT = 1e-15  # relative, of a frequency


def frequencies(loop: DelayedLoop) -> np.ndarray:
    """Angular frequencies (w,) [rad/s] up to the Nyquist one, close where the response turns fast."""
    top = np.pi / loop.cycle
    turns = loop.split[0] + 2
    grids = [np.linspace(0, top, max(EVEN, 40 * turns) + 1)[1:], top * np.geomspace(LOWEST, 1.0, LOW)]
    poles = np.log(_nonzero(np.linalg.eigvals(loop.transition[0]))) / loop.cycle
    for pole in poles[poles.imag > 0]:
        wide = np.abs(pole.real) + 1e-12 * top
        grids.append(pole.imag + wide * np.tan(np.pi / 2 * np.linspace(-1, 1, 2 * TURN + 1)[1:-1]))
    w = np.unique(np.concatenate(grids))
    return w[(w >= LOWEST * top) & (w <= top)]


def gain_crossings(loop: DelayedLoop) -> np.ndarray:
    """(n, 2) gains at which a pole lies on the unit circle, rising, and its angular frequency [rad/s].

    At such a gain P L = -1; whether the loop loses or wins a stable pole there its eigenvalues say.
    """
    w = frequencies(loop)
    g = loop.response(w)
    real, imaginary = np.real(g), np.imag(g)
    rows = []
    inside = np.flatnonzero((np.sign(imaginary[:-1]) != np.sign(imaginary[1:])) & (np.minimum(real[:-1], real[1:]) < 0))
    for i in inside[w[inside + 1] < np.pi / loop.cycle].tolist():
        at = _root(lambda x: _at(loop, x).imag, float(w[i]), float(w[i + 1]))
        if _at(loop, at).real < 0:
            rows.append((-1 / _at(loop, at).real, at))
    if real[-1] < 0:  # real by symmetry at the Nyquist frequency
        rows.append((-1 / float(real[-1]), float(w[-1])))
    static = _static(loop)
    if static < 0:
        rows.append((-1 / static, 0.0))
    return np.array(sorted(rows), float).reshape(-1, 2)


def size_crossings(loop: DelayedLoop, gain: float) -> np.ndarray:
    """Angular frequencies (n,) [rad/s], rising, at which P L has a size of one."""
    w = frequencies(loop)
    above = np.abs(gain * loop.response(w)) > 1

    def log_size(x: float) -> float:
        return float(np.log(np.abs(gain * _at(loop, x))))

    edges = np.flatnonzero(above[:-1] != above[1:]).tolist()
    return np.array([_root(log_size, float(w[i]), float(w[i + 1])) for i in edges])


def _at(loop: DelayedLoop, omega: float) -> complex:
    return complex(loop.response(np.array([omega]))[0])


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    if f(low) == 0:
        return low
    if np.sign(f(low)) == np.sign(f(high)):  # a root on the grid, up to rounding
        return high if abs(f(high)) < abs(f(low)) else low
    return float(scipy.optimize.brentq(f, low, high, xtol=EXACT * high, rtol=4 * EXACT))


def _static(loop: DelayedLoop) -> float:
    """L at frequency zero; 0 where it has no end there, for then no real pole crosses at one."""
    a, early, late = loop.transition
    poles = np.abs(np.linalg.eigvals(a) - 1)
    la, lb, lc, ld = loop.law_matrices
    if poles.min() < LOWEST or (len(la) and np.abs(np.linalg.eigvals(la) - 1).min() < LOWEST):
        return 0.0
    plant = float(loop.plant.C @ np.linalg.solve(np.eye(len(a)) - a, early + late))
    return plant * (ld + float(lc @ np.linalg.solve(np.eye(len(la)) - la, lb)) if len(la) else ld)


def _nonzero(poles: np.ndarray) -> np.ndarray:
    return poles[np.abs(poles) > 1e-12].astype(complex)
