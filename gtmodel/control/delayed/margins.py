"""How far a late loop is from its limit: in gain, in phase, in delay, and as the disk that holds gain and phase."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...results import ArgumentError
from .crossings import EXACT, frequencies, size_crossings
from .limit import stability_ranges
from .loop import DelayedLoop

STEP = 0.25  # of a cycle: from one delay that is tried to the next
LONGEST = 100  # cycles of further delay up to which a limit is looked for
PARTS = 8  # of a cycle at which the size of the response is looked at
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
    if not loop.stable(gain):
        raise ArgumentError(f"the loop is unstable at a gain of {gain:g}: it has no margins; take less", "gain")
    _, ranges = stability_ranges(loop)
    low, high = next(((a, b) for a, b in ranges if a <= gain <= b), (gain, gain))  # at a limit, up to rounding
    w = size_crossings(loop, gain)
    turn = np.angle(-gain * loop.response(w)) if len(w) else np.zeros(0)  # 0 where L = -1
    late = np.min((turn % (2 * np.pi)) / w, initial=np.inf)
    return LoopMargins(
        gain=float(high / gain), gain_below=float(low / gain), phase=float(np.min(np.abs(turn), initial=np.pi)),
        delay=delay_margin(loop, gain), phase_delay=float(late), disk=disk_margin(loop, gain),
    )  # fmt: skip


def delay_margin(loop: DelayedLoop, gain: float) -> float:
    """Further delay [s] at which an eigenvalue of the companion matrix first reaches the unit circle.

    The delay grows by quarters of a cycle; a loss of stability that returns between two of them is not seen. Infinite
    where the response stays below one for every delay, and where no delay of `LONGEST` cycles more ends the stability.
    Raises ArgumentError for a gain at which the loop is unstable.

    >>> loop = gt.control.delayed.DelayedLoop(gt.control.delayed.rigid_plant(0.004), cycle=0.004, delay=0.0)
    >>> round(1e3 * gt.control.delayed.delay_margin(loop, 1.0), 6)  # y(k+1) = y(k) - y(k-1): one cycle more [ms]
    4.0
    """
    if not loop.stable(gain):
        raise ArgumentError(f"the loop is unstable at a gain of {gain:g}: it has no delay margin; take less", "gain")
    if _small_for_every_delay(loop, gain):
        return np.inf

    def beyond(cycles: float) -> float:
        return loop.late_by(loop.delay + cycles * loop.cycle).radius(gain) - 1

    low = 0.0
    for high in STEP * np.arange(1, int(LONGEST / STEP) + 1):
        if beyond(float(high)) >= 0:
            return loop.cycle * float(scipy.optimize.brentq(beyond, low, float(high), xtol=NEAR, rtol=4 * EXACT))
        low = float(high)
    return np.inf


def disk_margin(loop: DelayedLoop, gain: float) -> float:
    """2 / max |S - T| over all frequencies, S = 1/(1 + P L), T = P L/(1 + P L): the balanced disk margin (Seiler,
    Packard and Gahinet 2020), 2 for a loop that bears everything.

    >>> loop = gt.control.delayed.DelayedLoop(gt.control.delayed.rigid_plant(0.004), cycle=0.004, delay=0.052)
    >>> round(gt.control.delayed.disk_margin(loop, 0.05), 3)
    0.672
    """

    def distance(w: np.ndarray) -> np.ndarray:
        L = gain * loop.response(w)
        with np.errstate(divide="ignore"):
            return 2 * np.abs(1 + L) / np.abs(1 - L)

    w = frequencies(loop)
    at = int(np.argmin(distance(w)))
    ends = float(w[max(at - 1, 0)]), float(w[min(at + 1, len(w) - 1)])
    if ends[0] == ends[1]:
        return float(distance(w[[at]])[0])
    least = scipy.optimize.minimize_scalar(lambda x: float(distance(np.array([x]))[0]), bounds=ends, method="bounded",
                                           options={"xatol": 1e-9 * ends[1]})  # fmt: skip
    return min(float(least.fun), float(distance(w[[at]])[0]))


def _small_for_every_delay(loop: DelayedLoop, gain: float) -> bool:
    """Whether |P L| < 1 at every frequency, looked at for all parts of a cycle: then no delay matters."""
    parts = [loop.late_by(loop.cycle * part) for part in np.arange(PARTS) / PARTS]
    return all(float(np.abs(gain * p.response(frequencies(p))).max()) < 1 for p in parts)
