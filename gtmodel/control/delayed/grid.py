"""Frequencies at which the response of a late loop is looked at: everywhere, and close where it turns fast."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...linear.state_space import continuous_poles

if TYPE_CHECKING:
    from .loop import DelayedLoop

EVEN = 1200  # frequencies up to the Nyquist frequency
LOW = 200  # more of them, by equal ratios, towards zero and towards the Nyquist frequency
LOWEST = 1e-6  # of the Nyquist frequency or the slowest pole
TURN = 24  # about each resonance, by equal turns of it
TAIL = 12  # of a decade of distance from a resonance
NARROW = 1e-10  # of the Nyquist frequency: the least width of a resonance
ON_A_POLE = 1e-13  # distance of a frequency from a pole at which the response is not asked
APART = 0.25  # relative change of the response from one frequency to the next at most
ROUNDS = 12  # of halving
WIDTH = 1e-12  # relative, of where a phase turns back


def frequencies(loop: DelayedLoop) -> np.ndarray:
    """Angular frequencies (w,) [rad/s] up to the Nyquist one, close where the response turns fast."""
    top = np.pi / loop.cycle
    z = np.concatenate(loop.poles)
    poles = continuous_poles(z[np.abs(z) > 1e-12], loop.cycle)
    slow = np.abs(poles[np.abs(poles) > WIDTH * top])
    low = LOWEST * min(top, float(slow.min(initial=top)))
    towards = np.geomspace(low / top, 1.0, LOW)
    grids = [np.linspace(0, top, max(EVEN, 40 * (loop.split[0] + 2)) + 1)[1:], top * towards,
             top * (1 - np.geomspace(LOWEST, 0.1, LOW // 4))]  # fmt: skip
    for pole in poles[poles.imag > 0]:
        wide = max(np.abs(pole.real), NARROW * top)
        tails = wide * np.geomspace(10.0, max(20.0, top / wide), 2 + int(TAIL * np.log10(max(20.0, top / wide))))
        grids += [pole.imag + wide * np.tan(np.pi / 2 * np.linspace(-1, 1, 2 * TURN + 1)[1:-1]),
                  pole.imag + tails, pole.imag - tails]  # fmt: skip
    w = np.unique(np.concatenate(grids))
    return off_poles(loop, w[(w >= low) & (w <= top)])


def sampled_response(loop: DelayedLoop) -> tuple[np.ndarray, np.ndarray]:
    """Angular frequencies (w,) [rad/s] and the response (w,) there, halved where it changes much."""
    w = frequencies(loop)
    g = loop.response(w)
    for _ in range(ROUNDS):
        size = np.abs(g)
        far = np.flatnonzero(np.abs(np.diff(g)) > APART * np.minimum(size[:-1], size[1:]))
        between = (w[far] + w[far + 1]) / 2
        between = off_poles(loop, between[(between > w[far]) & (between < w[far + 1])])
        if not len(between):
            break
        w, g = np.concatenate([w, between]), np.concatenate([g, loop.response(between)])
        order = np.argsort(w, kind="stable")
        w, g = w[order], g[order]
    return w, g


def off_poles(loop: DelayedLoop, w: np.ndarray) -> np.ndarray:
    """Those of the frequencies (w,) at which the response is finite."""
    return w[np.abs(np.exp(1j * w * loop.cycle)[:, None] - np.concatenate(loop.poles)).min(axis=1) > ON_A_POLE]
