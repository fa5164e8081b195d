"""Stability lobes of regenerative chatter, zeroth order in closed form (Altintas and Budak), and mode-coupling
chatter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from .._pickling import Portable
from ..linear.state_space import second_order
from .cutter import Cut, Cutter
from .forces import force_spectrum, mean_directional_matrix, plane, receptance_in_plane, to_world
from .oscillators import Oscillators
from .stability import DEEPEST, proven_depth

LOBES = 40
TURN = 0.05  # largest relative change of an eigenvalue between neighbouring frequencies
GAP = 0.02  # largest relative change of depth
SHALLOW = 50.0  # times the least depth: deeper parts of the curve need no refinement
ROUNDS = 12  # of bisection


@dataclass(frozen=True, eq=False)
class Lobes(Portable):
    """Points on the stability limit: spindle speed [1/s], axial depth [m], chatter frequency [Hz], numbers of lobe and
    branch.

    Neighbours of the same lobe and branch are joined. `proven` maps (speed [1/s], depth [m]) to the depth, at most that
    one, up to which the spectral radius is below 1.
    """

    speed: np.ndarray
    depth: np.ndarray
    frequency: np.ndarray
    lobe: np.ndarray
    branch: np.ndarray
    proven: Callable[[float, float], float] = field(repr=False)

    def depth_at(self, speed: ArrayLike) -> np.ndarray:
        """Return the greatest axial depth (n,) [m] at spindle speeds (n,) [1/s] that is below the lobes and has a
        spectral radius below 1 at all shallower depths tried (`proven_depth`). Infinite: no limit below 1 m.

        The zeroth order alone, `zeroth_order_at`, can be too deep: narrow cuts, few teeth, period doubling. Raises
        ValueError for a speed that is not positive.
        """
        depth = self.zeroth_order_at(speed)
        for i, at in enumerate(np.asarray(speed, float).ravel()):
            proven = self.proven(float(at), min(float(depth[i]), DEEPEST))
            if proven < min(depth[i], DEEPEST):
                depth[i] = proven
        return depth

    def zeroth_order_at(self, speed: ArrayLike) -> np.ndarray:
        """Return the least axial depth (n,) [m] of all lobes at spindle speeds (n,) [1/s]; infinite without a limit.

        Slow speeds that need lobes beyond the last one use the least depth that these lobes can reach.
        """
        speeds = np.asarray(speed, float).ravel()
        best = np.full(len(speeds), np.inf)
        joined = (np.diff(self.branch) == 0) & (np.diff(self.lobe) == 0) & (np.diff(self.speed) != 0)
        n, a = (np.stack([x[:-1][joined], x[1:][joined]]) for x in (self.speed, self.depth))
        n, a = (x[:, (n.min(axis=0) <= speeds.max()) & (n.max(axis=0) >= speeds.min())] for x in (n, a))
        for i, at in enumerate(speeds):
            across = (n.min(axis=0) <= at) & (at <= n.max(axis=0))
            if across.any():
                (n0, n1), (a0, a1) = n[:, across], a[:, across]
                best[i] = (a0 + (at - n0) / (n1 - n0) * (a1 - a0)).min()
        # at slower speeds, points of the last lobe stand for the lobes beyond it
        last = np.flatnonzero(self.lobe == self.lobe.max(initial=0))
        last = last[np.argsort(-self.speed[last], kind="stable")]
        least = np.minimum.accumulate(np.append(np.inf, self.depth[last]))
        return np.minimum(best, least[np.searchsorted(-self.speed[last], -speeds)])


def stability_lobes(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), lobes: int = LOBES, frequencies: ArrayLike | None = None,
) -> Lobes:  # fmt: skip
    """Return the stability lobes 0 to `lobes` of the first pose. The curves are of zeroth order, without helix and
    uneven pitch; the check at a speed, `Lobes.depth_at`, includes both.

    a (1 - exp(-j w T)) must be the inverse of an eigenvalue of the receptance times the mean directional matrix.
    frequencies [Hz]: of chatter, rising; by default refined around the modes until eigenvalues and depths change little
    between neighbours. Raises ValueError for a radial depth beyond the diameter, or frequencies that do not rise from
    above 0.

    >>> from gtmodel.milling import CuttingCoefficients, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> lobes = gt.milling.stability_lobes(robot, cutter, "climb", radial_depth=0.006, feed=[1.0, 0.0, 0.0])
    >>> (1e3 * lobes.zeroth_order_at([20.0, 25.0, 40.0])).round(2)  # [mm] at 1200, 1500 and 2400 rpm
    array([0.62, 0.78, 1.43])
    """
    D, P = mean_directional_matrix(cutter, mode, radial_depth), plane(feed, up)

    def inverses(hertz: np.ndarray) -> np.ndarray:
        values = np.linalg.eigvals(receptance_in_plane(oscillators, 2 * np.pi * hertz, P) @ D)
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1 / values

    if frequencies is None:
        hertz, needed = _resolved(_around(oscillators, P), inverses)
    else:
        hertz = np.asarray(frequencies, float).ravel()
        if not np.all(np.diff(hertz, prepend=0.0) > 0):
            raise ValueError("the chatter frequencies must rise and be above 0 Hz")
        needed = _followed(inverses(hertz))
    rows = []
    for branch in range(2):
        value = needed[:, branch]
        real, imaginary = np.real(value), np.imag(value)
        good = np.isfinite(value) & (real > 0)
        kappa, w = imaginary[good] / real[good], 2 * np.pi * hertz[good]
        depth = real[good] * (1 + kappa**2) / 2
        phase = 2 * np.arctan2(1, kappa)
        # separate pieces of the curve must not be joined
        piece = np.cumsum(np.diff(np.flatnonzero(good), prepend=-1) > 1)
        for lobe in range(lobes + 1):
            period = (phase + 2 * np.pi * lobe) / w
            rows.append(np.stack([1 / (cutter.teeth * period), depth, w / (2 * np.pi),
                                  np.full_like(depth, lobe), branch + 2 * piece]))  # fmt: skip

    def proven(speed: float, deepest: float) -> float:
        return proven_depth(oscillators, cutter, mode, radial_depth, speed, feed, up=up, deepest=deepest)

    speed, depth, frequency, lobe, label = np.concatenate(rows, axis=1)
    return Lobes(speed, depth, frequency, lobe, label, proven)


def _around(o: Oscillators, P: np.ndarray) -> np.ndarray:
    """Return chatter frequencies [Hz] from a fifth of the lowest mode in the plane of the cut to five times the
    highest, and around each mode at equal phase steps of its receptance."""
    moved = (P**2).sum(axis=0) > 1e-9
    f, zeta = o.frequency[0][moved], o.damping_ratio[0][moved]
    wide = np.geomspace(f.min() / 5, 5 * f.max(), 200)
    turn = zeta[:, None] / np.tan(np.linspace(0, np.pi, 62)[1:-1])
    return np.unique(np.concatenate([wide, (f[:, None] * (np.sqrt(1 + turn**2) + turn)).ravel()]))


def _resolved(
    hertz: np.ndarray, inverses: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Refine frequencies [Hz] where values change; return them and the inverse eigenvalues (n, 2) in two branches."""
    values = inverses(hertz)
    for _ in range(ROUNDS):
        values = _followed(values)
        coarse = np.flatnonzero(_changes(values))
        if not len(coarse):
            break
        between = np.sqrt(hertz[coarse] * hertz[coarse + 1])
        order = np.argsort(np.concatenate([hertz, between]), kind="stable")
        hertz = np.concatenate([hertz, between])[order]
        values = np.concatenate([values, inverses(between)])[order]
    return hertz, _followed(values)


