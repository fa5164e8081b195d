"""The fusion study: tracker and inertial unit along a known path, compared with two baselines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Unpack

import numpy as np

from ... import view
from ...measurements.inspection.data_tests import Data, tested
from ...results import SolveStatus, Work
from ...results.suspicion import suspicion_checks
from ...results.trajectory import Trajectory
from ...results.work import Interrupted, WorkOptions, never, study_function
from ...workers.mapped import mapped
from ..consistency import Consistency, consistency
from ..error_state import ErrorState, Filter
from ..filter_study import innovations_picture
from ..filtered import Filtered
from ..manifold import Manifold
from ..paths import TrackedPath
from ..smoother import Smoothed, smooth
from ..system import System
from ..tuning import ScheduledNoise, likely_modes
from .options import (
    SETTLED,
    TABLE_10,
    FusionFilter,
    FusionSensors,
    FusionStudy,
    FusionSweep,
    agree_on_sweep,
    agree_together,
    printed_errors,
)
from .scene import OUTLYING, Scene, process_of, scene_of, sensors_of, slope_velocity, tracker_system

SEGMENTS, ELLIPSOIDS = 400, 25  # of the path in space
AROUND = 0.2  # s around the bend in the picture of the angular acceleration
ITERATIONS = 3  # of the iterated filter
PARTICLE_SEED = 1
DECADES = (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0)  # m2/s5


@study_function
def fusion_study(
    path: TrackedPath | None = None,
    sensors: FusionSensors | None = None,
    filter: FusionFilter | None = None,
    sweep: FusionSweep | None = None,
    *,
    seed: int = 1,
    **work_options: Unpack[WorkOptions],
) -> FusionStudy:
    """Test what an inertial unit adds to a laser tracker along a known path: Cvitanic 2021, chapter 4.

    Readings are synthetic: the true motion with the noise, biases and errors of `sensors`; the filter knows only the
    noise. The velocity error is compared with two baselines, the slope of the last four positions and a Kalman filter
    on the tracker alone. The innovations test whether the filter is consistent.

    Args:
        path: sine, line or semicircle at constant speed, in 3 or 5 axes; the sine of the thesis if left out.
        sensors: those of Table 7 if left out.
        filter: its process noise, and whether two filters interact.
        sweep: one sensor parameter over several values.
        seed: of the noise.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError for a filter that does not fit the path.

    >>> path = gt.filtering.TrackedPath(duration=0.2)
    >>> study = gt.filtering.fusion_study(path, seed=2)
    >>> study.status.value, study.axes, len(study.trajectory)
    ('solved', 3, 201)
    """
    work = Work(**work_options)
    path, sensors = path or TrackedPath(), sensors or FusionSensors()
    design = filter or FusionFilter()
    agree_together(path, sensors, design)
    if sweep is not None:
        agree_on_sweep(path, sensors, design, sweep)
    work.step("drawing readings", 0.02)
    scene = scene_of(path, sensors, seed)
    work.step("filtering", 0.1)
    answer = partial(_answer, scene, path, sensors, sweep, seed, work.title)
    filtered = _filtered(scene, design, work, keep=lambda filtered: work.keep(partial(answer, filtered)))
    if not len(filtered.run.time):
        raise Interrupted("stopped before the first readings were filtered")
    work.keep(partial(answer, filtered))
    swept = {} if sweep is None else _swept(path, sensors, design, sweep, seed, work)
    if not filtered.run.status.ok and not filtered.stopped:
        return FusionStudy(status=filtered.run.status, message=filtered.run.message, title=work.title, axes=path.axes)
    c, preferred = filtered.consistency, None
    if c is not None and c.nis not in c.band and path.axes == 3:
        work.progress("likelihood of other densities", 0.9)
        preferred = _preferred(scene, design, work)
    stopped = swept.pop("stopped", False) or filtered.stopped or work.interrupted()
    return answer(filtered, swept, preferred, stopped=stopped)


def _answer(
    scene: Scene, path: TrackedPath, sensors: FusionSensors, sweep: FusionSweep | None, seed: int, title: str,
    filtered: _Fused, swept: dict[str, Any] | None = None, preferred: float | None = None, *, stopped: bool = True,
) -> FusionStudy:  # fmt: skip
    """Return the study of the rows that are filtered, smoothed and tested so far."""
    swept, c = swept or {}, filtered.consistency
    synthetic = (
        f"SYNTHETIC: seed {seed}, tracker {1e3 * sensors.position_noise:.3g} mm, accelerometer "
        f"{sensors.acceleration_noise:.3g} m/s2/rtHz"
    )
    if sensors.outlier_share:
        synthetic += f", {100 * sensors.outlier_share:g} % of the positions off by {OUTLYING:g} times its noise"
    table, printed = printed_errors(path, sensors)
    notes = [*filtered.run.notes, *_notes(scene, preferred)]
    checks, doubts = suspicion_checks(tested(*_read(scene, filtered.run)))
    notes += doubts
    done, whole = filtered.run.time[-1], scene.motion.time[-1]
    if done < whole:
        notes.append(f"the filter was stopped after {done:.3g} of {whole:.3g} s: all numbers are for this part")
    return FusionStudy(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED, title=title, axes=path.axes, checks=checks,
        synthetic=synthetic.removeprefix("SYNTHETIC: "),
        nis=None if c is None else c.nis, nis_band=() if c is None else tuple(c.band),
        nis_numbers=None if c is None else c.expected, verdict="" if c is None else c.message,
        trajectory=_trajectory(scene, filtered, synthetic), figures=_figures(scene, filtered, swept, sweep, title),
        scenes={"path": partial(_in_space, scene, filtered, title)},
        counted_less={name: float(n.sum()) / len(filtered.run.time) for name, n in filtered.run.weighed.items()},
        printed=printed, printed_in=table, notes=notes,
        preferred_jerk_density=preferred, **filtered.errors, **swept,
    )  # fmt: skip


def _read(scene: Scene, run: Filtered) -> list[Data]:
    """Readings and innovations of each sensor."""
    data = []
    for name, readings in scene.log.items():
        values, white = np.atleast_3d(readings.values.T).T[0], run.innovations.get(name)
        residuals = None if white is None else white[:, 0][np.isfinite(white[:, 0]).all(axis=1)]
        data.append(Data({name: values}, [name], "reading", recordings=[(name, readings.time)], residuals=residuals))
    return data


@dataclass(frozen=True, eq=False)
class _Fused:
    """A filtered scene."""

    run: Filtered
    judged: Filtered  # run whose innovations are tested: for interacting filters one with scheduled noise
    smoothed: Smoothed | None
    tracker: Filtered
    slope: np.ndarray
    errors: dict[str, Any]
    consistency: Consistency | None
    stopped: bool


def _filtered(
    scene: Scene,
    design: FusionFilter,
    work: Work,
    blame: bool = True,
    keep: Callable[[_Fused], object] | None = None,
) -> _Fused:
    """Filter a scene; keep: called with the result before it is smoothed and tested."""
    systems = systems_of(scene, design)
    report, keep_all = work.fractions("filtering"), design.smooth and len(systems) == 1  # else the scheduled run does
    run = filter_of(systems, design).run(scene.log, scene.initial, truth=scene.truth, keep=keep_all, progress=report)
    alone = tracker_system(scene.path, scene.sensors, design)
    log = {"tracker": scene.log["tracker"]}
    initial = replace(scene.initial, mean=_three(scene.initial.mean), deviation=_three(scene.initial.deviation))
    tracker = ErrorState(alone).run(log, initial, truth=_three(scene.truth), keep=False, progress=report)
    slope = slope_velocity(scene.log["tracker"])
    stopped = SolveStatus.INTERRUPTED in (run.status, tracker.status)
    judged, smoothed = run, None
    if keep is not None and len(run.time):
        errors = _errors(scene, run, None, tracker, slope)
        keep(_Fused(run, run, None, tracker, slope, errors, None, stopped))
    if len(systems) > 1 and run.status.ok:
        judged = _scheduled(systems, run, scene, design, report)
        if judged.status is SolveStatus.INTERRUPTED:
            judged, stopped = run, True
    if design.smooth and judged.status.ok and not stopped:
        work.progress("smoothing", 0.6)
        smoothed = smooth(judged)
    whole = run.status.ok and judged.status.ok and tracker.status.ok and not stopped
    errors = _errors(scene, run, smoothed, tracker, slope) if whole or stopped else {}
    test = consistency(judged, skip=settled(scene), blame=blame) if whole else None
    return _Fused(run, judged, smoothed, tracker, slope, errors, test, stopped)


def _three(values: Any) -> dict[str, Any]:
    return {name: values[name] for name in ("p", "v", "a")}


def settled(scene: Scene) -> float:
    """Time from which errors count [s]: the slope needs four positions."""
    return max(SETTLED, 4 * scene.sensors.sample_time)


def systems_of(scene: Scene, design: FusionFilter) -> list[System]:
    """The system of the filter, and of the second, faster filter if there is one."""
    slow = System(process_of(scene.path, scene.sensors, design), sensors_of(scene.path, scene.sensors, design))
    if design.fast_jerk_density is None:
        return [slow]
    noise: dict[str, Any] = {"jerk": design.fast_jerk_density}
    if scene.path.axes == 5:
        noise["angular_jerk"] = design.fast_angular_jerk_density or design.angular_jerk_density
    return [slow, slow.with_(noise=noise)]


def filter_of(systems: Sequence[System], design: FusionFilter) -> Filter:
    """The filter of this design."""
    if len(systems) > 1:
        from ..family.interacting import Interacting

        return Interacting(systems, stay=design.stay)
    if design.kind == "unscented":
        from ..family.kalman import Unscented

        return Unscented(systems[0])
    if design.kind == "particle":
        from ..family.particle import ParticleFilter

        return ParticleFilter(systems[0], particles=design.particles, seed=PARTICLE_SEED, marginalised=["p"])
    return ErrorState(systems[0], iterations=ITERATIONS if design.kind == "iterated" else 1)


def _scheduled(
    systems: Sequence[System], run: Filtered, scene: Scene, design: FusionFilter, progress: Callable[[float], bool]
) -> Filtered:
    """One filter with the most likely noise at each instant given the whole log: it can be smoothed, and unlike a
    mixture its innovations have an exact band."""
    assert run.mode_probabilities is not None
    stay = design.stay
    modes = likely_modes(run.mode_probabilities[:, 0], [[stay, 1 - stay], [1 - stay, stay]])
    scheduled = ScheduledNoise(systems, run.time, modes)
    return scheduled.run(scene.log, scene.initial, truth=scene.truth, keep=design.smooth, progress=progress)


def _probabilities(run: Filtered) -> np.ndarray | None:
    """Probability of the faster of two interacting filters (K,); None for a single filter."""
    return None if run.mode_probabilities is None else run.mode_probabilities[:, 0, -1]


def _errors(
    scene: Scene, run: Filtered, smoothed: Smoothed | None, tracker: Filtered, slope: np.ndarray
) -> dict[str, Any]:
    """Errors over the filtered rows; without the results that need more rows."""
    n = len(run.time)
    v, peak = scene.motion.v[:n], scene.peak[:n]
    late = scene.motion.time[:n] >= settled(scene)
    if not late.any():
        return {}

    def split(error: np.ndarray) -> tuple[float, float]:
        size = np.abs(error)[:, [0, 2]].mean(axis=1)
        return tuple(float(size[late & b].mean()) if np.any(late & b) else 0.0 for b in (~peak, peak))  # type: ignore[return-value]

    def whole(error: np.ndarray) -> float:
        return float(np.abs(error[late])[:, [0, 2]].mean())

    velocity = {"slope": slope[:n] - v, "tracker": tracker.error["v"][:n], "fused": run.error["v"]}
    velocity = {name: error for name, error in velocity.items() if len(error) == n}
    lines = {f"velocity_{name}": split(error) for name, error in velocity.items()}
    if smoothed is not None:
        lines["velocity_smoothed"] = split(smoothed["v"] - v)
    mine = (*lines["velocity_fused"], whole(velocity["fused"]))
    below = {
        f"below_{name}": tuple(1 - a / b if b > 0 else 0.0 for a, b in zip(mine, theirs, strict=True))
        for name, error in velocity.items() if name != "fused"
        for theirs in [(*lines[f"velocity_{name}"], whole(error))]
    }  # fmt: skip
    states = {
        "position": "p",
        "orientation": "Q",
        "acceleration": "a",
        "angular_velocity": "w",
        "angular_acceleration": "alpha",
    }
    fused = {name: _metrics(run.error[state][late]) for name, state in states.items() if state in scene.states}
    errors: dict[str, Any] = {**lines, **below, "fused": fused, "alone": _alone(scene, late)}
    fast = _probabilities(run)
    if fast is not None:
        errors["fast_share"] = tuple(float(fast[late & b].mean()) if np.any(late & b) else 0.0 for b in (~peak, peak))
    return errors


def _metrics(error: np.ndarray) -> tuple[float, float, float]:
    """Mean over the axes of |error|, mean length, mean of |sum of the components|."""
    sizes = np.abs(error), np.linalg.norm(error, axis=1), np.abs(error.sum(axis=1))
    return float(sizes[0].mean()), float(sizes[1].mean()), float(sizes[2].mean())


def _alone(scene: Scene, rows: np.ndarray) -> dict[str, tuple[float, float, float]]:
    """Errors of the sensors themselves: readings minus ideal readings."""
    truth = System(process_of(scene.path, scene.sensors, FusionFilter()), sensors_of(scene.path, scene.sensors))
    states = np.concatenate([getattr(scene.motion, name) for name in scene.states], axis=1)
    errors = {}
    for name, quantity in _MEASURED.items():
        if name not in truth.sensors:
            continue
        right = truth.read((name,), 0.0, states, np.zeros(0))
        error = Manifold([truth.readings[name]]).minus(scene.log[name].values, right)
        errors[quantity] = _metrics(error[: len(rows)][rows])
    return errors


_MEASURED = {
    "tracker": "position", "orientation": "orientation", "accelerometer": "acceleration", "gyro": "angular_velocity"
}  # fmt: skip


_SweptRow = tuple[float, float, float, bool]


def _swept(
    path: TrackedPath, sensors: FusionSensors, design: FusionFilter, sweep: FusionSweep, seed: int, work: Work
) -> dict[str, Any]:
    task = partial(_swept_row, path, sensors, replace(design, smooth=False), seed, sweep.parameter)

    rows = list[_SweptRow]()

    def here(value: float) -> _SweptRow | None:
        work.progress(f"{sweep.parameter} {value:.4g}", 0.3 + 0.7 * len(rows) / len(sweep.values))
        return task(value, stop=work.interrupted)

    with closing(mapped(task, sweep.values, here=here, waiting=work.interrupted)) as results:
        for row in results:
            if row is None:
                break
            rows.append(row)
    fused, tracker, slope, right = (list(column) for column in zip(*rows, strict=True)) if rows else ([], [], [], [])
    limits, unit = TABLE_10[sweep.parameter]
    printed = limits[0 if path.axes == 3 else 1]
    values = list(sweep.values[: len(fused)])
    return {
        "sweep_parameter": sweep.parameter, "sweep_values": values, "sweep_fused": fused, "sweep_tracker": tracker,
        "sweep_slope": slope, "sweep_consistent": right, "limit_tracker": _crossing(values, fused, tracker),
        "limit_slope": _crossing(values, fused, slope),
        "limit_printed": None if printed is None else printed * (np.pi / 180 if unit.startswith("deg") else 1.0),
        "stopped": len(rows) < len(sweep.values),
    }  # fmt: skip


def _swept_row(
    path: TrackedPath, sensors: FusionSensors, design: FusionFilter, seed: int, parameter: str, value: float,
    stop: Callable[[], bool] = never,
) -> _SweptRow | None:  # fmt: skip
    """Return the mean velocity errors in the plane [m/s] of the fusion and of both baselines, infinite if the filter
    lost the body, and whether the filter is consistent; None if it was stopped."""
    changed = sensors.with_value(parameter, value)
    filtered = _filtered(scene_of(path, changed, seed), design, Work(stop=stop), blame=False)
    if filtered.stopped:
        return None
    if not filtered.errors:
        return np.inf, np.inf, np.inf, False
    rows = filtered.run.time >= max(SETTLED, 4 * changed.sample_time)
    right, c = path.motion(filtered.run.time).v, filtered.consistency
    velocities = filtered.run["v"], filtered.tracker["v"], filtered.slope
    fused, tracker, slope = (float(np.abs(v - right)[rows][:, [0, 2]].mean()) for v in velocities)
    return fused, tracker, slope, c is not None and c.nis in c.band


def _crossing(values: Sequence[float], ours: Sequence[float], theirs: Sequence[float]) -> float | None:
    """First value at which our error is not smaller, interpolated linearly in logarithms."""
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.log(np.asarray(ours) / np.asarray(theirs))
    for k in range(len(values)):
        if excess[k] >= 0:
            if k == 0 or not np.isfinite(excess[k]) or min(values[k - 1 : k + 1]) <= 0:
                return float(values[k])
            share = -excess[k - 1] / (excess[k] - excess[k - 1])
            return float(values[k - 1] * (values[k] / values[k - 1]) ** share)
    return None


def _preferred(scene: Scene, design: FusionFilter, work: Work) -> float | None:
    """Most likely density of white jerk in the plane, among the decades; None if stopped."""
    plain = replace(design, printed=False)
    system = System(process_of(scene.path, scene.sensors, plain), sensors_of(scene.path, scene.sensors, plain))

    def likelihood(density: float) -> float:
        other = system.with_(noise={"jerk": (density, plain.jerk_density[1], density)})
        run = ErrorState(other).run(scene.log, scene.initial, keep=False, progress=lambda _: work.interrupted())
        return float(run.log_likelihood[0]) if run.status.ok else -np.inf

    best = max(DECADES, key=likelihood)
    return None if work.interrupted() else best


def _notes(scene: Scene, preferred: float | None) -> list[str]:
    if scene.path.axes == 3:
        note = f"the most likely density of white jerk along x and z, among decades, is {preferred} m2/s5"
        return [note] if preferred else []
    arm = np.linalg.norm(scene.sensors.arm)
    rate = np.linalg.norm(scene.motion.w, axis=1).max()
    force = np.linalg.norm(scene.motion.alpha, axis=1).max() * arm + rate**2 * arm
    if force < 100:
        return []
    return [
        f"at the bends the accelerometer on its arm sees about {force:.3g} m/s2, beyond the range of such units: "
        "the results assume an ideal unit; use a slower feed"
    ]


def _trajectory(scene: Scene, f: _Fused, synthetic: str) -> Trajectory:
    n = len(f.run.time)
    motion = scene.motion
    columns: dict[str, Any] = {"velocity": motion.v[:n], "velocity_fused": f.run["v"]}
    columns["velocity_deviation"] = f.run.deviation["v"]
    units = dict.fromkeys(columns, "m/s")
    columns |= {"position_fused": f.run["p"], "nis": f.judged.nis[:n, 0], "at_bend": scene.peak[:n].astype(float)}
    units["position_fused"] = "m"
    if f.smoothed is not None:
        columns["velocity_smoothed"], units["velocity_smoothed"] = f.smoothed["v"], "m/s"
    fast = _probabilities(f.run)
    if fast is not None:
        columns["fast_probability"] = fast
    return Trajectory(f.run.time, columns, units, title="fused", synthetic=synthetic)


def _figures(
    scene: Scene, filtered: _Fused, swept: dict[str, Any], sweep: FusionSweep | None, title: str
) -> dict[str, Callable[[], Any]]:
    figures: dict[str, Callable[[], Any]] = {
        "baselines": partial(_baselines_figure, scene, filtered, title),
        "velocity": partial(_velocity_figure, scene, filtered, title),
        "innovations": partial(innovations_picture, filtered.judged, title),
    }
    if scene.path.axes == 5:
        figures["angular_acceleration"] = partial(_alpha_figure, scene, filtered, title)
    if sweep is not None and swept.get("sweep_values"):
        figures["sweep"] = partial(_sweep_figure, swept, title)
    return figures


def _in_space(scene: Scene, f: _Fused, title: str) -> view.RobotScene:
    """True and fused path, and the filter's covariance at some instants."""
    true, fused = scene.motion.p[: len(f.run.time)], f.run["p"]
    rows = np.unique(np.linspace(0, len(true) - 1, SEGMENTS + 1).round().astype(int))
    first = int(np.searchsorted(f.run.time, settled(scene)))  # the start is uncertain and would hide all others
    marked = np.unique(np.linspace(min(first, len(true) - 1), len(true) - 1, ELLIPSOIDS).round().astype(int))
    drawn, note = view.ellipsoids(fused[marked], f.run.covariance("p")[marked])
    way = view.lines(true[rows[:-1]], true[rows[1:]], name="true path", colour="#000000")
    marks = view.dots(fused[marked], name="fused position")
    return view.around(None, [way, marks, *drawn], title=title, note=f"{note} Line: true path; synthetic data.".strip())


