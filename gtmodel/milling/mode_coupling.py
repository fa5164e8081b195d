"""Chatter by mode coupling: two orthogonal modes close to each other, the force between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..linear.state_space import second_order
from .cutter import Cut, Cutter
from .directional import mean_directional_matrix, plane
from .forces import to_world
from .oscillators import Oscillators
from .spectrum import force_spectrum

CLOSE = 0.2  # relative distance of two modes that counts as close
BETWEEN = (15.0, 75.0)  # angle [deg] of the force from the first mode's axis that counts as between
DEEPEST = 1.0  # m; beyond it no cut is looked for


@dataclass(frozen=True)
class ModeCoupling:
    """Mode coupling of one pose and cut.

    pair: axes (0 to 2 for x to z) of the two modes that are judged. apart: their distance relative to the higher one.
    angle [deg]: of the mean force between their axes, 0 to 90. critical_depth [m]: axial depth at which the linear
    model turns unstable without regeneration, infinite if there is none below 1 m. warn: whether chatter is possible or
    to be expected. sentence: the verdict in words.
    """

    pair: tuple[int, int]
    apart: float
    angle: float
    critical_depth: float
    warn: bool
    message: str


def mode_coupling(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0)
) -> ModeCoupling:
    """Whether the first pose chatters by mode coupling. The two modes that the plane of the force excites are judged
    (Cvitanic 2021, section 3.3.3).

    m x'' + c x' + (k - a D) x = 0 with the mean directional matrix D turns unstable at the critical depth. Warns where
    that is less than the depth of the cut, or where the modes are close and the mean force points between them.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> coupling = gt.milling.mode_coupling(robot, cutter, cut, feed=[1.0, 0.0, 0.0])
    >>> round(1e3 * coupling.critical_depth, 2), coupling.warn  # [mm]; deeper than that it chatters
    (0.96, True)
    """
    F = to_world(force_spectrum(cutter, cut, 0)[0].real, feed, up)
    f = oscillators.frequency[0]
    share = (plane(feed, up) ** 2).sum(axis=0)
    first, second = sorted(np.argsort(-share, kind="stable")[:2].tolist())
    apart = float(abs(f[first] - f[second]) / max(f[first], f[second]))
    angle = float(np.rad2deg(np.arctan2(abs(F[second]), abs(F[first]))))
    depth = critical_depth(oscillators, cutter, cut, feed, up=up)
    between = BETWEEN[0] <= angle <= BETWEEN[1]
    unstable, near = depth <= cut.axial_depth, apart <= CLOSE and between
    names = f"{'xyz'[first]} ({f[first]:.3g} Hz) and {'xyz'[second]} ({f[second]:.3g} Hz)"
    cause = f"modes {names} are {100 * apart:.0f} % apart, the mean force {angle:.0f} deg from {'xyz'[first]}"
    limit = f"beyond {1e3 * depth:.3g} mm" if np.isfinite(depth) else "at no depth below 1 m"
    verdict = "mode-coupling chatter is to be expected" if unstable else (
        "mode coupling is possible" if near else "no sign of mode coupling")  # fmt: skip
    return ModeCoupling((first, second), apart, angle, depth, unstable or near,
                        f"{verdict}: {cause}; the linear model turns unstable {limit}")  # fmt: skip


def critical_depth(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0)
) -> float:
    """Least axial depth [m] at which the first pose turns unstable by mode coupling alone; infinite if there is none
    below 1 m.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> round(1e3 * gt.milling.critical_depth(robot, cutter, cut, feed=[1.0, 0.0, 0.0]), 2)  # [mm]
    0.96
    """
    P = plane(feed, up)
    D = P.T @ mean_directional_matrix(cutter, cut.mode, cut.radial_depth) @ P
    m, c, k = (np.diag(x[0]) for x in (oscillators.m, oscillators.c, oscillators.k))

    def growth(depth: np.ndarray | float) -> np.ndarray:
        A, *_ = second_order(m, c, k - np.reshape(depth, (-1, 1, 1)) * D, m[:, :0])
        return np.linalg.eigvals(A).real.max(axis=1)

    depths = np.geomspace(1e-6, DEEPEST, 600)
    unstable = np.flatnonzero(growth(depths) > 0)
    if not len(unstable):
        return np.inf
    i = int(unstable[0])
    if i == 0:
        return float(depths[0])
    root: Any = scipy.optimize.brentq(lambda a: float(growth(a)[0]), depths[i - 1], depths[i], xtol=1e-12)
    return float(root)
