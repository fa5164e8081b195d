"""The motion of a robot under a law that samples, as a study."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import numpy as np

from ..compiler.analysis.switching import in_mode
from ..compiler.causal import compile_causal, flat_of
from ..lang import Model, ModelError
from ..results import ArgumentError, SolveStatus, Status, Trajectory, Work, at_most
from ..results.door import study_function
from ..results.options import Within
from ..results.refusal import naming
from ..results.table import csv_text
from ..results.work import Progress, never, silent
from .loop_options import LoopSampling, Move, TrackingLimits
from .loop_result import LoopSimulationStudy
from .sampled_loop import law_function
from .tracked import Tracked, track
from .tracking_loop import actuators

MOST_SAMPLES = 100_000
FOUR_MS, UNLIMITED = LoopSampling(), TrackingLimits()


@study_function
def loop_simulation(
    robot: Model,
    law: Any,
    reference: Move | Trajectory,
    *,
    sampling: LoopSampling = FOUR_MS,
    limits: TrackingLimits = UNLIMITED,
    known: str = "q",
    targets: str = "tau",
    tolerance: Annotated[float, Within(least=1e-14, most=0.1)] = 1e-9,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> LoopSimulationStudy:
    """Simulate a robot in continuous time under a law that computes at samples, along a reference.

    Args:
        robot: what moves; its `known` positions [m] and `targets` forces [N] are vectors of one length.
        law: `ComputedTorque`, `Feedforward`, `Feedback`, or a `Law` of your own; its model may differ from the robot.
        reference: a `Move` of the tool "T", or a trajectory that holds "T" or `known` at equal steps. The robot starts
            on it, and before the first sample acts its motors hold the law's forces at rest there.
        sampling: period, delay, and what the controller measures.
        limits: of errors and forces, which become checks.
        tolerance: of the integrator.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    A run that ends early, or is interrupted, keeps what there is. Raises ArgumentError for what is given wrong.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.ComputedTorque(robot, stiffness=900.0, damping=60.0)
    >>> move = gt.control.Move(start=[0.5, -0.9, 0.3], goal=[0.52, -0.9, 0.3], duration=0.2, rest=0.0)
    >>> s = gt.control.loop_simulation(robot, law, move)
    >>> s.status.ok, s.samples, bool(max(s.rms_error) < 1e-3)
    (True, 51, True)
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    if not callable(getattr(law, "forces", None)):
        raise ArgumentError(f"a law has a method forces(); {type(law).__name__} has none", "law")
    with naming("robot", ModelError):
        shape, unit, force = actuators(robot, known, targets)
    if (unit, force) != ("m", "N"):
        raise ArgumentError(
            f"the actuators of this study move in m under forces in N; this robot has '{known}' in {unit} and "
            f"'{targets}' in {force}: use gt.control.track", "robot",
        )  # fmt: skip
    work.step("equations")
    motion, start = _reference(robot, reference, known, sampling.period)
    if motion.duration / sampling.period > MOST_SAMPLES:
        raise ArgumentError(f"the run has more than {MOST_SAMPLES} samples of that period", "sampling.period")
    with naming("law", ModelError):
        at_rest = [motion[known][0], np.zeros(shape), np.zeros(shape)]
        first = law_function(law, shape[0])(*at_rest, at_rest[0], np.zeros(shape)).full().reshape(-1)

    def report(time: float) -> bool:
        work.progress("simulating", (time - motion.time[0]) / motion.duration, {"time_s": time})
        return work.interrupted()

    tracked = track(
        robot, law, motion, start, known=known, targets=targets, tolerance=tolerance, progress=report, throw=False,
        period=sampling.period, delay=sampling.delay, first=first, resolution=sampling.resolution,
        velocity=sampling.velocity, compiled=sampling.compiled,
    )  # fmt: skip
    return _study_of(tracked, sampling, limits, title)


