"""How far a late loop is from its limit: in gain, in phase, in delay, and as the disk that holds gain and phase."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from ...results import ArgumentError
from .limit import EXACT, LARGE, gain_limit, largest_in_sector, least_of, size_crossings, stability_ranges
from .loop import APART, DelayedLoop
from .options import GainMargins
from .plants import MOST_CYCLES

STEP = 0.25  # of a cycle: from one delay that is tried to the next, at most
FAST = 0.5  # rad that the fastest pole of the plant turns in such a step
LONGEST = 100  # cycles of further delay up to which a limit is looked for
PARTS = 8  # of a cycle at which the size of the response is looked at
SOLVED = 1e-9  # of the logarithm of -P L
NEAR = 1e-12  # s, relative to the cycle: of a delay margin


@dataclass(frozen=True)
class LoopMargins:
    """How much more a stable loop bears.

    gain: the smallest factor above one that makes it unstable; gain_below: the largest below one, 0 where less gain
    never does. phase [rad]: the least turn of the response either way, at most pi. delay [s]: further delay up to which
    it stays stable, with the hold split exactly; infinite where no delay up to `LONGEST` cycles ends it. phase_delay
    [s]: the textbook's estimate, least (phase modulo 2 pi) / w, right where it is a whole number of cycles. disk: of
    gain and phase together, 2 / max |S - T| (skew 0); a factor between (2 - disk) / (2 + disk) and its inverse leaves
    the loop stable.
    """

    gain: float
    gain_below: float
    phase: float
    delay: float
    phase_delay: float
    disk: float


def loop_margins(loop: DelayedLoop, gain: float) -> LoopMargins:
    """Margins of the loop at a gain; the eigenvalues of the companion matrix decide.

    `control.margin` returns the gain margin nearest one, which of an unstable loop may be a crossing far above its
    limit: here a loop must be stable, and the smallest factor counts. Raises ArgumentError where it is unstable at this
    gain.

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
    low, high = next(((a, b) for a, b in ranges if a <= gain <= b), (gain, gain))  # at a limit, up to rounding
    w = size_crossings(loop, gain)
    turn = np.angle(-gain * loop.response(w)) if len(w) else np.zeros(0)  # 0 where L = -1
    late = np.min((turn % (2 * np.pi)) / w, initial=np.inf)
    return LoopMargins(
        gain=float(high / gain), gain_below=float(low / gain), phase=float(np.min(np.abs(turn), initial=np.pi)),
        delay=delay_margin(loop, gain), phase_delay=float(late), disk=disk_margin(loop, gain),
    )  # fmt: skip


def margin_limit(loop: DelayedLoop, margins: GainMargins) -> float:
    """The greatest gain up to which the loop keeps a gain margin and a phase margin; infinite where nothing limits it.

    The response says it in one look: with less gain than 1 / |L| wherever L is within the phase margin of the negative
    real axis, no P L of size one comes nearer. Raises ArgumentError where small gains are unstable already.

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
    """Further delay [s] at which an eigenvalue of the companion matrix first reaches the unit circle.

    It is the least delay at which P L = -1 has a solution: candidates from where P L has a size of one, by quarters of
    a cycle, then both equations at once, the hold split exactly. Infinite where the response stays below one for every
    delay, and where no delay of `LONGEST` cycles more ends the stability. Raises ArgumentError for a gain at which the
    loop is unstable.

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
    """Frequencies at which P L has a size of one with so much more delay, and further delays [cycles] that turn it to
    -1 there."""
    near = loop.late_by(loop.delay + cycles * loop.cycle)
    w = size_crossings(near, gain)
    turn = np.angle(-gain * near.response(w)) if len(w) else w
    return [(at, cycles + (phase + 2 * np.pi * whole) / (at * loop.cycle))
            for at, phase in zip(w.tolist(), turn.tolist(), strict=True) for whole in (-1, 0, 1)]  # fmt: skip


def _first_solution(
    loop: DelayedLoop, gain: float, low: float, high: float, estimates: list[tuple[float, float]]
) -> float | None:
    """The least further delay between these [cycles] at which P L = -1 somewhere; None where there is none."""
    solved = _at_the_nyquist_frequency(loop, gain, low, high)
    for omega, late in estimates:
        if 2 * low - high < late < 2 * high - low:
            end = _solution(loop, gain, omega, late)
            if end is not None and low < end <= high:
                solved.append(end)
    return min(solved, default=None)


def _at_the_nyquist_frequency(loop: DelayedLoop, gain: float, low: float, high: float) -> list[float]:
    """Further delays between these [cycles] at which P L = -1 there, where L is real for every delay."""
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
    """Further delay [cycles] near `late` at which P L = -1 near `omega`, by Newton's method; None if there is none."""
    top = np.pi / loop.cycle

    def off(x: np.ndarray) -> np.ndarray:
        delayed = loop.late_by(loop.delay + max(float(x[1]), -loop.delay / loop.cycle) * loop.cycle)
        value = np.log(-gain * delayed.response(np.array([x[0] * top]))[0])
        return np.array([value.real, value.imag])

    ended = scipy.optimize.root(off, [omega / top, late], options={"xtol": NEAR})
    w, delay = (float(x) for x in ended.x)
    arrived = 0 < w <= 1 and np.abs(off(ended.x)).max() < SOLVED
    return delay if arrived and abs(delay - late) < 2 * STEP else None


def disk_margin(loop: DelayedLoop, gain: float) -> float:
    """2 / max |S - T| over all frequencies, S = 1/(1 + P L), T = P L/(1 + P L): the balanced disk margin (Seiler,
    Packard and Gahinet 2020), 2 for a loop that bears everything. Raises ArgumentError for a gain at which the loop is
    unstable.

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
    # of neighbours the response differs by a quarter at most: a valley that is this much higher holds nothing less
    for i in np.flatnonzero(low & (d < 2 * least + 2 * APART)).tolist():
        ends = float(w[max(i - 1, 0)]), float(w[min(i + 1, len(w) - 1)])
        least = min(least, least_of(lambda x: float(distance(np.array([x]))[0]), *ends)[1])
    return least


def _check_stable(loop: DelayedLoop, gain: float, asked: str) -> None:
    if not loop.stable(gain):
        raise ArgumentError(f"the loop is unstable at a gain of {gain:g}: it has no {asked}; take less", "gain")


def _small_for_every_delay(loop: DelayedLoop, gain: float) -> bool:
    """Whether |P L| < 1 at every frequency, looked at for all parts of a cycle: then no delay matters."""
    parts = [loop.late_by(loop.cycle * part) for part in np.arange(PARTS) / PARTS]
    return all(float(np.abs(gain * p.sampled[1]).max()) < 1 for p in parts)
