"""Mechanistic milling forces (Cvitanic 2021, eqs. (12)-(17)) from discs and in closed form, their Fourier coefficients,
and their change with a displacement of the tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .cutter import Cut, Cutter, Teeth, immersion, teeth_in_cut
from .oscillators import Oscillators

DISCS = 100
# below this lag [rad] the midpoint of the helix is more accurate than a difference of antiderivatives
STRAIGHT = 1e-7
THIN = 1e-3  # share of a sample below which a lag is replaced by its midpoint, for the same reason
BESIDE = 1e-9  # rad, inside an edge of the cut


def forces(cutter: Cutter, cut: Cut, phi: ArrayLike, discs: int = DISCS) -> np.ndarray:
    """Return the forces (n, 3) on the cutter [N] at spindle angles phi (n,) [rad], summed over discs (Cvitanic 2021,
    eqs. (12)-(17)).

    The components are feed, transverse and axial; `to_world` transforms them to world coordinates.

    phi is measured from the transverse axis in the sense of rotation; tooth i is at phi plus its angle, and lags by
    z tan(helix)/R at height z. Raises ValueError for a radial depth beyond the diameter or less than one disc.

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
        tooth = (phi[:, None] + angle - lag) % (2 * np.pi)
        force += _force_density(tooth, cutter, teeth, i).sum(axis=1) * dz
    return force


def integrated_forces(cutter: Cutter, cut: Cut, phi: ArrayLike) -> np.ndarray:
    """Return the forces (n, 3) on the cutter [N] like `forces`, integrated over the helix in closed form: exact for any
    helix angle.

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
        tip = phi + angle
        if lag < STRAIGHT:
            force += cut.axial_depth * _force_density((tip - lag / 2) % (2 * np.pi), cutter, teeth, i)
            continue
        integral = _antiderivative(tip, cutter, teeth, i) - _antiderivative(tip - lag, cutter, teeth, i)
        force += integral * cut.axial_depth / lag
    return force


def mean_forces(cutter: Cutter, cut: Cut, phi: ArrayLike, width: float) -> np.ndarray:
    """Return `integrated_forces` (n, 3) [N] averaged from phi - width/2 to phi + width/2 [rad], in closed form.

    Samples spaced by one width then carry the whole impulse, however short the cut of a tooth. Raises ValueError for a
    width that is not positive.

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
            integral = _antiderivative(late - lag / 2, cutter, teeth, i) - _antiderivative(
                early - lag / 2, cutter, teeth, i
            )
            force += integral * cut.axial_depth / width
            continue
        integral = np.zeros((len(phi), 3))
        for sign, limit in ((1, late), (-1, early), (-1, late - lag), (1, early - lag)):
            integral += sign * _second_antiderivative(limit, cutter, teeth, i)
        force += integral * cut.axial_depth / (lag * width)
    return force