def _reference(
    robot: Model, reference: Move | Trajectory, known: str, period: float
) -> tuple[Trajectory, dict[str, Any]]:
    """Positions of the actuators at equal steps, and where the robot starts."""
    if isinstance(reference, Move):
        count = max(1, round((reference.duration + reference.rest) / period))
        time = period * np.arange(count + 1)
        s = np.minimum(time / reference.duration, 1.0)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        begin, end = np.asarray(reference.start), np.asarray(reference.goal)
        reference = Trajectory(time, {"T": begin + share[:, None] * (end - begin)}, {"T": "m"}, synthetic="a move")
    if len(reference) < 4 or not np.allclose(np.diff(reference.time), reference.time[1] - reference.time[0], rtol=1e-6):
        raise ArgumentError("the reference wants rows at equal steps, four or more of them", "reference")
    if "T" not in reference.names:
        if known not in reference.names:
            names = ", ".join(reference.names)
            raise ArgumentError(f"the reference holds neither 'T' nor '{known}'; it has {names}", "reference")
        rates = reference[f"der({known})"][0] if f"der({known})" in reference.names else np.zeros(3)
        return reference, {known: reference[known][0], f"der({known})": rates}
    with naming("robot", ModelError):
        q, status = _positions(robot, reference["T"], known)
    bad = np.flatnonzero(status != Status.OK)
    if bad.size:
        why = Status(int(status[bad[0]])).message
        raise ArgumentError(f"at {reference.time[bad[0]]:g} s the robot cannot be there: {why}", "reference")
    rates = reference["der(T)"][0] if "der(T)" in reference.names else np.zeros(3)
    rows = Trajectory(reference.time, {known: q}, {known: "m"}, synthetic=reference.synthetic)
    return rows, {"T": reference["T"][0], "der(T)": rates}


def _positions(robot: Model, places: np.ndarray, known: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the actuators and statuses at places (n, 3) of the tool; of a robot with switches, such as friction
    that sticks, on a side of them that has these. Raises ModelError where the sides differ in them."""
    flat = flat_of(robot)
    if flat.events is None or not flat.events.modes:
        return compile_causal(flat, known="T", targets=known)(places)
    sides, refused = [], None
    for side in (False, True):
        try:
            q, status = compile_causal(in_mode(flat, [side] * len(flat.events.modes)), known="T", targets=known)(places)
            sides.append((q, status))
        except ModelError as error:
            refused = error
    if not sides:
        assert refused is not None
        raise refused
    if len(sides) > 1 and not np.allclose(sides[0][0], sides[1][0], rtol=0, atol=1e-9, equal_nan=True):
        raise ModelError(f"'{known}' at 'T' depends on the side of a gt.If; give the reference in '{known}'")
    return sides[0]


def _study_of(tracked: Tracked, sampling: LoopSampling, limits: TrackingLimits, title: str) -> LoopSimulationStudy:
    run, samples, motion = tracked.simulation, tracked.samples, tracked.trajectory
    assert samples is not None
    forces = np.max(np.abs(samples["forces"]), axis=0, initial=0.0)
    checks = {n: at_most(c.value, c.bound or 0.0, c.advice) for n, c in run.checks.items()}
    if limits.error is not None:
        advice = "lower the delay or the gains, or mend the law's model"
        checks["largest_error_m"] = at_most(float(tracked.largest.max()), limits.error, advice)
    if limits.force is not None:
        checks["largest_force_N"] = at_most(float(forces.max()), limits.force, "lower the gains, or take a longer move")
    return LoopSimulationStudy(
        status=SolveStatus.SOLVED if run.status.converged else run.status,
        message=run.message,
        title=title,
        checks=checks,
        trajectory=motion,
        figures={"loop": partial(_figure, motion, samples, title)},
        files={"samples.csv": _table(samples)},
        law_samples=samples,
        period=sampling.period,
        delay=sampling.delay,
        samples=len(samples),
        end_time=float(motion.time[-1]),
        rms_error=tracked.rms,
        largest_error=tracked.largest,
        last_error=tracked.error[-1],
        largest_force=forces,
    )


def _table(samples: Trajectory) -> str:
    columns = {"time_s": samples.time}
    for name in samples.names:
        unit = samples.unit(name).replace("/", "_")
        columns |= {f"{name}_{k + 1}_{unit}": column for k, column in enumerate(samples[name].T)}
    return csv_text(columns, digits=17)


def _figure(motion: Trajectory, samples: Trajectory, title: str) -> Any:
    from ..plot.signals import sampled_loop_figure

    return sampled_loop_figure(motion, samples, title=title)