def _changes(values: np.ndarray) -> np.ndarray:
    """Return (n - 1,) whether values change too much between neighbouring frequencies."""
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(np.real(values) > 0, np.abs(values) ** 2 / (2 * np.real(values)), np.inf)
        least = np.minimum(depth[:-1], depth[1:])
        turned = np.abs(np.diff(values, axis=0)) > TURN * np.minimum(np.abs(values[:-1]), np.abs(values[1:]))
        jumps = ~(np.abs(np.diff(depth, axis=0)) <= GAP * least)
    counts = least < SHALLOW * np.min(depth, initial=np.inf)
    return ((turned | jumps) & counts).any(axis=1)


def _followed(values: np.ndarray) -> np.ndarray:
    """Sort each pair (n, 2) so that it changes least from its neighbour."""
    stay = np.abs(np.diff(values, axis=0)).sum(axis=1)
    cross = np.abs(values[1:] - values[:-1, ::-1]).sum(axis=1)
    swapped = np.cumsum(np.append(False, cross < stay)) % 2 == 1
    return np.where(swapped[:, None], values[:, ::-1], values)


CLOSE = 0.2  # relative distance of two modes that counts as close
BETWEEN = (15.0, 75.0)  # angle [deg] of the force from the first mode's axis that counts as between


@dataclass(frozen=True)
class ModeCoupling:
    """Mode coupling of one pose and cut.

    pair: axes (0 to 2 for x to z) of the two modes. apart: their distance relative to the higher one. angle [deg]: of
    the mean force between their axes, 0 to 90. critical_depth [m]: axial depth at which the linear model becomes
    unstable without regeneration, infinite if there is none below 1 m. warn: whether chatter is possible or expected.
    message: the verdict in words.
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
    """Return whether the first pose chatters by mode coupling of the two modes that the force plane excites most
    (Cvitanic 2021, section 3.3.3).

    m x'' + c x' + (k - a D) x = 0 with the mean directional matrix D becomes unstable at the critical depth. Warns if
    this is less than the depth of the cut, or if the modes are close and the mean force points between them.

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
    verdict = "mode-coupling chatter is expected" if unstable else (
        "mode coupling is possible" if near else "no sign of mode coupling")  # fmt: skip
    return ModeCoupling((first, second), apart, angle, depth, unstable or near,
                        f"{verdict}: {cause}; the linear model becomes unstable {limit}")  # fmt: skip


def critical_depth(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0)
) -> float:
    """Return the least axial depth [m] at which mode coupling alone makes the first pose unstable; infinite if there is
    none below 1 m.

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
