"""Simulation of a plant that tracks a reference under a law, and the study of a robot under a sampled law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from gtmodel import lang as gt
from gtmodel.results import Trajectory
from gtmodel.results.trajectory import TIME_SLACK
from gtmodel.simulation import Simulation, simulate
from gtmodel.simulation.options import Progress as SimulationProgress

from .. import view
from ..compiler.analysis.switching import in_mode
from ..compiler.causal import compile_causal, flat_of
from ..lang import Model, ModelError
from ..results import ArgumentError, SolveStatus, Status, Work, at_most
from ..results.options import Within
from ..results.refusal import naming
from ..results.table import csv_text
from ..results.work import WorkOptions, study_function
from .feedforward import Law
from .loop_options import LoopSampling, LoopSimulationStudy, Move, TrackingLimits
from .sampled_loop import actuators, law_function, sampled_loop, tracking_loop


@dataclass(frozen=True, eq=False)
class Tracked:
    """Result of `track`: a motion under a law.

    trajectory: "reference", "position" and "forces" at the reference's times, in SI units. At a sampling instant,
        forces are those just before it. simulation: the run itself.
    samples: inputs and forces of a sampled law at each sample; None in continuous time.
    """

    trajectory: Trajectory
    simulation: Simulation
    samples: Trajectory | None = None

    @property
    def error(self) -> np.ndarray:
        """Reference minus position, (n, k)."""
        return self.trajectory["reference"] - self.trajectory["position"]

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of the error, (k,)."""
        return np.sqrt(np.mean(self.error**2, axis=0))

    @property
    def largest(self) -> np.ndarray:
        """Largest absolute error, (k,)."""
        return np.max(np.abs(self.error), axis=0)


def track(
    plant: gt.Model,
    law: Law,
    reference: Trajectory,
    start: Mapping[str, Any],
    *,
    known: str = "q",
    targets: str = "tau",
    tolerance: float = 1e-7,
    period: float | None = None,
    progress: SimulationProgress | None = None,
    throw: bool = True,
    **sampled: Any,
) -> Tracked:
    """Simulate the plant along a reference under a law; returns a `Tracked`, with the tracking error.

    Args:
        plant: a model whose `known` and `targets` are vectors of equal length.
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or your own `Law`.
        reference: holds the known variable at equal steps; a cubic spline connects its rows.
        start: start values by the plant's names, e.g. {"T": [...], "der(T)": [0, 0, 0]}.
        known, targets: names of the actuators' positions and forces.
        tolerance: of the integrator, see `simulate`.
        period: sampling period of the law [s]; None: the law acts in continuous time.
        progress, throw: as in `simulate`; a run that ends early has fewer rows.
        sampled: further arguments of `sampled_loop`, only with a period: `delay` (default 0.008 s), `first`,
            `resolution`, `velocity`, `compiled`.

    Raises ModelError if plant, law and start do not fit together, and NotSimulated.

    >>> class Cart(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg", positive=True)
    ...     q = gt.variable(1, unit="m")
    ...     tau = gt.input(1, unit="N")
    ...     def equations(self):
    ...         yield self.m * gt.der(self.q, 2) == self.tau
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> reference = gt.Trajectory(t, {"q": 3 * t[:, None] ** 2 - 2 * t[:, None] ** 3}, {"q": "m"})
    >>> for mass in (2.0, 1.0):  # in the law's model
    ...     law = gt.control.Feedforward(Cart(m=mass), stiffness=800.0, damping=80.0)
    ...     run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]})
    ...     print(bool(abs(run.error).max() > 1e-3))  # m
    False
    True

    With a sampling period of 20 ms and a delay of 10 ms:

    >>> law = gt.control.Feedforward(Cart(), stiffness=800.0, damping=80.0)
    >>> run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]}, period=0.02, delay=0.01)
    >>> run.largest.round(4), len(run.samples)
    (array([0.002]), 51)
    """
    rows = reference[known]
    table = Trajectory(reference.time, {"reference": rows}, {"reference": reference.unit(known)})
    if period is None and sampled:
        raise TypeError(f"track() accepts {', '.join(sampled)} only for a sampled law; set period as well")
    if period is None:
        loop = tracking_loop(plant, law, known, targets)
    else:
        loop = sampled_loop(plant, law, period, known=known, targets=targets, **sampled)
    run = simulate(
        loop,
        float(reference.time[-1]),
        start_time=float(reference.time[0]),
        inputs={"reference": (table, "cubic")},
        start={_inside(name): value for name, value in start.items()},
        step=float(reference.time[1] - reference.time[0]),
        outputs=[f"plant.{known}", f"plant.{targets}"],
        tolerance=tolerance,
        progress=progress,
        throw=throw,
    )
    simulated = run.trajectory
    time = reference.time[reference.time <= simulated.time[-1] * (1 + TIME_SLACK)]
    rows = rows[: len(time)]
    q, tau = (np.column_stack([simulated(time, f"plant.{n}[{k}]") for k in range(rows.shape[1])])
              for n in (known, targets))  # fmt: skip
    names = {"reference": (rows, reference.unit(known)), "position": (q, reference.unit(known)),
             "forces": (tau, simulated.unit(f"plant.{targets}"))}  # fmt: skip
    note = "; ".join(n for n in (reference.synthetic, "simulated closed loop, no noise") if n)
    trajectory = Trajectory(
        time, {n: v for n, (v, _) in names.items()}, {n: u for n, (_, u) in names.items()}, synthetic=note
    )
    return Tracked(trajectory, run, run.samples.get("law"))


