"""Gain, phase, delay and disk margins of a delayed loop."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from ...results import ArgumentError
from .limit import EXACT, gain_limit, largest_in_sector, least_of, size_crossings, stability_ranges
from .loop import APART, DelayedLoop
from .options import GainMargins
from .plants import MOST_CYCLES

STEP = 0.25  # of a cycle: largest step between delays in the search
FAST = 0.5  # rad: largest phase of the plant's fastest pole in a step
LONGEST = 100  # cycles of further delay in the search
PARTS = 8  # of a cycle: delays at which |P L| is computed
SOLVED = 1e-9  # tolerance of log(-P L)
LARGE = 120  # states beyond which no eigenvalues are computed for a delay
NEAR = 1e-12  # tolerance of a delay margin, in cycles


@dataclass(frozen=True)
class LoopMargins:
    """Stability margins of a loop.

    gain: the smallest factor above one that makes the loop unstable; gain_below: the largest factor below one, or 0 if
    less gain never does. phase [rad]: the smallest phase shift in either direction that does, at most pi. delay [s]:
    further delay up to which the loop stays stable, with the hold split exactly; infinite if no delay up to `LONGEST`
    cycles makes it unstable. phase_delay [s]: the textbook estimate, the least (phase modulo 2 pi) / w, exact if it is
    a whole number of cycles. disk: 2 / max |S - T| (skew 0), for gain and phase together; the loop stays stable for
    factors between (2 - disk) / (2 + disk) and its inverse.
    """

    gain: float
    gain_below: float
    phase: float
    delay: float
    phase_delay: float
    disk: float


def loop_margins(loop: DelayedLoop, gain: float) -> LoopMargins:
    """Return the margins of the loop at a gain; eigenvalues of the companion matrix decide about stability.

    `control.margin` returns the gain margin nearest to one; for an unstable loop this may be a crossing far above the
    limit. This function requires a stable loop and returns the smallest factor. Raises ArgumentError if the loop is
    unstable at this gain.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)
    >>> m = gt.control.delayed.loop_margins(loop, 0.2)
    >>> round(m.gain, 3), round(1e3 * m.delay, 2)  # a factor, and [ms]
    (1.216, 2.61)
    """
    if not (np.isfinite(gain) and gain > 0):
        raise ArgumentError(f"must be a number above 0; found {gain!r}", "gain")
    _check_stable(loop, gain, "margins")
    _, ranges = stability_ranges(loop)
    low, high = next(((a, b) for a, b in ranges if a <= gain <= b), (gain, gain))  # on a limit, within rounding
    w = size_crossings(loop, gain)
    turn = np.angle(-gain * loop.response(w)) if len(w) else np.zeros(0)  # 0 where L = -1
    late = np.min((turn % (2 * np.pi)) / w, initial=np.inf)
    return LoopMargins(
        gain=float(high / gain), gain_below=float(low / gain), phase=float(np.min(np.abs(turn), initial=np.pi)),
        delay=delay_margin(loop, gain), phase_delay=float(late), disk=disk_margin(loop, gain),
    )  # fmt: skip


def margin_limit(loop: DelayedLoop, margins: GainMargins) -> float:
    """Return the greatest gain up to which the loop keeps a gain margin and a phase margin; infinite without a limit.

    The phase margin holds for gains below the least 1 / |L| over all frequencies at which L is within the phase margin
    of the negative real axis. Raises ArgumentError if already small gains are unstable.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)
    >>> P = gt.control.delayed.margin_limit(loop, gt.control.delayed.GainMargins(gain=1.2, phase=np.pi / 4))
    >>> margins = gt.control.delayed.loop_margins(loop, P)
    >>> round(P, 4), round(margins.gain, 2), round(np.rad2deg(margins.phase))
    (0.1518, 1.6, 45)
    """
    limit = gain_limit(loop).gain / margins.gain
    nearest = largest_in_sector(loop, margins.phase)
    return min(limit, float(1 / nearest)) if nearest > 0 else limit


def delay_margin(loop: DelayedLoop, gain: float) -> float:
    """Return the further delay [s] at which an eigenvalue of the companion matrix first reaches the unit circle.

    This is the least delay at which P L = -1 has a solution. Candidates are the frequencies with |P L| = 1 at steps of
    a quarter cycle; real and imaginary part are then solved together, with the hold split exactly. Infinite if |P L|
    stays below one for every delay, or if no delay up to `LONGEST` further cycles makes the loop unstable. Raises
    ArgumentError if the loop is unstable at this gain.

    >>> loop = gt.control.delayed.DelayedLoop(gt.control.delayed.rigid_plant(0.004), cycle=0.004, delay=0.0)
    >>> round(1e3 * gt.control.delayed.delay_margin(loop, 1.0), 6)  # y(k+1) = y(k) - y(k-1): one cycle more [ms]
    4.0
    """
    _check_stable(loop, gain, "delay margin")
    if _small_for_every_delay(loop, gain):
        return np.inf

    def beyond(cycles: float) -> float:
        return loop.late_by(loop.delay + cycles * loop.cycle).radius(gain) - 1

    step = min(STEP, FAST / (np.abs(np.linalg.eigvals(loop.plant.A)).max() * loop.cycle + FAST))
    ends = step * np.arange(1 + int(min(LONGEST, MOST_CYCLES - loop.delay / loop.cycle) / step))
    estimates = _estimates(loop, gain, 0.0)
    for low, high in pairwise(ends.tolist()):
        before, estimates = estimates, _estimates(loop, gain, high)
        late = _first_solution(loop, gain, low, high, before + estimates)
        if late is None and len(loop) < LARGE and beyond(high) >= 0:
            late = float(scipy.optimize.brentq(beyond, low, high, xtol=NEAR, rtol=4 * EXACT))
        if late is not None:
            return loop.cycle * late
    return np.inf


def _estimates(loop: DelayedLoop, gain: float, cycles: float) -> list[tuple[float, float]]:
    """Frequencies with |P L| = 1 after a further delay, and the further delays [cycles] that give P L = -1 there."""
    near = loop.late_by(loop.delay + cycles * loop.cycle)
    w = size_crossings(near, gain)
    turn = np.angle(-gain * near.response(w)) if len(w) else w
    return [(omega, cycles + (phase + 2 * np.pi * whole) / (omega * loop.cycle))
            for omega, phase in zip(w.tolist(), turn.tolist(), strict=True) for whole in (-1, 0, 1)]  # fmt: skip


def _first_solution(
    loop: DelayedLoop, gain: float, low: float, high: float, estimates: list[tuple[float, float]]
) -> float | None:
    """The least further delay in (low, high] [cycles] at which P L = -1 at some frequency; None if there is none."""
    solved = _at_the_nyquist_frequency(loop, gain, low, high)
    for omega, late in estimates:
        if 2 * low - high < late < 2 * high - low:
            end = _solution(loop, gain, omega, late)
            if end is not None and low < end <= high:
                solved.append(end)
    return min(solved, default=None)


def _at_the_nyquist_frequency(loop: DelayedLoop, gain: float, low: float, high: float) -> list[float]:
    """Further delays in [low, high] [cycles] with P L = -1 at the Nyquist frequency, where L is always real."""
    top = np.array([np.pi / loop.cycle])

    def above(cycles: float) -> float:
        return 1 + gain * float(loop.late_by(loop.delay + cycles * loop.cycle).response(top)[0].real)

    tried = np.linspace(low, high, 3)
    signs = np.array([above(float(x)) for x in tried]) > 0
    return [
        float(scipy.optimize.brentq(above, float(tried[i]), float(tried[i + 1]), xtol=NEAR, rtol=4 * EXACT))
        for i in np.flatnonzero(signs[:-1] != signs[1:])
    ]


def _solution(loop: DelayedLoop, gain: float, omega: float, late: float) -> float | None:
    """Further delay [cycles] near `late` with P L = -1 near `omega`, by a root search; None if there is none."""
    top = np.pi / loop.cycle

    def off(x: np.ndarray) -> np.ndarray:
        delayed = loop.late_by(loop.delay + max(float(x[1]), -loop.delay / loop.cycle) * loop.cycle)
        value = np.log(-gain * delayed.response(np.array([x[0] * top]))[0])
        return np.array([value.real, value.imag])

    root = scipy.optimize.root(off, [omega / top, late], options={"xtol": NEAR})
    w, delay = (float(x) for x in root.x)
    converged = 0 < w <= 1 and np.abs(off(root.x)).max() < SOLVED
    return delay if converged and abs(delay - late) < 2 * STEP else None


def disk_margin(loop: DelayedLoop, gain: float) -> float:
    """Return the balanced disk margin (Seiler, Packard and Gahinet 2020), at most 2.

    It is 2 / max |S - T| over all frequencies, S = 1/(1 + P L), T = P L/(1 + P L). Raises ArgumentError if the loop is
    unstable at this gain.

    >>> loop = gt.control.delayed.DelayedLoop(gt.control.delayed.rigid_plant(0.004), cycle=0.004, delay=0.052)
    >>> round(gt.control.delayed.disk_margin(loop, 0.05), 3)
    0.672
    """
    _check_stable(loop, gain, "disk margin")

    def distance(w: np.ndarray) -> np.ndarray:
        L = gain * loop.response(w)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(L == 1, np.inf, 2 * np.abs(1 + L) / np.abs(1 - L))

    w, _ = loop.sampled
    d = distance(w)
    low = np.concatenate([[True], d[1:] <= d[:-1]]) & np.concatenate([d[:-1] <= d[1:], [True]])
    least = float(d.min())
    # neighbouring responses differ by at most a quarter: valleys higher than this cannot hold the minimum
    for i in np.flatnonzero(low & (d < 2 * least + 2 * APART)).tolist():
        ends = float(w[max(i - 1, 0)]), float(w[min(i + 1, len(w) - 1)])
        least = min(least, least_of(lambda x: float(distance(np.array([x]))[0]), *ends)[1])
    return least


def _check_stable(loop: DelayedLoop, gain: float, margin: str) -> None:
    if not loop.stable(gain):
        raise ArgumentError(f"the loop is unstable at a gain of {gain:g} and has no {margin}; reduce it", "gain")


def _small_for_every_delay(loop: DelayedLoop, gain: float) -> bool:
    """Whether |P L| < 1 at every frequency, for delays of all parts of a cycle; then no delay makes it unstable."""
    parts = [loop.late_by(loop.cycle * part) for part in np.arange(PARTS) / PARTS]
    return all(float(np.abs(gain * p.sampled[1]).max()) < 1 for p in parts)
