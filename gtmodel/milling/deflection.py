"""Deflection of the tool while it cuts: static index (Cvitanic 2021, eq. (18)) and dynamic index (eq. (19)), with exact
discretisation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..linear.state_space import held, ramped, second_order
from .cutter import Cut, Cutter, tooth_frequency
from .forces import mean_forces, peak_force, to_world
from .oscillators import Oscillators

HOLDS = ("zero", "linear")


def responses(oscillators: Oscillators, F: ArrayLike, step: float, *, hold: str = "linear") -> Iterator[np.ndarray]:
    """Yield displacements x (t, 3) [m] of each pose, from rest, under a force F (t, 3) [N], world coordinates, sampled
    every `step` [s].

    Exact for a force that is constant ("zero") or linear ("linear") between samples; for other forces the errors are of
    first and second order in the step. Raises ValueError for an unknown hold, a wrong shape or step, and a force that
    is not finite.

    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> F = np.tile([100.0, 0.0, 0.0], (4001, 1))  # a step of 100 N
    >>> x = next(iter(gt.milling.responses(robot, F, step=1e-3)))  # of the first pose
    >>> (1e6 * x[-1]).round(1)  # [um]: F / k in equilibrium
    array([50.,  0.,  0.])
    """
    if hold not in HOLDS:
        raise ValueError(f"the hold is '{hold}'; expected one of {', '.join(HOLDS)}")
    F = checked_force(F, step)
    o = oscillators
    m, c, k = (x[..., None, None] for x in (o.m, o.c, o.k))
    A, B, _ = second_order(m, c, k, np.ones((1, 1)))
    b, a, start = recursion(A, B, step, hold)
    rows = np.ascontiguousarray(F.T)
    for pose in range(len(oscillators)):
        x = np.empty_like(rows)
        for j in range(3):
            x[j], _ = scipy.signal.lfilter(b[pose, j], a[pose, j], rows[j], zi=start[pose, j] * rows[j, 0])
        yield x.T


def checked_force(F: ArrayLike, step: float) -> np.ndarray:
    """Return F (t, 3) as an array. Raises ValueError for a wrong shape or step, or a number that is not finite."""
    F = np.asarray(F, float)
    if F.ndim != 2 or F.shape[1] != 3 or len(F) < 2:
        raise ValueError(f"the force has the shape {F.shape}; expected (t, 3) with two times or more")
    if not np.all(np.isfinite(F)):
        raise ValueError("the force contains a number that is not finite; expected finite numbers")
    if not step > 0:
        raise ValueError(f"the step is {step:g} s; expected more than 0")
    return F


def recursion(A: np.ndarray, B: np.ndarray, step: float, hold: str = "linear") -> tuple[np.ndarray, ...]:
    """Return coefficients b, a (..., 3) of the filter from u to the first state of s' = A s + B u, A (..., 2, 2),
    B (..., 2, 1), and the filter's initial state (..., 2) per unit of first input for which s starts at zero."""
    if hold == "linear":
        D, now, later = ramped(A, B, step)
    else:
        D, now = held(A, B, step)
        later = np.zeros_like(now)
    now, later = now[..., 0], later[..., 0]
    trace, det = D[..., 0, 0] + D[..., 1, 1], np.linalg.det(D)
    # Cayley-Hamilton: x[+2] - trace x[+1] + det x = (D - trace) B u ...
    back = D[..., 0, :] - trace[..., None] * [1.0, 0.0]
    b = np.stack([later[..., 0], now[..., 0] + (back * later).sum(-1), (back * now).sum(-1)], axis=-1)
    a = np.stack([np.ones_like(trace), -trace, det], axis=-1)
    # at rest at the first sample, for any input
    start = np.stack([-b[..., 0], now[..., 0] - b[..., 1]], axis=-1)
    return b, a, start


def steady_state(oscillators: Oscillators, spectrum: np.ndarray, speed: float, samples: int = 512) -> np.ndarray:
    """Return the periodic displacements (n, samples, 3) [m] over one turn of the spindle at `speed` [1/s].

    spectrum (h + 1, 3): Fourier coefficients of the force in world coordinates by harmonics of the spindle. Raises
    ValueError for a speed that is not positive, a spectrum that is not finite, or fewer samples than twice the
    harmonics.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> axes = gt.milling.to_world(np.eye(3), feed=[1.0, 0.0, 0.0])
    >>> spectrum = gt.milling.force_spectrum(cutter, cut, harmonics=100) @ axes
    >>> x = gt.milling.steady_state(robot, spectrum, speed=25.0)
    >>> x.shape, round(1e3 * np.linalg.norm(x, axis=2).max(), 3)  # [mm]
    ((1, 512, 3), np.float64(0.028))
    """
    tooth_frequency(speed, 1)
    if not np.all(np.isfinite(spectrum)):
        raise ValueError("the spectrum contains a number that is not finite; expected finite numbers")
    n = np.arange(len(spectrum))
    if samples <= 2 * n[-1]:
        raise ValueError(f"{samples} samples cannot resolve {n[-1]} harmonics; expected more than {2 * n[-1]}")
    x = oscillators.receptance(2 * np.pi * speed * n) * spectrum
    return np.fft.irfft(x, samples, axis=1) * samples


