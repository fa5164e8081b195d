"""The law "predictive" in Python: an optimum over a horizon, solved anew in every cycle of the loop."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .._lazy import hint
from ..cgen.real import DOUBLE
from ..cgen.steps.function import record
from ..results.refusal import ArgumentError
from ..results.status import Status
from .exchange import AXES, Command, RobotFeedback
from .laws import ReferenceTable

if TYPE_CHECKING:
    from ..predictive.controller import Controller
else:
    Controller = hint("gtmodel.predictive.controller", "Controller")

# since the start: cycles without a solution, without a usable reading; rows of goals that could not be used; cycles of
# the robot that the loop did not go through
PLAN_COUNTERS = ("plan_failed", "plan_lost", "plan_refused", "plan_skipped")
# of a record, after its own: GT_PLAN_* of gt_law.h
PLAN_COLUMNS = (
    *("iterations", "cost", "kkt_residual", "active", *PLAN_COUNTERS),
    *(f"predicted[{n}]" for n in range(AXES)),
    *(f"force[{n}]" for n in range(AXES)),
)
ITERATIONS, COST, RESIDUAL, ACTIVE, FAILED, LOST, REFUSED, SKIPPED, PREDICTED = range(9)
FORCE = PREDICTED + AXES


@dataclass
class PredictiveLaw:
    """Law that follows the plan of a predictive controller, which reads the positions of the axes.

    controller: measures one variable q, and commands a servo, which makes the forces tau. goals: a row holds the
    references of one stage. sends_speed: the servo also receives speeds. `numbers` stand in the log; the C version is
    gt_law_predictive.h.

    Raises ArgumentError for another controller.
    """

    reads_wrenches: ClassVar[bool] = False
    controller: Controller
    goals: ReferenceTable
    axes: int
    sends_speed: bool
    cycle_ms: int
    hold_cycles: int
    numbers: list[float] = field(default_factory=lambda: [0.0] * len(PLAN_COLUMNS))

    def __post_init__(self) -> None:
        law = self.controller
        first = law.readings[0].name
        names = {
            "command": f"{first}.command",
            "position": first,
            "speed": f"der({first})",
            "force": f"{first[:-1]}tau",
        }
        given = {k.name: k.identifier for k in law.outputs}
        missing = [name for name in names.values() if name not in given]
        if len(law.readings) != 1 or law.readings[0].count != self.axes or missing:
            raise ArgumentError(
                f"expected a controller that measures {self.axes} positions, commands a servo, and returns "
                f"{', '.join(missing)} too", "controller",
            )  # fmt: skip
        self._names = {key: given[name] for key, name in names.items()}
        horizon = law.program.horizon
        self._rows = horizon.stages + 1 if horizon.preview else 1
        self._stage_ms, self._delay = round(1e3 * horizon.stage), horizon.delay
        self._twin, self._state = law.twin(DOUBLE), record(law.state, DOUBLE)
        self._goal = np.zeros((self._rows, 0))

    def init(self, first: RobotFeedback) -> Status:
        if self.goals.rows.shape[1] != sum(k.count for k in self.controller.goals) // self._rows:
            return Status.OUT_OF_RANGE
        self._done, self._refused, self._over = 0, 0, Status.OK
        self._predicted = [list(first.position_m) for _ in range(self._delay + 1)]
        start = {**self.controller.defaults, "speeds": float(self.sends_speed)}
        return self._twin.init(self._state, record(self.controller.start, DOUBLE, start))

    def step(self, feedback: RobotFeedback, elapsed_ms: int, command: Command) -> Status:
        now, status = elapsed_ms // self.cycle_ms, Status.OK
        while self._done < now and status is Status.OK:  # cycles of the robot that the loop did not go through
            status = self._run(None, command.copy())
            self.numbers[SKIPPED] += 1.0
        if status is Status.OK:
            status = self._run(feedback.position_m[: self.axes], command)
        self._over = status
        if status is Status.OK:
            self._done = now + 1
        return status

    def go_on(self, command: Command) -> Status:
        """Write the command of the plan in a cycle that brought nothing to answer; return OK, or why there is none."""
        return self._run(None, command) if self._over is Status.OK else self._over

    def _goals(self) -> Status:
        now_ms, ahead_ms = self._done * self.cycle_ms, self._delay * self.cycle_ms
        rows, status = list[list[float]](), Status.OK
        for k in range(self._rows):
            stage_ms = ahead_ms + k * self._stage_ms if self._rows > 1 else 0
            status, row = self.goals.at(now_ms + stage_ms)
            if status is not Status.OK:
                break
            rows.append(row)
        if status is Status.OK:
            self._refused, self._goal = 0, np.array(rows)
            return status
        self._refused += 1
        self.numbers[REFUSED] += 1.0
        return Status.OK if self._done and self._refused <= self.hold_cycles else status

    def _run(self, position_m: list[float] | None, command: Command) -> Status:
        """One cycle of the plan; it writes the command only with OK."""
        law, numbers = self.controller, self.numbers
        slot = self._done % (self._delay + 1)
        numbers[PREDICTED : PREDICTED + AXES] = self._predicted[slot]
        status = self._goals()
        if status is not Status.OK:
            return status
        inputs, outputs, place = record(law.inputs, DOUBLE), record(law.outputs, DOUBLE), 0
        reading = np.full(self.axes, np.nan) if position_m is None else np.array(position_m)
        for k, values in ((law.readings[0], reading), (law.before[0], np.array(command.position_m[: self.axes]))):
            inputs[k.identifier] = values.reshape(inputs[k.identifier].shape)
        for k in law.goals:
            own = k.count // self._rows
            values = self._goal[:, place : place + own]
            inputs[k.identifier] = values.reshape(inputs[k.identifier].shape)
            place += own
        status = self._twin.step(self._state, inputs, outputs)
        if status is not Status.OK:
            numbers[LOST if status is Status.STALE_INPUT else FAILED] += 1.0
            return status
        active = np.asarray(outputs["active"]) if law.limits else []
        numbers[: ACTIVE + 1] = [float(outputs["iterations"]), float(outputs["cost"]), float(outputs["residual"]),
                                 float(sum(2.0**k for k, n in enumerate(active) if n > 0))]  # fmt: skip
        numbers[FAILED] += float(outputs["failed"] > 0)
        numbers[LOST] += float(outputs["lost"] > 0)
        cycle = {key: np.reshape(outputs[name], -1).tolist() for key, name in self._names.items()}
        numbers[FORCE : FORCE + self.axes] = cycle["force"]
        self._predicted[slot][: self.axes] = cycle["position"]
        command.along_path = False
        command.position_m[: self.axes], command.speed_m_s[: self.axes] = cycle["command"], cycle["speed"]
        self._done += 1
        return Status.OK
