"""Mechanistic milling forces, Cvitanic 2021, eqs. (12)-(17): summed over discs, and in closed form over the helix."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .cutter import Cut, Cutter, Teeth, teeth_in_cut

DISCS = 100
# below this lag [rad] differences of the antiderivative lose more digits than the midpoint of the helix costs
STRAIGHT = 1e-7
THIN = 1e-3  # of a sample: a lag below it counts as its middle, likewise
BESIDE = 1e-9  # rad, within an edge of the cut


def forces(cutter: Cutter, cut: Cut, phi: ArrayLike, discs: int = DISCS) -> np.ndarray:
    """Forces (n, 3) on the cutter [N] at spindle angles phi (n,) [rad], by a sum over discs (Cvitanic 2021, eqs.
    (12)-(17)).

    Their directions are feed, transverse and axial; `to_world` turns them into world coordinates.

    phi is measured from the transverse axis in the sense of turning; tooth i stands at phi + its angle, at height z
    behind by z tan(helix)/R. Raises ValueError for a depth beyond the diameter or less than one disc.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> gt.milling.forces(cutter, cut, np.radians([90.0, 150.0])).round(1)  # before the cut, and in it
    array([[ 0. ,  0. ,  0. ],
           [66.3, 89.1,  0. ]])
    """
    if discs < 1:
        raise ValueError(f"found {discs} discs; expected at least one")
    phi = np.asarray(phi, float).ravel()
    teeth, dz = teeth_in_cut(cutter, cut), cut.axial_depth / discs
    lag = cutter.lag(1.0) * dz * (np.arange(discs) + 0.5)
    force = np.zeros((len(phi), 3))
    for i, angle in enumerate(teeth.angle):
        turned = (phi[:, None] + angle - lag) % (2 * np.pi)
        force += _at(turned, cutter, teeth, i).sum(axis=1) * dz
    return force


def integrated_forces(cutter: Cutter, cut: Cut, phi: ArrayLike) -> np.ndarray:
    """Forces (n, 3) on the cutter [N], as `forces`, by closed-form integration over the helix: exact at any helix
    angle.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8), helix=0.5)
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> phi = np.radians([117.0])  # a tooth enters
    >>> gt.milling.integrated_forces(cutter, cut, phi).round(2)
    array([[  7.06, 102.27,   0.  ]])
    >>> gt.milling.forces(cutter, cut, phi, discs=20).round(2)
    array([[  7.08, 102.92,   0.  ]])
    """
    phi = np.asarray(phi, float).ravel()
    teeth, lag = teeth_in_cut(cutter, cut), cutter.lag(cut.axial_depth)
    force = np.zeros((len(phi), 3))
    for i, angle in enumerate(teeth.angle):
        at = phi + angle
        if lag < STRAIGHT:
            force += cut.axial_depth * _at((at - lag / 2) % (2 * np.pi), cutter, teeth, i)
            continue
        behind = _antiderivative(at, cutter, teeth, i) - _antiderivative(at - lag, cutter, teeth, i)
        force += behind * cut.axial_depth / lag
    return force


def mean_forces(cutter: Cutter, cut: Cut, phi: ArrayLike, width: float) -> np.ndarray:
    """`integrated_forces` (n, 3) [N] averaged from phi - width/2 to phi + width/2 [rad], in closed form.

    Samples that are one width apart then carry the whole impulse, however short the cut of a tooth. Raises ValueError
    for a width that is not positive.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> phi = 2 * np.pi * np.arange(8) / 8
    >>> gt.milling.mean_forces(cutter, cut, phi, width=2 * np.pi / 8).mean(axis=0).round(2)  # [N]
    array([17.32, 37.11,  0.  ])
    >>> gt.milling.force_spectrum(cutter, cut, 0)[0].real.round(2)
    array([17.32, 37.11,  0.  ])
    """
    if not width > 0:
        raise ValueError(f"the width is {width:g} rad; expected more than 0")
    phi = np.asarray(phi, float).ravel()
    teeth, lag = teeth_in_cut(cutter, cut), cutter.lag(cut.axial_depth)
    force = np.zeros((len(phi), 3))
    for i, angle in enumerate(teeth.angle):
        late, early = phi + angle + width / 2, phi + angle - width / 2
        if lag < max(STRAIGHT, THIN * width):
            behind = _antiderivative(late - lag / 2, cutter, teeth, i) - _antiderivative(
                early - lag / 2, cutter, teeth, i
            )
            force += behind * cut.axial_depth / width
            continue
        behind = np.zeros((len(phi), 3))
        for sign, at in ((1, late), (-1, early), (-1, late - lag), (1, early - lag)):
            behind += sign * _second_antiderivative(at, cutter, teeth, i)
        force += behind * cut.axial_depth / (lag * width)
    return force


def peak_force(cutter: Cutter, cut: Cut, samples: int = 3600) -> np.ndarray:
    """Force (3,) [N], feed, transverse, axial, at the spindle angle where its norm is largest.

    It is the input of the static index (Cvitanic 2021, eq. (18)).

    Tried at `samples` angles and wherever a tooth enters or leaves with its tip or its upper end.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> gt.milling.peak_force(cutter, cut).round(1)
    array([  7.6, 189.8,   0. ])
    """
    teeth, lag = teeth_in_cut(cutter, cut), cutter.lag(cut.axial_depth)
    ends = (teeth.start + BESIDE, teeth.end - BESIDE)
    corners = [edge + late - teeth.angle for edge in ends for late in (0.0, lag)]
    phi = np.concatenate([2 * np.pi * np.arange(samples) / samples, *corners])
    F = integrated_forces(cutter, cut, phi)
    return F[np.argmax(np.linalg.norm(F, axis=1))]


def to_world(F: ArrayLike, feed: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Forces (..., 3), given along feed, transverse and axial direction, in world coordinates.

    feed (3,): direction of the cutter over the workpiece; up (3,): along the tool axis, from tip to spindle. The
    transverse axis is up x feed. Raises ValueError where feed has a part along the tool axis or no length.

    >>> gt.milling.to_world([10.0, 1.0, 0.0], feed=[0.0, 1.0, 0.0])  # transverse: up x feed = -x
    array([-1., 10.,  0.])
    """
    f, u = np.asarray(feed, float), np.asarray(up, float)
    f_length, u_length = np.linalg.norm(f), np.linalg.norm(u)
    if not (f_length > 0 and u_length > 0):
        raise ValueError(f"feed direction {f.tolist()} and tool axis {u.tolist()} must not be zero")
    f, u = f / f_length, u / u_length
    if abs(f @ u) > 1e-6:
        raise ValueError(f"the feed direction {f.tolist()} runs along the tool axis; expected one across it")
    return np.asarray(F, float) @ np.stack([f, np.cross(u, f), u])


