"""A unit of anybody as the plant of a loop: behind a simulated controller, and for learning control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..loop.plant import Servo
from ..results.agreement import Within, agree, numbers_of
from ..results.refusal import ArgumentError
from .caller import TIMEOUT_S
from .export import Fmu
from .running import ABOVE_ZERO, WHOLE, RunningUnit, UnitStopped
from .signals import Scaling, scaling

MOST_STEPS = 1000
QUANTITIES = {"position": "m", "command": "m", "command_speed": "m/s", "force": "N", "speed": "m/s", "arm": "m"}


class FmuPlant:
    """A unit behind a simulated controller, as the plants of `gt.loop`: carts under commanded positions.

    Args:
        path: of the archive, FMI 2.0 or 3.0, with co-simulation.
        position: its outputs that are the measured positions, one for each cart.
        command: its inputs that take commanded positions, and command_speed, if there are, commanded speeds; or
        force: its inputs that take motor forces of `servo`, with `speed`, its outputs that are speeds.
        arm: its outputs that are where the arm's side stands; the positions if left out.
        servo: that makes the forces, `Servo()` if left out; with `command` the one inside of the unit, None: unknown.
        start: start values by name, in the unit's own units. cycle_s: [s].
        units: by "position", "command", "command_speed", "force", "speed", "arm" the unit, such as "mm", of variables
            whose description says none.
        steps: communication steps in a cycle; 1 if left out, with forces as many as the servo has substeps.
        timeout: of a call of the unit [s].

    Within a cycle a commanded position goes on at the commanded speed from step to step. Numbers become SI by the units
    of the description. Raises ArgumentError as `RunningUnit`, and unless either command or force is given, one for each
    position, for a variable twice, for units of another dimension or none, and for a communication step that does not
    fit the unit's own.
    """

    def __init__(
        self,
        path: str | Path | Fmu,
        position: Sequence[str],
        *,
        command: Sequence[str] = (),
        command_speed: Sequence[str] = (),
        force: Sequence[str] = (),
        speed: Sequence[str] = (),
        arm: Sequence[str] = (),
        servo: Servo | None = None,
        start: Mapping[str, float] | None = None,
        cycle_s: float = 0.004,
        units: Mapping[str, str] | None = None,
        steps: int | None = None,
        timeout: float = TIMEOUT_S,
    ) -> None:
        given = {
            "position": position, "command": command, "command_speed": command_speed, "force": force,
            "speed": speed, "arm": arm,
        }  # fmt: skip
        named(given)
        agree(cycle_s, float, "cycle_s", ABOVE_ZERO)
        agree(steps, int | None, "steps", (Within(least=1, most=MOST_STEPS),))
        for name in set(units or {}) - set(QUANTITIES):
            raise ArgumentError(f"'{name}' is none of {', '.join(QUANTITIES)}", "units")
        self.unit = RunningUnit(path, start, timeout=timeout)
        self._names = {name: list(variables) for name, variables in given.items() if variables}
        self._scales: dict[str, Scaling] = {}
        for name, variables in self._names.items():
            inputs = name in ("command", "command_speed", "force")
            signals = (self.unit.signals.taken if inputs else self.unit.signals.computed)(variables, name)
            self._scales[name] = scaling(signals, QUANTITIES[name], (units or {}).get(name, ""), name)
        self.servo = servo or (Servo() if force else None)
        self.cycle_s = cycle_s
        self.steps = steps or (self.servo.substeps if force and self.servo is not None else 1)
        self._fits(cycle_s / self.steps)
        try:
            self.position_m = self._read("position")
        except UnitStopped as error:
            raise ArgumentError(f"it has no positions at its start: {error}", "start") from error

    @property
    def title(self) -> str:
        """What it is, for people."""
        under = " under a servo" if "force" in self._names else ""
        return f"unit '{self.unit.name}' (FMI {self.unit.version}){under}"

    @property
    def arm_m(self) -> np.ndarray:
        """The arm's side of the carts [m]."""
        return self._read("arm") if "arm" in self._names else self.position_m

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        """One cycle under a commanded position [m] and speed [m/s]. Raises UnitStopped, and
        ArgumentError for other than one number for each cart."""
        carts = self._names["position"]
        u, du = numbers_of(carts, position_m, "position_m"), numbers_of(carts, speed_m_s, "speed_m_s")
        h = self.cycle_s / self.steps
        servo = self.servo if "force" in self._names else None
        seen = [name for name in ("position", "speed") if name == "position" or servo is not None]
        outputs = [variable for name in seen for variable in self._names[name]]
        q, dq = (self._read("position"), self._read("speed")) if servo is not None else (self.position_m, du)
        for k in range(self.steps):
            now = u + k * h * du if k else u
            if servo is not None:
                given = {"force": servo.kp_N_m * (now - q) + servo.kd_N_s_m * (du - dq)}
            else:
                given = {"command": now} | ({"command_speed": du} if "command_speed" in self._names else {})
            values = [(self._names[name], self._scales[name].own(x)) for name, x in given.items()]
            got = np.split(self.unit.advance(values, h, outputs), len(seen))
            q, *rest = (self._scales[name].si(x) for name, x in zip(seen, got, strict=True))
            dq = rest[0] if rest else du
        self.position_m = q

    def _read(self, name: str) -> np.ndarray:
        return self._scales[name].si(self.unit.get(self._names[name]))

    def _fits(self, step: float) -> None:
        """Raises ArgumentError where the unit's own step and that of the communication are no multiples."""
        own = self.unit.inner_step
        if own is None:
            return
        ratio = max(step / own, own / step)
        if abs(ratio - round(ratio)) > WHOLE * ratio:
            fitting = [n for n in range(1, 101) if abs(self.cycle_s / n / own - round(self.cycle_s / n / own)) < WHOLE]
            fitting = [n for n in fitting if self.cycle_s / n >= own * (1 - WHOLE)]
            advice = f"take {fitting[0]}" if fitting else f"no whole part of a cycle of {1e3 * self.cycle_s:g} ms fits"
            raise ArgumentError(
                f"'{self.unit.name}' has steps of {1e3 * own:g} ms inside; they do not fit a communication step of "
                f"{1e3 * step:g} ms; {advice}",
                "steps",
            )