def _inside(name: str) -> str:
    """The loop's name of a plant variable such as "T" or "der(T,2)"."""
    return f"der(plant.{name[4:]}" if name.startswith("der(") else f"plant.{name}"


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
    **work_options: Unpack[WorkOptions],
) -> LoopSimulationStudy:
    """Simulate a robot in continuous time along a reference under a sampled law.

    Args:
        robot: the plant; its `known` positions [m] and `targets` forces [N] are vectors of equal length.
        law: `ComputedTorque`, `Feedforward`, `Feedback`, or your own `Law`; its model may differ from the robot.
        reference: a `Move` of the tool "T", or a trajectory that holds "T" or `known` at equal steps. The robot starts
            on the reference. Until the first sample acts, its motors apply the law's forces at rest at the start.
        sampling: period, delay, and the controller's measurements.
        limits: on errors and forces; each becomes a check.
        tolerance: of the integrator.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The study of a run that ends early or is interrupted holds the results so far. Raises ArgumentError for an argument
    that does not fit.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> law = gt.control.ComputedTorque(robot, stiffness=900.0, damping=60.0)
    >>> move = gt.control.Move(start=[0.5, -0.9, 0.3], goal=[0.52, -0.9, 0.3], duration=0.2, rest=0.0)
    >>> s = gt.control.loop_simulation(robot, law, move)
    >>> s.status.ok, s.samples, bool(max(s.rms_error) < 1e-3)
    (True, 51, True)
    """
    work = Work(**work_options)
    if not callable(getattr(law, "forces", None)):
        raise ArgumentError(f"a law needs a method forces(); {type(law).__name__} has none", "law")
    with naming("robot", ModelError):
        shape, unit, force = actuators(robot, known, targets)
    if (unit, force) != ("m", "N"):
        raise ArgumentError(
            f"the study needs actuators with positions in m and forces in N; this robot has '{known}' in {unit} and "
            f"'{targets}' in {force}: use gt.control.track", "robot",
        )  # fmt: skip
    work.step("equations")
    motion, start = _reference(robot, reference, known, sampling.period)
    if motion.duration / sampling.period > MOST_SAMPLES:
        raise ArgumentError(f"the run has more than {MOST_SAMPLES} samples; take a longer period", "sampling.period")
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
    study = _study_of(tracked, sampling, limits, work.title)
    run = tracked.trajectory
    names = {"position": known, "reference": f"{known}.reference", "forces": "forces"}
    shown = Trajectory(
        run.time, {new: run[old] for old, new in names.items()},
        {new: run.units[old] for old, new in names.items() if old in run.units}, title=study.title,
    )  # fmt: skip
    # not "motion": trajectory.csv has other names than the robot, so that the folder holds the scene itself
    return study.with_(scenes={"loop": partial(view.scene, robot, shown)}) if view.points_of(robot) else study


