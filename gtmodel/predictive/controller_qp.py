"""A `StageQP` as a step function: solved again in every cycle, from the last solution, in C."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..cgen.real import DOUBLE, STAGE_QP, Real
from ..cgen.steps.function import StepFunction, StepMember, StepTwin, dtype_of, step_prototype
from ..results.refusal import ArgumentError
from ..results.status import Status
from .interior_point import InteriorPoint
from .qp_text import QPText, init_text
from .stage_qp import StageQP

SPREAD, MISSING = 0.1, 0.1  # of the examples: relative to the typical numbers; share with a number that is not finite


class ControllerQP(StepFunction, Portable):
    """A quadratic program over a horizon for C code in a control loop.

    Each cycle solves the problem from the measured state and the data of the cycle, starting from the last solution,
    moved on by one stage. Outputs are the first input and the plan. A cycle without a solution changes nothing: the
    caller goes on with the last plan, or stops.

    Args:
        qp: the problem; its `max_iterations` bounds the work of a cycle. In float its tolerance is at least 1e-4.
        period: of a cycle [s].
        x, data, last_data: typical arguments of `StageQP.solve`, from which the self-test is drawn.

    Raises ArgumentError if they have no solution.

    >>> import casadi as ca
    >>> x, u, none = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX(0, 1)
    >>> after = ca.vertcat(x[0] + 0.1 * x[1] + 0.005 * u, x[1] + 0.1 * u)
    >>> rows = [gt.predictive.LimitedRow(u, -1, 1)]
    >>> stage = gt.predictive.HorizonStage(x, u, none, after, ca.sumsqr(x) + 0.01 * u**2, rows)
    >>> end = gt.predictive.HorizonStage(x, None, none, None, 10 * ca.sumsqr(x))
    >>> law = gt.predictive.ControllerQP(gt.predictive.StageQP(stage, 20, end), 0.1, [1.0, 0.0])
    >>> [m.identifier for m in law.inputs], [m.identifier for m in law.outputs]
    (['x'], ['u', 'plan', 'cost', 'iterations'])
    """

    runtime = STAGE_QP

    def __init__(self, qp: StageQP, period: float, x: Any, data: Any = (), last_data: Any = ()) -> None:
        if not period > 0:
            raise ArgumentError(f"expected more than 0 s; found {period}", "period")
        solution = qp.solve(x, data, last_data)
        if solution.status != Status.OK:
            raise ArgumentError(f"expected typical arguments with a solution: {solution.status.message}", "x")
        self.qp, self.period = qp, float(period)
        self.title = f"optimal control over {qp.count} stages"
        n, m, count = qp.stage.states, qp.stage.inputs, qp.count
        numbers = np.broadcast_to(np.asarray(data, float), (count, qp.stage.numbers)).ravel()
        self._typical = {"x": np.asarray(x, float), "data": numbers, "last_data": np.asarray(last_data, float)}
        descriptions = {
            "x": (n, "measured state"),
            "data": (count * qp.stage.numbers, "of the stages, one after the other"),
            "last_data": (qp.last.numbers, "of the last stage"),
        }
        self.inputs = [StepMember(name, size, "?", text) for name, (size, text) in descriptions.items() if size]
        self.outputs = [
            StepMember("u", m, "?", "first input"),
            StepMember("plan", count * m, "?", "inputs of all stages"),
            StepMember("cost", description="with prices"),
            StepMember("iterations", description=f"at most {qp.max_iterations}", integer=True),
        ]
        self.state = [
            StepMember("plan", count * m, "?", "inputs of all stages"),
            StepMember("sides", max(1, self._sides), "1", "distances from the limits, and multipliers"),
            StepMember("begun", description="1 after the first solution", integer=True),
        ]
        self.start = []
        self.defaults: Mapping[str, Any] = {}

    @property
    def _sides(self) -> int:
        return self.qp.count * self.qp.stage.positives + self.qp.last.positives

    def kernels(self, symbol: str) -> list[ca.Function]:
        """Return the operations of a stage and of the last one under their C names."""
        return QPText(self.qp, symbol).kernels()

    def text(self, symbol: str, real: Real) -> str:
        """Return the C text of init and step."""
        qp, of = self.qp, QPText(self.qp, symbol, real)
        n, m, count, own, end = qp.stage.states, qp.stage.inputs, qp.count, of.own, of.end
        arrays, pointers = of.memory()
        known = {member.name for member in self.inputs}
        data, last_data = (f"in->{k}" if k in known else "none" for k in ("data", "last_data"))
        none = "" if {"data", "last_data"} <= known else "    const double none[1] = {0.0};\n"
        finite = " || ".join(f"(gt_stage_qp_finite({i.address('in->')}, {i.count}) == 0)" for i in self.inputs)
        moved = "".join(
            f"        gt_stage_qp_copy({to}, &state->{member}[{size if count > 1 else 0}], {(count - 1) * size});\n"
            f"        gt_stage_qp_copy(&{to}[{(count - 1) * size}], &state->{member}[{(count - 1) * size}], {size});\n"
            for to, member, size in (("u", "plan", m), ("start", "sides", own))
            if size
        )
        if end:
            moved += f"        gt_stage_qp_copy(&start[{count * own}], &state->sides[{count * own}], {end});\n"
        return (
            f"{of.table()}{init_text(symbol)}"
            f"{step_prototype(symbol)}\n{{\n    gt_stage_qp_work work;\n    gt_stage_qp_call call;\n"
            f"    gt_stage_qp_outcome found;\n    gt_status status;\n{none}"
            f"    double start[{max(1, of.sides)}];\n{arrays}    int k;\n\n"
            f"    if ({finite}) {{\n        return GT_NOT_FINITE;\n    }}\n{pointers}    call.f = &{symbol}_qp;\n"
            f"    call.data = {data};\n    call.last_data = {last_data};\n    call.w = &work;\n"
            f"    gt_stage_qp_copy(x, in->x, {n});\n    if (state->begun != 0) {{\n{moved}    }} else {{\n"
            f"        for (k = 0; k < {count * m}; k++) {{\n            u[k] = 0.0;\n        }}\n    }}\n"
            "    status = gt_stage_qp_solve(&call, (state->begun != 0) ? start : 0, &found);\n"
            "    if (status == GT_OK) {\n"
            f"        gt_stage_qp_copy(out->u, u, {m});\n        gt_stage_qp_copy(out->plan, u, {count * m});\n"
            "        out->cost = found.cost;\n        out->iterations = found.iterations;\n"
            f"        gt_stage_qp_copy(state->plan, u, {count * m});\n"
            f"        gt_stage_qp_copy(state->sides, sides, {of.sides});\n"
            "        state->begun = 1;\n    }\n    return status;\n}\n\n"
        )

    def twin(self, real: Real = DOUBLE) -> StepTwin:
        """Return the twin in Python."""
        return ControllerQPTwin(self, real)

    def facts(self) -> Mapping[str, Any]:
        """Return the data from which the code was generated."""
        qp = self.qp
        text = [str(f[k]) for f in qp.kernels for k in f]
        numbers = [float(v).hex() for v in (self.period, qp.tolerance)]
        sides = [[str(d.bound), d.sign, d.row, d.price] for s in (qp.stage, qp.last) for d in s.sides]
        matrices = [str(v) for s in (qp.stage, qp.last) for v in s.matrices.values()]
        return {"numbers": numbers, "count": qp.count, "iterations": qp.max_iterations, "kernels": text,
                "sides": sides, "matrices": matrices}  # fmt: skip

    def notes(self) -> list[str]:
        """Return the meaning of its statuses."""
        return [
            "- GT_NOT_FINITE: an input is not finite, or a number became so on the way",
            f"- GT_NOT_CONVERGED: no solution within {self.qp.max_iterations} iterations; the exact limits may exclude "
            "each other",
            "- GT_SINGULAR: the cost is not strictly convex in an input, or the exact limits exclude each other",
        ]

    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Return arguments near the typical ones, some not finite."""
        rng = np.random.default_rng(seed)
        records = np.zeros(rows, dtype_of(self.inputs, real))
        for member in self.inputs:
            typical = self._typical[member.name]
            values = typical + SPREAD * (np.abs(typical) + SPREAD) * rng.normal(size=(rows, member.count))
            values[rng.random(rows) < MISSING, 0] = np.nan
            records[member.identifier] = real.array(values)
        return records

    def complete(self, real: Real) -> np.ndarray:
        """Return the typical arguments."""
        row = np.zeros((), dtype_of(self.inputs, real))
        for member in self.inputs:
            row[member.identifier] = real.array(self._typical[member.name])
        return row


