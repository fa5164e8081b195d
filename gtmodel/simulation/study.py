"""Simulation of a robot, or of any model, as a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal, Unpack

from .. import view
from ..compiler.causal import flat_of
from ..lang.model import Model
from ..lang.source import ModelError
from ..results import ArgumentError, SolveStatus, Trajectory, Work, at_most
from ..results.options import Within
from ..results.table import csv_text
from ..results.trajectory_files import csv_bytes
from ..results.work import WorkOptions, study_function
from .hybrid.clock import Event
from .options import ENERGIES, LARGEST_TIME, MOST_ROWS, MOST_STEPS, Simulation, SimulationStudy, described
from .run import simulate

TIGHTER = "use a smaller tolerance"
# residual bound in SI units: closed forms and converged Newton unknowns leave round-off, 1e-12 of forces up to 1e4 N
EQUATIONS = 1e-8


@study_function
def simulation_study(
    model: Model,
    final_time: Annotated[float, Within(above=0.0, most=LARGEST_TIME)],
    *,
    inputs: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    step: Annotated[float | None, Within(above=0.0)] = None,
    max_step: Annotated[float | None, Within(above=0.0)] = None,
    outputs: Sequence[str] = (),
    keep: Sequence[str] | None = None,
    prefer: Sequence[str] = (),
    tolerance: Annotated[float, Within(least=1e-14, most=0.1)] = 1e-9,
    method: Literal["bdf", "adams"] = "bdf",
    **work_options: Unpack[WorkOptions],
) -> SimulationStudy:
    """Simulate a model from 0 to `final_time` [s], with checks, table and pictures.

    Args:
        inputs, start, parameters, step, max_step, outputs, keep, prefer, tolerance, method: as in `simulate`.
            A robot's scene in space needs q among the kept names.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The result of a run that ends early or is interrupted holds everything up to its end. Raises ArgumentError for a
    wrong argument, and ModelError for a wrong model or start values that contradict its equations.

    >>> import gtmodel as gt
    >>> from gtmodel.simulation import simulation_study
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> s = simulation_study(robot, 0.1, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3], "der(T)": 0.0})
    >>> s.energy_error < 1e-4
    True
    """
    work = Work(**work_options)
    refuse_unknown(model, start=start or {}, inputs=inputs or {}, outputs=outputs, keep=keep or (), prefer=prefer)
    _refuse_steps(final_time, step, max_step)

    def report(time: float) -> bool:
        work.progress("simulating", time / final_time, {"time_s": time})
        return work.interrupted()

    try:
        simulation = simulate(
            model, final_time, inputs=inputs, start=start, parameters=parameters, step=step, max_step=max_step,
            outputs=outputs, keep=keep, prefer=prefer, tolerance=tolerance, method=method, progress=report, throw=False,
        )  # fmt: skip
    except ModelError as error:
        if error.argument:
            raise ArgumentError(str(error), error.argument) from error
        raise
    study = _study_of(simulation, work.title).with_(notes=getattr(type(model), "_notes", ()))
    if view.points_of(model) and (keep is None or "q" in keep):  # q always determines the pose
        study = study.with_(scenes={"motion": partial(view.scene, model, study.trajectory)})
    return study


def refuse_unknown(model: Model, **lists: Mapping[str, Any] | Sequence[str]) -> None:
    """Raises ArgumentError for a name that is not in the model."""
    flat = flat_of(model)
    discrete = {s.name for s in flat.events.shown} if flat.events else set()
    for argument, names in lists.items():
        for n, name in enumerate(names):
            if name in discrete and argument in ("start", "outputs", "keep"):
                continue
            try:
                flat.lookup(name)
            except ModelError as error:
                place = f"{argument}.{name}" if isinstance(names, Mapping) else f"{argument}[{n}]"
                raise ArgumentError(str(error), place) from error


def _refuse_steps(final_time: float, step: float | None, max_step: float | None) -> None:
    if step is not None and step > final_time:
        raise ArgumentError(f"{step:g} s is longer than the run of {final_time:g} s", "step")
    for argument, value, most in (("step", step, MOST_ROWS), ("max_step", max_step, MOST_STEPS)):
        if value is not None and final_time / value > most:
            raise ArgumentError(f"{value:g} s is too short: a run has at most {most} such steps", argument)


def _study_of(simulation: Simulation, title: str) -> SimulationStudy:
    recorded = simulation.trajectory
    complete = simulation.status.converged  # failed checks are reported by the study
    if not simulation.status.ok:
        title += f" ({simulation.status.value})"
    trajectory = Trajectory(
        recorded.time, {n: recorded[n] for n in recorded.names}, recorded.units, title=title, provenance={}
    )
    checks = {"equations_residual": at_most(simulation.residual, EQUATIONS, TIGHTER)}
    checks |= {
        name: at_most(check.value, check.bound or 0.0, check.advice) for name, check in simulation.checks.items()
    }
    marks = [change.time for change in (*simulation.switches, *simulation.events)]
    figures = {"signals": partial(_signals, trajectory, marks)}
    events = [_row_of(e) for e in simulation.events]
    energies: dict[str, Any] = {}
    if simulation.energy_error is not None:
        figures["energy"] = partial(_energy, trajectory)
        energies = {f"energy_{k}": float(x[-1] - x[0]) for k in ENERGIES for x in [trajectory[f"energy.{k}"]]}
    return SimulationStudy(
        status=SolveStatus.SOLVED if complete else simulation.status,
        message=simulation.message,
        title=title,
        checks=checks,
        trajectory=trajectory,
        figures=figures,
        simulation=simulation,
        end_time=float(trajectory.time[-1]),
        end={name: trajectory[name][-1] for name in trajectory.names if not name.startswith("energy.")},
        states=list(simulation.states),
        switches=len(simulation.switches),
        events=events,
        accumulation=simulation.accumulation,
        files=_files(simulation, events),
        chosen=simulation.chosen,
        energy_error=simulation.energy_error,
        **energies,
    )


def _row_of(event: Event) -> dict[str, Any]:
    """Return an event as in result.json."""
    changes = {name: list(pair) for name, pair in {**event.discrete, **event.restarted}.items()}
    return {"time_s": event.time, "causes": list(event.causes), "changes": changes, "energy_J": event.energy}


def _files(simulation: Simulation, events: list[dict[str, Any]]) -> dict[str, str]:
    """Return CSV files of the events, and of the inputs and outputs of each sampled block at its samples."""
    files = {}
    if events:
        columns = {
            "time [s]": [e["time_s"] for e in events],
            "causes": [" and ".join(e["causes"]) for e in events],
            "changes": [described(e) if e["changes"] else "" for e in events],
            "energy [J]": [e["energy_J"] for e in events],
        }
        files["events.csv"] = csv_text(columns, digits=15)
    for name, samples in simulation.samples.items():
        files[f"samples_{name}.csv"] = csv_bytes(samples).decode()
    return files


def _signals(trajectory: Trajectory, marks: list[float]) -> Any:
    from ..plot.signals import signals_figure

    return signals_figure(trajectory, marks=marks)


def _energy(trajectory: Trajectory) -> Any:
    from ..plot.signals import energy_figure

    return energy_figure(trajectory)
