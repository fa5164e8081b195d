"""Fourier coefficients of the milling forces in closed form: engagement, pitch and helix are all elementary."""

from __future__ import annotations

import numpy as np

from .cutter import Cut, Cutter, teeth_in_cut
from .forces import tooth_terms

# weights of exp(j p phi), p = -2..2, in 1, sin, cos, sin^2, sin cos
_EXPONENTIALS = np.array(
    [[0, 0, 1, 0, 0], [0, 0.5j, 0, -0.5j, 0], [0, 0.5, 0, 0.5, 0], [-0.25, 0, 0.5, 0, -0.25],
     [0.25j, 0, 0, 0, -0.25j]]
)  # fmt: skip


def force_spectrum(cutter: Cutter, cut: Cut, harmonics: int = 200) -> np.ndarray:
    """(harmonics + 1, 3) complex F_n [N]: F(phi) = Re(F_0 + 2 sum F_n exp(j n phi)), n counts turns of the spindle.

    With even teeth and no runout only multiples of the number of teeth are not zero. F_0 is the mean force.
    Raises ValueError for a negative number of harmonics.
    """
    if harmonics < 0:
        raise ValueError(f"found {harmonics} harmonics; expected none or more")
    n = np.arange(harmonics + 1)
    teeth, lag = teeth_in_cut(cutter, cut), cutter.lag(cut.axial_depth)
    # the mean of exp(-j n z tan(beta)/R) over the depth
    helix = cut.axial_depth * np.exp(-0.5j * n * lag) * np.sinc(n * lag / (2 * np.pi))
    found = np.zeros((harmonics + 1, 3), complex)
    for i, angle in enumerate(teeth.angle):
        order = np.arange(-2, 3)[None, :] - n[:, None]
        middle, width = (teeth.start[i] + teeth.end[i]) / 2, teeth.end[i] - teeth.start[i]
        integral = width * np.exp(1j * order * middle) * np.sinc(order * width / (2 * np.pi))
        terms = _EXPONENTIALS.T @ tooth_terms(cutter, teeth, i)
        found += (helix * np.exp(1j * n * angle))[:, None] * (integral @ terms) / (2 * np.pi)
    return found


def at_angles(spectrum: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """(n, 3) the truncated series at angles phi (n,) [rad]."""
    n = np.arange(len(spectrum))
    waves = np.exp(1j * np.outer(phi, n)) * np.where(n, 2, 1)
    return np.real(waves @ spectrum)
