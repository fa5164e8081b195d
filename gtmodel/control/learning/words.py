"""What a learning study says in words: how fast, what stays and why, and what else is worth knowing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .course import Floor
from .designed import AxisLearning
from .lifted import Array
from .options import LearningDesign

SLOWLY = 1.5  # times the floor: beyond, more runs would help
SHARE = 0.05  # of the energy on either side of the band in which a signal lies
SLOWEST = 0.5  # Hz: what lies below is no matter of a Q that is 1 at rest
PASSES = 0.995  # of |Q|: where it lets this much through, Q is not why an error stays
APART = 0.01  # of sigma above the bound over frequency: the run's ends are then what is slow


def sentence(
    axes: Sequence[AxisLearning], floors: Sequence[Floor], design: LearningDesign, names: Sequence[str],
    corrected: slice,
) -> str:  # fmt: skip
    """Rate and floor in words, of the slowest axis and of the one of which most stays."""
    slow = max(axes, key=lambda a: a.bound.value)
    k = int(np.argmax([f.share for f in floors]))
    monotone = all(a.rate.monotone for a in axes)
    sigma = max(a.rate.sigma for a in axes)
    rate = f"{slow.bound.value:.2f} per iteration at {slow.bound.frequency:.0f} Hz"
    if monotone and sigma > slow.bound.value + APART:
        rate = f"{sigma:.2f} per iteration"
    return (
        f"{'converges' if monotone else 'converges in the end'}, rate {rate}; {100 * floors[k].share:.2g} % of the "
        f"error of {names[k]} cannot be learned: {why(axes[k], floors[k], design, corrected)}"
    )


def why(axis: AxisLearning, left: Floor, design: LearningDesign, corrected: slice) -> str:
    """What keeps the error that is not learned."""
    if left.clipped:
        return "the bounds on the input keep it"
    if design.law == "norm_optimal":
        return "the weight of the effort keeps it"
    low, high = band(left.rest[corrected], axis.sample_time)
    energy = np.abs(np.fft.rfft(left.rest[corrected])) ** 2
    f = np.fft.rfftfreq(len(left.rest[corrected]), axis.sample_time)
    passed = np.interp(f, axis.frequency, np.abs(axis.response))
    if low < SLOWEST or (energy.sum() > 0 and float(energy @ passed / energy.sum()) > PASSES):
        return "it belongs to the lead-in and the lead-out, where the windows hold the input back"
    if design.case == "1":
        return f"the reference holds it above {low:.2g} Hz, where Q with its low pass at {design.low_pass:g} Hz falls"
    return f"it lies between {low:.2g} and {high:.2g} Hz, where Q lets less than all of it through"


def band(signal: Array, sample_time: float) -> tuple[float, float]:
    """Frequencies [Hz] between which nine tenths of the energy of a signal (N,) lie."""
    energy = np.abs(np.fft.rfft(signal)) ** 2
    f = np.fft.rfftfreq(len(signal), sample_time)
    below = np.cumsum(energy)
    if not below[-1] > 0:
        return 0.0, float(f[-1])
    low, high = np.searchsorted(below / below[-1], [SHARE, 1 - SHARE])
    return float(f[low]), float(f[min(high, len(f) - 1)])


def notes(
    design: LearningDesign, axes: Sequence[AxisLearning], floors: Sequence[Floor], errors: Array, names: Sequence[str]
) -> tuple[str, ...]:
    """Of errors (runs, axes): what is slow, what scatters, what an estimate hides."""
    made = []
    for name, axis, left, course in zip(names, axes, floors, errors.T, strict=True):
        if not axis.rate.monotone:
            made.append(f"{name}: {axis.rate.words}")
        if len(course) and 0 < SLOWLY * left.total < course[-1]:
            runs = int(np.ceil(np.log(left.total / course[-1]) / np.log(min(axis.bound.value, 0.999))))
            made.append(
                f"{name}: after {len(course) - 1} iterations {100 * course[-1] / course[0]:.2g} % of the error is left "
                f"where {100 * left.total / left.before:.2g} % would be possible: at {axis.bound.value:.2f} per "
                f"iteration near {axis.bound.frequency:.3g} Hz that takes some {runs} more, for there the loop passes "
                "too little of the input"
            )
        if left.scatter > left.repeating:
            made.append(f"{name}: most of the floor is what differs from run to run; more iterations do not help")
    if design.case in ("2A", "2B"):
        made.append("what the estimate gets wrong is learned into the tool: its error may stay above that shown")
    return tuple(made)


def micrometres(value: float) -> str:
    """A length [m] as people read it: four digits, no powers of ten."""
    um = 1e6 * value
    return f"{um:.0f} um" if um >= 1000 else f"{um:.3g} um"
