"""Any FMU as a plant: of a simulated controller, and for learning control."""

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
    """An FMU as a plant for `gt.loop`: carts under commanded positions.

    Args:
        path: of the archive, FMI 2.0 or 3.0, with co-simulation.
        position: outputs with the measured positions, one for each cart.
        command: inputs for commanded positions; command_speed: optional inputs for commanded speeds.
        force: instead of command, inputs for the motor forces of `servo`; speed: outputs with the speeds.
        arm: outputs with the positions on the arm's side; default: `position`.
        servo: computes the forces, default `Servo()`; with `command` the servo inside the FMU, None: unknown.
        start: start values by name, in the FMU's own units. cycle_s: cycle [s].
        units: unit, such as "mm", of variables without one in the description, by "position", "command",
            "command_speed", "force", "speed" or "arm".
        steps: communication steps per cycle; default 1, with forces the substeps of the servo.
        timeout: of a call of the FMU [s].

    limit_N: largest force of each motor of `servo` [N], at which it saturates; None with `command`. force_N: what the
    servo asked for at each step of the last cycle, (steps, carts).

    Within a cycle the commanded position moves at the commanded speed from step to step. Values are converted to SI
    with the units of the description. Raises ArgumentError as `RunningUnit` does, and unless either command or force is
    set, with one name per position; also for a duplicate variable, a missing unit or one of another dimension, and a
    communication step that does not fit the unit's inner step.
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
        roles = {
            "position": position, "command": command, "command_speed": command_speed, "force": force,
            "speed": speed, "arm": arm,
        }  # fmt: skip
        named(roles)
        agree(cycle_s, float, "cycle_s", ABOVE_ZERO)
        agree(steps, int | None, "steps", (Within(least=1, most=MOST_STEPS),))
        for name in set(units or {}) - set(QUANTITIES):
            raise ArgumentError(f"expected one of {', '.join(QUANTITIES)}; found '{name}'", "units")
        self.unit = RunningUnit(path, start, timeout=timeout)
        self._names = {name: list(variables) for name, variables in roles.items() if variables}
        self._scales: dict[str, Scaling] = {}
        for name, variables in self._names.items():
            inputs = name in ("command", "command_speed", "force")
            signals = (self.unit.signals.taken if inputs else self.unit.signals.computed)(variables, name)
            self._scales[name] = scaling(signals, QUANTITIES[name], (units or {}).get(name, ""), name)
        self.servo = servo or (Servo() if force else None)
        self.cycle_s = cycle_s
        self.limit_N, self.force_N = (np.inf if force else None), np.zeros((0, len(position)))
        self.steps = steps or (self.servo.substeps if force and self.servo is not None else 1)
        self._check_step(cycle_s / self.steps)
        try:
            self.position_m = self._read("position")
        except UnitStopped as error:
            raise ArgumentError(f"the FMU has no positions at its start: {error}", "start") from error

    @property
    def title(self) -> str:
        """Name of the plant, for messages."""
        under = " under a servo" if "force" in self._names else ""
        return f"unit '{self.unit.name}' (FMI {self.unit.version}){under}"

    @property
    def arm_m(self) -> np.ndarray:
        """Arm side of the carts [m]."""
        return self._read("arm") if "arm" in self._names else self.position_m

    def step(self, position_m: Sequence[float], speed_m_s: Sequence[float]) -> None:
        """Advance one cycle under commanded positions [m] and speeds [m/s].

        Raises UnitStopped, and ArgumentError unless there is one number for each cart.
        """
        carts = self._names["position"]
        u, du = numbers_of(carts, position_m, "position_m"), numbers_of(carts, speed_m_s, "speed_m_s")
        h = self.cycle_s / self.steps
        servo = self.servo if "force" in self._names else None
        measured = [name for name in ("position", "speed") if name == "position" or servo is not None]
        outputs = [variable for name in measured for variable in self._names[name]]
        q, dq = (self._read("position"), self._read("speed")) if servo is not None else (self.position_m, du)
        forces: list[np.ndarray] = []
        for k in range(self.steps):
            now = u + k * h * du if k else u
            if servo is not None:
                forces.append(np.asarray(servo.kp_N_m * (now - q) + servo.kd_N_s_m * (du - dq)))
                limit = np.inf if self.limit_N is None else self.limit_N
                inputs = {"force": np.clip(forces[-1], -limit, limit)}
            else:
                inputs = {"command": now} | ({"command_speed": du} if "command_speed" in self._names else {})
            values = [(self._names[name], self._scales[name].own(np.asarray(x))) for name, x in inputs.items()]
            results = np.split(self.unit.advance(values, h, outputs), len(measured))
            q, *rest = (self._scales[name].si(x) for name, x in zip(measured, results, strict=True))
            dq = rest[0] if rest else du
        self.position_m, self.force_N = q, np.array(forces).reshape(-1, len(carts))

    def _read(self, name: str) -> np.ndarray:
        return self._scales[name].si(self.unit.get(self._names[name]))

    def _check_step(self, step: float) -> None:
        """Raise ArgumentError unless the FMU's inner step and the communication step are multiples."""
        h = self.unit.inner_step
        if h is None:
            return
        ratio = max(step / h, h / step)
        if abs(ratio - round(ratio)) > WHOLE * ratio:
            fitting = [n for n in range(1, 101) if abs(self.cycle_s / n / h - round(self.cycle_s / n / h)) < WHOLE]
            fitting = [n for n in fitting if self.cycle_s / n >= h * (1 - WHOLE)]
            advice = (
                f"choose {fitting[0]}" if fitting else f"no number of steps fits a cycle of {1e3 * self.cycle_s:g} ms"
            )
            raise ArgumentError(
                f"'{self.unit.name}' has inner steps of {1e3 * h:g} ms, which do not fit a communication step of "
                f"{1e3 * step:g} ms; {advice}",
                "steps",
            )