def _velocity_figure(scene: Scene, f: _Fused, title: str) -> Any:
    from ...plot.filters import error_figure

    lines = {name: e for name, e in _velocity_errors(scene, f).items() if name in ("fused", "smoothed")}
    return error_figure(f.run.time, lines, f.run.deviation["v"], axes=("x", "z"), pick=(0, 2), title=title)


def _baselines_figure(scene: Scene, f: _Fused, title: str) -> Any:
    from ...plot.filters import baselines_figure

    n = len(f.run.time)
    return baselines_figure(f.run.time, _velocity_errors(scene, f), scene.peak[:n], pick=(0, 2), title=title)


def _velocity_errors(scene: Scene, filtered: _Fused) -> dict[str, np.ndarray]:
    """Velocity errors by method (n, 3) [m/s]."""
    n = len(filtered.run.time)
    estimates = {
        "slope of four positions": filtered.slope,
        "tracker alone": filtered.tracker["v"],
        "fused": filtered.run["v"],
    }
    if filtered.smoothed is not None:
        estimates["smoothed"] = filtered.smoothed["v"]
    return {name: v[:n] - scene.motion.v[:n] for name, v in estimates.items() if len(v) >= n}


def _alpha_figure(scene: Scene, filtered: _Fused, title: str) -> Any:
    from ...plot.filters import state_figure

    t = filtered.run.time
    middle = t[np.argmax(np.abs(scene.motion.w[: len(t), 1]))]
    near = np.abs(t - middle) < AROUND
    return state_figure(
        t[near], scene.motion.alpha[: len(t), 1][near], filtered.run["alpha"][near, 1],
        filtered.run.deviation["alpha"][near, 1], "about y [rad/s²]", title=title,
    )  # fmt: skip


def _sweep_figure(swept: dict[str, Any], title: str) -> Any:
    from ...plot.filters import sweep_figure

    lines = {
        "slope of four positions": swept["sweep_slope"],
        "tracker alone": swept["sweep_tracker"],
        "fused": swept["sweep_fused"],
    }
    label = swept["sweep_parameter"].replace("_", " ")
    return sweep_figure(
        swept["sweep_values"], lines, swept["sweep_consistent"], label, swept["limit_printed"], title=title
    )