def tooth_terms(cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """(5, 3) force of tooth i per depth [N/m] as weights of 1, sin, cos, sin^2, sin cos of its angle."""
    (e_t, e_r, e_a) = cutter.coefficients.edge + cutter.coefficients.cutting * teeth.offset[i]
    (q_t, q_r, q_a) = cutter.coefficients.cutting * teeth.feed[i]
    return np.array([[0, 0, e_a], [-e_r, e_t, q_a], [-e_t, -e_r, 0], [-q_r, q_t, 0], [-q_t, -q_r, 0]])


def _at(turned: np.ndarray, cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """(..., 3) [N/m] of tooth i at angles within one turn, eqs. (12)-(17) before the integral over z."""
    s, c = np.sin(turned), np.cos(turned)
    chip = teeth.feed[i] * s + teeth.offset[i]
    edge, cutting = cutter.coefficients.edge, cutter.coefficients.cutting
    tangential, radial, axial = (edge[j] + cutting[j] * chip for j in range(3))
    cuts = (turned >= teeth.start[i]) & (turned <= teeth.end[i])
    F = np.stack([-tangential * c - radial * s, tangential * s - radial * c, axial], axis=-1)
    return np.where(cuts[..., None], F, 0.0)


def _antiderivative(angle: np.ndarray, cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """(n, 3) integral of the force of tooth i per depth over its angle, whole turns included [N.rad/m]."""
    turns = np.floor(angle / (2 * np.pi))
    inside = np.clip(angle - 2 * np.pi * turns, teeth.start[i], teeth.end[i])
    ends = _primitives(np.stack([teeth.start[i], teeth.end[i]]))
    terms = tooth_terms(cutter, teeth, i)
    return (_primitives(inside) - ends[0] + turns[:, None] * (ends[1] - ends[0])) @ terms


def _second_antiderivative(angle: np.ndarray, cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """(n, 3) integral of `_antiderivative` from 0 [N.rad2/m]."""
    start, end = teeth.start[i], teeth.end[i]
    turns = np.floor(angle / (2 * np.pi))
    at = angle - 2 * np.pi * turns
    inside = np.clip(at, start, end)
    first, whole = _primitives(np.array([start])), np.diff(_primitives(np.array([start, end])), axis=0)

    def within(a: np.ndarray) -> np.ndarray:
        return _second_primitives(a) - _second_primitives(np.array([start])) - (a - start)[:, None] * first

    turn = within(np.array([end])) + (2 * np.pi - end) * whole
    done = (np.pi * turns * (turns - 1) + turns * at + np.maximum(at - end, 0))[:, None] * whole
    return (done + turns[:, None] * turn + within(inside)) @ tooth_terms(cutter, teeth, i)


def _primitives(a: np.ndarray) -> np.ndarray:
    """(n, 5) of 1, sin, cos, sin^2, sin cos."""
    s = np.sin(a)
    return np.stack([a, -np.cos(a), s, a / 2 - np.sin(2 * a) / 4, s * s / 2], axis=-1)


def _second_primitives(a: np.ndarray) -> np.ndarray:
    """(n, 5) antiderivatives of `_primitives`."""
    double = np.sin(2 * a) / 8
    return np.stack([a * a / 2, -np.sin(a), -np.cos(a), a * a / 4 + np.cos(2 * a) / 8, a / 4 - double], axis=-1)