def _reference(
    robot: Model, reference: Move | Trajectory, known: str, period: float
) -> tuple[Trajectory, dict[str, Any]]:
    """Positions of the actuators at equal steps, and the robot's start values."""
    if isinstance(reference, Move):
        count = max(1, round((reference.duration + reference.rest) / period))
        time = period * np.arange(count + 1)
        s = np.minimum(time / reference.duration, 1.0)
        share = s**3 * (10 - 15 * s + 6 * s**2)
        begin, end = np.asarray(reference.start), np.asarray(reference.goal)
        reference = Trajectory(time, {"T": begin + share[:, None] * (end - begin)}, {"T": "m"}, synthetic="a move")
    if len(reference) < 4 or not np.allclose(np.diff(reference.time), reference.time[1] - reference.time[0], rtol=1e-6):
        raise ArgumentError("the reference needs four or more rows at equal time steps", "reference")
    if "T" not in reference.names:
        if known not in reference.names:
            names = ", ".join(reference.names)
            raise ArgumentError(f"the reference holds neither 'T' nor '{known}'; it holds {names}", "reference")
        rates = reference[f"der({known})"][0] if f"der({known})" in reference.names else np.zeros(3)
        return reference, {known: reference[known][0], f"der({known})": rates}
    with naming("robot", ModelError):
        q, status = _positions(robot, reference["T"], known)
    bad = np.flatnonzero(status != Status.OK)
    if bad.size:
        why = Status(int(status[bad[0]])).message
        raise ArgumentError(f"the robot cannot reach it at {reference.time[bad[0]]:g} s: {why}", "reference")
    rates = reference["der(T)"][0] if "der(T)" in reference.names else np.zeros(3)
    rows = Trajectory(reference.time, {known: q}, {known: "m"}, synthetic=reference.synthetic)
    return rows, {"T": reference["T"][0], "der(T)": rates}


def _positions(robot: Model, points: np.ndarray, known: str) -> tuple[np.ndarray, np.ndarray]:
    """Actuator positions and statuses at tool positions (n, 3). If the robot has modes, such as sticking friction, any
    mode that determines the positions is used; raises ModelError if the modes give different positions."""
    flat = flat_of(robot)
    if flat.events is None or not flat.events.modes:
        return compile_causal(flat, known="T", targets=known)(points)
    sides, refusal = [], None
    for side in (False, True):
        try:
            q, status = compile_causal(in_mode(flat, [side] * len(flat.events.modes)), known="T", targets=known)(points)
            sides.append((q, status))
        except ModelError as error:
            refusal = error
    if not sides:
        assert refusal is not None
        raise refusal
    if len(sides) > 1 and not np.allclose(sides[0][0], sides[1][0], rtol=0, atol=1e-9, equal_nan=True):
        raise ModelError(f"'{known}' at 'T' depends on the side of a gt.If; give the reference in '{known}'")
    return sides[0]


def _study_of(tracked: Tracked, sampling: LoopSampling, limits: TrackingLimits, title: str) -> LoopSimulationStudy:
    run, samples, motion = tracked.simulation, tracked.samples, tracked.trajectory
    assert samples is not None
    forces = np.max(np.abs(samples["forces"]), axis=0, initial=0.0)
    checks = {n: at_most(c.value, c.bound or 0.0, c.advice) for n, c in run.checks.items()}
    if limits.error is not None:
        advice = "reduce the delay or the gains, or correct the law's model"
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
