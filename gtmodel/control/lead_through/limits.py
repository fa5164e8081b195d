"""The gain at which runs in time begin to grow, beside the one by eigenvalues, and what a cone does to the force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...linear.roots import bisected
from ...results import ArgumentError
from .gains import SurfaceGains
from .guided import guide
from .law import SurfaceLaw
from .options import ConeComparison, ServoChain
from .scenes import SyntheticSurface

CYCLES = 1000
LARGE = 0.1  # [N]: it has grown until contact was lost
SMALL = 1e-8  # [N] off the reference: the contact stays linear
HALVINGS = 10  # of the range: a gain is found to two thousandths
FLOOR = 1e-12  # [N] what is smaller has died away: rounding alone is left, and grows or not by chance
WIDE = 16  # the spectrum is this much finer than its window
STIFFNESS = 5000.0  # the linear loop knows K k alone


def simulated_limit(gains: SurfaceGains, servo: ServoChain, near: float) -> tuple[float, float]:
    """The loop gain [1/s] at which a small deviation begins to grow in time, between half and twice `near`, and the
    frequency [Hz] of what grows just above it. Raises ArgumentError where
    nothing begins to grow there within a run of 1000 cycles.

    >>> L = gt.control.lead_through
    >>> limit = gt.control.delayed.gain_limit(L.force_loop(L.ServoChain()))
    >>> gain, frequency = L.simulated_limit(L.SurfaceGains(), L.ServoChain(), limit.gain)
    >>> bool(abs(gain / limit.gain - 1) < 0.05), bool(abs(frequency - limit.frequency) < 2.0)
    (True, True)
    """
    low, high = 0.5 * near, 2.0 * near
    if _grows(_run(gains, servo, low)) or not _grows(_run(gains, servo, high)):
        seconds = CYCLES * gains.cycle
        raise ArgumentError(
            f"runs of {seconds:g} s do not show a gain between {low:.3g} and {high:.3g} 1/s at which they grow"
        )
    low, high = bisected(lambda gain: not _grows(_run(gains, servo, float(gain))), low, high, HALVINGS)
    tail = _run(gains, servo, 1.03 * high)[CYCLES // 4 : CYCLES // 2]  # after the transient
    window = np.hanning(len(tail)) * (tail - tail.mean())
    spectrum = np.abs(np.fft.rfft(window, WIDE * len(tail)))
    return float(low), float(np.fft.rfftfreq(WIDE * len(tail), gains.cycle)[int(np.argmax(spectrum))])


def _run(gains: SurfaceGains, servo: ServoChain, loop_gain: float) -> np.ndarray:
    """Force less its reference [N], on a surface along the nominal normal."""
    reference = max(gains.force_reference, 1.0)
    own = replace(
        gains, force_gain=loop_gain / STIFFNESS, cone=0.0, any_direction=False, force_reference=reference,
        enter_force=reference / 2, leave_force=reference / 4, force_speed_limit=1e3, speed_limit=1e3,
        acceleration_limit=1e6,
    )  # fmt: skip
    start = (0.0, 0.0, -(reference + SMALL) / STIFFNESS)
    hand = np.zeros((CYCLES, 3))
    run = guide(SurfaceLaw(own), hand, SyntheticSurface(stiffness=STIFFNESS), servo, start=start)
    return run.force[:, 2] - reference


def _grows(deviation: np.ndarray) -> bool:
    parts = np.array_split(deviation, 5)  # the first hold the transient
    late = float(np.std(parts[-1]))
    return bool(late > max(float(np.std(parts[2])), FLOOR) or np.abs(deviation).max() > LARGE)


def cone_deviations(gains: SurfaceGains, servo: ServoChain, asked: ConeComparison) -> dict[str, list[float]]:
    """Root mean square of the force less its reference [N], a number for each cone: on a flat and a tilted surface,
    without and with the filter.

    Keys as "flat, unfiltered".

    >>> L = gt.control.lead_through
    >>> short = L.ConeComparison(cones=(0.0, 0.17), duration=4.0, seeds=1)
    >>> narrow, wide = L.cone_deviations(L.SurfaceGains(), L.ServoChain(), short)["flat, unfiltered"]
    >>> wide > narrow
    True
    """
    answers: dict[str, list[float]] = {}
    for surface, tilt in (("flat", 0.0), ("tilted", asked.tilt)):
        for kind, constant in (("unfiltered", 0.0), ("filtered", asked.constant)):
            answers[f"{surface}, {kind}"] = [_deviation(gains, servo, asked, c, constant, tilt) for c in asked.cones]
    return answers


def _deviation(
    gains: SurfaceGains, servo: ServoChain, asked: ConeComparison, cone: float, constant: float, tilt: float
) -> float:
    law = SurfaceLaw(replace(gains, force_gain=asked.force_gain, cone=cone, normal_filter=constant, friction=0.0))
    p, k = law.gains, asked.stiffness
    hand = np.tile([asked.speed * p.damping, 0.0, 0.0], (round(asked.duration / p.cycle), 1))
    off = []
    for seed in range(asked.seeds):
        run = guide(
            law, hand, SyntheticSurface(stiffness=k, tilt=tilt), servo, start=(0.0, 0.0, -p.force_reference / k),
            noise=asked.noise, seed=seed,
        )  # fmt: skip
        late = run.force[round(2.0 / p.cycle) :]
        off.append(np.mean((np.linalg.norm(late, axis=1) - p.force_reference) ** 2))
    return float(np.sqrt(np.mean(off)))
