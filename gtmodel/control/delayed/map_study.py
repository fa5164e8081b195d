"""Gain limits over the joints of an arm, from commands that were answered by vibration in some poses, as a study."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError, SolveStatus, Work
from ...results.door import study_function
from ...results.table import csv_text
from ...results.work import Progress, never, silent
from .command_step import command_response, fit_command_step
from .field import GainField, fit_gain_field, limits_over, recommended_over
from .limit import gain_limit
from .loop import DelayedLoop
from .options import FeedbackTiming, GainMap, GainMargins, SyntheticCommands
from .plants import equivalent_plant
from .result import FeedbackMapStudy

TIMING, MAP, MARGINS = FeedbackTiming(), GainMap(), GainMargins()
QUANTITIES = ("m", "c", "k")


@dataclass(frozen=True, eq=False)
class MeasuredPlants:
    """m, c and k (n, d) of `equivalent_plant` in n poses along d directions, at joints (n, 2) [rad].

    synthetic: seed and noise of synthetic ones. Raises ArgumentError for shapes that do not fit.

    >>> one = np.ones((4, 1))
    >>> plants = gt.control.delayed.MeasuredPlants(np.zeros((4, 2)), one, 60 * one, 3e4 * one, ("x",))
    >>> plants.m.shape
    (4, 1)
    """

    joints: np.ndarray
    m: np.ndarray
    c: np.ndarray
    k: np.ndarray
    directions: tuple[str, ...]
    synthetic: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", np.asarray(self.joints, float))
        if self.joints.ndim != 2 or self.joints.shape[1] != 2:
            raise ArgumentError(f"have the shape {self.joints.shape}; expected (n, 2)", "joints")
        for name in QUANTITIES:
            value = np.asarray(getattr(self, name), float)
            if value.shape != (len(self.joints), len(self.directions)):
                expected = (len(self.joints), len(self.directions))
                raise ArgumentError(f"has the shape {value.shape}; expected {expected}", name)
            object.__setattr__(self, name, value)


def synthetic_plants(
    joints: ArrayLike, options: SyntheticCommands, directions: Sequence[str], cycle: float
) -> tuple[MeasuredPlants, float]:
    """Plants fitted to synthetic vibrations at joints (n, 2) [rad], and the share of their 95 % intervals that hold the
    m, c, k of the experiment. cycle [s]. Raises ArgumentError where directions and options do not fit.

    >>> options = gt.control.delayed.SyntheticCommands(seed=1)
    >>> plants, inside = gt.control.delayed.synthetic_plants([[-0.7, 1.6]], options, ["x", "y"], cycle=0.004)
    >>> plants.m.shape, plants.synthetic
    ((1, 2), 'seed 1, noise 15 um, repeatability 5 %')
    """
    poses = np.atleast_2d(np.asarray(joints, float))
    if len(options.frequency) != len(directions):
        raise ArgumentError(
            f"has {len(options.frequency)} numbers for {len(directions)} directions", "synthetic.frequency"
        )
    rng, true = np.random.default_rng(options.seed), true_plants(poses, options)
    time = cycle * np.arange(1, round(options.duration / cycle) + 1)
    fitted, inside = np.empty_like(true), 0
    for pose in range(len(poses)):
        for d in range(len(directions)):
            values = true[:, pose, d] * np.exp(options.repeatability * rng.standard_normal(3))
            y = command_response(values[0], values[1], values[2], time, size=options.size, cycle=cycle)
            y = y + options.noise * rng.standard_normal(len(time))
            fit = fit_command_step(time, y, size=options.size, cycle=cycle, sigma=options.noise)
            low, high = fit.intervals()
            inside += int(np.sum((low < values) & (values < high)))
            fitted[:, pose, d] = fit.values
    said = f"seed {options.seed}, noise {1e6 * options.noise:g} um, repeatability {100 * options.repeatability:g} %"
    return MeasuredPlants(poses, fitted[0], fitted[1], fitted[2], tuple(directions), said), inside / fitted.size


def true_plants(joints: np.ndarray, options: SyntheticCommands) -> np.ndarray:
    """m, c, k (3, n, d) of the synthetic arm at joints (n, 2) [rad].

    >>> m, c, k = gt.control.delayed.true_plants(np.array([[-0.7, 1.6]]), gt.control.delayed.SyntheticCommands())
    >>> (np.sqrt(k / m) / (2 * np.pi)).round(2)  # [Hz], along x and y
    array([[13.81,  9.75]])
    """
    reach = (np.cos(joints[:, 0]) + np.cos(joints.sum(axis=1)))[:, None]
    w = 2 * np.pi * np.array(options.frequency) * np.exp(options.frequency_slope * reach)
    m = np.array(options.mass) * np.exp(options.mass_slope * reach)
    return np.stack([m, 2 * np.array(options.damping_ratio) * w * m, w**2 * m])


@study_function
def feedback_map(
    measured: MeasuredPlants | SyntheticCommands,
    joints: Sequence[Sequence[float]] = (),
    asked: Sequence[Sequence[float]] = (),
    timing: FeedbackTiming = TIMING,
    *,
    gain_steps: Mapping[str, float],
    options: GainMap = MAP,
    margins: GainMargins = MARGINS,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> FeedbackMapStudy:
    """Gain limits of late corrections over joints 2 and 3 of an arm (Cvitanic 2021, sections 5.3.4, 5.4).

    Args:
        measured: m, c, k in some poses; or synthetic vibrations, from which they are fitted.
        joints: poses (n, 2) [rad] of the synthetic experiments; left out with measured plants.
        asked: poses (k, 2) [rad] of the table.
        timing: cycle and delay; corrections that add up are not asked for here.
        gain_steps: by direction, from one gain that can be set to the next.
        options: grid, draws and quantile.
        margins: what the recommended gain of a pose keeps in every draw.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError for what is given wrong.

    >>> rng = np.random.default_rng(1)
    >>> joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (10, 2)))
    >>> study = gt.control.delayed.feedback_map(
    ...     gt.control.delayed.SyntheticCommands(), joints.tolist(), [[-0.7, 1.6]], gain_steps={"x": 0.1, "y": 0.01})
    >>> study.status.ok, bool(0.05 < study.quantile["x"][0] < study.true_limit["x"][0])
    (True, True)
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    directions, inside = tuple(gain_steps), None
    truth = measured if isinstance(measured, SyntheticCommands) else None
    if timing.accumulate:
        raise ArgumentError("the map takes corrections that do not add up; leave it out", "timing.accumulate")
    if isinstance(measured, SyntheticCommands):
        if len(joints) < 4:
            raise ArgumentError(f"{len(joints)} poses are too few; expected four or more", "joints")
        work.step("vibrations")
        measured, share = synthetic_plants(joints, measured, directions, timing.cycle)
        inside = {"m, c and k": share}
    elif len(joints):
        raise ArgumentError("the measured plants say in which poses they are; leave it out", "joints")
    if set(measured.directions) != set(directions):
        raise ArgumentError(
            f"names {', '.join(directions)}; measured were {', '.join(measured.directions)}", "gain_steps"
        )
    work.step("field")
    field = fit_gain_field(
        measured.joints,
        measured.m,
        measured.c,
        measured.k,
        directions=measured.directions,
        synthetic=measured.synthetic,
    )
    table = np.asarray(asked, float).reshape(-1, 2)
    low, high = measured.joints.min(axis=0), measured.joints.max(axis=0)
    axes = [np.linspace(low[i], high[i], options.points) for i in (0, 1)]
    grid = np.stack(np.meshgrid(*axes), axis=-1)
    times: dict[str, Any] = {"cycle": timing.cycle, "delay": timing.delay, "draws": options.draws}
    notes = [f"plants are synthetic: {field.synthetic}"] if field.synthetic else []
    beyond = np.any((table < low) | (table > high), axis=1)
    if beyond.any():
        rows = ", ".join(str(1 + i) for i in np.flatnonzero(beyond).tolist())
        notes.append(f"rows {rows} of the table lie outside of the measured joints: predictions are wide there")
    maps = dict[str, np.ndarray]()
    median, quantile, recommended, true = (dict[str, list[float]]() for _ in range(4))

    def picture() -> Any:
        from ...plot.delayed import map_figure

        return map_figure(axes[0], axes[1], maps, measured.joints, table, title=title)

    def so_far() -> FeedbackMapStudy:
        files = {"map.csv": _map_table(grid, maps)} if maps else {}
        if median:
            files["table.csv"] = _table(table, median, quantile, recommended, true)
        return FeedbackMapStudy(
            status=SolveStatus.INTERRUPTED,
            title=title,
            notes=notes,
            figures={"map": picture} if maps else {},
            files=files,
            poses=len(measured.joints),
            asked=table.tolist(),
            median=median,
            quantile=quantile,
            recommended=recommended,
            true_limit=true or None,
            least={d: float(v.min()) for d, v in maps.items()},
            inside=inside,
        )

    work.keep(so_far)
    for d in directions if len(table) else ():  # of few poses: soon there
        work.step(f"limits along {d}")
        drawn = limits_over(field, table, d, **times)
        median[d] = np.median(drawn, axis=1).tolist()
        quantile[d] = np.quantile(drawn, options.quantile, axis=1).tolist()
        kept = limits_over(field, table, d, **times, margins=margins)
        recommended[d] = recommended_over(kept, gain_steps[d]).tolist()
    true |= _true(field, truth, table, timing) if truth is not None else {}
    for d in directions:
        work.step(f"map along {d}")
        over = limits_over(field, grid.reshape(-1, 2), d, **times)
        maps[d] = np.quantile(over, options.quantile, axis=1).reshape(grid.shape[:2])
    whole = so_far()
    said = (f"along {d} 95 % of the limits lie above {v:.3g} in every pose of the map" for d, v in whole.least.items())
    return replace(whole, status=SolveStatus.SOLVED, message="; ".join(said))