class ControllerQPTwin(StepTwin):
    """A `ControllerQP` in Python: takes and returns records with the same bytes as C."""

    def __init__(self, controller: ControllerQP, real: Real) -> None:
        qp = controller.qp
        self.controller, self.real = controller, real
        self.method = InteriorPoint(
            qp.stage, qp.count, qp.last, qp.tolerance_in(real), qp.max_iterations, qp.kernels, real
        )

    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """Empty the state."""
        state[...] = np.zeros((), state.dtype)
        return Status.OK

    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """Run one cycle."""
        controller, qp = self.controller, self.controller.qp
        own, count = qp.stage.positives, qp.count
        known = [m.name for m in controller.inputs]
        x, data, last = (
            inputs[k].reshape(-1) if k in known else np.zeros(0, self.real.dtype) for k in ("x", "data", "last_data")
        )
        if not all(np.all(np.isfinite(v)) for v in (x, data, last)):
            return Status.NOT_FINITE
        at = None
        if state["begun"]:
            plan = state["plan"].reshape(count, -1)
            sides = state["sides"][: count * own].reshape(count, own)
            end = state["sides"][count * own : controller._sides].reshape(-1, 1)
            at = (np.vstack([plan[1:], plan[-1:]]).T, np.vstack([sides[1:], sides[-1:]]).T, end)
        o = self.method.solve(x, data.reshape(count, -1).T, last.reshape(-1, 1), at)
        if o.status != Status.OK:
            return o.status
        plan = o.u.T.ravel()
        outputs["u"], outputs["plan"], outputs["cost"] = plan[: qp.stage.inputs], plan, o.cost
        outputs["iterations"] = o.iterations
        state["plan"], state["begun"] = plan, 1
        if controller._sides:
            state["sides"] = np.concatenate([o.sides.T.ravel(), o.last_sides.ravel()])
        return Status.OK
