"""Chatter of a cut with a delayed correction loop: regeneration and feedback in one semi-discretised map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..control.delayed.options import FeedbackAxis, FeedbackCut, FeedbackTiming
from ..linear.roots import crossing
from ..linear.state_space import held, second_order
from ..results import ArgumentError
from ..results.refusal import naming
from ..simulation.hybrid.clock import exact
from .cutter import Cut, Cutter, tooth_frequency
from .forces import plane
from .oscillators import Oscillators
from .stability import mean_matrices

STEPS = 20  # of a cycle
MOST_STEPS = 40_000  # of the common period of tooth and cycle
FEWEST = 4  # steps of the tooth period
UNEVEN = 1e-9  # rad
NEAR = 1e-6  # relative tolerance of a depth: Brent's method needs as many radii as bisection to 1e-3


@dataclass(frozen=True)
class CorrectedTool:
    """A cutting tool corrected along one direction by -gain times its deviation, `delay` [s] late.

    oscillators: of the tool, in kg; the first pose is used. equivalent_mass (3,): m of `equivalent_plant` along x, y, z
    of the world, with frequency and damping of the oscillators. direction (3,): unit vector along which the deviation
    is measured and corrected. cycle [s]. Raises ArgumentError for invalid values.
    """

    oscillators: Oscillators
    equivalent_mass: np.ndarray
    direction: np.ndarray
    cycle: float
    delay: float

    def __post_init__(self) -> None:
        mass, e = np.asarray(self.equivalent_mass, float), np.asarray(self.direction, float)
        if mass.shape != (3,) or not np.all((mass > 0) & np.isfinite(mass)):
            raise ArgumentError(f"expected three positive numbers; found {mass.tolist()}", "equivalent_mass")
        if e.shape != (3,) or not abs(np.linalg.norm(e) - 1) < UNEVEN:
            raise ArgumentError(f"expected a unit vector; found {e.tolist()}", "direction")
        if not (np.isfinite(self.cycle) and self.cycle > 0):
            raise ArgumentError(f"must be a number above 0; found {self.cycle!r}", "cycle")
        if not (np.isfinite(self.delay) and self.delay >= 0):
            raise ArgumentError(f"must be a number, at least 0; found {self.delay!r}", "delay")
        object.__setattr__(self, "equivalent_mass", mass)
        object.__setattr__(self, "direction", e)


@dataclass(frozen=True)
class ChatterRadius:
    """radius: growth per cycle; below 1 the cut is stable. cycles_per_tooth: rational approximation of tooth period
    over cycle. speed [1/s]: spindle speed with this ratio. speed_error: its relative error to the requested speed."""

    radius: float
    cycles_per_tooth: Fraction
    speed: float
    speed_error: float


def chatter_radius(
    tool: CorrectedTool, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, gain: float, *,
    up: ArrayLike = (0.0, 0.0, 1.0), steps: int = STEPS,
) -> ChatterRadius:  # fmt: skip
    """Return the growth per cycle of a cut with corrections, at a spindle speed [1/s].

    A cycle has `steps` steps; the tooth period is rounded to a whole number of steps, and the map covers the common
    period of tooth and cycle. Within a step the force coefficient and the displacement of the previous tooth are
    constant, as in Insperger and Stepan 2004; the hold of the corrections is exact for any delay. A second run with
    twice as many steps shows the error of the rational ratio and of the steps. Raises ArgumentError for an uneven
    pitch, fewer than four steps per tooth period, and a common period that is too long; ValueError for invalid speeds.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.0003, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> tool = gt.milling.CorrectedTool(robot, [2.0, 0.5, 2.0], [0.0, 1.0, 0.0], cycle=0.004, delay=0.052)
    >>> for gain in (0.0, 0.1):
    ...     r = gt.milling.chatter_radius(tool, cutter, cut, 25.0, [1.0, 0.0, 0.0], gain)
    ...     print(r.cycles_per_tooth, r.radius < 1)
    5 True
    5 False
    """
    if np.ptp(cutter.pitch) > UNEVEN:
        raise ArgumentError("the pitch of the teeth is uneven; expected even pitch", "cutter")
    if not np.isfinite(gain):
        raise ArgumentError(f"must be a number; found {gain!r}", "gain")
    tooth, together = _common_period(cutter, tool.cycle, speed, steps)
    P = plane(feed, up)
    W = cut.axial_depth * np.einsum("ji,tjk,kl->til", P, mean_matrices(cutter, cut, tooth), P)
    growth = _over(tool, W, steps, tooth, together, gain)
    used = 1 / (cutter.teeth * tooth * (tool.cycle / steps))
    return ChatterRadius(growth ** (steps / together), Fraction(tooth, steps), used, used / speed - 1)


def corrected_depth(
    tool: CorrectedTool, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, gain: float, *,
    deepest: float, up: ArrayLike = (0.0, 0.0, 1.0), steps: int = STEPS,
) -> float:  # fmt: skip
    """Return the axial depth [m] at which a cut with corrections first chatters, from steps of a fifth and Brent's
    method; `deepest` if it does not, 0 if the loop is unstable without a cut. The axial depth of `cut` is not used.

    Raises ArgumentError as `chatter_radius` does, and unless `deepest` is positive.


    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.0003, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> tool = gt.milling.CorrectedTool(robot, [2.0, 0.5, 2.0], [0.0, 1.0, 0.0], cycle=0.004, delay=0.052)
    >>> depths = [gt.milling.corrected_depth(
    ...     tool, cutter, cut, 25.0, [1.0, 0.0, 0.0], gain, deepest=5e-3) for gain in (0.0, 0.1)]
    >>> [round(1e3 * depth, 2) for depth in depths]  # [mm]; the second gain is beyond its limit
    [0.77, 0.0]
    """

    @cache
    def growth(depth: float) -> float:
        deeper = replace(cut, axial_depth=depth)
        return chatter_radius(tool, cutter, deeper, speed, feed, gain, up=up, steps=steps).radius

    if not (np.isfinite(deepest) and deepest > 0):
        raise ArgumentError(f"must be a number above 0; found {deepest!r}", "deepest")
    low = deepest * 1e-3
    if growth(low * 1e-6) >= 1:
        return 0.0
    if growth(low) >= 1:
        low, high = low * 1e-6, low
    else:
        high = low
        while high < deepest and growth(high) < 1:
            low, high = high, min(1.2 * high, deepest)
        if growth(high) < 1:
            return deepest
    return crossing(lambda depth: np.log(growth(depth)), low, high, NEAR)[0]


@dataclass(frozen=True)
class CorrectedCut:
    """A cut with delayed corrections, for `cut` of `gt.control.delayed_feedback`: its options and gains, the cutter and
    its engagement; the axial depth of `cut` is not used.

    >>> of = gt.control.delayed.FeedbackCut("y", 25.0, [350.0, 350.0, 250.0], 17.0, 0.03)
    >>> cutter = gt.milling.Cutter(0.02, 2, gt.milling.CuttingCoefficients(6e3, 9e8, 7e3, 3e8))
    >>> cut = gt.milling.Cut("climb", radial_depth=0.006, axial_depth=0.0003, feed_per_tooth=1e-4)
    >>> gt.milling.CorrectedCut(of, cutter, cut).of.axis
    'y'
    """

    of: FeedbackCut
    cutter: Cutter
    cut: Cut

    def tool(self, plants: Mapping[str, Any], timing: FeedbackTiming) -> CorrectedTool:
        """Return the corrected tool. Raises ArgumentError for plants, timing or steps that do not fit."""
        of = self.of
        axes = {n: p for n, p in plants.items() if isinstance(p, FeedbackAxis)}
        if not {"x", "y"} <= set(axes) or of.axis not in ("x", "y"):
            raise ArgumentError(
                "a cut needs axes x and y with frequency and damping, and a correction along one of them", "cut.axis"
            )
        if timing.accumulate:
            raise ArgumentError("is not supported with a cut; leave it out", "timing.accumulate")
        with naming("cut."):
            _common_period(self.cutter, timing.cycle, of.speed, of.steps)
        frequency = np.array([axes["x"].frequency, axes["y"].frequency, of.z_frequency])
        zeta = np.array([axes["x"].damping_ratio, axes["y"].damping_ratio, of.z_damping_ratio])
        mass = np.array(of.mass)
        return CorrectedTool(
            Oscillators.with_damping_ratio(mass, mass * (2 * np.pi * frequency) ** 2, zeta),
            np.array([axes["x"].equivalent_mass(timing), axes["y"].equivalent_mass(timing), 1.0]),
            np.eye(3)["xy".index(of.axis)], timing.cycle, timing.delay,
        )  # fmt: skip

    def depths(self, tool: CorrectedTool, limit: float) -> dict[str, Any]:
        """Return chatter depths at shares of the gain limit, with the names of `DelayedFeedbackStudy`."""
        of = self.of
        gains = [share * limit for share in of.shares]
        once = chatter_radius(tool, self.cutter, self.cut, of.speed, of.feed_direction, 0.0, steps=of.steps)
        along = partial(corrected_depth, tool, self.cutter, self.cut, of.speed, of.feed_direction, deepest=of.deepest)
        return {
            "chatter_depth": {f"{g:.4g}": along(g, steps=of.steps) for g in gains},
            "chatter_depth_finer": {f"{g:.4g}": along(g, steps=2 * of.steps) for g in gains},
            "tooth_in_cycles": str(once.cycles_per_tooth),
            "spindle_speed_error": once.speed_error,
        }


def _common_period(cutter: Cutter, cycle: float, speed: float, steps: int) -> tuple[int, int]:
    """Steps of the tooth period, and of the common period of tooth and cycle; a cycle [s] has `steps`."""
    if steps < 4:
        raise ArgumentError(f"found {steps}; expected four or more", "steps")
    period = 1 / tooth_frequency(speed, cutter.teeth)
    step = cycle / steps
    tooth = round(period / step)
    if tooth < FEWEST:
        enough = steps * (int(np.ceil(FEWEST * step / period)) + 1)
        raise ArgumentError(
            f"the tooth period has {period / step:.3g} steps; expected {FEWEST} or more: choose {enough} steps or a "
            "slower spindle", "steps",
        )  # fmt: skip
    together = lcm(tooth, steps)
    if together > MOST_STEPS:
        raise ArgumentError(
            f"a tooth period of {tooth} steps and a cycle of {steps} have a common period of {together} steps, more "
            f"than {MOST_STEPS}; choose a number of steps with more factors", "steps",
        )  # fmt: skip
    return tooth, together


def _over(tool: CorrectedTool, W: np.ndarray, steps: int, tooth: int, together: int, gain: float) -> float:
    """Return the largest modulus of the multipliers of the map over the common period of tooth and cycle."""
    o, step = tool.oscillators, tool.cycle / steps
    m, c, k = (np.diag(x[0]) for x in (o.m, o.c, o.k))
    push = tool.direction / (tool.equivalent_mass * tool.cycle**2)
    whole, rest = divmod(exact(tool.delay), exact(tool.cycle))
    count = int(whole) + 1  # stored corrections, youngest first
    # pieces of a step: (span, whether the older correction acts); the hold changes once per cycle
    changes, remainder = int(float(rest) // step), float(rest) % step
    pieces = {i: [(step, i < changes)] for i in range(steps)}
    if remainder > 0:
        pieces[changes] = [(remainder, True), (step - remainder, False)]
    spans = sorted({span for p in pieces.values() for span, _ in p})
    pushed = np.broadcast_to((m @ push)[:, None], (tooth, 3, 1))
    A, B, _ = second_order(m, c, k - W, np.concatenate([-W, pushed], axis=2))
    E = {}
    for span in spans:
        free, entry = held(A, B, span)  # the delayed displacement is the mean of two past ones
        E[span] = free, np.concatenate([entry[..., :3], entry[..., :3]], axis=-1) / 2, entry[..., 3:]
    # columns: response to the initial state, to x at the last grid times, and to the corrections in transit
    size = 6 + 3 * tooth + count
    now = np.eye(6, size)
    past = np.empty((3 * (tooth + 1 + together), size))  # x at the grid times, oldest first
    past[: 3 * tooth], past[3 * tooth : 3 * tooth + 3] = np.eye(3 * tooth, size, 6), now[:3]
    sent = list(np.eye(count, size, 6 + 3 * tooth))
    for i in range(together):
        if i % steps == 0:
            sent = [-gain * tool.direction @ now[:3], *sent[:count]]
        late, early = sent[int(whole)], sent[int(whole) + 1]
        delayed = past[3 * i : 3 * i + 6]
        for span, older in pieces[i % steps]:
            free, entry, push = (x[i % tooth] for x in E[span])
            now = free @ now + entry @ delayed + push * (early if older else late)
        past[3 * (i + tooth + 1) :][:3] = now[:3]
    monodromy = np.concatenate([now, past[3 * together : -3], sent[:count]])
    return float(np.abs(np.linalg.eigvals(monodromy)).max())
