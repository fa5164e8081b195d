"""Milling forces as a smooth CasADi function: depths and feed may be variables of an optimisation."""

from __future__ import annotations

from typing import Any, get_args

import casadi as ca
import numpy as np

from .cutter import Cutter, Mode

WIDTH = 0.02  # of the gate, in cosines of the angle


def smooth_force_function(cutter: Cutter, mode: str, *, width: float = WIDTH, discs: int = 40) -> Any:
    """Return the CasADi function (phi [rad], a_e [m], a_p [m], f_t [m]) -> F (3) [N], feed, transverse and axial.

    The gate of each tooth is a logistic function of cos(phi_i - middle) - cos(half the immersion): periodic and
    differentiable everywhere; for width -> 0 the force is that of `forces`. a_e must stay between 0 and the diameter (a
    slot does not use a_e). Chips are not clipped. Raises ValueError for an unknown mode, a width that is not positive,
    or a cutter with runout.

    >>> from gtmodel.milling import CuttingCoefficients, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> F = gt.milling.smooth_force_function(cutter, "climb")
    >>> np.array(F(np.radians(150.0), 0.006, 0.002, 1e-4)).ravel().round(1)  # [N]
    array([66.3, 89.1,  0. ])
    """
    if mode not in get_args(Mode):
        raise ValueError(f"the mode is '{mode}'; expected one of {', '.join(get_args(Mode))}")
    if not width > 0 or discs < 1:
        raise ValueError(f"found a width of {width:g} and {discs} discs; expected more than 0 and at least 1")
    if cutter.runout is not None and np.any(cutter.runout):
        raise ValueError("smooth forces do not support runout; use forces() or a cutter without runout")
    phi, a_e, a_p, f_t = (ca.SX.sym(name) for name in ("phi", "a_e", "a_p", "f_t"))
    if mode == "slot":
        start, end = 0.0, np.pi
    else:
        immersed = ca.acos(1 - a_e / cutter.radius)
        start, end = (np.pi - immersed, np.pi) if mode == "climb" else (0.0, immersed)
    middle, limit = (start + end) / 2, ca.cos((end - start) / 2)
    k = cutter.coefficients
    F, dz = ca.SX.zeros(3), a_p / discs
    for angle, pitch in zip(cutter.angles, cutter.pitch, strict=True):
        feed = f_t * cutter.teeth * pitch / (2 * np.pi)
        for disc in range(discs):
            tooth = phi + angle - cutter.lag(1.0) * dz * (disc + 0.5)
            gate = (1 + ca.tanh((ca.cos(tooth - middle) - limit) / (2 * width))) / 2
            s, c = ca.sin(tooth), ca.cos(tooth)
            h = feed * s
            t, r, a = k.K_te + k.K_tc * h, k.K_re + k.K_rc * h, k.K_ae + k.K_ac * h
            F += gate * dz * ca.vertcat(-t * c - r * s, t * s - r * c, a)
    return ca.Function("milling_force", [phi, a_e, a_p, f_t], [F], ["phi", "a_e", "a_p", "f_t"], ["F"])