def _true(
    field: GainField, truth: SyntheticCommands, table: np.ndarray, timing: FeedbackTiming
) -> dict[str, list[float]]:
    values = true_plants(table, truth) if len(table) else np.empty((3, 0, len(field.directions)))
    return {
        d: [
            gain_limit(DelayedLoop(equivalent_plant(v[0], v[1], v[2], timing.cycle), timing.cycle, timing.delay)).gain
            for v in values[:, :, i].T
        ]
        for i, d in enumerate(field.directions)
        if len(table)
    }


def _table(table: np.ndarray, *by: Mapping[str, list[float]]) -> str:
    columns: dict[str, Any] = {f"joint_{j + 2}_deg": np.rad2deg(table[:, j]) for j in (0, 1)}
    for name, values in zip(("median", "quantile", "recommended", "true"), by, strict=True):
        columns |= {f"{name}_{d}": v for d, v in values.items()}
    return csv_text(columns, digits=9)


def _map_table(grid: np.ndarray, maps: Mapping[str, np.ndarray]) -> str:
    columns: dict[str, Any] = {f"joint_{j + 2}_deg": np.rad2deg(grid[..., j]).ravel() for j in (0, 1)}
    return csv_text(columns | {f"quantile_{d}": v.ravel() for d, v in maps.items()}, digits=9)
