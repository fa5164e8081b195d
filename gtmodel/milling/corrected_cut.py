"""Chatter of a cut while a late loop corrects: regeneration and feedback in one map, semi-discretised."""

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
from ..simulation.hybrid.clock import exact
from .cutter import Cut, Cutter, tooth_frequency
from .forces import plane
from .oscillators import Oscillators
from .stability import mean_matrices

STEPS = 20  # of a cycle
MOST_STEPS = 40_000  # until tooth and cycle meet again
FEWEST = 4  # steps of the period of a tooth
UNEVEN = 1e-9  # rad
NEAR = 1e-6  # relative, of a depth: Brent's method needs no more radii for it than halving for a thousandth


@dataclass(frozen=True)
class CorrectedTool:
    """A tool that cuts and is corrected along one direction, by gain -gain times its deviation, `delay` [s] late.

    oscillators: of the tool, in kg (the first pose counts). equivalent_mass (3,): m of `equivalent_plant` along x, y,
    z of the world; frequency and damping are those of the oscillators. direction (3,): of unit length, along which the
    deviation is measured and corrected. cycle [s]. Raises ArgumentError for what does not fit.
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
            raise ArgumentError(f"expected three numbers of unit length; found {e.tolist()}", "direction")
        if not (np.isfinite(self.cycle) and self.cycle > 0):
            raise ArgumentError(f"must be a number above 0; found {self.cycle!r}", "cycle")
        if not (np.isfinite(self.delay) and self.delay >= 0):
            raise ArgumentError(f"must be a number, at least 0; found {self.delay!r}", "delay")
        object.__setattr__(self, "equivalent_mass", mass)
        object.__setattr__(self, "direction", e)


@dataclass(frozen=True)
class ChatterRadius:
    """radius: of the growth in a cycle; below 1 the cut is stable. cycles_per_tooth: the rational number that is taken
    for the period of a tooth over the cycle. speed [1/s]: of the spindle that has it. speed_error: relative, from the
    one that was asked for."""

    radius: float
    cycles_per_tooth: Fraction
    speed: float
    speed_error: float


def chatter_radius(
    tool: CorrectedTool, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, gain: float, *,
    up: ArrayLike = (0.0, 0.0, 1.0), steps: int = STEPS,
) -> ChatterRadius:  # fmt: skip
    """Growth in a cycle of a cut at a spindle speed [1/s] while corrections act.

    A step is a cycle by `steps`; the period of a tooth is taken as the nearest number of steps, and the map runs until
    tooth and cycle meet again. In a step the force's coefficient and the displacement of the tooth before are constant,
    as in Insperger and Stepan 2004; corrections are held exactly, whatever their delay. The more steps the nearer: the
    error of the rational number and of the steps shows in a second run with twice as many. Even pitch only. Raises
    ArgumentError for an uneven pitch, for fewer than four steps in the period of a tooth and where tooth and cycle meet
    too late, ValueError for impossible speeds.

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
        raise ArgumentError("the pitch of the teeth is uneven; this map takes even pitch only", "cutter")
    if steps < 4:
        raise ArgumentError(f"found {steps}; expected four or more", "steps")
    if not np.isfinite(gain):
        raise ArgumentError(f"must be a number; found {gain!r}", "gain")
    asked = 1 / tooth_frequency(speed, cutter.teeth)
    step = tool.cycle / steps
    tooth = round(asked / step)
    if tooth < FEWEST:
        raise ArgumentError(
            f"a tooth comes every {asked / step:.3g} steps; expected {FEWEST} or more: take {steps} steps times "
            f"{int(np.ceil(FEWEST * step / asked)) + 1} or a slower spindle", "steps",
        )  # fmt: skip
    together = lcm(tooth, steps)
    if together > MOST_STEPS:
        raise ArgumentError(
            f"a tooth of {tooth} steps and a cycle of {steps} meet after {together} steps, more than {MOST_STEPS}; "
            "take a number of steps with more factors", "steps",
        )  # fmt: skip
    P = plane(feed, up)
    W = cut.axial_depth * np.einsum("ji,tjk,kl->til", P, mean_matrices(cutter, cut, tooth), P)
    growth = _over(tool, W, steps, tooth, together, gain)
    used = 1 / (cutter.teeth * tooth * step)
    return ChatterRadius(growth ** (steps / together), Fraction(tooth, steps), used, used / speed - 1)


