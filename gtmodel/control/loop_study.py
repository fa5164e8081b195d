"""The motion of a robot under a law that samples, as a study, and simulations of a plant under a law along a
reference with their tracking errors."""

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
    """What `track` returns: a motion under a law.

    trajectory: "reference", "position" and "forces" on the reference's rows, in SI units; forces that are held at
        samples are those before a sample at that instant. simulation: the run behind it.
    samples: of a law at samples what it read and computed at each; else None.
    """

    trajectory: Trajectory
    simulation: Simulation
    samples: Trajectory | None = None

    @property
    def error(self) -> np.ndarray:
        """(n, k) reference less position."""
        return self.trajectory["reference"] - self.trajectory["position"]

    @property
    def rms(self) -> np.ndarray:
        """(k,) root mean square of the error."""
        return np.sqrt(np.mean(self.error**2, axis=0))

    @property
    def largest(self) -> np.ndarray:
        """(k,) largest absolute value of the error at a row."""
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
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or a `Law` of your own.
        reference: holds the known variable at equal steps; between its rows it is a cubic spline.
        start: start values of the plant by its own names, e.g. {"T": [...], "der(T)": [0, 0, 0]}.
        known, targets: the actuators' positions and forces, by name.
        tolerance: of the integrator, see `simulate`.
        period: between two samples of the law [s]; None: it acts in continuous time.
        progress, throw: as of `simulate`; what ended early has fewer rows.
        sampled: further arguments of `sampled_loop` where a period is given: `delay`, 0.008 s if left out, `first`,
            `resolution`, `velocity`, `compiled`.

    Raises ModelError for a plant, law or start that does not fit, and NotSimulated.

    >>> class Cart(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg", positive=True)
    ...     q = gt.variable(1, unit="m")
    ...     tau = gt.input(1, unit="N")
    ...     def equations(self):
    ...         yield self.m * gt.der(self.q, 2) == self.tau
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> reference = gt.Trajectory(t, {"q": 3 * t[:, None] ** 2 - 2 * t[:, None] ** 3}, {"q": "m"})
    >>> for mass in (2.0, 1.0):  # as the law believes
    ...     law = gt.control.Feedforward(Cart(m=mass), stiffness=800.0, damping=80.0)
    ...     run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]})
    ...     print(bool(abs(run.error).max() > 1e-3))  # m
    False
    True

    The same at samples every 20 ms, which act 10 ms later:

    >>> law = gt.control.Feedforward(Cart(), stiffness=800.0, damping=80.0)
    >>> run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]}, period=0.02, delay=0.01)
    >>> run.largest.round(4), len(run.samples)
    (array([0.002]), 51)
    """
    rows = reference[known]
    table = Trajectory(reference.time, {"reference": rows}, {"reference": reference.unit(known)})
    if period is None and sampled:
        raise TypeError(f"track() takes {', '.join(sampled)} with a period only; a law in continuous time has none")
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
    """A plant's own name, "T" or "der(T,2)", seen from the loop."""
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
    work = Work(**work_options)
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
    return _study_of(tracked, sampling, limits, work.title)


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