def named(roles: Mapping[str, Sequence[str]]) -> None:
    """Raise ArgumentError unless the names of variables by role can make a plant, whatever the FMU is."""
    position, command, force = roles["position"], roles["command"], roles["force"]
    if not position:
        raise ArgumentError("name the outputs with the positions of the carts", "position")
    if bool(command) == bool(force):
        raise ArgumentError("name either inputs for positions, or inputs for forces of a servo", "command")
    if force and not roles["speed"]:
        raise ArgumentError("a servo needs the speeds of the carts; name the outputs with the speeds", "speed")
    if force and roles["command_speed"]:
        raise ArgumentError("leave it out with forces; only inputs for positions take it", "command_speed")
    for name, variables in roles.items():
        if variables and len(variables) != len(position):
            raise ArgumentError(f"expected {len(position)} names, one for each position; found {len(variables)}", name)
        for k, variable in enumerate(variables):
            if variable in variables[:k]:
                raise ArgumentError(f"'{variable}' appears twice", name)


class FmuExperiment:
    """An FMU that repeats a motion, for `gt.control.learning.study(..., experiment=...)`.

    Args:
        path: of the archive, FMI 2.0 or 3.0, with co-simulation; every run restarts it.
        names: of the axes. reference: (N, axes) [m]. sample_time: sampling period [s].
        inputs: variables for reference plus learned input, one for each axis.
        outputs: variables of the signals "motor", "tool", "acceleration", one for each axis.
        corrected: samples that count; default: all. start: start values by name. timeout: of a call [s].

    Each sample is taken before its inputs act. Raises ArgumentError as `RunningUnit` does, and unless there is one name
    for each axis, no name twice, with inputs for `inputs` and computed variables for `outputs`.
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
        for name, variables in (("inputs", inputs), *(("outputs", o) for o in outputs.values())):
            if len(variables) != len(self.names):
                raise ArgumentError(
                    f"expected {len(self.names)} names, one for each axis; found {len(variables)}", name
                )
            if twice := [n for n in variables if list(variables).count(n) > 1]:
                raise ArgumentError(f"'{twice[0]}' appears twice", name)
        self.unit = RunningUnit(path, start, timeout=timeout)
        self.inputs, self.outputs = list(inputs), {signal: list(variables) for signal, variables in outputs.items()}
        self.unit.signals.taken(self.inputs, "inputs")
        self.unit.signals.computed([n for variables in self.outputs.values() for n in variables], "outputs")
        self.synthetic = f"simulated by the FMU {self.unit.name}"

    def run(self, inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Run with an input (N, axes) added to the reference; return signals (N, axes) by name. Raises UnitStopped."""
        if np.shape(inputs) != self.reference.shape:
            raise ArgumentError(f"expected {self.reference.shape} numbers; found {np.shape(inputs)}", "inputs")
        self.unit.restart()
        outputs = [variable for variables in self.outputs.values() for variable in variables]
        rows = [self.unit.get(outputs)]
        commands = self.reference + inputs
        for command in commands[:-1]:
            rows.append(self.unit.advance([(self.inputs, command)], self.sample_time, outputs))
        self.unit.set(self.inputs, commands[-1])
        self.unit.step(self.sample_time)
        return dict(zip(self.outputs, np.split(np.array(rows), len(self.outputs), axis=1), strict=True))
