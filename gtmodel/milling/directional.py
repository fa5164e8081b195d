"""How a displaced tool changes the cutting force: directional coefficients, Altintas and Budak 1995."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .cutter import Cutter, immersion
from .forces import to_world
from .oscillators import Oscillators


def directional_matrix(cutter: Cutter, phi: ArrayLike, start: float, end: float) -> np.ndarray:
    """D (n, 2, 2) [N/m2] of one tooth at angles phi (n,) [rad]: force in feed and transverse direction per depth of
    cut and displacement (x - x before), x the tool's displacement in the same directions."""
    phi = np.asarray(phi, float).ravel() % (2 * np.pi)
    s, c, k = np.sin(phi), np.cos(phi), cutter.coefficients
    push = np.stack([-(k.K_tc * c + k.K_rc * s), k.K_tc * s - k.K_rc * c], axis=-1)
    cuts = (phi >= start) & (phi <= end)
    return np.where(cuts[:, None, None], push[:, :, None] * np.stack([s, c], axis=-1)[:, None, :], 0.0)


def directional_antiderivative(cutter: Cutter, angle: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """(n, 2, 2) integral of `directional_matrix` over a tooth's angles (n,) [rad], whole turns included [N.rad/m2]."""
    turns = np.floor(angle / (2 * np.pi))
    inside = np.clip(angle - 2 * np.pi * turns, *span)
    ends = _integral(cutter, np.array(span))
    return _integral(cutter, inside) - ends[0] + turns[:, None, None] * (ends[1] - ends[0])


def mean_directional_matrix(cutter: Cutter, mode: str, radial_depth: float) -> np.ndarray:
    """Directional matrix D (2, 2) [N/m2] averaged over a turn, all teeth together, in closed form (Altintas and Budak
    1995).

    D times axial depth times displacement of the tool is the change of the force, both in feed and transverse
    direction.

    >>> from gtmodel.milling import CuttingCoefficients, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> gt.milling.mean_directional_matrix(cutter, "climb", radial_depth=0.006).round(-6) / 1e6  # [N/mm2]
    array([[  82., -178.],
           [ 154., -193.]])
    """
    start, end = immersion(mode, radial_depth, cutter.diameter)
    at = _integral(cutter, np.array([start, end]))
    return cutter.teeth / (2 * np.pi) * (at[1] - at[0])


def plane(feed: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """(2, 3) feed and transverse direction, world coordinates."""
    return to_world(np.eye(3)[:2], feed, up)


def receptance_in_plane(oscillators: Oscillators, omega: ArrayLike, P: np.ndarray) -> np.ndarray:
    """(w, 2, 2) [m/N] of one pose in feed and transverse direction."""
    H = oscillators.receptance(omega)[0]
    return np.einsum("ij,wj,kj->wik", P, H, P)


def _integral(cutter: Cutter, a: np.ndarray) -> np.ndarray:
    """(n, 2, 2) antiderivative of the matrix at angles (n,) within the cut."""
    k, double = cutter.coefficients, np.sin(2 * a) / 4
    ss, cc, sc = a / 2 - double, a / 2 + double, np.sin(a) ** 2 / 2
    D = [[-(k.K_tc * sc + k.K_rc * ss), -(k.K_tc * cc + k.K_rc * sc)],
         [k.K_tc * ss - k.K_rc * sc, k.K_tc * sc - k.K_rc * cc]]  # fmt: skip
    return np.moveaxis(np.array(D), -1, 0)
