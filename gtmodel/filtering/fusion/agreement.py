"""What of a fusion study's options goes together: an option that would change nothing is refused, not ignored."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...results import ArgumentError
from ..paths import TrackedPath
from .options import FusionFilter, FusionSensors, FusionSweep

SETTLED = 0.02  # s; what the filters forget of their start, left out of all errors and of the innovations
MOST_SAMPLES = 2_000_000  # along the path: a minute's work is 300,000 in three axes, a gigabyte as many as these
SAME = 1e-12  # relative: a default that was written in other units
TURNING = ("orientation_noise", "rate_noise", "rate_bias", "arm", "arm_error")  # of what only a body that turns shows


def agree_together(path: TrackedPath, sensors: FusionSensors, design: FusionFilter) -> None:
    """Raises ArgumentError for options that contradict each other, and for those that change nothing."""
    if design.printed and path.axes == 5:
        raise ArgumentError("the printed covariance is that of 3 axes; leave it out in 5", "filter.printed")
    fast = [design.fast_jerk_density is not None, design.fast_angular_jerk_density is not None]
    if any(fast) and design.printed:
        raise ArgumentError("with the printed covariance there is no second filter", "filter.fast_jerk_density")
    if fast[1] and not fast[0]:
        raise ArgumentError("give fast_jerk_density too; the second filter has both", "filter.fast_jerk_density")
    if any(fast) and design.kind != "extended":
        raise ArgumentError(f"two interacting filters are extended ones; found {design.kind!r}", "filter.kind")
    if design.smooth and design.kind == "particle":
        raise ArgumentError("particles cannot be smoothed; leave it out, or take another kind", "filter.smooth")
    if path.duration < 3 * SETTLED:
        raise ArgumentError(f"expected at least {3 * SETTLED:g} s; found {path.duration:g}", "path.duration")
    if path.duration < 10 * sensors.sample_time:
        raise ArgumentError("expected at least 10 samples along the path", "sensors.sample_time")
    if path.duration > MOST_SAMPLES * sensors.sample_time:
        samples = path.duration / sensors.sample_time
        raise ArgumentError(f"expected at most {MOST_SAMPLES:,} samples; found {samples:.3g}", "path.duration")
    still = "in 3 axes the body does not turn and is not asked for its orientation; leave it out, or take 5 axes"
    _without(sensors, "sensors", dict.fromkeys(TURNING, still) if path.axes == 3 else {})
    shape = {"sine": ("radius", "turn"), "line": ("amplitude", "cycles", "radius")}
    unused = dict.fromkeys(shape.get(path.kind, ("amplitude", "cycles")), f"a {path.kind} has none; leave it out")
    _without(path, "path", unused | ({"turn": still} if path.axes == 3 else {}))
    alone = {} if design.printed else {"exact_step": "belongs to printed = true; leave it out"}
    if design.kind != "particle":
        alone["particles"] = "belongs to kind = 'particle'; leave it out"
    if not fast[0]:
        alone["stay"] = "is of two interacting filters; leave it out, or give fast_jerk_density"
    if path.axes == 3:
        alone |= dict.fromkeys(("angular_jerk_density", "fast_angular_jerk_density"), still)
    if design.printed:
        alone["jerk_density"] = "with the printed covariance there is none; leave it out"
    _without(design, "filter", alone)


def agree_on_sweep(path: TrackedPath, sensors: FusionSensors, design: FusionFilter, sweep: FusionSweep) -> None:
    """Raises ArgumentError for a sweep of what is not there, of no values, and of one that does not fit."""
    if not sweep.values:
        raise ArgumentError("expected at least one value; found none", "sweep.values")
    if path.axes == 3 and sweep.parameter in TURNING:
        raise ArgumentError(
            f"'{sweep.parameter}' is of a body that turns, which it does not in 3 axes; take 5", "sweep.parameter"
        )
    for value in sweep.values:
        try:
            agree_together(path, sensors.with_value(sweep.parameter, value), design)
        except ArgumentError as fault:
            sentence = f"{value:g} of '{sweep.parameter}' does not fit: {fault.message}"
            raise ArgumentError(sentence, "sweep.values") from None


def _without(given: Any, section: str, unused: dict[str, str]) -> None:
    """Raises ArgumentError for one of these options that is other than its default."""
    plain = type(given)()
    for name, why in unused.items():
        one, other = getattr(given, name), getattr(plain, name)
        if (one is None) != (other is None) or (one is not None and not np.allclose(one, other, rtol=SAME, atol=0.0)):
            raise ArgumentError(why, f"{section}.{name}")
