"""How far the correction of an external sensor may be turned up, as a study."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ...linear.roots import bisected
from ...results import ArgumentError, SolveStatus, Work
from ...results.options import Within
from ...results.refusal import naming
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from .limit import GainLimit, WorstCase, gain_limit, recommended_gain, worst_case
from .loop import DelayedLoop
from .margins import loop_margins, margin_limit
from .off_axis import limits_that_meet, off_axis_limits, plant_of_limit
from .options import (
    CutWhileCorrecting,
    DelayedFeedbackStudy,
    FeedbackAxis,
    FeedbackBox,
    FeedbackTiming,
    GainMargins,
    OffAxisRun,
    SinePath,
)
from .plants import MOST_CYCLES, CorrectedPlant, equivalent_plant
from .run import DelayedRun, run_along

TIMING, THESIS_PATH, BOX, MARGINS = FeedbackTiming(), SinePath(), FeedbackBox(), GainMargins()
READINGS = ((0.004, False), (0.004, True), (0.012, False), (0.012, True))  # cycles of 5.3.5 and 5.3.3
QUANTILE = 0.05  # of the limits in the box, for information
FEWER = 10  # times fewer random points where margins are looked for: they add a search from the worst of the limits
BESIDE = 0.05  # of a limit: where runs are drawn
HALVINGS = 9  # of the range: runs find a limit to half a per cent of itself
RANGE = (0.1, 10.0)  # times the declared limit along y: limits that are tried against experiments
CURVE = 60  # points of a picture's curve
Given = FeedbackAxis | CorrectedPlant


@study_function
def delayed_feedback(
    plants: Mapping[str, FeedbackAxis | CorrectedPlant],
    timing: FeedbackTiming = TIMING,
    *,
    box: FeedbackBox | None = BOX,
    margins: GainMargins = MARGINS,
    off_axis: Sequence[OffAxisRun] = (),
    path: SinePath | None = THESIS_PATH,
    noise: Annotated[float, Within(least=0.0)] = 15e-6,
    seed: Annotated[int, Within(least=0)] = 0,
    cut: CutWhileCorrecting | None = None,
    gain_step: Annotated[float, Within(above=0.0)] = 0.01,
    **work_options: Unpack[WorkOptions],
) -> DelayedFeedbackStudy:
    """Gain limits, margins and recommended gains of corrections from an external sensor that come late (Cvitanic 2021,
    chapter 5).

    Args:
        plants: by name what a correction acts on, `FeedbackAxis` or any `CorrectedPlant`, such as `servo_plant` makes.
        timing: cycle and delay, and whether corrections add up.
        box: how far plant and delay may be off: worst case and recommended gain; of a `CorrectedPlant` the delay alone.
            None: neither is asked for.
        margins: what the recommended gain keeps wherever in the box was looked.
        off_axis: directions between the plants "x" and "y", and what experiments saw along them.
        path, noise [m], seed: of the synthetic runs that show the limit in time; no runs without a path.
        cut: what cuts meanwhile, a `gt.milling.CorrectedCut`.
        gain_step: of gains of a `CorrectedPlant`; a `FeedbackAxis` has its own.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError for what is given wrong, and for a plant that is unstable at the smallest gains.

    >>> y = gt.control.delayed.FeedbackAxis(frequency=12.0, damping_ratio=0.06, limit=0.016, gain_step=0.01)
    >>> study = gt.control.delayed_feedback({"y": y}, box=gt.control.delayed.FeedbackBox(draws=50), path=None)
    >>> round(study.limit["y"], 4), study.recommended["y"]  # a step is 0.01: none of them is safe
    (0.016, 0.0)
    >>> round(study.worst_limit["y"], 4), round(study.margin_limit["y"], 4)
    (0.0085, 0.0042)
    """
    work = Work(**work_options)
    if not plants:
        raise ArgumentError("expected one or more plants", "plants")
    made = {name: _made(name, p, timing) for name, p in plants.items()}
    if off_axis and not {"x", "y"} <= set(plants):
        raise ArgumentError(f"lies between the plants x and y; there are {', '.join(plants)}", "off_axis")
    tool = None if cut is None else cut.tool(plants, timing)
    loops = {name: DelayedLoop(p, timing.cycle, timing.delay) for name, p in made.items()}
    limits, worst, kept = dict[str, GainLimit](), dict[str, WorstCase](), dict[str, WorstCase]()
    steps = {n: p.gain_step if isinstance(p, FeedbackAxis) else gain_step for n, p in plants.items()}
    work.keep(partial(_so_far, work.title, limits, worst, kept, steps))
    for name, p in plants.items():
        work.step(f"limit along {name}")
        limits[name] = _limit(name, loops[name])
        _check_gain(name, p, limits[name].gain)
    notes = [_returns(name, x) for name, x in limits.items() if x.returns]
    notes += [_aliased(n, p, timing) for n, p in plants.items() if isinstance(p, FeedbackAxis) and _fast(p, timing)]
    if box is not None:
        for name, plant in plants.items():
            work.step(f"worst case of {name}")
            worst[name], kept[name] = _worst(plant, made[name], timing, box, margins)
    recommended = {n: recommended_gain(w.gain, steps[n]) for n, w in kept.items()}
    gains = {n: _gain(p, limits[n].gain, recommended.get(n)) for n, p in plants.items()}
    there = {n: loop_margins(loops[n], g) for n, g in gains.items() if g > 0}
    readings = {n: _readings(p, timing) for n, p in plants.items() if isinstance(p, FeedbackAxis)}
    runs, simulated = dict[str, list[DelayedRun]](), dict[str, float]()
    for name, loop in loops.items() if path is not None else ():
        work.step(f"runs along {name}")
        assert path is not None
        at, limit = partial(run_along, loop, path=path, noise=noise, seed=seed), limits[name].gain
        if np.isfinite(limit):
            runs[name] = [at((1 + s) * limit) for s in (-BESIDE, BESIDE)]
            simulated[name] = _simulated(at, limit)
            if abs(simulated[name] / limit - 1) > BESIDE:
                notes.append(
                    f"along {name} a run of {path.duration:g} s shows the limit at {simulated[name]:.3g} only, the "
                    f"eigenvalues at {limit:.3g}: near it the error grows or fades slowly; take a longer run"
                )
    turned = _off_axis(plants, made, timing, off_axis, notes) if off_axis else {}
    if cut is not None and tool is not None:
        work.step("chatter")
        with naming("cut."):
            turned |= cut.depths(tool, limits[cut.of.axis].gain)
    if worst:
        notes += [_worst_words(n, w) for n, w in worst.items() if np.isfinite(w.gain)]
        notes += [_kept_words(n, w, margins) for n, w in kept.items() if np.isfinite(w.gain)]
        notes += [_beyond(n, gains[n], worst[n].gain) for n in there if gains[n] >= worst[n].gain]
    return DelayedFeedbackStudy(
        status=SolveStatus.SOLVED,
        message="; ".join(_words(n, limits[n], recommended.get(n), kept.get(n)) for n in plants),
        title=work.title,
        notes=notes,
        figures=_figures(loops, limits, worst, recommended, runs, made, off_axis, timing, turned, work.title),
        files={"limits.csv": _table(limits, recommended, worst)},
        runs=runs,
        limit={n: x.gain for n, x in limits.items()},
        frequency={n: x.frequency for n, x in limits.items()},
        returns={n: x.returns for n, x in limits.items() if x.returns},
        simulated_limit=simulated or None,
        worst_limit={n: w.gain for n, w in worst.items()} or None,
        worst_point={n: w.point for n, w in worst.items()},
        quantile_limit={n: float(np.quantile(w.limits, QUANTILE, method="lower")) for n, w in worst.items()} or None,
        margin_limit={n: w.gain for n, w in kept.items()} or None,
        margin_point={n: w.point for n, w in kept.items()},
        recommended=recommended or None,
        gain={n: gains[n] for n in there},
        gain_margin={n: m.gain for n, m in there.items()},
        phase_margin={n: m.phase for n, m in there.items()},
        delay_margin={n: m.delay for n, m in there.items()},
        disk_margin={n: m.disk for n, m in there.items()},
        readings=readings,
        **turned,
    )


def _so_far(
    title: str, limits: Mapping[str, GainLimit], worst: Mapping[str, WorstCase], kept: Mapping[str, WorstCase],
    steps: Mapping[str, float],
) -> DelayedFeedbackStudy:  # fmt: skip
    """The limits, worst cases and recommended gains that are known when a study is ended."""
    return DelayedFeedbackStudy(
        status=SolveStatus.INTERRUPTED,
        title=title,
        limit={n: x.gain for n, x in limits.items()},
        frequency={n: x.frequency for n, x in limits.items()},
        returns={n: x.returns for n, x in limits.items() if x.returns},
        worst_limit={n: w.gain for n, w in worst.items()} or None,
        worst_point={n: w.point for n, w in worst.items()},
        margin_limit={n: w.gain for n, w in kept.items()} or None,
        margin_point={n: w.point for n, w in kept.items()},
        recommended={n: recommended_gain(w.gain, steps[n]) for n, w in kept.items()} or None,
    )


def _made(name: str, plant: Given, timing: FeedbackTiming) -> CorrectedPlant:
    if isinstance(plant, CorrectedPlant):
        if timing.accumulate:
            raise ArgumentError("says what a correction does by itself; leave it out", "timing.accumulate")
        return plant
    with naming(f"plants.{name}."):
        return plant.plant(timing)


def _limit(name: str, loop: DelayedLoop) -> GainLimit:
    with naming(f"plants.{name}"):
        return gain_limit(loop)


def _returns(name: str, limit: GainLimit) -> str:
    there = ", ".join(f"{a:.3g} to {b:.3g}" for a, b in limit.returns)
    return f"along {name} the loop would be stable again at gains of {there}; on the way there it is not"


def _fast(axis: FeedbackAxis, timing: FeedbackTiming) -> bool:
    return axis.frequency * timing.cycle >= 0.5


def _aliased(name: str, axis: FeedbackAxis, timing: FeedbackTiming) -> str:
    rate = 1 / timing.cycle
    return (
        f"{name} swings at {axis.frequency:g} Hz, faster than half the sampling rate, {rate:g} Hz; the limit holds for "
        "the samples alone"
    )


def _worst(
    given: Given, made: CorrectedPlant, timing: FeedbackTiming, box: FeedbackBox, margins: GainMargins
) -> tuple[WorstCase, WorstCase]:
    """The least limit in the box, and the least gain up to which the margins are kept."""
    sides = {"delay": (max(0.0, timing.delay - box.delay), timing.delay + box.delay)}
    if sides["delay"][1] > MOST_CYCLES * timing.cycle:
        raise ArgumentError(f"leads to more than the {MOST_CYCLES} cycles of delay that are taken", "box.delay")
    if not isinstance(given, FeedbackAxis):
        return _both(lambda p: DelayedLoop(made, timing.cycle, p["delay"]), sides, box, margins)
    m, w, zeta = given.equivalent_mass(timing), 2 * np.pi * given.frequency, given.damping_ratio
    shares = {"mass": box.mass, "damping": box.damping, "stiffness": box.stiffness}
    sides |= {name: (1 - s, 1 + s) for name, s in shares.items()}

    def loop_of(p: Mapping[str, float]) -> DelayedLoop:
        plant = equivalent_plant(
            p["mass"] * m, p["damping"] * 2 * zeta * w * m, p["stiffness"] * w**2 * m, timing.cycle,
            accumulate=timing.accumulate,
        )  # fmt: skip
        return DelayedLoop(plant, timing.cycle, p["delay"])

    return _both(loop_of, sides, box, margins)


def _both(
    loop_of: Callable[[Mapping[str, float]], DelayedLoop], sides: Mapping[str, tuple[float, float]], box: FeedbackBox,
    margins: GainMargins,
) -> tuple[WorstCase, WorstCase]:  # fmt: skip
    worst = worst_case(loop_of, sides, draws=box.draws, seed=box.seed)
    kept = worst_case(
        loop_of, sides, limit_of=lambda loop: margin_limit(loop, margins), draws=max(box.draws // FEWER, 1),
        seed=box.seed,
    )  # fmt: skip
    half = worst.gain / margins.gain  # where the other search has seen less
    return worst, kept if kept.gain <= half else replace(kept, gain=half, point=worst.point)


def _check_gain(name: str, plant: Given, limit: float) -> None:
    if isinstance(plant, FeedbackAxis) and plant.gain is not None and plant.gain >= limit:
        raise ArgumentError(
            f"{plant.gain:g} is not below the limit, {limit:.4g}: such a loop has no margins", f"plants.{name}.gain"
        )


def _gain(plant: Given, limit: float, recommended: float | None) -> float:
    """At which margins are asked for: the one that is named, the recommended one, or half the limit."""
    if isinstance(plant, FeedbackAxis) and plant.gain is not None:
        return plant.gain
    other = limit / 2 if recommended is None else recommended
    return other if np.isfinite(other) else 1.0


def _readings(axis: FeedbackAxis, timing: FeedbackTiming) -> dict[str, float]:
    """The limit with each cycle and meaning of a correction, for the same vibration after one command: m times cycle
    stays."""
    m = axis.equivalent_mass(timing)
    limits = {}
    for cycle, accumulate in READINGS:
        other = FeedbackTiming(cycle, timing.delay, accumulate)
        plant = axis.plant(other, mass=m * timing.cycle / cycle)
        meaning = "adding up" if accumulate else "not adding up"
        limits[f"{1e3 * cycle:g} ms, {meaning}"] = gain_limit(DelayedLoop(plant, cycle, timing.delay)).gain
    return limits


def _simulated(at: Callable[..., DelayedRun], limit: float) -> float:
    """The gain at which runs begin to grow, between half and twice the limit; the nearer end where none does."""
    low, high = 0.5 * limit, 2.0 * limit
    if not at(low).bounded:
        return low
    return float(bisected(lambda gain: at(float(gain)).bounded, low, high, HALVINGS)[0])


def _off_axis(
    plants: Mapping[str, Given], made: Mapping[str, CorrectedPlant], timing: FeedbackTiming,
    wanted: Sequence[OffAxisRun], notes: list[str],
) -> dict[str, Any]:  # fmt: skip
    x, y, times = made["x"], plants["y"], (timing.cycle, timing.delay)
    limits = off_axis_limits(x, made["y"], [o.angle for o in wanted], *times)
    answers: dict[str, Any] = {"off_axis_limit": {_degrees(o): float(p) for o, p in zip(wanted, limits, strict=True)}}
    seen = {o.angle: (o.stable, o.unstable) for o in wanted if o.stable is not None and o.unstable is not None}
    if not seen or not isinstance(y, FeedbackAxis):
        return answers
    if timing.accumulate:
        notes.append("experiments along directions are not compared where corrections add up")
        return answers
    own = gain_limit(DelayedLoop(made["y"], *times)).gain
    plant_of = partial(plant_of_limit, y.frequency, y.damping_ratio, cycle=timing.cycle, delay=timing.delay)
    between = (RANGE[0] * own, RANGE[1] * own)
    met = limits_that_meet(plant_of, seen, x, *times, between=between)
    answers["meeting_limits"] = met
    if not met:
        notes.append("no limit along y puts all directions where the experiments saw them")
        return answers
    said = " or ".join(f"{a:.4g} to {b:.4g}" for a, b in met)
    notes.append(f"limits along y of {said} put all {len(seen)} directions where the experiments saw them")
    predicted = {}
    for o in wanted:
        if o.angle not in seen:
            ends = [off_axis_limits(x, plant_of(e), [o.angle], *times)[0] for interval in met for e in interval]
            predicted[_degrees(o)] = [float(min(ends)), float(max(ends))]
            notes.append(
                f"they predict {min(ends):.3g} to {max(ends):.3g} at {_degrees(o)} deg, where nothing was measured"
            )
    return answers | {"meeting_predictions": predicted}


def _degrees(run: OffAxisRun) -> str:
    return f"{np.rad2deg(run.angle):g}"


def _words(name: str, limit: GainLimit, recommended: float | None, kept: WorstCase | None) -> str:
    if not np.isfinite(limit.gain):
        return f"along {name} no gain makes the loop unstable"
    text = f"along {name} at most {limit.gain:.3g}, where it swings at {limit.frequency:.3g} Hz"
    if recommended is None or kept is None:
        return text
    if recommended:
        return f"{text}; take {recommended:g}"
    return f"{text}; no step of the gain keeps the margins, which allow {kept.gain:.3g} at the worst point of the box"


def _point(point: Mapping[str, float]) -> str:
    """A point of the box in words: "a delay of 54 ms, mass -15 %"."""
    off = [f"{n} {100 * (x - 1):+.0f} %" for n, x in point.items() if n != "delay"]
    return ", ".join([f"a delay of {1e3 * point['delay']:.4g} ms", *off])


def _worst_words(name: str, worst: WorstCase) -> str:
    return (
        f"along {name} the least limit seen in the box is {worst.gain:.3g}, with {_point(worst.point)}; 5 % of the "
        f"random points lie below {np.quantile(worst.limits, QUANTILE):.3g}"
    )


def _kept_words(name: str, kept: WorstCase, margins: GainMargins) -> str:
    return (
        f"along {name} gains up to {kept.gain:.3g} keep a gain margin of {margins.gain:g} and a phase margin of "
        f"{np.rad2deg(margins.phase):g} degrees everywhere that was looked; the worst is {_point(kept.point)}"
    )


def _beyond(name: str, gain: float, worst: float) -> str:
    return f"along {name} the gain of {gain:g} is unstable in part of the box, where the limit goes down to {worst:.3g}"


def _table(limits: Mapping[str, GainLimit], recommended: Mapping[str, float], worst: Mapping[str, WorstCase]) -> str:
    return csv_text(
        {
            "axis": list(limits),
            "limit": [x.gain for x in limits.values()],
            "frequency_Hz": [x.frequency for x in limits.values()],
            "worst_limit": [worst[n].gain if n in worst else float("nan") for n in limits],
            "recommended": [recommended.get(n, float("nan")) for n in limits],
        },
        digits=12,
    )


def _figures(
    loops: Mapping[str, DelayedLoop], limits: Mapping[str, GainLimit], worst: Mapping[str, WorstCase],
    recommended: Mapping[str, float], runs: Mapping[str, list[DelayedRun]], made: Mapping[str, CorrectedPlant],
    off_axis: Sequence[OffAxisRun], timing: FeedbackTiming, more: Mapping[str, Any], title: str,
) -> dict[str, Callable[[], Any]]:  # fmt: skip
    """Pictures by name; what they need is computed when they are drawn."""

    def radii() -> Any:
        from ...plot.delayed import radius_figure

        curves = {}
        for n, loop in loops.items():
            top = 1.6 * limits[n].gain if np.isfinite(limits[n].gain) else 2.0
            gains = np.linspace(0, top, CURVE)
            curves[n] = (gains, np.array([loop.radius(float(g)) for g in gains]), limits[n].gain)
        return radius_figure(curves, title=title)

    def box() -> Any:
        from ...plot.delayed import box_figure

        drawn = {n: (w.limits, w.nominal, w.gain, recommended[n]) for n, w in worst.items()}
        return box_figure(drawn, title=title)

    def along() -> Any:
        from ...plot.delayed import runs_figure

        return runs_figure({n: (r, limits[n].gain) for n, r in runs.items()}, BESIDE, title=title)

    def polar() -> Any:
        from ...plot.delayed import directions_figure

        angles = np.linspace(0, np.pi / 2, CURVE)
        return directions_figure(
            angles, off_axis_limits(made["x"], made["y"], angles, timing.cycle, timing.delay),
            [(o.angle, o.stable, o.unstable) for o in off_axis], title=title,
        )  # fmt: skip

    def depths() -> Any:
        from ...plot.delayed import depth_figure

        return depth_figure(more["chatter_depth"], more["chatter_depth_finer"], title=title)

    figures: dict[str, Callable[[], Any]] = {"limits": radii}
    figures |= {"box": box} if worst else {}
    figures |= {"runs": along} if runs else {}
    figures |= {"directions": polar} if off_axis else {}
    return figures | ({"chatter": depths} if "chatter_depth" in more else {})