RATE = 20000.0  # least samples per second
SECONDS = 2.0  # of cutting, from rest
SETTLE = 1.0  # initial part that means leave out [s]
PER_TOOTH = 40  # least samples per tooth period: fewer would alias the force
MOST = 3_000_000  # samples of a force: more indicates a speed or duration in a wrong unit


@dataclass(frozen=True, eq=False)
class Deflection:
    """Norm of the tool's displacement while it cuts, by pose (n,) [m].

    peak: largest value from the first chip on, the dynamic index (Cvitanic 2021, eq. (19)). mean, std, steady_peak:
    mean, standard deviation and largest value after the transients.
    """

    peak: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    steady_peak: np.ndarray


def samples_per_turn(speed: float, teeth: int, seconds: float, rate: float = RATE) -> int:
    """Return the samples of the force per turn at a spindle speed [1/s]: at least `rate` per second and 40 per tooth.

    Raises ValueError for a speed that is not positive, and for more than three million samples in `seconds`.
    """
    tooth_frequency(speed, teeth)
    turn = max(np.ceil(rate / speed - 1e-9), PER_TOOTH * teeth)
    if max(turn, turn * speed * seconds) > MOST:
        raise ValueError(
            f"{seconds:.4g} s of cutting at {60 * speed:g} rpm are {turn * speed * seconds:.2g} samples; expected "
            f"{MOST:.2g} at most: is the speed in turns per minute and the time in seconds?"
        )
    return int(turn)


def duration(speed: float, seconds: float = SECONDS, settle: float = SETTLE) -> float:
    """Return `seconds`, or longer so that a whole turn at `speed` [1/s] follows after `settle` [s]."""
    return max(seconds, settle + 1 / speed)


def cutting_force(
    cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0),
    seconds: float = SECONDS, rate: float = RATE,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Return the force (t, 3) [N], world coordinates, and its step [s]: whole samples per turn, at least `rate` per
    second.

    Each sample is the mean over the step around it, so that samples carry the whole impulse once. speed [1/s] of the
    spindle; feed (3,) and up (3,): see `to_world`. Raises ValueError for invalid values.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> F, step = gt.milling.cutting_force(cutter, cut, speed=25.0, feed=[1.0, 0.0, 0.0], seconds=0.1)
    >>> F.shape, round(step, 6)
    ((2001, 3), 5e-05)
    """
    if not (seconds > 0 and rate > 0):
        raise ValueError(f"found {seconds:g} s at {rate:g} samples per second; expected more than 0")
    turn = samples_per_turn(speed, cutter.teeth, seconds, rate)
    F = to_world(mean_forces(cutter, cut, 2 * np.pi * np.arange(turn) / turn, 2 * np.pi / turn), feed, up)
    step = 1 / (speed * turn)
    return F[np.arange(int(np.ceil(seconds / step)) + 1) % turn], step


def deflections(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), seconds: float = SECONDS, settle: float = SETTLE, rate: float = RATE,
    hold: str = "linear",
) -> Deflection:  # fmt: skip
    """Return the deflection of the tool in every pose of the oscillators, from rest; its `peak` is the dynamic index
    (Cvitanic 2021, eq. (19)).

    speed [1/s] of the spindle; means cover whole turns after settle [s]. `seconds` is extended for a spindle so slow
    that no whole turn would follow. Raises ValueError for invalid values.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> deflection = gt.milling.deflections(robot, cutter, cut, speed=25.0, feed=[1.0, 0.0, 0.0])
    >>> (1e3 * deflection.peak).round(3), (1e3 * deflection.mean).round(3)  # [mm]
    (array([0.052]), array([0.026]))
    """
    if not 0 <= settle < seconds:
        raise ValueError(f"settle is {settle:g} s; expected at least 0 and less than the {seconds:g} s of cutting")
    tooth_frequency(speed, cutter.teeth)
    seconds = duration(speed, seconds, settle)
    F, step = cutting_force(cutter, cut, speed, feed, up=up, seconds=seconds, rate=rate)
    turns = max(1, int((seconds - settle) * speed * (1 + 1e-9)))
    after = len(F) - turns * round(1 / (speed * step))
    rows = np.empty((4, len(oscillators)))
    for pose, x in enumerate(responses(oscillators, F, step, hold=hold)):
        squared = np.einsum("ij,ij->i", x, x)
        late = np.sqrt(squared[after:])
        rows[:, pose] = np.sqrt(squared.max()), late.mean(), late.std(), late.max()
    return Deflection(*rows)


def static_index(
    compliance: ArrayLike, cutter: Cutter, cut: Cut, feed: ArrayLike, *, up: ArrayLike = (0.0, 0.0, 1.0)
) -> np.ndarray:
    """Return the static index |K^-1 F_peak| (n,) [m] of poses with translational compliances (n, 3, 3) [m/N] (Cvitanic
    2021, eq. (18)).

    It does not depend on the speed. Computed from joint stiffness it is several times as large as measured deflections:
    use it only to rank poses.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> compliance = np.diag([5e-7, 6e-7, 3e-7])[None]  # of one pose [m/N]
    >>> 1e3 * gt.milling.static_index(compliance, cutter, cut, feed=[1.0, 0.0, 0.0]).round(6)  # [mm]
    array([0.114])
    """
    F = to_world(peak_force(cutter, cut), feed, up)
    return np.linalg.norm(np.asarray(compliance, float) @ F, axis=-1)