def peak_force(cutter: Cutter, cut: Cut, samples: int = 3600) -> np.ndarray:
    """Return the force (3,) [N], feed, transverse, axial, at the spindle angle with the largest norm.

    It is the input of the static index (Cvitanic 2021, eq. (18)). Candidates are `samples` angles, and the angles at
    which the tip or the upper end of a tooth enters or leaves the cut.

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
    """Transform forces (..., 3) from feed, transverse and axial directions to world coordinates.

    feed (3,): direction of the cutter over the workpiece; up (3,): along the tool axis, from tip to spindle. The
    transverse axis is up x feed. Raises ValueError if feed is zero or not perpendicular to the tool axis.

    >>> gt.milling.to_world([10.0, 1.0, 0.0], feed=[0.0, 1.0, 0.0])  # transverse: up x feed = -x
    array([-1., 10.,  0.])
    """
    f, u = np.asarray(feed, float), np.asarray(up, float)
    f_length, u_length = np.linalg.norm(f), np.linalg.norm(u)
    if not (f_length > 0 and u_length > 0):
        raise ValueError(f"feed direction {f.tolist()} and tool axis {u.tolist()} must not be zero")
    f, u = f / f_length, u / u_length
    if abs(f @ u) > 1e-6:
        raise ValueError(f"the feed direction {f.tolist()} is not perpendicular to the tool axis")
    return np.asarray(F, float) @ np.stack([f, np.cross(u, f), u])


def tooth_terms(cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """Return the force of tooth i per depth [N/m] as weights (5, 3) of 1, sin, cos, sin^2, sin cos of its angle."""
    (e_t, e_r, e_a) = cutter.coefficients.edge + cutter.coefficients.cutting * teeth.offset[i]
    (q_t, q_r, q_a) = cutter.coefficients.cutting * teeth.feed[i]
    return np.array([[0, 0, e_a], [-e_r, e_t, q_a], [-e_t, -e_r, 0], [-q_r, q_t, 0], [-q_t, -q_r, 0]])


def _force_density(phi: np.ndarray, cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """Return the force (..., 3) [N/m] of tooth i at angles within one turn: integrand over z of eqs. (12)-(17)."""
    s, c = np.sin(phi), np.cos(phi)
    chip = teeth.feed[i] * s + teeth.offset[i]
    edge, cutting = cutter.coefficients.edge, cutter.coefficients.cutting
    tangential, radial, axial = (edge[j] + cutting[j] * chip for j in range(3))
    cuts = (phi >= teeth.start[i]) & (phi <= teeth.end[i])
    F = np.stack([-tangential * c - radial * s, tangential * s - radial * c, axial], axis=-1)
    return np.where(cuts[..., None], F, 0.0)


def _antiderivative(angle: np.ndarray, cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """Return the integral (n, 3) of tooth i's force per depth over its angle, including whole turns [N.rad/m]."""
    turns = np.floor(angle / (2 * np.pi))
    inside = np.clip(angle - 2 * np.pi * turns, teeth.start[i], teeth.end[i])
    ends = _primitives(np.stack([teeth.start[i], teeth.end[i]]))
    terms = tooth_terms(cutter, teeth, i)
    return (_primitives(inside) - ends[0] + turns[:, None] * (ends[1] - ends[0])) @ terms


def _second_antiderivative(angle: np.ndarray, cutter: Cutter, teeth: Teeth, i: int) -> np.ndarray:
    """Return the integral (n, 3) of `_antiderivative` from 0 [N.rad2/m]."""
    start, end = teeth.start[i], teeth.end[i]
    turns = np.floor(angle / (2 * np.pi))
    rest = angle - 2 * np.pi * turns
    inside = np.clip(rest, start, end)
    first, whole = _primitives(np.array([start])), np.diff(_primitives(np.array([start, end])), axis=0)

    def within(a: np.ndarray) -> np.ndarray:
        return _second_primitives(a) - _second_primitives(np.array([start])) - (a - start)[:, None] * first

    turn = within(np.array([end])) + (2 * np.pi - end) * whole
    done = (np.pi * turns * (turns - 1) + turns * rest + np.maximum(rest - end, 0))[:, None] * whole
    return (done + turns[:, None] * turn + within(inside)) @ tooth_terms(cutter, teeth, i)


def _primitives(a: np.ndarray) -> np.ndarray:
    """Return antiderivatives (n, 5) of 1, sin, cos, sin^2, sin cos."""
    s = np.sin(a)
    return np.stack([a, -np.cos(a), s, a / 2 - np.sin(2 * a) / 4, s * s / 2], axis=-1)


def _second_primitives(a: np.ndarray) -> np.ndarray:
    """Return antiderivatives (n, 5) of `_primitives`."""
    double = np.sin(2 * a) / 8
    return np.stack([a * a / 2, -np.sin(a), -np.cos(a), a * a / 4 + np.cos(2 * a) / 8, a / 4 - double], axis=-1)


def directional_matrix(cutter: Cutter, phi: ArrayLike, start: float, end: float) -> np.ndarray:
    """Return D (n, 2, 2) [N/m2] of one tooth at angles phi (n,) [rad]: force in feed and transverse direction per depth
    of cut and per relative displacement, x now minus x one tooth period earlier."""
    phi = np.asarray(phi, float).ravel() % (2 * np.pi)
    s, c, k = np.sin(phi), np.cos(phi), cutter.coefficients
    push = np.stack([-(k.K_tc * c + k.K_rc * s), k.K_tc * s - k.K_rc * c], axis=-1)
    cuts = (phi >= start) & (phi <= end)
    return np.where(cuts[:, None, None], push[:, :, None] * np.stack([s, c], axis=-1)[:, None, :], 0.0)


