"""A filter as a step function for `gt.cgen`, with a twin in Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from ..._pickling import Portable
from ...cgen.real import DOUBLE, FILTER, Real
from ...cgen.steps.function import StepFunction, StepMember, StepTwin, dtype_of
from ...results.refusal import ArgumentError
from ...results.status import Status
from ..belief import InitialState
from ..system import System
from .plan import plan_of
from .text import text
from .twin import UNIT, FilterTwin, Pair

# times n (n + 1) round-offs: least share of each variance for its entry of D. U D U' is positive if D is above zero;
# the share leaves room to multiply U D U' and factor it again in double. In float this worst case is more than good
# filters leave, so there the share is 2 n round-offs, a typical error
ROUND_OFFS = 2.0
MISSING = 0.2  # share of missing readings in a run of examples
WRONG = 9  # one step in so many has a reading that is refused
SPREAD = 3.0  # initial deviations over which the examples vary


class ControllerFilter(StepFunction, Portable):
    """The error-state Kalman filter of a system as a step function, for C code in a control loop.

    Each step advances the belief by one period and then uses the readings whose valid flag is set; without a reading it
    only advances. A sensor's delay is a whole number of periods, and its reading is used at the instant at which it was
    taken. The filter stores the belief of the oldest instant whose readings are complete; each step goes from there to
    the present with the readings received so far. The result is that of `ErrorState` on sorted data.

    Args:
        system: process and sensors.
        period: of the loop [s].
        start: default start, one period before the first step; `_init` can take another one.
        stale: sensor -> number of cycles without a reading after which the status is STALE_INPUT; never if left out.
        closed: sensor -> number of consecutive readings beyond its gate after which the status is OUT_OF_RANGE.
        title: one line for header and README.

    Raises GenerationError, an ArgumentError, for unsupported models: directions among the states, or equations that
    need an iteration.

    >>> class Cart(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     a = gt.input(unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == self.a
    >>> process = gt.filtering.ProcessModel(Cart(), noise={"a": 0.1}, states=["x", "v"])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> start = gt.filtering.InitialState({}, {"x": 1.0, "v": 1.0})
    >>> cart = gt.filtering.ControllerFilter(system, 0.004, start)
    >>> [m.identifier for m in cart.inputs]
    ['tape_m', 'tape_valid']
    """

    runtime = FILTER

    def __init__(
        self,
        system: System,
        period: float,
        start: InitialState,
        *,
        stale: Mapping[str, int] | None = None,
        closed: Mapping[str, int] | None = None,
        title: str = "",
    ) -> None:
        if not period > 0:
            raise ArgumentError(f"expected more than 0 s; found {period}", "period")
        for argument, limits in (("stale", stale or {}), ("closed", closed or {})):
            for name, count in limits.items():
                if name not in system.sensors:
                    names = ", ".join(f"'{n}'" for n in system.sensors)
                    raise ArgumentError(f"there is no sensor '{name}'; the sensors are {names}", argument)
                if count < 1:
                    raise ArgumentError(f"expected at least 1 cycle; found {count}", f"{argument}.{name}")
        self.system, self.period, self.initial = system, float(period), start
        self.plan = plan_of(system, self.period, stale or {}, closed or {})
        self.title = title or f"filter of {', '.join(part.name for part in system.space.parts)}"
        self._members()
        belief = start.belief(system, 0.0)
        deviations = np.sqrt(np.diag(belief.P[0]))
        if np.any(deviations <= 0):
            raise ArgumentError("expected deviations above zero; generated code needs them", "start.deviation")
        self.defaults: Mapping[str, Any] = {
            **{part.name: _value(part, belief.x[0, at]) for part, at, _ in system.space.places()},
            **{
                f"{part.name}.deviation": _scalar(deviations[along], m.size)
                for (part, _, along), m in zip(system.space.places(), self.deviation_members, strict=True)
            },
        }

    def _members(self) -> None:
        space, plan, d = self.system.space, self.plan, self.system.dynamics
        self.mean_members = [StepMember(p.name, None if p.size == 1 else p.size, p.unit, "mean") for p in space.parts]
        self.deviation_members = [
            StepMember(
                f"{p.name}.deviation", None if p.dimension == 1 else p.dimension, p.error_unit,
                "standard deviation of the error",
            )
            for p in space.parts
        ]  # fmt: skip
        self.known_members = [
            StepMember(name, None if size == 1 else size, "?", "known input") for name, size in d.inputs.items()
        ]
        self.sensor_members = []
        for sensor, reading in zip(plan.sensors, self.system.readings.values(), strict=True):
            late = f", {sensor.delay} cycles late" if sensor.delay else ""
            self.sensor_members.append(
                (
                    StepMember(sensor.name, None if sensor.size == 1 else sensor.size, reading.unit, f"reading{late}"),
                    StepMember(f"{sensor.name}.valid", description="1 with a new reading, else 0", integer=True),
                    StepMember(f"{sensor.name}.gated", description="1 if the gate left the reading out", integer=True),
                    StepMember(f"{sensor.name}.age", description="cycles since its last reading", integer=True),
                )
            )
        self.start = [*self.mean_members, *self.deviation_members, *self.known_members]
        self.inputs = [*self.known_members, *[m for value, flag, _, _ in self.sensor_members for m in (value, flag)]]
        lag = f"{plan.depth} cycles ago, at the last complete instant: " if plan.depth else ""
        self.outputs = [
            *self.mean_members, *self.deviation_members,
            StepMember("nis", description=f"{lag}normalised innovation squared"),
            StepMember("count", description=f"{lag}number of its degrees of freedom", integer=True),
            *[m for _, _, gated, age in self.sensor_members for m in (gated, age)],
        ]  # fmt: skip
        ring, sensors = plan.depth + 1, len(plan.sensors)
        known = [StepMember("before", plan.inputs), StepMember("inputs", ring * plan.inputs)] if plan.inputs else []
        self.state = [
            StepMember("time", unit="s", description="since the start"),
            StepMember("mean", plan.size, description="states side by side"),
            StepMember("factor", plan.errors * plan.stride, description=f"U, columns of {plan.stride}, of U D U'"),
            StepMember("diagonal", plan.errors, description="D of the covariance U D U' of the errors"),
            *known,
            StepMember("readings", ring * plan.numbers, description="of the last instants"),
            StepMember("present", ring * sensors, description="1 if the reading is there", integer=True),
            StepMember("place", description="index of the newest instant", integer=True),
            StepMember("begun", description="cycles since the start, up to the buffer length", integer=True),
            StepMember("closed", sensors, description="consecutive readings beyond the gate", integer=True),
            StepMember("age", sensors, description="cycles since the last reading", integer=True),
        ]

    def pivot_of(self, real: Real) -> float:
        """Return the least share of each variance for its entry of D: the round-off of a factorisation."""
        n = self.plan.errors
        return ROUND_OFFS * (n * (n + 1) if real is DOUBLE else n) * real.precision.round_off

    def kernels(self, symbol: str) -> list[ca.Function]:
        """Return the generated functions under their C names."""
        return [k.called(f"{symbol}_{k.name}") for k in self.plan.kernels]

    def text(self, symbol: str, real: Real) -> str:
        """Return the C code of init and step, with their tables."""
        return text(self, symbol, real)

    def twin(self, real: Real = DOUBLE) -> StepTwin:
        """Return the same filter in Python."""
        return ControllerTwin(self, real)

    def notes(self) -> list[str]:
        """Return the meaning of its statuses."""
        late = f" The longest delay is {self.plan.depth} cycles." if self.plan.depth else ""
        return [
            f"The reading of a sensor is used if its valid flag is not 0.{late}",
            "- GT_NOT_FINITE: a known input, a valid reading or the resulting estimate is not finite; call again in "
            "the same cycle with the flag cleared",
            "- GT_OUT_OF_RANGE: a quaternion is not of unit length (1e-6), a number is so large that its round-off "
            "reaches the sensor's deviation, or the gate of a sensor left out too many consecutive readings: "
            "initialise again",
            "- GT_SINGULAR: the covariance is not positive definite: a pivot is below its limit",
            "- GT_STALE_INPUT: a sensor had no reading for too many cycles: initialise again",
        ]

    def facts(self) -> Mapping[str, Any]:
        """Return the data from which the code was generated."""
        plan = self.plan
        sensors = [
            {
                "name": s.name, "delay": s.delay, "stale": s.stale, "closed": s.closed, "gate": s.gate.hex(),
                "variance": [float(v).hex() for v in s.variance], "entries": len(s.jacobian.places),
            }
            for s in plan.sensors
        ]  # fmt: skip
        matrices = [plan.transition.value.tolist(), plan.noise.value.tolist()]
        return {
            "period": self.period.hex(), "parts": plan.parts, "errors": plan.errors, "sensors": sensors,
            "constants": [[float(v).hex() for v in m] for m in matrices],
        }  # fmt: skip

    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Return inputs of a run: readings of states that drift from the start, some missing, some to be refused."""
        rng, system = np.random.default_rng(seed), self.system
        records = np.zeros(rows, dtype_of(self.inputs, real))
        start = self.initial.belief(system, 0.0)
        d = np.sqrt(np.diag(start.P[0])) * rng.normal(size=(rows, self.plan.errors)).cumsum(axis=0)
        x = system.space.plus(start.x, d * (SPREAD / max(rows, 1)))
        for m in self.known_members:
            records[m.identifier] = real.array(rng.normal(size=(rows, m.count)).reshape(records[m.identifier].shape))
        u = np.zeros((rows, self.plan.inputs))
        for sensor, (value, flag, _, _) in zip(self.plan.sensors, self.sensor_members, strict=True):
            z = system.read((sensor.name,), 0.0, x, u)
            z = z + (0.0 if sensor.quaternion else 1.0) * sensor.deviation * rng.normal(size=z.shape)
            if sensor.quaternion:
                z /= np.linalg.norm(z, axis=1)[:, None]
            z[rng.random(rows) < 1.0 / WRONG] *= rng.choice([np.nan, 1e30, 0.5])
            records[value.identifier] = real.array(z.reshape(records[value.identifier].shape))
            records[flag.identifier] = rng.random(rows) > MISSING
        return records

    def complete(self, real: Real) -> np.ndarray:
        """Return inputs with a reading of every sensor at the start, without noise."""
        x = self.initial.belief(self.system, 0.0).x
        row = np.zeros((), dtype_of(self.inputs, real))
        for sensor, (value, flag, _, _) in zip(self.plan.sensors, self.sensor_members, strict=True):
            z = self.system.read((sensor.name,), 0.0, x, np.zeros((1, self.plan.inputs)))
            row[value.identifier], row[flag.identifier] = real.array(z[0].reshape(row[value.identifier].shape)), 1
        return row


class ControllerTwin(StepTwin):
    """A `ControllerFilter` in Python: takes and returns records with the same bytes as C."""

    def __init__(self, controller: ControllerFilter, real: Real) -> None:
        self.controller, self.real = controller, real
        self.filter = FilterTwin(controller.plan, real, controller.pivot_of(real))

    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """Fill a new state from a record of the start."""
        controller, real = self.controller, self.real
        places = controller.system.space.places()
        mean = [start[m.identifier].reshape(-1) for m in controller.mean_members]
        deviation = np.concatenate([start[m.identifier].reshape(-1) for m in controller.deviation_members])
        known = [start[m.identifier].reshape(-1) for m in controller.known_members]
        if not all(np.all(np.isfinite(v)) for v in (*mean, deviation, *known)):
            return Status.NOT_FINITE
        for value, (part, _, _) in zip(mean, places, strict=True):
            if part.kind == "quaternion":
                square = real.dtype(0.0)
                for x in value:
                    square = square + x * x
                if not abs(square - real.dtype(1.0)) <= real.dtype(UNIT):
                    return Status.OUT_OF_RANGE
        with np.errstate(over="ignore"):
            variance = deviation * deviation
        if not np.all((deviation > 0) & (variance > 0) & np.isfinite(variance)):
            return Status.OUT_OF_RANGE
        state[...] = np.zeros((), state.dtype)
        state["mean"] = np.concatenate(mean)
        state["factor"] = np.eye(controller.plan.errors, controller.plan.stride, dtype=real.dtype).ravel()
        state["diagonal"] = variance
        if known:
            state["before"] = np.concatenate(known)
        return Status.OK

    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """Do one cycle."""
        controller, plan, real = self.controller, self.controller.plan, self.real
        ring, sensors, known = plan.depth + 1, len(plan.sensors), bool(plan.inputs)
        none = np.zeros((ring, 0), real.dtype)
        factor = state["factor"].reshape(plan.errors, plan.stride)[:, : plan.errors].copy()
        next: dict[str, Any] = {
            "belief": Pair(
                state["time_s"][()], state["mean"].copy(), factor, state["diagonal"].copy(), state["closed"].astype(int)
            ),
            "before": state["before"].copy() if known else none[0],
            "inputs": state["inputs"].reshape(ring, -1).copy() if known else none,
            "readings": state["readings"].reshape(ring, -1).copy(),
            "present": state["present"].reshape(ring, sensors).copy(),
            "place": int(state["place"]), "begun": int(state["begun"]), "age": state["age"].astype(int),
        }  # fmt: skip
        u = np.concatenate([none[0], *[inputs[m.identifier].reshape(-1) for m in controller.known_members]])
        z = np.concatenate([inputs[value.identifier].reshape(-1) for value, _, _, _ in controller.sensor_members])
        flags = [int(inputs[flag.identifier]) for _, flag, _, _ in controller.sensor_members]
        status, now, outcome = self.filter.cycle(next, u, z, np.array(flags))
        if status != Status.OK or now is None:
            return status
        belief = next["belief"]
        padded = np.zeros((plan.errors, plan.stride), real.dtype)
        padded[:, : plan.errors] = belief.factor
        state["time_s"], state["mean"] = belief.time, belief.x
        state["factor"], state["diagonal"] = padded.ravel(), belief.diagonal
        if known:
            state["before"], state["inputs"] = next["before"], next["inputs"].ravel()
        state["readings"], state["present"] = next["readings"].ravel(), next["present"].ravel()
        for name in ("place", "begun", "age"):
            state[name] = next[name]
        state["closed"] = belief.closed
        for m, (_, at, _) in zip(controller.mean_members, controller.system.space.places(), strict=True):
            outputs[m.identifier] = now.x[at].reshape(outputs[m.identifier].shape)
        deviations = np.sqrt(now.variances())
        for m, (_, _, along) in zip(controller.deviation_members, controller.system.space.places(), strict=True):
            outputs[m.identifier] = deviations[along].reshape(outputs[m.identifier].shape)
        outputs["nis"], outputs["count"] = outcome.nis, outcome.count
        for k, (_, _, gated, age) in enumerate(controller.sensor_members):
            outputs[gated.identifier], outputs[age.identifier] = outcome.gated[k], next["age"][k]
        return Status.OK


def _value(part: Any, x: np.ndarray) -> Any:
    return float(x[0]) if part.size == 1 else x


def _scalar(values: np.ndarray, size: int | None) -> Any:
    return float(values[0]) if size is None else values