def named(given: Mapping[str, Sequence[str]]) -> None:
    """Raises ArgumentError unless the names of variables can make a plant, whatever the unit is."""
    position, command, force = given["position"], given["command"], given["force"]
    if not position:
        raise ArgumentError("name the outputs that are the positions of the carts", "position")
    if bool(command) == bool(force):
        raise ArgumentError("give either inputs for positions, or inputs for forces of a servo", "command")
    if force and not given["speed"]:
        raise ArgumentError("a servo takes the speeds of the carts; name the outputs that are speeds", "speed")
    if force and given["command_speed"]:
        raise ArgumentError("belongs to inputs for positions; with forces the servo has the speeds", "command_speed")
    for name, variables in given.items():
        if variables and len(variables) != len(position):
            raise ArgumentError(f"expected {len(position)} names, one for each position; found {len(variables)}", name)
        for k, variable in enumerate(variables):
            if variable in variables[:k]:
                raise ArgumentError(f"'{variable}' is there twice", name)


class FmuExperiment:
    """A unit that repeats a motion, as `gt.control.learning.study(..., experiment=...)` takes it.

    Args:
        path: of the archive, FMI 2.0 or 3.0, with co-simulation; it begins anew at every run.
        names: of the axes. reference: (N, axes) [m]. sample_time: [s].
        inputs: its variables that take reference plus learned input, one for each axis.
        outputs: signal ("motor", "tool", "acceleration") = its variables, one for each axis.
        corrected: the samples that count, all if left out. start: start values by name. timeout: of a call [s].

    A run is sampled before the inputs of each sample act. Raises ArgumentError as `RunningUnit`, for another number of
    names than axes, a name twice, inputs that are none and outputs that are not computed.
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
        timeout: float = TIMEOUT_S,
    ) -> None:
        agree(sample_time, float, "sample_time", ABOVE_ZERO)
        self.names, self.sample_time = tuple(names), float(sample_time)
        self.reference = np.array(reference, float)
        self.corrected = corrected or slice(0, len(self.reference))
        if self.reference.ndim != 2 or self.reference.shape[1] != len(self.names):
            raise ArgumentError(f"expected (N, {len(self.names)}) numbers; found {self.reference.shape}", "reference")
        if not np.all(np.isfinite(self.reference)):
            raise ArgumentError("expected finite numbers", "reference")
        for name, given in (("inputs", inputs), *(("outputs", o) for o in outputs.values())):
            if len(given) != len(self.names):
                raise ArgumentError(f"expected {len(self.names)} names, one for each axis; found {len(given)}", name)
            if twice := [n for n in given if list(given).count(n) > 1]:
                raise ArgumentError(f"'{twice[0]}' is there twice", name)
        self.unit = RunningUnit(path, start, timeout=timeout)
        self.inputs, self.outputs = list(inputs), {signal: list(given) for signal, given in outputs.items()}
        self.unit.signals.taken(self.inputs, "inputs")
        self.unit.signals.computed([n for given in self.outputs.values() for n in given], "outputs")
        self.synthetic = f"simulated by the unit {self.unit.name}"

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Signals by name (N, axes) of a run with an input (N, axes) added to the reference. Raises UnitStopped."""
        if np.shape(inputs) != self.reference.shape:
            raise ArgumentError(f"expected {self.reference.shape} numbers; found {np.shape(inputs)}", "inputs")
        self.unit.restart()
        outputs = [variable for given in self.outputs.values() for variable in given]
        rows = [self.unit.get(outputs)]
        ats = self.reference + inputs
        for at in ats[:-1]:
            rows.append(self.unit.advance([(self.inputs, at)], self.sample_time, outputs))
        self.unit.set(self.inputs, ats[-1])
        self.unit.step(self.sample_time)
        return dict(zip(self.outputs, np.split(np.array(rows), len(self.outputs), axis=1), strict=True))
