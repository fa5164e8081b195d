"""Study of delayed feedback: gain limits, margins and recommended gains."""

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
QUANTILE = 0.05  # of the limits in the box
FEWER = 10  # times fewer random points for the limits with margins
BESIDE = 0.05  # of a limit: distance of the drawn runs from it
HALVINGS = 9  # of the range: runs give a limit to half a per cent
RANGE = (0.1, 10.0)  # times the declared limit along y: limits compared with experiments
CURVE = 60  # points of a picture's curve
Plant = FeedbackAxis | CorrectedPlant


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
    """Compute gain limits, margins and recommended gains of delayed corrections (Cvitanic 2021, chapter 5).

    Args:
        plants: by name, each a `FeedbackAxis` or any `CorrectedPlant`, for example from `servo_plant`.
        timing: cycle and delay, and whether corrections accumulate.
        box: uncertainty of plant and delay, for worst case and recommended gain; for a `CorrectedPlant` only of the
            delay. None: neither is computed.
        margins: kept by the recommended gain at every tested point of the box.
        off_axis: directions between the plants "x" and "y", with results of experiments.
        path, noise [m], seed: of the synthetic runs that show the limit in time; no runs without a path.
        cut: a cut during the correction, a `gt.milling.CorrectedCut`.
        gain_step: step of the gain for a `CorrectedPlant`; a `FeedbackAxis` has its own.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError for an argument that does not fit, and for a plant that is unstable at the smallest gains.

    >>> y = gt.control.delayed.FeedbackAxis(frequency=12.0, damping_ratio=0.06, limit=0.016, gain_step=0.01)
    >>> study = gt.control.delayed_feedback({"y": y}, box=gt.control.delayed.FeedbackBox(draws=50), path=None)
    >>> round(study.limit["y"], 4), study.recommended["y"]  # even one step, 0.01, does not keep the margins
    (0.016, 0.0)
    >>> round(study.worst_limit["y"], 4), round(study.margin_limit["y"], 4)
    (0.0085, 0.0042)
    """
    work = Work(**work_options)
    if not plants:
        raise ArgumentError("expected one or more plants", "plants")
    linear = {name: _linear(name, p, timing) for name, p in plants.items()}
    if off_axis and not {"x", "y"} <= set(plants):
        raise ArgumentError(f"needs the plants x and y; found {', '.join(plants)}", "off_axis")
    tool = None if cut is None else cut.tool(plants, timing)
    loops = {name: DelayedLoop(p, timing.cycle, timing.delay) for name, p in linear.items()}
    limits, worst, with_margins = dict[str, GainLimit](), dict[str, WorstCase](), dict[str, WorstCase]()
    steps = {n: p.gain_step if isinstance(p, FeedbackAxis) else gain_step for n, p in plants.items()}
    work.keep(partial(_so_far, work.title, limits, worst, with_margins, steps))
    for name, p in plants.items():
        work.step(f"limit along {name}")
        limits[name] = _limit(name, loops[name])
        _check_gain(name, p, limits[name].gain)
    notes = [_returns(name, x) for name, x in limits.items() if x.returns]
    notes += [_aliased(n, p, timing) for n, p in plants.items() if isinstance(p, FeedbackAxis) and _fast(p, timing)]
    if box is not None:
        for name, plant in plants.items():
            work.step(f"worst case of {name}")
            worst[name], with_margins[name] = _worst(plant, linear[name], timing, box, margins)
    recommended = {n: recommended_gain(w.gain, steps[n]) for n, w in with_margins.items()}
    gains = {n: _gain(p, limits[n].gain, recommended.get(n)) for n, p in plants.items()}
    at_gain = {n: loop_margins(loops[n], g) for n, g in gains.items() if g > 0}
    readings = {n: _readings(p, timing) for n, p in plants.items() if isinstance(p, FeedbackAxis)}
    runs, simulated = dict[str, list[DelayedRun]](), dict[str, float]()
    for name, loop in loops.items() if path is not None else ():
        work.step(f"runs along {name}")
        assert path is not None
        run, limit = partial(run_along, loop, path=path, noise=noise, seed=seed), limits[name].gain
        if np.isfinite(limit):
            runs[name] = [run((1 + s) * limit) for s in (-BESIDE, BESIDE)]
            simulated[name] = _simulated(run, limit)
            if abs(simulated[name] / limit - 1) > BESIDE:
                notes.append(
                    f"along {name} a run of {path.duration:g} s gives a limit of {simulated[name]:.3g}, the "
                    f"eigenvalues give {limit:.3g}: near it deviations grow or decay slowly; take a longer run"
                )
    more = _off_axis(plants, linear, timing, off_axis, notes) if off_axis else {}
    if cut is not None and tool is not None:
        work.step("chatter")
        with naming("cut."):
            more |= cut.depths(tool, limits[cut.of.axis].gain)
    if worst:
        notes += [_worst_words(n, w) for n, w in worst.items() if np.isfinite(w.gain)]
        notes += [_margin_words(n, w, margins) for n, w in with_margins.items() if np.isfinite(w.gain)]
        notes += [_beyond(n, gains[n], worst[n].gain) for n in at_gain if gains[n] >= worst[n].gain]
    return DelayedFeedbackStudy(
        status=SolveStatus.SOLVED,
        message="; ".join(_words(n, limits[n], recommended.get(n), with_margins.get(n)) for n in plants),
        title=work.title,
        notes=notes,
        figures=_figures(loops, limits, worst, recommended, runs, linear, off_axis, timing, more, work.title),
        files={"limits.csv": _table(limits, recommended, worst)},
        runs=runs,
        limit={n: x.gain for n, x in limits.items()},
        frequency={n: x.frequency for n, x in limits.items()},
        returns={n: x.returns for n, x in limits.items() if x.returns},
        simulated_limit=simulated or None,
        worst_limit={n: w.gain for n, w in worst.items()} or None,
        worst_point={n: w.point for n, w in worst.items()},
        quantile_limit={n: float(np.quantile(w.limits, QUANTILE, method="lower")) for n, w in worst.items()} or None,
        margin_limit={n: w.gain for n, w in with_margins.items()} or None,
        margin_point={n: w.point for n, w in with_margins.items()},
        recommended=recommended or None,
        gain={n: gains[n] for n in at_gain},
        gain_margin={n: m.gain for n, m in at_gain.items()},
        phase_margin={n: m.phase for n, m in at_gain.items()},
        delay_margin={n: m.delay for n, m in at_gain.items()},
        disk_margin={n: m.disk for n, m in at_gain.items()},
        readings=readings,
        **more,
    )


