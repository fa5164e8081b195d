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
    """Fourier coefficients (harmonics + 1, 3) [N], complex: F(phi) = Re(F_0 + 2 sum F_n exp(j n phi)).

    The directions are feed, transverse and axial; n counts harmonics of the spindle.

    With evenly spaced teeth and no runout only multiples of the number of teeth are not zero. F_0 is the mean force.
    Raises ValueError for a negative number of harmonics.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> F = gt.milling.force_spectrum(cutter, cut, harmonics=4)
    >>> np.abs(F[:, 1]).round(1)  # [N], transverse; two teeth: even harmonics of the spindle only
    array([37.1,  0. , 31.7,  0. , 19.5])
    """
    if harmonics < 0:
        raise ValueError(f"found {harmonics} harmonics; expected none or more")
    n = np.arange(harmonics + 1)
    teeth, lag = teeth_in_cut(cutter, cut), cutter.lag(cut.axial_depth)
    # the mean of exp(-j n z tan(beta)/R) over the depth
    helix = cut.axial_depth * np.exp(-0.5j * n * lag) * np.sinc(n * lag / (2 * np.pi))
    spectrum = np.zeros((harmonics + 1, 3), complex)
    for i, angle in enumerate(teeth.angle):
        order = np.arange(-2, 3)[None, :] - n[:, None]
        middle, width = (teeth.start[i] + teeth.end[i]) / 2, teeth.end[i] - teeth.start[i]
        integral = width * np.exp(1j * order * middle) * np.sinc(order * width / (2 * np.pi))
        terms = _EXPONENTIALS.T @ tooth_terms(cutter, teeth, i)
        spectrum += (helix * np.exp(1j * n * angle))[:, None] * (integral @ terms) / (2 * np.pi)
    return spectrum


def at_angles(spectrum: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Forces (n, 3) [N] of a truncated Fourier series, as `force_spectrum` gives it, at spindle angles phi (n,) [rad].

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> phi = np.radians([150.0])
    >>> series = gt.milling.at_angles(gt.milling.force_spectrum(cutter, cut, 200), phi)
    >>> np.abs(series - gt.milling.integrated_forces(cutter, cut, phi)).max() < 1.0  # [N]
    np.True_
    """
    n = np.arange(len(spectrum))
    waves = np.exp(1j * np.outer(phi, n)) * np.where(n, 2, 1)
    return np.real(waves @ spectrum)
