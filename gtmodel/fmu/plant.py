"""A unit of anybody as the plant of a loop, run by FMPy: behind a simulated controller, and for learning control."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..loop.plant import Servo
from ..results.refusal import ArgumentError
from .export import Fmu

NEEDS_FMPY = "running a unit needs FMPy; install it by pip install 'gtmodel[fmi]'"


class UnitStopped(RuntimeError):
    """A unit that has no answer on the way: one sentence with the time."""


class RunningUnit:
    """One instance of a unit in co-simulation, by FMPy; variables by their names in the description.

    path: of the archive, FMI 2.0 or 3.0, or what `export` gave. start: values by name, set before it begins.

    Raises ArgumentError without FMPy, for an archive that it cannot read or that has no co-simulation, and for names
    that are no real variables of it; UnitStopped where a step ends without an answer.
    """

    def __init__(self, path: str | Path | Fmu, start: Mapping[str, float] | None = None) -> None:
        if find_spec("fmpy") is None:
            raise ArgumentError(NEEDS_FMPY, "path")
        fmpy: Any = import_module("fmpy")
        simulation: Any = import_module("fmpy.simulation")
        folder = tempfile.mkdtemp(prefix="gtmodel-fmu-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        if isinstance(path, Fmu):
            (own := Path(folder) / f"{path.table.name}.fmu").write_bytes(path.data)
            path = own
        try:
            description = fmpy.read_model_description(str(path))
            fmpy.extract(str(path), folder)
        except Exception as error:
            raise ArgumentError(f"FMPy cannot read '{path}': {error}", "path") from error
        if description.coSimulation is None:
            raise ArgumentError(f"'{path}' offers no co-simulation", "path")
        self.name = str(description.modelName)
        self._three = str(description.fmiVersion).startswith("3")
        self._references = {
            v.name: int(v.valueReference) for v in description.modelVariables if v.type in ("Real", "Float64")
        }
        self._unit: Any = simulation.instantiate_fmu(folder, description, "CoSimulation")
        self._start = dict(start or {})
        self.time = 0.0
        self._begin()

    def _begin(self) -> None:
        if self._start:
            self.set(list(self._start), list(self._start.values()))
        if self._three:
            self._unit.enterInitializationMode(startTime=0.0)
        else:
            self._unit.setupExperiment(startTime=0.0)
            self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()
        self.time = 0.0

    def restart(self) -> None:
        """Back to the start, with the same start values."""
        self._unit.reset()
        self._begin()

    def places(self, names: Sequence[str], argument: str) -> list[int]:
        """Value references of variables. Raises ArgumentError for a name that is none."""
        for name in names:
            if name not in self._references:
                there = ", ".join(list(self._references)[:12])
                raise ArgumentError(f"'{self.name}' has no real variable '{name}'; it has {there}, ...", argument)
        return [self._references[name] for name in names]

    def set(self, names: Sequence[str], values: Sequence[float] | np.ndarray) -> None:
        """Sets variables by name."""
        (self._unit.setFloat64 if self._three else self._unit.setReal)(
            self.places(names, "inputs"), list(map(float, values))
        )

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Values of variables by name."""
        return np.array((self._unit.getFloat64 if self._three else self._unit.getReal)(self.places(names, "outputs")))

    def step(self, length: float) -> None:
        """Goes on by `length` [s]. Raises UnitStopped where it cannot."""
        try:
            self._unit.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        except Exception as error:
            raise UnitStopped(
                f"'{self.name}' stopped between {self.time:.6g} and {self.time + length:.6g} s"
            ) from error
        self.time += length