def _so_far(
    title: str, limits: Mapping[str, GainLimit], worst: Mapping[str, WorstCase], with_margins: Mapping[str, WorstCase],
    steps: Mapping[str, float],
) -> DelayedFeedbackStudy:  # fmt: skip
    """The limits, worst cases and recommended gains of an interrupted study."""
    return DelayedFeedbackStudy(
        status=SolveStatus.INTERRUPTED,
        title=title,
        limit={n: x.gain for n, x in limits.items()},
        frequency={n: x.frequency for n, x in limits.items()},
        returns={n: x.returns for n, x in limits.items() if x.returns},
        worst_limit={n: w.gain for n, w in worst.items()} or None,
        worst_point={n: w.point for n, w in worst.items()},
        margin_limit={n: w.gain for n, w in with_margins.items()} or None,
        margin_point={n: w.point for n, w in with_margins.items()},
        recommended={n: recommended_gain(w.gain, steps[n]) for n, w in with_margins.items()} or None,
    )


def _linear(name: str, plant: Plant, timing: FeedbackTiming) -> CorrectedPlant:
    if isinstance(plant, CorrectedPlant):
        if timing.accumulate:
            raise ArgumentError("belongs to axes; this plant defines the effect of corrections", "timing.accumulate")
        return plant
    with naming(f"plants.{name}."):
        return plant.plant(timing)


def _limit(name: str, loop: DelayedLoop) -> GainLimit:
    with naming(f"plants.{name}"):
        return gain_limit(loop)