def corrected_depth(
    tool: CorrectedTool, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, gain: float, *,
    deepest: float, up: ArrayLike = (0.0, 0.0, 1.0), steps: int = STEPS,
) -> float:  # fmt: skip
    """The axial depth [m] at which a cut first chatters while corrections act, by steps of a fifth and Brent's method;
    `deepest` where it does not, 0 where the loop is unstable without a cut. cut: its own axial depth does not count.

    Raises ArgumentError as `chatter_radius`, and for a deepest cut of nothing.


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
    """What cuts while late corrections act, for `cut` of `gt.control.delayed_feedback`: its numbers and the gains that
    are asked for, cutter, and how the cutter is engaged; the axial depth of `cut` does not count.

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
        """What cuts and is corrected. Raises ArgumentError for what does not fit."""
        of = self.of
        axes = {n: p for n, p in plants.items() if isinstance(p, FeedbackAxis)}
        if not {"x", "y"} <= set(axes) or of.axis not in ("x", "y"):
            raise ArgumentError(
                "a cut wants the axes x and y by frequency and damping, and is corrected along one of them", "cut.axis"
            )
        if timing.accumulate:
            raise ArgumentError("the map of a cut has no arm that moves by itself; leave it out", "timing.accumulate")
        frequency = np.array([axes["x"].frequency, axes["y"].frequency, of.z_frequency])
        zeta = np.array([axes["x"].damping_ratio, axes["y"].damping_ratio, of.z_damping_ratio])
        mass = np.array(of.mass)
        return CorrectedTool(
            Oscillators.with_damping_ratio(mass, mass * (2 * np.pi * frequency) ** 2, zeta),
            np.array([axes["x"].equivalent_mass(timing), axes["y"].equivalent_mass(timing), 1.0]),
            np.eye(3)["xy".index(of.axis)], timing.cycle, timing.delay,
        )  # fmt: skip

    def depths(self, tool: CorrectedTool, limit: float) -> dict[str, Any]:
        """Depths of chatter at shares of the limit of the gain, as `DelayedFeedbackStudy` names them."""
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


def _over(tool: CorrectedTool, W: np.ndarray, steps: int, tooth: int, together: int, gain: float) -> float:
    """Largest modulus of the multipliers of the map over so many steps that tooth and cycle meet."""
    o, step = tool.oscillators, tool.cycle / steps
    m, c, k = (np.diag(x[0]) for x in (o.m, o.c, o.k))
    push = tool.direction / (tool.equivalent_mass * tool.cycle**2)
    whole, rest = divmod(exact(tool.delay), exact(tool.cycle))
    count = int(whole) + 1  # corrections that are kept, youngest first
    # pieces of a step: (span, whether the correction is the older one); the hold changes once in a cycle
    changes, left = int(float(rest) // step), float(rest) % step
    pieces = {i: [(step, i < changes)] for i in range(steps)}
    if left > 0:
        pieces[changes] = [(left, True), (step - left, False)]
    spans = sorted({span for p in pieces.values() for span, _ in p})
    pushed = np.broadcast_to((m @ push)[:, None], (tooth, 3, 1))
    A, B, _ = second_order(m, c, k - W, np.concatenate([-W, pushed], axis=2))
    E = {span: held(A, B, span) for span in spans}
    # columns: what the state now, x at the last grid times and the corrections on their way become
    size = 6 + 3 * tooth + count
    now = np.eye(6, size)
    past = [np.eye(3, size), *np.eye(3 * tooth, size, 6).reshape(tooth, 3, size)]
    sent = list(np.eye(count, size, 6 + 3 * tooth))
    for i in range(together):
        if i % steps == 0:
            sent = [-gain * tool.direction @ now[:3], *sent[:count]]
        late, early = sent[int(whole)], sent[int(whole) + 1]
        delayed = (past[-1] + past[-2]) / 2
        for span, older in pieces[i % steps]:
            free, entry = (x[i % tooth] for x in E[span])
            acting = early if older else late
            now = free @ now + entry[:, :3] @ delayed + np.outer(entry[:, 3], acting)
        past = [now[:3], *past[:-1]]
    monodromy = np.concatenate([now, *past[1:], sent[:count]])
    return float(np.abs(np.linalg.eigvals(monodromy)).max())
