"""Study of gain limits over the joints of an arm, with Gaussian processes of m, c and k measured in some poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..._lazy import hint
from ...results import ArgumentError, SolveStatus, Work
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from ...workers.mapped import mapped
from .command_step import command_response, fit_command_step
from .limit import gain_limit, recommended_gain
from .loop import DelayedLoop
from .margins import margin_limit
from .options import FeedbackMapStudy, FeedbackTiming, GainMap, GainMargins, SyntheticCommands
from .plants import equivalent_plant

if TYPE_CHECKING:
    from ...vibration import GaussianProcess
else:
    GaussianProcess = hint("gtmodel.vibration", "GaussianProcess")

SCALES = (0.35, 0.6)  # rad: spread of joints 2 and 3 over the printed poses
DRAWS = 400
QUANTITIES = ("m", "c", "k")
TABLE_STEP, TABLE_EDGE = 0.01, 1e-6  # step of log frequency; how far the table extends beyond the draws
FEW = 400  # up to this number limits are computed without a table


@dataclass(frozen=True, eq=False)
class GainField:
    """m, c and k of `equivalent_plant` over two joint angles [rad], each the exponential of a Gaussian process.

    directions: names, such as "x" and "y". processes: (direction, quantity) -> process of the logarithm.
    synthetic: seed and noise if the data are synthetic.
    """

    directions: tuple[str, ...]
    processes: dict[tuple[str, str], GaussianProcess]
    synthetic: str | None = None

    def at(self, joints: ArrayLike, direction: str) -> tuple[np.ndarray, np.ndarray]:
        """Return means and standard deviations (3, n) of log m, log c, log k at joints (n, 2) [rad]."""
        if direction not in self.directions:
            raise ArgumentError(f"expected one of {', '.join(self.directions)}; found '{direction}'", "direction")
        poses = np.atleast_2d(np.asarray(joints, float))
        rows = [self.processes[direction, q].predict(poses) for q in QUANTITIES]
        return np.array([r[0] for r in rows]), np.array([r[1] for r in rows])


def fit_gain_field(
    joints: ArrayLike, m: ArrayLike, c: ArrayLike, k: ArrayLike, *, directions: Sequence[str] = ("x", "y"),
    scale: tuple[float, float] = SCALES, seed: int = 0, synthetic: str | None = None,
) -> GainField:  # fmt: skip
    """Fit Gaussian processes to measured m, c, k (n, d) at joints (n, 2) [rad], d directions (Cvitanic 2021, 5.3.4).

    The processes of a direction share length scales that maximise the marginal likelihood; seed: of the starts. Raises
    ArgumentError if shapes do not fit, if values are not positive, or if there are fewer than four different poses.

    >>> rng = np.random.default_rng(1)
    >>> joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    >>> m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 1))) for size in (3.0, 57.7, 34200.0))
    >>> field = gt.control.delayed.fit_gain_field(joints, m, c, k, directions=["x"])
    >>> limits = gt.control.delayed.limits_over(field, np.deg2rad([[-40.0, 90.0]]), "x", cycle=0.004, delay=0.052)
    >>> limits.shape, bool(0.1 < np.median(limits) < 0.4)  # draws of the processes at each pose
    ((1, 400), True)
    """
    from ...vibration import KernelInputs, fit_gaussian_processes

    poses = np.atleast_2d(np.asarray(joints, float))
    values = [np.asarray(v, float) for v in (m, c, k)]
    if poses.ndim != 2 or poses.shape[1] != 2:
        raise ArgumentError(f"have the shape {poses.shape}; expected (n, 2)", "joints")
    processes = {}
    for q, v in zip(QUANTITIES, values, strict=True):
        if v.shape != (len(poses), len(directions)):
            raise ArgumentError(f"has the shape {v.shape}; expected {(len(poses), len(directions))}", q)
        if not np.all((v > 0) & np.isfinite(v)):
            row = int(np.argwhere(~((v > 0) & np.isfinite(v)))[0, 0])
            raise ArgumentError(f"must be positive and finite; pose {row} is not", q)
    inputs = KernelInputs(scale, (False, False))
    for d, direction in enumerate(directions):
        logs = np.log(np.stack([v[:, d] for v in values]))
        try:
            fitted = fit_gaussian_processes(poses, logs, inputs, seed=seed)
        except ValueError as error:
            raise ArgumentError(str(error), "joints") from error
        processes |= {(direction, q): g for q, g in zip(QUANTITIES, fitted, strict=True)}
    return GainField(tuple(directions), processes, synthetic)


def limits_over(
    field: GainField, joints: ArrayLike, direction: str, *, cycle: float, delay: float, draws: int = DRAWS,
    seed: int = 0, margins: GainMargins | None = None,
) -> np.ndarray:  # fmt: skip
    """Return gain limits (n, draws) at joints (n, 2) [rad] for draws of m, c and k from the processes.

    With `margins` the limits are the gains up to which the margins are kept (`margin_limit`). All poses use the same
    draws, so that limits of neighbouring poses are correlated. At a given frequency and damping ratio the limit is
    proportional to the mass, so it is interpolated linearly in a table over these two. The error is up to one per cent
    where the limiting mode of the loop changes. Raises ArgumentError for an unknown direction.

    >>> rng = np.random.default_rng(1)
    >>> joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    >>> m, c, k = gt.control.delayed.true_plants(joints, gt.control.delayed.SyntheticCommands())
    >>> field = gt.control.delayed.fit_gain_field(joints, m, c, k)
    >>> limits = gt.control.delayed.limits_over(field, joints[:2], "y", cycle=0.004, delay=0.052, draws=100)
    >>> limits.shape
    (2, 100)
    """
    return _limits_over(field, joints, direction, [margins], cycle=cycle, delay=delay, draws=draws, seed=seed)[0]


def _limits_over(
    field: GainField, joints: ArrayLike, direction: str, margins: Sequence[GainMargins | None], *,
    cycle: float, delay: float, draws: int, seed: int = 0,
) -> list[np.ndarray]:  # fmt: skip
    """The limits for each of these margins, from the same loops."""
    mean, std = field.at(joints, direction)
    normal = np.random.default_rng(seed).standard_normal((3, 1, draws))
    log_m, log_c, log_k = mean[..., None] + std[..., None] * normal
    log_w, log_zeta = (log_k - log_m) / 2, log_c - np.log(2) - (log_k + log_m) / 2
    return [np.exp(log_m + limit) for limit in _log_limits_of_one(log_w, log_zeta, cycle, delay, margins)]


def recommended_over(limits: np.ndarray, step: float) -> np.ndarray:
    """Return `recommended_gain` (n,) for the least of limits with margins (n, draws), so that every draw keeps them.

    >>> gt.control.delayed.recommended_over(np.array([[0.021, 0.026], [0.05, 0.06]]), step=0.01)
    array([0.02, 0.05])
    """
    return np.array([recommended_gain(float(row.min()), step) for row in np.atleast_2d(limits)])


def _log_limits_of_one(
    log_w: np.ndarray, log_zeta: np.ndarray, cycle: float, delay: float, margins: Sequence[GainMargins | None]
) -> list[np.ndarray]:
    """Logarithm of the limit for a unit mass, for each of these margins."""

    def exact(w: float, zeta: float) -> list[float]:
        loop = DelayedLoop(equivalent_plant(1.0, 2 * zeta * w, w**2, cycle), cycle, delay)
        return [float(np.log(gain_limit(loop).gain if m is None else margin_limit(loop, m))) for m in margins]

    if log_w.size <= FEW:
        pairs = zip(np.exp(log_w).ravel().tolist(), np.exp(log_zeta).ravel().tolist(), strict=True)
        return [column.reshape(log_w.shape) for column in np.array([exact(w, z) for w, z in pairs]).T]
    axes = []
    for values, step in ((log_w, TABLE_STEP), (log_zeta, 5 * TABLE_STEP)):
        low, high = float(values.min()) - TABLE_EDGE, float(values.max()) + TABLE_EDGE
        axes.append(np.linspace(low, high, max(4, 2 + int((high - low) / step))))
    dampings = np.exp(axes[1]).tolist()

    def row(w: float) -> list[list[float]]:
        return [exact(w, z) for z in dampings]

    table = np.array(list(mapped(row, np.exp(axes[0]).tolist())))
    at = np.stack([log_w, log_zeta], axis=-1)
    return [scipy.interpolate.RegularGridInterpolator(axes, t, method="linear")(at) for t in np.moveaxis(table, -1, 0)]


TIMING, MAP, MARGINS = FeedbackTiming(), GainMap(), GainMargins()


@dataclass(frozen=True, eq=False)
class MeasuredPlants:
    """m, c and k (n, d) of `equivalent_plant` in n poses along d directions, at joints (n, 2) [rad].

    synthetic: seed and noise if the data are synthetic. Raises ArgumentError if shapes do not fit.

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
    """Return plants fitted to synthetic vibrations at joints (n, 2) [rad], and the share of 95 % intervals that contain
    the true m, c, k. cycle [s]. Raises ArgumentError if directions and options do not fit.

    >>> options = gt.control.delayed.SyntheticCommands(seed=1)
    >>> plants, inside = gt.control.delayed.synthetic_plants([[-0.7, 1.6]], options, ["x", "y"], cycle=0.004)
    >>> plants.m.shape, plants.synthetic
    ((1, 2), 'seed 1, noise 15 um, repeatability 5 %')
    """
    poses = np.atleast_2d(np.asarray(joints, float))
    if len(options.frequency) != len(directions):
        raise ArgumentError(
            f"expected {len(directions)} numbers, one per direction; found {len(options.frequency)}",
            "synthetic.frequency",
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
    note = f"seed {options.seed}, noise {1e6 * options.noise:g} um, repeatability {100 * options.repeatability:g} %"
    return MeasuredPlants(poses, fitted[0], fitted[1], fitted[2], tuple(directions), note), inside / fitted.size


def true_plants(joints: np.ndarray, options: SyntheticCommands) -> np.ndarray:
    """Return m, c, k (3, n, d) of the synthetic arm at joints (n, 2) [rad].

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
    **work_options: Unpack[WorkOptions],
) -> FeedbackMapStudy:
    """Compute gain limits of delayed corrections over joints 2 and 3 of an arm (Cvitanic 2021, sections 5.3.4, 5.4).

    Args:
        measured: m, c, k in some poses; or synthetic vibrations, to which they are fitted.
        joints: poses (n, 2) [rad] of the synthetic experiments; empty with measured plants.
        asked: poses (k, 2) [rad] of the table.
        timing: cycle and delay; corrections must not accumulate.
        gain_steps: step of the adjustable gain, by direction.
        options: grid, draws and quantile.
        margins: kept by the recommended gain of a pose in every draw.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError for an argument that does not fit.

    >>> rng = np.random.default_rng(1)
    >>> joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (10, 2)))
    >>> study = gt.control.delayed.feedback_map(
    ...     gt.control.delayed.SyntheticCommands(), joints.tolist(), [[-0.7, 1.6]], gain_steps={"x": 0.1, "y": 0.01},
    ...     options=gt.control.delayed.GainMap(draws=50))
    >>> study.status.ok, bool(0.05 < study.quantile["x"][0] < study.true_limit["x"][0])
    (True, True)
    """
    work = Work(**work_options)
    directions, inside = tuple(gain_steps), None
    truth = measured if isinstance(measured, SyntheticCommands) else None
    if timing.accumulate:
        raise ArgumentError("a map cannot have corrections that accumulate; leave it out", "timing.accumulate")
    if isinstance(measured, SyntheticCommands):
        if len(joints) < 4:
            raise ArgumentError(f"expected four or more poses; found {len(joints)}", "joints")
        work.step("vibrations")
        measured, share = synthetic_plants(joints, measured, directions, timing.cycle)
        inside = {"m, c and k": share}
    elif len(joints):
        raise ArgumentError("the measured plants hold their poses; leave it out", "joints")
    if set(measured.directions) != set(directions):
        raise ArgumentError(
            f"expected the measured directions {', '.join(measured.directions)}; found {', '.join(directions)}",
            "gain_steps",
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
        notes.append(f"rows {rows} of the table lie outside the measured joints: predictions are uncertain there")
    maps = dict[str, np.ndarray]()
    median, quantile, recommended, true = (dict[str, list[float]]() for _ in range(4))

    def picture() -> Any:
        from ...plot.delayed import map_figure

        return map_figure(axes[0], axes[1], maps, measured.joints, table, title=work.title)

    def so_far() -> FeedbackMapStudy:
        files = {"map.csv": _map_table(grid, maps)} if maps else {}
        if median:
            files["table.csv"] = _table(table, median, quantile, recommended, true)
        return FeedbackMapStudy(
            status=SolveStatus.INTERRUPTED,
            title=work.title,
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
    for d in directions if len(table) else ():  # few poses, so done before the map
        work.step(f"limits along {d}")
        drawn, limits = _limits_over(field, table, d, [None, margins], **times)
        median[d] = np.median(drawn, axis=1).tolist()
        quantile[d] = np.quantile(drawn, options.quantile, axis=1).tolist()
        recommended[d] = recommended_over(limits, gain_steps[d]).tolist()
    true |= _true(field, truth, table, timing) if truth is not None else {}
    for d in directions:
        work.step(f"map along {d}")
        over = limits_over(field, grid.reshape(-1, 2), d, **times)
        maps[d] = np.quantile(over, options.quantile, axis=1).reshape(grid.shape[:2])
    whole = so_far()
    parts = (f"along {d} 95 % of the limits lie above {v:.3g} in every pose of the map" for d, v in whole.least.items())
    return replace(whole, status=SolveStatus.SOLVED, message="; ".join(parts))


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