def _returns(name: str, limit: GainLimit) -> str:
    ranges = ", ".join(f"{a:.3g} to {b:.3g}" for a, b in limit.returns)
    return f"along {name} the loop is stable again at gains of {ranges}, but unstable at the gains below them"


def _fast(axis: FeedbackAxis, timing: FeedbackTiming) -> bool:
    return axis.frequency * timing.cycle >= 0.5


def _aliased(name: str, axis: FeedbackAxis, timing: FeedbackTiming) -> str:
    rate = 1 / timing.cycle
    return (
        f"{name} oscillates at {axis.frequency:g} Hz, above half the sampling rate of {rate:g} Hz; the limit applies "
        "only to the samples"
    )


def _worst(
    axis: Plant, linear: CorrectedPlant, timing: FeedbackTiming, box: FeedbackBox, margins: GainMargins
) -> tuple[WorstCase, WorstCase]:
    """The least limit in the box, and the least limit with margins."""
    sides = {"delay": (max(0.0, timing.delay - box.delay), timing.delay + box.delay)}
    if sides["delay"][1] > MOST_CYCLES * timing.cycle:
        raise ArgumentError(f"leads to more than {MOST_CYCLES} cycles of delay; reduce it", "box.delay")
    if not isinstance(axis, FeedbackAxis):
        return _both(lambda p: DelayedLoop(linear, timing.cycle, p["delay"]), sides, box, margins)
    m, w, zeta = axis.equivalent_mass(timing), 2 * np.pi * axis.frequency, axis.damping_ratio
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
    loops = dict[tuple[float, ...], DelayedLoop]()  # both searches begin at the same points

    def kept(p: Mapping[str, float]) -> DelayedLoop:
        place = tuple(p.values())
        if place not in loops:
            loops[place] = loop_of(p)
        return loops[place]

    worst = worst_case(kept, sides, draws=box.draws, seed=box.seed)
    with_margins = worst_case(
        kept, sides, limit_of=lambda loop: margin_limit(loop, margins), draws=max(box.draws // FEWER, 1),
        seed=box.seed,
    )  # fmt: skip
    half = worst.gain / margins.gain  # the other search may have found a lower limit
    return worst, with_margins if with_margins.gain <= half else replace(with_margins, gain=half, point=worst.point)


def _check_gain(name: str, plant: Plant, limit: float) -> None:
    if isinstance(plant, FeedbackAxis) and plant.gain is not None and plant.gain >= limit:
        raise ArgumentError(
            f"must be below the limit, {limit:.4g}, to have margins; found {plant.gain:g}", f"plants.{name}.gain"
        )


def _gain(plant: Plant, limit: float, recommended: float | None) -> float:
    """The gain at which margins are computed: the declared one, the recommended one, or half the limit."""
    if isinstance(plant, FeedbackAxis) and plant.gain is not None:
        return plant.gain
    default = limit / 2 if recommended is None else recommended
    return default if np.isfinite(default) else 1.0


def _readings(axis: FeedbackAxis, timing: FeedbackTiming) -> dict[str, float]:
    """The limit for each reading of the thesis with the same vibration after one command: m times cycle is constant."""
    m = axis.equivalent_mass(timing)
    limits = {}
    for cycle, accumulate in READINGS:
        plant = axis.plant(FeedbackTiming(cycle, timing.delay, accumulate), mass=m * timing.cycle / cycle)
        meaning = "adding up" if accumulate else "not adding up"
        limits[f"{1e3 * cycle:g} ms, {meaning}"] = gain_limit(DelayedLoop(plant, cycle, timing.delay)).gain
    return limits


def _simulated(run: Callable[..., DelayedRun], limit: float) -> float:
    """The gain at which runs begin to grow, clipped to between half and twice the limit."""
    low, high = 0.5 * limit, 2.0 * limit
    if not run(low).bounded:
        return low
    return float(bisected(lambda gain: run(float(gain)).bounded, low, high, HALVINGS)[0])


def _off_axis(
    plants: Mapping[str, Plant], linear: Mapping[str, CorrectedPlant], timing: FeedbackTiming,
    runs: Sequence[OffAxisRun], notes: list[str],
) -> dict[str, Any]:  # fmt: skip
    x, y, times = linear["x"], plants["y"], (timing.cycle, timing.delay)
    limits = off_axis_limits(x, linear["y"], [o.angle for o in runs], *times)
    answers: dict[str, Any] = {"off_axis_limit": {_degrees(o): float(p) for o, p in zip(runs, limits, strict=True)}}
    tested = {o.angle: (o.stable, o.unstable) for o in runs if o.stable is not None and o.unstable is not None}
    if not tested or not isinstance(y, FeedbackAxis):
        return answers
    if timing.accumulate:
        notes.append("experiments in other directions are not compared if corrections accumulate")
        return answers
    limit = gain_limit(DelayedLoop(linear["y"], *times)).gain
    plant_of = partial(plant_of_limit, y.frequency, y.damping_ratio, cycle=timing.cycle, delay=timing.delay)
    between = (RANGE[0] * limit, RANGE[1] * limit)
    met = limits_that_meet(plant_of, tested, x, *times, between=between)
    answers["meeting_limits"] = met
    if not met:
        notes.append("for no limit along y do all directions agree with the experiments")
        return answers
    ranges = " or ".join(f"{a:.4g} to {b:.4g}" for a, b in met)
    notes.append(f"with limits along y of {ranges} all {len(tested)} directions agree with the experiments")
    predicted = {}
    for o in runs:
        if o.angle not in tested:
            ends = [off_axis_limits(x, plant_of(e), [o.angle], *times)[0] for interval in met for e in interval]
            predicted[_degrees(o)] = [float(min(ends)), float(max(ends))]
            notes.append(f"they predict {min(ends):.3g} to {max(ends):.3g} at {_degrees(o)} deg, without an experiment")
    return answers | {"meeting_predictions": predicted}


def _degrees(run: OffAxisRun) -> str:
    return f"{np.rad2deg(run.angle):g}"


def _words(name: str, limit: GainLimit, recommended: float | None, least: WorstCase | None) -> str:
    if not np.isfinite(limit.gain):
        return f"along {name} no gain makes the loop unstable"
    text = f"along {name} the gain limit is {limit.gain:.3g}, with an oscillation at {limit.frequency:.3g} Hz"
    if recommended is None or least is None:
        return text
    if recommended:
        return f"{text}; recommended {recommended:g}"
    return f"{text}; no step of the gain keeps the margins, which allow {least.gain:.3g} at the worst point of the box"


def _point(point: Mapping[str, float]) -> str:
    """A point of the box in words: "a delay of 54 ms, mass -15 %"."""
    off = [f"{n} {100 * (x - 1):+.0f} %" for n, x in point.items() if n != "delay"]
    return ", ".join([f"a delay of {1e3 * point['delay']:.4g} ms", *off])


def _worst_words(name: str, worst: WorstCase) -> str:
    return (
        f"along {name} the least limit found in the box is {worst.gain:.3g}, at {_point(worst.point)}; 5 % of the "
        f"random points have limits below {np.quantile(worst.limits, QUANTILE):.3g}"
    )


def _margin_words(name: str, least: WorstCase, margins: GainMargins) -> str:
    return (
        f"along {name} gains up to {least.gain:.3g} keep a gain margin of {margins.gain:g} and a phase margin of "
        f"{np.rad2deg(margins.phase):g} degrees at all tested points; the worst is {_point(least.point)}"
    )


def _beyond(name: str, gain: float, worst: float) -> str:
    return f"along {name} the gain of {gain:g} is unstable in part of the box: the least limit is {worst:.3g}"


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
    recommended: Mapping[str, float], runs: Mapping[str, list[DelayedRun]], linear: Mapping[str, CorrectedPlant],
    off_axis: Sequence[OffAxisRun], timing: FeedbackTiming, more: Mapping[str, Any], title: str,
) -> dict[str, Callable[[], Any]]:  # fmt: skip
    """Pictures by name; their curves are computed on drawing."""

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
            angles, off_axis_limits(linear["x"], linear["y"], angles, timing.cycle, timing.delay),
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
