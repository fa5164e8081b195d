"""A predictive controller from a model: an optimum over a horizon, solved again in every cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..cgen.real import DOUBLE, STAGE_QP, Real
from ..cgen.steps.function import StepFunction, StepMember, StepTwin, dtype_of, record
from ..lang.events import SampledBlock
from ..lang.model import Model
from ..lang.source import ModelError
from ..results.agreement import Within, agree
from ..results.refusal import ArgumentError, naming
from ..results.status import Status
from .block import block_of, closed_loop
from .closed_loop import LinearCycle
from .converged import ConvergedPlan, converged
from .cycle import CycleTwin, kernels_of, text_of
from .discretised import Discretised
from .options import AxisServo, ControlHorizon, Measurement, numbers
from .servo import axis_signals
from .statement import Reader, Wishes

PRICE = (1e3, 1e3)  # of a soft limit, by its size
OUTSIDE = 1e-6  # of a limit, by its size: rest at the targets is found to 1e-7
SPREAD, MISSING = 0.02, 0.1  # of examples: relative to the typical numbers; share with a number that is not finite


def controller(
    model: Model,
    horizon: ControlHorizon,
    *,
    tolerances: Mapping[str, Any] | None = None,
    targets: Mapping[str, Any] | None = None,
    references: Sequence[str] = (),
    limits: Mapping[str, Any] | None = None,
    prices: Mapping[str, Any] | None = None,
    measured: Mapping[str, Measurement] | None = None,
    disturbance: Mapping[str, float] | None = None,
    servo: AxisServo | None = None,
    outputs: Sequence[str] = (),
    prefer: Sequence[str] = (),
    branches: Mapping[str, int] | None = None,
) -> Controller:
    """Return the predictive controller of a model of components.

    In each cycle it minimises the integral over the horizon of the squares of (value - reference) / tolerance, plus a
    cost after the horizon by the Riccati equation (`ControlHorizon.terminal`). A cycle linearises once and solves one
    quadratic program (real-time iteration; Diehl, Bock, Schloeder 2005, SIAM J. Control Optim. 43, 1714-1736).

    Args:
        model: with its inputs declared by gt.input; these are decided. An Optimization states its own cost, a sum of
            squares, and its limits, but no instants and no free constants. The horizon is that of the second argument.
        horizon: stages, period, delay.
        tolerances: variable -> deviation that counts 1, in its SI unit, one number or one for each entry (Bryson); of
            inputs too, whose reference is the value that holds the targets.
        targets: variable -> reference, for all with a tolerance but derivatives and inputs, whose reference is zero
            or the holding value. The Riccati equation and the filter are those of rest at the targets.
        references: variables with a tolerance whose reference is given in each cycle; of an Optimization, parameters.
        limits: variable -> (low, high). Limits of inputs hold exactly, all others are soft. They add to `min`, `max`
            and the constraints of the model.
        prices: limited variable -> (linear, quadratic) price of exceeding its limit by its own size; by default
            (1000, 1000) for soft ones.
        measured: variable -> its noise, variables that the inputs do not change at once. Left out: all states.
        disturbance: input -> standard deviation of its random change in one second, in its unit. An offset of each
            input is then estimated, so that no error remains at rest (Pannocchia, Rawlings 2003, AIChE J. 49, 426-437).
        servo: the plant takes positions, and this servo makes the forces; the controller predicts with it, and returns
            the position to command. It then also returns position, speed and acceleration of the axes.
        outputs: further variables to return, at the end of the present period if no delay is declared.
        prefer, branches: as for `causal`.

    Raises ArgumentError for wrong arguments and ModelError for a model that has no closed form in these causalities.

    >>> class Cart(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     m = gt.parameter(2.0, unit="kg")
    ...     force = gt.input(unit="N", min=-2.0, max=2.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield self.m * gt.der(self.v) == self.force
    >>> law = gt.predictive.controller(
    ...     Cart(), gt.predictive.ControlHorizon(period=0.05, stages=20), tolerances={"x": 0.01, "force": 1.0},
    ...     targets={"x": 0.0}, references=["x"],
    ... )
    >>> cycle = law.begin()
    >>> cycle.step({"x": 1.0, "v": 0.0}, {"x": 0.0}).values["force"].round(3)
    array([-2.])
    """
    if not isinstance(model, Model):
        raise ArgumentError(f"expected a configured model; found {type(model).__name__}", "model")
    agree(horizon, ControlHorizon, "horizon")
    agree(measured, Mapping[str, Measurement] | None, "measured")
    agree(disturbance, Mapping[str, float] | None, "disturbance")
    agree(branches, Mapping[str, int] | None, "branches")
    for name, table in (("tolerances", tolerances), ("targets", targets), ("limits", limits), ("prices", prices)):
        agree(table, Mapping[str, Any] | None, name)
    for name, texts in (("references", references), ("outputs", outputs), ("prefer", prefer)):
        agree(texts, Sequence[str], name)
    agree(servo, AxisServo | None, "servo")
    if servo is not None:
        axes = [name for q in measured or {} for name in axis_signals(q)]
        outputs = [*outputs, *(name for name in axes if name not in outputs)]
    wishes = Wishes(
        dict(tolerances or {}), dict(targets or {}), list(references), dict(measured or {}), dict(limits or {}),
        list(outputs), list(prefer), dict(branches or {}),
    )  # fmt: skip
    reader, programs, reasons = Reader(model, wishes), list[Discretised](), list[str]()
    forms = ("inverse", "explicit") if horizon.causality == "auto" else (horizon.causality,)
    for form in forms:
        try:
            statement = reader.read(form)
        except ModelError as error:
            if form == forms[-1] and not programs:
                raise
            reasons.append(f"{form} form: {error}")
            continue
        program = Discretised(statement, horizon, wishes.measured, dict(disturbance or {}), dict(prices or {}), PRICE,
                              servo)  # fmt: skip
        programs.append(program)
        reasons.append(f"{form} form: about {program.operations} operations in a cycle of ten iterations")
    best = min(programs, key=lambda program: program.operations)
    if targets:
        _refuse_targets(best)
    return Controller(best, reasons, servo)


def _refuse_targets(program: Discretised) -> None:
    """Raise ArgumentError if rest at the targets is outside a limit."""
    s, rest = program.statement, program.standstill
    values = program.rows(rest.x, rest.w, rest.w, s.targets).full()[:, 0]
    for r, value in zip(s.rows, values, strict=True):
        if not r.low - OUTSIDE * r.size <= value <= r.high + OUTSIDE * r.size:
            raise ArgumentError(
                f"rest at the targets has {r.name} = {value:.4g}, outside its limits {r.low:g} to {r.high:g}; move the "
                "target, or the limit", "targets",
            )  # fmt: skip


@dataclass(frozen=True, eq=False)
class CycleResult:
    """Result of one cycle: status and outputs by name; `plan`: input of the stages, (stages, m).

    With another status than OK, nothing has happened, and there are no values.

    >>> class Tank(gt.Model):
    ...     level = gt.variable(unit="m")
    ...     pump = gt.input(unit="m/s", min=0.0, max=0.2)
    ...     outflow = gt.parameter(0.05, unit="m/s")
    ...     def equations(self):
    ...         yield gt.der(self.level) == self.pump - self.outflow
    >>> horizon = gt.predictive.ControlHorizon(period=0.1, stages=10)
    >>> law = gt.predictive.controller(
    ...     Tank(), horizon, tolerances={"level": 0.01, "pump": 0.1}, targets={"level": 0.5}
    ... )
    >>> law.begin().step({"level": np.nan}).status.name
    'NOT_FINITE'
    """

    status: Status
    values: dict[str, Any]
    plan: np.ndarray


class Controller(StepFunction, Portable):
    """A predictive controller as a step function: in Python, in a simulation, and in C. Made by `controller`.

    >>> class Tank(gt.Model):
    ...     level = gt.variable(unit="m")
    ...     pump = gt.input(unit="m/s", min=0.0, max=0.2)
    ...     outflow = gt.parameter(0.05, unit="m/s")
    ...     def equations(self):
    ...         yield gt.der(self.level) == self.pump - self.outflow
    >>> horizon = gt.predictive.ControlHorizon(period=0.1, stages=10)
    >>> law = gt.predictive.controller(
    ...     Tank(), horizon, tolerances={"level": 0.01, "pump": 0.1}, targets={"level": 0.5}
    ... )
    >>> [m.identifier for m in law.inputs], [m.identifier for m in law.outputs][:2]
    (['x'], ['pump_m_s', 'clipped'])
    """

    runtime = STAGE_QP

    def __init__(self, program: Discretised, reasons: Sequence[str], servo: AxisServo | None = None) -> None:
        s, horizon, qp = program.statement, program.horizon, program.qp
        self.program, self.reasons, self.period, self.servo = program, list(reasons), horizon.period, servo
        self.title = f"predictive control over {qp.count} stages of {horizon.stage:g} s, {s.causality} form"
        n, m, nd = qp.stage.states, qp.stage.inputs, program.d.numel()
        self.estimates, self.share = bool(nd), horizon.period / horizon.stage
        self.first = program.standstill.w
        self.limits = [f"{s.rows[k.row].name} {'low' if k.sign > 0 else 'high'}" for k in qp.stage.sides]
        self.sides = qp.count * qp.stage.positives + qp.last.positives
        rows = qp.count + 1 if horizon.preview else 1
        where = "of all stages, one after the other, and of the end" if horizon.preview else "of all stages"
        size = lambda k, r=1: None if k * r == 1 else k * r  # noqa: E731
        names = ", ".join(k.name for k in s.states)
        self.readings = [StepMember(k.name, size(k.size), k.unit, "reading") for k in s.sensors]
        if program.observer is None:
            self.readings = [StepMember("x", n, "?", f"state: {names}")]
        self.goals = [StepMember(f"{k.name}.goal", size(k.size, rows), k.unit, where) for k in s.references]
        self.commands = [StepMember(k.name, size(k.size), k.unit, "input of the plant") for k in s.inputs]
        self.shown = [StepMember(k.name, size(k.size), k.unit, "after this period") for k in s.shown]
        self.before = list[StepMember]()
        self.sent = list[StepMember]()
        if servo is not None:
            (q,) = self.readings
            self.before = [StepMember(f"{q.name}.before", q.size, q.unit, "position that was commanded last")]
            self.sent = [StepMember(f"{q.name}.command", q.size, q.unit, "position to command")]
        self.inputs = [*self.readings, *self.before, *self.goals]
        self.outputs = [
            *self.commands, *self.sent, *self.shown,
            StepMember("clipped", description="largest part of an input that its limit cut off"),
            StepMember("cost", description="of the plan, with prices"),
            StepMember("iterations", description=f"at most {qp.max_iterations}", integer=True),
            StepMember("residual", description="KKT residual of the program, relative to 1 + cost; -1: not finite"),
            StepMember("failed", description="cycles in a row without a solution", integer=True),
            StepMember("lost", description="cycles in a row without a usable reading", integer=True),
            *([StepMember("active", len(qp.stage.sides), description="stages of the plan at a limit: " +
                          ", ".join(self.limits), integer=True)] if qp.stage.sides else []),
        ]  # fmt: skip
        speeds = [StepMember("speeds", description="1: the servo also receives the way of its command in a period as a "
                             "speed; 0: it does not")] if servo is not None else []  # fmt: skip
        self.start = [StepMember("x", n, "?", f"state: {names}"), *speeds]
        self.defaults: Mapping[str, Any] = {"x": program.standstill.x} | {k.name: 1.0 for k in speeds}
        past = [StepMember("past", horizon.delay * m, "?", "inputs on their way")] if horizon.delay else []
        if servo is not None:
            way = [StepMember("sent", horizon.delay * m, "?", "positions commanded before")] if horizon.delay else []
            past += [*way, *speeds]
        offset = [StepMember("d", nd, "?", "disturbance")] if nd else []
        self.state = [
            StepMember("x", n, "?", "predicted for the next cycle"), *offset, *past,
            StepMember("plan_x", (qp.count + 1) * n, "?", "states of the plan"),
            StepMember("plan_v", qp.count * m, "?", "inputs of the plan"),
            StepMember("sides", max(1, self.sides), "1", "distances from the limits, and multipliers"),
            StepMember("failed", description="cycles in a row without a solution", integer=True),
            StepMember("lost", description="cycles in a row without a usable reading", integer=True),
            StepMember("begun", description="1 after the first cycle", integer=True),
        ]  # fmt: skip

    @property
    def bounds(self) -> dict[str, list[list[float | None]]]:
        """Limits of variables that are also references: lower ones and upper ones of their entries; None: no limit."""
        rows = {r.name: [b if np.isfinite(b) else None for b in (r.low, r.high)] for r in self.program.statement.rows}
        bounds = dict[str, list[list[float | None]]]()
        for k in self.program.statement.references:
            names = [k.name] if k.size == 1 else [f"{k.name}[{j}]" for j in range(k.size)]
            if set(names) & set(rows):
                bounds[k.name] = [list(side) for side in zip(*(rows.get(n, [None, None]) for n in names), strict=True)]
        return bounds

    def kernels(self, symbol: str) -> list[ca.Function]:
        """Return the generated functions under their C names."""
        return kernels_of(self, symbol)

    def text(self, symbol: str, real: Real) -> str:
        """Return the C text of init and step."""
        return text_of(self, symbol, real)

    def twin(self, real: Real = DOUBLE) -> StepTwin:
        """Return the twin in Python."""
        return CycleTwin(self, real)

    def facts(self) -> Mapping[str, Any]:
        """Return the data from which the code was generated."""
        program, horizon = self.program, self.program.horizon
        text = [f"{f} {_digest(f)}" for f in kernels_of(self, "f")]
        numbers = [float(v).hex() for v in (self.period, horizon.stage, program.qp.tolerance, *self.first)]
        return {"numbers": numbers, "stages": program.qp.count, "max_iterations": program.qp.max_iterations,
                "length_ms": 1e3 * horizon.stage, "preview": horizon.preview, "limits": self.limits,
                "causality": program.statement.causality, "delay": horizon.delay, "patience": horizon.patience,
                "spectral_radius": float(f"{self.radius():.3g}"),  # digits that do not depend on the machine
                **({"bounds": self.bounds} if self.bounds else {}),
                **({} if self.servo is None else dict(zip(("stiffness", "damping"), self._gains, strict=True))),
                "kernels": text}  # fmt: skip

    def notes(self) -> list[str]:
        """Return how it was made, its guarantees, and the meaning of its statuses."""
        program, horizon = self.program, self.program.horizon
        rows = list(zip(program.statement.rows, program.qp.stage.rows, strict=True))
        radius, under = self.radius(), "as plant" if self.servo is None else "under its servo as plant"
        hard, soft = ([r.name for r, q in rows if (q.price is None) == exact] for exact in (True, False))
        return [
            f"- stages: {self.reasons[0]}" + (f"; {'; '.join(self.reasons[1:])}" if self.reasons[1:] else ""),
            f"- always: at most {program.qp.max_iterations} iterations; the inputs within their limits",
            f"- planned within their limits, exactly in the linearised stages: {', '.join(hard) or 'nothing'}",
            f"- within their limits if the price allows it: {', '.join(soft) or 'nothing'}",
            "- not promised: stability, except near the targets with the terminal cost"
            + ("" if self.servo is None else "; a safe motion while the motors of the servo saturate"),
            f"- near the targets: the closed loop with the model {under} has a spectral radius of {radius:.3g}"
            + ("" if radius < 1 else ", so it does not settle"),
            f"- without a solution or a usable reading it follows its last plan, up to {horizon.patience} cycles in a "
            "row; then:",
            "- GT_STALE_INPUT: no usable reading",
            "- GT_NOT_CONVERGED, GT_SINGULAR: no solution of the quadratic program",
            "- GT_NOT_FINITE: a reference or the first reading is not finite, or the numbers of the program overflow",
        ]

    @property
    def _gains(self) -> list[list[float]]:
        """Stiffness and damping of the servo, one number for each axis."""
        return [] if self.servo is None else [g.tolist() for g in self.servo.gains(self.readings[0].count)]

    @cached_property
    def _closed_loop(self) -> LinearCycle:
        return LinearCycle(self.program)

    def radius(self, servo: AxisServo | None = None, *, speeds: bool | None = None) -> float:
        """Return the spectral radius of a cycle near the targets, no limit active; the loop settles if it is below 1.

        The plant is the model, which takes the inputs of the controller, or with `servo` its commands.

        Args:
            servo: of the plant; the one that the controller knows if left out.
            speeds: whether it receives speeds too, as over EGM; if None, the larger radius of both.

        Raises ArgumentError for a servo of a plant that takes the inputs of the controller.

        >>> class Cart(gt.Model):
        ...     m = gt.parameter(40.0, unit="kg")
        ...     q = gt.variable(unit="m")
        ...     tau = gt.input(unit="N")
        ...     def equations(self):
        ...         yield self.m * gt.der(self.q, 2) == self.tau
        >>> servo = gt.predictive.AxisServo(stiffness=40.0 * 200.0**2, damping=2 * 0.6 * 200.0 * 40.0)  # 200 rad/s
        >>> law = gt.predictive.controller(
        ...     Cart(), gt.predictive.ControlHorizon(period=0.004, stages=12, length=0.02, delay=2),
        ...     tolerances={"q": 0.001, "der(q)": 0.5, "tau": 200.0}, targets={"q": 0.0},
        ...     measured={"q": gt.predictive.Measurement(1e-5)}, disturbance={"tau": 100.0}, servo=servo,
        ... )
        >>> softer = gt.predictive.AxisServo(0.5 * servo.stiffness, 0.7 * servo.damping)
        >>> bool(law.radius() < 1), bool(law.radius(softer) < 1)
        (True, True)
        """
        agree(servo, AxisServo | None, "servo")
        if servo is not None and self.servo is None:
            raise ArgumentError("this controller commands no servo; give it one when it is made", "servo")
        several = (speeds,) if speeds is not None else (True, False) if self.servo else (True,)
        with naming("servo."):
            return max(self._closed_loop.radius(servo or self.servo, s) for s in several)

    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Return readings and references near the standstill, some not finite."""
        rng, complete = np.random.default_rng(seed), self.complete(DOUBLE)
        records = np.zeros(rows, dtype_of(self.inputs, real))
        for k in self.inputs:
            typical = complete[k.identifier].reshape(-1)
            spread = SPREAD * (np.abs(typical) + SPREAD)
            if k in (*self.readings, *self.before) and self.program.observer is not None:
                place = sum(r.count for r in self.readings[: self.readings.index(k)]) if k in self.readings else 0
                spread = np.minimum(spread, SPREAD * self.program.observer.jump[place : place + k.count])
            values = typical + spread * rng.normal(size=(rows, k.count))
            if k in self.readings:
                values[rng.random(rows) < MISSING, 0] = np.nan
            records[k.identifier] = real.array(values.reshape(records[k.identifier].shape))
        return records

    def complete(self, real: Real) -> np.ndarray:
        """Return the readings and references at the targets."""
        program, s = self.program, self.program.statement
        rest = program.standstill.x
        y = rest if program.observer is None else np.asarray(ca.Function("y", [s.x], [s.measured])(rest).full())[:, 0]
        rows = program.qp.count + 1 if program.horizon.preview else 1
        values, first = {}, 0
        for k in self.readings:
            values[k.name] = y[first : first + k.count].reshape(() if k.size is None else (k.size,))
            first += k.count
        values |= {k.name: values[self.readings[0].name] for k in self.before}
        first = 0
        for k in self.goals:
            own = k.count // rows
            goal = np.tile(s.targets[first : first + own], rows)
            values[k.name] = goal[0] if k.size is None else goal
            first += own
        return record(self.inputs, real, values)

    def begin(self, x: Any = None) -> ControllerRun:
        """Return a running instance in Python, from a state x, (n,) or by name; by default at rest at the targets."""
        return ControllerRun(self, self.program.standstill.x if x is None else self._state(x))

    def _state(self, x: Any) -> np.ndarray:
        """State (n,) from numbers, or from values by name. Raises ArgumentError."""
        names = [s.name for s in self.program.statement.states]
        if isinstance(x, Mapping):
            if set(x) != set(names):
                raise ArgumentError(f"expected the states {', '.join(names)}; found {', '.join(map(str, x))}", "x")
            x = [x[name] for name in names]
        state = numbers(x, "x")
        if state.shape != (len(names),) or not np.all(np.isfinite(state)):
            raise ArgumentError(f"expected {len(names)} finite numbers, for {', '.join(names)}; found {x!r}", "x")
        return state

    def converge(
        self, x: Any, goals: Mapping[str, Any] | None = None, *, d: Any = 0.0, start: ConvergedPlan | None = None,
        max_iterations: int = 200, tolerance: float = 1e-7,
    ) -> ConvergedPlan:  # fmt: skip
        """Return the optimum that the cycles approach from a state: sequential quadratic programming with line search.

        Args:
            x: state (n,), or by name.
            goals: references by variable; the targets if left out.
            d: disturbance of the inputs of the stages.
            start: a plan to begin with; by default straight from the state to rest at the targets.
            tolerance: of the last change of a state or an input, relative to 1 + its size.

        >>> class Cart(gt.Model):
        ...     x = gt.variable()
        ...     v = gt.input(min=-1.0, max=1.0)
        ...     def equations(self):
        ...         yield gt.der(self.x) == self.v
        >>> horizon = gt.predictive.ControlHorizon(period=0.1, stages=20)
        >>> law = gt.predictive.controller(Cart(), horizon, tolerances={"x": 0.1, "v": 1.0}, targets={"x": 0.0})
        >>> plan = law.converge([1.0])
        >>> plan.status.name, plan.inputs[0].round(6)
        ('OK', array([-1.]))
        """
        agree(max_iterations, Annotated[int, Within(least=1)], "max_iterations")
        agree(tolerance, Annotated[float, Within(above=0.0)], "tolerance")
        state, shift, nd = self._state(x), numbers(d, "d"), self.program.d.numel()
        if shift.shape not in ((), (nd,)) or not np.all(np.isfinite(shift)) or (nd == 0 and np.any(shift)):
            raise ArgumentError(f"expected {nd} finite numbers, one for each estimated disturbance; found {d!r}", "d")
        if start is not None and start.v.shape != (self.program.qp.count, self.program.qp.stage.inputs):
            raise ArgumentError("expected a plan of this controller; found one of another size", "start")
        shift = np.broadcast_to(shift, (nd,))
        plan = converged(self, state, goals or {}, shift, start, max_iterations, tolerance)
        p, first, beyond = self.references_of(goals or {}), 0, list[str]()
        for k in self.program.statement.references:
            values, first = p[first : first + k.size], first + k.size
            low, high = (np.array(side, float)[:, None] for side in self.bounds.get(k.name, ([None], [None])))
            if np.any((values < low) | (values > high)):
                beyond.append(
                    f"the goal of '{k.name}' is outside its limits, which the price of the limits holds it to"
                )
        return replace(plan, notes=[*plan.notes, *beyond])

    def references_of(self, goals: Mapping[str, Any]) -> np.ndarray:
        """Return the references of all stages and the end, (numbers, stages + 1), with the targets for those left out.

        Raises ArgumentError for another name, a wrong number of them, or one that is not finite.
        """
        inputs, rows = self._filled({}, goals), self.program.qp.count + 1 if self.program.horizon.preview else 1
        columns = [inputs[k.identifier].reshape(rows, -1) for k in self.goals]
        p = np.concatenate([np.zeros((rows, 0)), *columns], axis=1)
        if not np.all(np.isfinite(p)):
            raise ArgumentError("expected finite numbers", "goals")
        return np.ascontiguousarray(np.broadcast_to(p, (self.program.qp.count + 1, p.shape[1])).T)

    def _filled(self, readings: Mapping[str, Any], goals: Mapping[str, Any]) -> np.ndarray:
        """Record of inputs: given values, elsewhere those at the targets."""
        inputs, values = self.complete(DOUBLE), dict(readings)
        known = {k.name.removesuffix(".goal"): k for k in self.goals}
        for name, value in goals.items():
            if name not in known:
                raise ArgumentError(f"'{name}' is not a reference; expected {', '.join(known) or 'none'}", "goals")
            values[known[name].name] = value
        rows = self.program.qp.count + 1 if self.program.horizon.preview else 1
        for k in self.inputs:
            if k.name in values:
                array, own = numbers(values[k.name], k.name), k.count // (rows if k in self.goals else 1)
                if array.size not in (k.count, own):
                    raise ArgumentError(f"expected {k.count} numbers; found {array.size}", k.name)
                array = np.tile(array.ravel(), k.count // array.size)
                inputs[k.identifier] = array.reshape(inputs[k.identifier].shape)
        return inputs

    def block(self) -> type[SampledBlock]:
        """Return the controller as a sampled block: a class for `gt.part` of a model that `gt.simulate` runs.

        Its inputs are the measured variables, or the states, with "_" for other signs, and NAME_goal for references;
        its outputs the inputs of the plant, the further outputs as next_NAME, and failed, lost, iterations and
        clipped. The delay of the horizon is that of the block. In a cycle that ends in another status than OK, failed
        is -1 and all other outputs stay as they were: assert that it stays at least 0. Raises ArgumentError for a
        controller that commands a servo.
        """
        return block_of(self)

    def around(self, plant: Model) -> Model:
        """Return a closed loop for `gt.simulate`: the plant as part `plant`, this controller as part `law`.

        plant: the model, or another one with the same inputs and measured variables, such as one with other masses.
        References are inputs of the loop, law.NAME_goal. A cycle that ends in another status than OK ends the
        simulation as failed. For a controller with preview use `block`.

        Raises ArgumentError for a controller with preview or with a servo, and ModelError if the inputs are not the
        plant's own.
        """
        return closed_loop(self, plant)


class ControllerRun(Portable):
    """A running `Controller` in Python: the same operations as in C.

    >>> class Tank(gt.Model):
    ...     level = gt.variable(unit="m")
    ...     pump = gt.input(unit="m/s", min=0.0, max=0.2)
    ...     outflow = gt.parameter(0.05, unit="m/s")
    ...     def equations(self):
    ...         yield gt.der(self.level) == self.pump - self.outflow
    >>> horizon = gt.predictive.ControlHorizon(period=0.1, stages=10)
    >>> law = gt.predictive.controller(
    ...     Tank(), horizon, tolerances={"level": 0.01, "pump": 0.1}, targets={"level": 0.5}
    ... )
    >>> run = law.begin()
    >>> run.step({"level": 0.5}).values["pump"].round(4)  # the outflow
    array([0.05])
    """

    def __init__(self, law: Controller, x: np.ndarray) -> None:
        self.law = law
        self.state, self._sent = record(law.state, DOUBLE), dict[str, Any]()
        status = self.twin.init(self.state, record(law.start, DOUBLE, {**law.defaults, "x": x}))
        if status != Status.OK:
            raise ArgumentError("expected finite numbers", "x")

    @cached_property
    def twin(self) -> CycleTwin:
        """The operations of a cycle."""
        return CycleTwin(self.law)

    def step(self, measured: Mapping[str, Any], goals: Mapping[str, Any] | None = None) -> CycleResult:
        """Run one cycle.

        Args:
            measured: readings by variable, or all states by name.
            goals: references by variable; the targets if left out. With preview one row for each stage and the end.

        Raises ArgumentError for a missing or unknown name.
        """
        law = self.law
        names = [k.name for k in law.readings]
        if law.program.observer is None:
            names = [k.name for k in law.program.statement.states]
        for name in names:
            if name not in measured:
                raise ArgumentError(f"there is no reading of '{name}'", "measured")
        if unknown := [name for name in measured if name not in names]:
            raise ArgumentError(f"'{unknown[0]}' is not measured; expected {', '.join(names)}", "measured")
        values: dict[str, Any] = {name: numbers(measured[name], f"measured.{name}") for name in names}
        if law.program.observer is None:
            if several := [name for name in names if values[name].size != 1]:
                raise ArgumentError(f"expected 1 number; found {values[several[0]].size}", f"measured.{several[0]}")
            values = {"x": np.array([values[name].item() for name in names])}
        sent = {k.name: self._sent.get(k.name, values[names[0]]) for k in law.before}
        inputs = law._filled(values | sent, goals or {})
        outputs = record(law.outputs, DOUBLE)
        status = self.twin.step(self.state, inputs, outputs)
        values = (
            {k.name: np.array(outputs[k.identifier]).reshape(-1) for k in law.outputs} if status == Status.OK else {}
        )
        if status == Status.OK:
            self._sent = {k.name: values[s.name] for k, s in zip(law.before, law.sent, strict=True)}
        return CycleResult(status, values, self.state["plan_v"].reshape(law.program.qp.count, -1).copy())

    @property
    def disturbance(self) -> np.ndarray:
        """Estimated offset of the inputs of the stages."""
        return np.array(self.state["d"]) if self.law.estimates else np.zeros(0)


def _digest(f: ca.Function) -> str:
    """Hash of the instructions of a function, with all digits of its constants."""
    lines = [
        f"{f.instruction_id(k)} {f.instruction_input(k)} {f.instruction_output(k)} "
        + (float(f.instruction_constant(k)).hex() if f.instruction_id(k) == ca.OP_CONST else "")
        for k in range(f.n_instructions())
    ]
    return sha256("\n".join(lines).encode()).hexdigest()