def directional_antiderivative(cutter: Cutter, angle: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Return the integral (n, 2, 2) of `directional_matrix` over a tooth's angles (n,) [rad], including whole turns
    [N.rad/m2]."""
    turns = np.floor(angle / (2 * np.pi))
    inside = np.clip(angle - 2 * np.pi * turns, *span)
    ends = _integral(cutter, np.array(span))
    return _integral(cutter, inside) - ends[0] + turns[:, None, None] * (ends[1] - ends[0])


def mean_directional_matrix(cutter: Cutter, mode: str, radial_depth: float) -> np.ndarray:
    """Return the directional matrix D (2, 2) [N/m2] averaged over a turn, summed over the teeth, in closed form
    (Altintas and Budak 1995).

    D times axial depth times displacement of the tool is the change of the force, in feed and transverse direction.

    >>> from gtmodel.milling import CuttingCoefficients, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> gt.milling.mean_directional_matrix(cutter, "climb", radial_depth=0.006).round(-6) / 1e6  # [N/mm2]
    array([[  82., -178.],
           [ 154., -193.]])
    """
    start, end = immersion(mode, radial_depth, cutter.diameter)
    ends = _integral(cutter, np.array([start, end]))
    return cutter.teeth / (2 * np.pi) * (ends[1] - ends[0])


def plane(feed: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Return feed and transverse direction (2, 3), world coordinates."""
    return to_world(np.eye(3)[:2], feed, up)


def receptance_in_plane(oscillators: Oscillators, omega: ArrayLike, P: np.ndarray) -> np.ndarray:
    """Return the receptance (w, 2, 2) [m/N] of the first pose in feed and transverse direction."""
    H = oscillators.receptance(omega)[0]
    return np.einsum("ij,wj,kj->wik", P, H, P)


def _integral(cutter: Cutter, a: np.ndarray) -> np.ndarray:
    """Return the antiderivative (n, 2, 2) of the directional matrix at angles (n,) within the cut."""
    k, double = cutter.coefficients, np.sin(2 * a) / 4
    ss, cc, sc = a / 2 - double, a / 2 + double, np.sin(a) ** 2 / 2
    D = [[-(k.K_tc * sc + k.K_rc * ss), -(k.K_tc * cc + k.K_rc * sc)],
         [k.K_tc * ss - k.K_rc * sc, k.K_tc * sc - k.K_rc * cc]]  # fmt: skip
    return np.moveaxis(np.array(D), -1, 0)


# weights of exp(j p phi), p = -2..2, in 1, sin, cos, sin^2, sin cos
_EXPONENTIALS = np.array(
    [[0, 0, 1, 0, 0], [0, 0.5j, 0, -0.5j, 0], [0, 0.5, 0, 0.5, 0], [-0.25, 0, 0.5, 0, -0.25],
     [0.25j, 0, 0, 0, -0.25j]]
)  # fmt: skip


def force_spectrum(cutter: Cutter, cut: Cut, harmonics: int = 200) -> np.ndarray:
    """Return complex Fourier coefficients (harmonics + 1, 3) [N]: F(phi) = Re(F_0 + 2 sum F_n exp(j n phi)).

    The components are feed, transverse and axial; n counts harmonics of the spindle. F_0 is the mean force. With evenly
    spaced teeth and no runout only multiples of the number of teeth are nonzero. Raises ValueError for a negative
    number of harmonics.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> F = gt.milling.force_spectrum(cutter, cut, harmonics=4)
    >>> np.abs(F[:, 1]).round(1)  # [N], transverse; two teeth: even harmonics of the spindle only
    array([37.1,  0. , 31.7,  0. , 19.5])
    """
    if harmonics < 0:
        raise ValueError(f"found {harmonics} harmonics; expected 0 or more")
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
    """Return forces (n, 3) [N] of a truncated Fourier series from `force_spectrum`, at spindle angles phi (n,) [rad].

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