class FmuPlant:
    """A unit behind a simulated controller, as the plants of `gt.loop`: carts under commanded positions.

    Args:
        path: of the archive, FMI 2.0 or 3.0, with co-simulation.
        position: its outputs that are the measured positions [m], one for each cart.
        command: its inputs that take commanded positions [m]; or
        force: its inputs that take motor forces [N] of `servo`, with `speed`, its outputs that are speeds [m/s].
        arm: its outputs that are where the arm's side stands [m]; the positions if left out.
        start: start values by name. cycle_s: [s].

    Raises ArgumentError as `RunningUnit`, and unless either command or force is given, one for each position.
    """

    def __init__(
        self,
        path: str | Path | Fmu,
        position: Sequence[str],
        *,
        command: Sequence[str] = (),
        force: Sequence[str] = (),
        speed: Sequence[str] = (),
        arm: Sequence[str] = (),
        servo: Servo | None = None,
        start: Mapping[str, float] | None = None,
        cycle_s: float = 0.004,
    ) -> None:
        if bool(command) == bool(force):
            raise ArgumentError("give either inputs for positions, or inputs for forces of a servo", "command")
        for name, given in (("command", command), ("force", force), ("arm", arm), ("speed", speed if force else ())):
            if given and len(given) != len(position):
                raise ArgumentError(f"expected {len(position)} names, one for each position; found {len(given)}", name)
        if force and not speed:
            raise ArgumentError("a servo takes the speeds of the carts; name the outputs that are speeds", "speed")
        self.unit = RunningUnit(path, start)
        for name, given in (("position", position), ("command", command), ("force", force), ("speed", speed)):
            self.unit.places(given, name)
        self._position, self._command, self._force, self._speed = map(list, (position, command, force, speed))
        self._arm = list(arm) or self._position
        self.unit.places(self._arm, "arm")
        self.servo, self.cycle_s = servo or Servo(), cycle_s
        self.position_m = self.unit.get(self._position)

    @property
    def arm_m(self) -> np.ndarray:
        """The arm's side of the carts [m]."""
        return self.unit.get(self._arm)

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        """One cycle under a commanded position [m] and speed [m/s]. Raises UnitStopped."""
        u, du = np.array(position_m, float), np.array(speed_m_s, float)
        if self._command:
            self.unit.set(self._command, u.tolist())
            self.unit.step(self.cycle_s)
        else:
            h = self.cycle_s / self.servo.substeps
            for k in range(self.servo.substeps):
                q, dq = self.unit.get(self._position), self.unit.get(self._speed)
                force = self.servo.kp_N_m * (u + k * h * du - q) + self.servo.kd_N_s_m * (du - dq)
                self.unit.set(self._force, force.tolist())
                self.unit.step(h)
        self.position_m = self.unit.get(self._position)


class FmuExperiment:
    """A unit that repeats a motion, as `gt.control.learning.study(..., experiment=...)` takes it.

    Args:
        path: of the archive, FMI 2.0 or 3.0, with co-simulation; it begins anew at every run.
        names: of the axes. reference: (N, axes) [m]. sample_time: [s].
        inputs: its variables that take reference plus learned input, one for each axis.
        outputs: signal ("motor", "tool", "acceleration") = its variables, one for each axis.
        corrected: the samples that count, all if left out. start: start values by name.

    A run is sampled before the inputs of each sample act. Raises ArgumentError as `RunningUnit`, and for another number
    of names than axes.
    """

    def __init__(
        self,
        path: str | Path | Fmu,
        reference: np.ndarray,
        *,
        names: Sequence[str],
        inputs: Sequence[str],
        outputs: Mapping[str, Sequence[str]],
        sample_time: float,
        corrected: slice | None = None,
        start: Mapping[str, float] | None = None,
    ) -> None:
        self.names, self.sample_time = tuple(names), float(sample_time)
        self.reference = np.array(reference, float)
        self.corrected = corrected or slice(0, len(self.reference))
        if self.reference.ndim != 2 or self.reference.shape[1] != len(self.names):
            raise ArgumentError(f"expected (N, {len(self.names)}) numbers; found {self.reference.shape}", "reference")
        for name, given in (("inputs", inputs), *(("outputs", o) for o in outputs.values())):
            if len(given) != len(self.names):
                raise ArgumentError(f"expected {len(self.names)} names, one for each axis; found {len(given)}", name)
        self.unit = RunningUnit(path, start)
        self.inputs, self.outputs = list(inputs), {signal: list(given) for signal, given in outputs.items()}
        self.unit.places([*self.inputs, *[n for given in self.outputs.values() for n in given]], "outputs")
        self.synthetic = f"simulated by the unit {self.unit.name}"

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Signals by name (N, axes) of a run with an input (N, axes) added to the reference. Raises UnitStopped."""
        self.unit.restart()
        rows: dict[str, list[np.ndarray]] = {signal: [] for signal in self.outputs}
        for at in self.reference + inputs:
            for signal, given in self.outputs.items():
                rows[signal].append(self.unit.get(given))
            self.unit.set(self.inputs, at.tolist())
            self.unit.step(self.sample_time)
        return {signal: np.array(values) for signal, values in rows.items()}
