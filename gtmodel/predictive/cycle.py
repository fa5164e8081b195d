"""One cycle of a predictive controller, in Python and as C text: both do the same operations in the same order.

1. The reading corrects the predicted state and the disturbance; a reading that is not finite or jumps is left out. In
   the first cycle, the state of the start is moved to the reading before.
2. The state is predicted over the delay, with the inputs on their way.
3. The last plan is moved on by one period, and the stages are linearised there.
4. One quadratic program is solved, from the last solution. Without a solution the plan stays as moved, and the next
   cycle begins without it.
5. The first input of the plan, within its limits, is the output.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .._lazy import hint
from ..cgen.newton_steps import run
from ..cgen.real import DOUBLE, Real, decimal
from ..cgen.steps.function import StepTwin, step_prototype
from ..results.status import Status
from .interior_point import InteriorPoint, LastIterate
from .qp_text import QPText, called, init_text
from .stage_qp import StageQP

if TYPE_CHECKING:
    from .controller import Controller
else:
    Controller = hint("gtmodel.predictive.controller", "Controller")

LOCATING = 8  # steps from the start to the first reading
PARTS = ("advance", "locate", "correct", "prepare", "finish", "command")


class CycleTwin(StepTwin):
    """A `Controller` in Python: takes and returns records with the same bytes as C."""

    def __init__(self, controller: Controller, real: Real = DOUBLE) -> None:
        self.controller, self.real, program = controller, real, controller.program
        qp = program.qp
        self.method = InteriorPoint(
            qp.stage, qp.count, qp.last, qp.tolerance_in(real), qp.max_iterations, qp.kernels, real
        )
        self.functions = {name: getattr(program, name) for name in PARTS}
        self._prepare = program.prepare.map(qp.count)

    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """Empty the state, and begin at the state of the start."""
        if not all(np.all(np.isfinite(start[k.identifier])) for k in self.controller.start):
            return Status.NOT_FINITE
        state[...] = np.zeros((), state.dtype)
        for k in self.controller.start:
            state[k.identifier] = start[k.identifier]
        return Status.OK

    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """Run one cycle."""
        with np.errstate(all="ignore"):
            return self._step(state, inputs, outputs)

    def _step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        c, program, real = self.controller, self.controller.program, self.real
        qp, horizon, nothing = program.qp, program.horizon, np.zeros(0, real.dtype)
        n, m, count, begun = qp.stage.states, qp.stage.inputs, qp.count, bool(state["begun"])
        y = np.concatenate([nothing, *[inputs[k.identifier].reshape(-1) for k in c.readings]])
        rows = count + 1 if horizon.preview else 1
        goals = [inputs[k.identifier].reshape(rows, -1) for k in c.goals]
        p = np.concatenate([np.zeros((rows, 0), real.dtype), *goals], axis=1)
        if not np.all(np.isfinite(p)):
            return Status.NOT_FINITE
        p = np.broadcast_to(p, (count + 1, p.shape[1])).T
        way, speeds = list[np.ndarray](), list[Any]()
        for k in c.before:
            last = inputs[k.identifier].reshape(-1)
            if not np.all(np.isfinite(last)):
                return Status.NOT_FINITE
            earlier = state["sent"].reshape(-1, m) if begun and horizon.delay else [last] * horizon.delay
            way, speeds = [*earlier, last], [state["speeds"]]
        # 1
        before, d = state["x"], state["d"] if c.estimates else nothing
        if not begun:
            for _ in range(LOCATING):
                before = self._call("locate", before, y)[0]
        near, *innovations = self._call("locate", before, y)
        hat, d_hat, far = self._call("correct", before if c.estimates else near, d, *innovations)
        lost = 0
        if not (np.all(np.isfinite(y)) and far[0] <= 1 and np.all(np.isfinite(np.concatenate([hat, d_hat])))):
            hat, d_hat, lost = before, d, int(state["lost"]) + 1
            if not begun:
                return Status.NOT_FINITE
            if lost > horizon.patience:
                return Status.STALE_INPUT
        # 2
        x, past = hat, state["past"].reshape(-1, m) if horizon.delay else np.zeros((0, m), real.dtype)
        for k, v in enumerate(past):
            (x,) = self._call("advance", x, v, d_hat, p[:, 0], *_pair(way, k), *speeds)
        # 3
        if begun:
            plan = (state["plan_x"].reshape(-1, n).T, state["plan_v"].reshape(-1, m).T)
            all_sides = state["sides"][: c.sides]
            sides = all_sides[: count * qp.stage.positives].reshape(count, -1).T
            share = real.dtype(c.share)
            moved = [a[:, :-1] + share * (a[:, 1:] - a[:, :-1]) for a in (*plan, sides)]
            plan_x, plan_v, sides = (
                np.column_stack([b, a[:, -1:]]) for a, b in zip((*plan, sides), moved, strict=True)
            )
            end = all_sides[count * qp.stage.positives :].reshape(-1, 1)
            start = None if state["failed"] else (np.zeros_like(plan_v), sides, end)
        else:
            plan_x = np.repeat(x[:, None], count + 1, axis=1)
            plan_v, start = np.repeat(real.array(c.first)[:, None], count, axis=1), None
            sides, end = np.zeros((0, count)), np.zeros((0, 1))
        data = self._prepared(plan_x, plan_v, d_hat, p[:, :-1])
        (last,) = self._call("finish", plan_x[:, -1], d_hat, p[:, -1])
        # 4
        o = self.method.solve(x - plan_x[:, 0], data, last.reshape(-1, 1), start)
        failed = 0
        if o.status == Status.OK:
            plan_x, plan_v, sides, end = plan_x + o.x, plan_v + o.u, o.sides, o.last_sides
        else:
            failed = int(state["failed"]) + 1
            if not begun or failed > horizon.patience:
                return o.status
        # 5
        forces, clipped, shown, *sent = self._call("command", x, plan_v[:, 0], d_hat, p[:, 0], *way[-1:], *speeds)
        now, way = past[0] if horizon.delay else plan_v[:, 0], way + sent
        (after,) = self._call("advance", hat, now, d_hat, p[:, 0], *_pair(way, 0), *speeds)
        if not np.all(np.isfinite(np.concatenate([forces, clipped, shown, *sent, after]))):
            return Status.NOT_FINITE
        for member, values in ((c.commands, forces), (c.sent, sent[0] if sent else nothing), (c.shown, shown)):
            first = 0
            for k in member:
                outputs[k.identifier] = values[first : first + k.count].reshape(outputs[k.identifier].shape)
                first += k.count
        outputs["clipped"], outputs["cost"], outputs["iterations"] = clipped[0], o.cost, o.iterations
        if not np.isfinite(o.cost):
            outputs["cost"] = 0.0
        outputs["residual"] = self._residual(o)
        outputs["failed"], outputs["lost"] = failed, lost
        if limits := len(qp.stage.sides):
            outputs["active"] = np.count_nonzero(sides[limits : 2 * limits] > sides[:limits], axis=1)
        state["x"], state["lost"], state["failed"], state["begun"] = after, lost, failed, 1
        if c.estimates:
            state["d"] = d_hat
        if horizon.delay:
            state["past"] = np.concatenate([past[1:].ravel(), plan_v[:, 0]])
            if way:
                state["sent"] = np.concatenate(way[1:-1])
        state["plan_x"], state["plan_v"] = plan_x.T.ravel(), plan_v.T.ravel()
        if c.sides:
            state["sides"] = np.concatenate([sides.T.ravel(), np.ravel(end)])
        return Status.OK

    def _residual(self, o: LastIterate) -> Any:
        gap, residual, gradient, cost = (self.real.dtype(v) for v in (o.gap, o.residual, o.gradient, o.cost))
        if not np.all(np.isfinite([gap, residual, gradient, cost])):
            return -1.0
        size = self.real.dtype(1.0) + abs(cost)
        return max(residual, gap / size, gradient / size)

    def _call(self, name: str, *arguments: np.ndarray) -> list[np.ndarray]:
        f = self.functions[name]
        if self.real is DOUBLE:
            return [r.full()[:, 0] for r in f.call([np.asarray(a) for a in arguments])]
        return [r[:, 0] for r in run(f, [np.reshape(a, (-1, 1)) for a in arguments])]

    def _prepared(self, x: Any, v: Any, d: np.ndarray, p: Any) -> np.ndarray:
        wide = [x[:, :-1], v, np.repeat(d[:, None], v.shape[1], axis=1), p, x[:, 1:]]
        if self.real is DOUBLE:
            return np.asarray(self._prepare.call(wide)[0].full())
        return run(self.functions["prepare"], wide)[0]


def _pair(way: list[np.ndarray], k: int) -> list[np.ndarray]:
    """The position commanded before cycle k, and that of the cycle; nothing without a servo."""
    return [np.concatenate(way[k : k + 2])] if way else []


def kernels_of(controller: Controller, symbol: str) -> list[ca.Function]:
    """Return the generated functions under their C names."""
    program = controller.program
    own = [called(getattr(program, name), f"{symbol}_{name}") for name in PARTS]
    return [*own, *QPText(program.qp, symbol).kernels()]


def _gathered(members: Any, target: str, struct: str = "in->") -> str:
    lines, first = [], 0
    for k in members:
        lines.append(f"    gt_stage_qp_copy(&{target}[{first}], {k.address(struct)}, {k.count});\n")
        first += k.count
    return "".join(lines)


def _goals(controller: Controller, rows: int) -> str:
    """References, one row for each stage."""
    lines, first, size = [], 0, controller.program.statement.p.numel()
    for k in controller.goals:
        own = k.count // rows
        at = f"&{k.address('in->')}[k * {own}]" if k.size is not None else k.address("in->")
        lines.append(f"        gt_stage_qp_copy(&p[(k * {size}) + {first}], {at}, {own});\n")
        first += own
    return f"    for (k = 0; k < {rows}; k++) {{\n{''.join(lines)}    }}\n" if lines else ""


def text_of(controller: Controller, symbol: str, real: Real) -> str:
    """Return the C text of init and step."""
    c, program = controller, controller.program
    qp, horizon, of = program.qp, program.horizon, QPText(program.qp, symbol, real)
    n, m, count, delay = qp.stage.states, qp.stage.inputs, qp.count, horizon.delay
    nd, np_, ny = program.d.numel(), program.statement.p.numel(), sum(k.count for k in c.readings)
    forces, shown = sum(k.count for k in c.commands), sum(k.count for k in c.shown)
    rows = count + 1 if horizon.preview else 1
    arrays, pointers = of.memory()
    own = of.own
    numbers = {
        "reading": ny, "innovation": ny, "own": ny, "near": n, "p": rows * np_, "hat": n, "ahead": n, "d": nd,
        "next": n, "plan_x": (count + 1) * n,
        "plan_v": count * m, "start": of.sides, "data": count * qp.stage.numbers, "last_data": qp.last.numbers,
        "command": forces, "shown": shown, **({"sent": (delay + 2) * m} if c.before else {}),
    }  # fmt: skip
    # an array of nothing is initialised: its address is passed on
    locals_ = "".join(
        f"    double {k}[{size}];\n" if size else f"    double {k}[1] = {{0.0}};\n" for k, size in numbers.items()
    )
    first = ", ".join(decimal(v) for v in c.first)
    at = f"&p[k * {np_}]" if horizon.preview else "p"
    end = f"&p[{count * np_}]" if horizon.preview else "p"

    def moved(target: str, member: str, size: int, rows: int) -> str:
        if not size:
            return ""
        return (
            f"        for (k = 0; k < {(rows - 1) * size}; k++) {{\n"
            f"            {target}[k] = state->{member}[k] + ({decimal(c.share)} * (state->{member}[k + {size}] - "
            f"state->{member}[k]));\n        }}\n"
            f"        gt_stage_qp_copy(&{target}[{(rows - 1) * size}], "
            f"&state->{member}[{(rows - 1) * size}], {size});\n"
        )

    def call(name: str, arguments: list[str], results: list[str], indent: str = "    ") -> str:
        lines = [f"{indent}arg[{k}] = {a};\n" for k, a in enumerate(arguments)]
        lines += [f"{indent}res[{k}] = {r};\n" for k, r in enumerate(results)]
        return "".join(lines) + f"{indent}(void){symbol}_{name}(arg, res, 0, 0, 0);\n"

    shift = (
        moved("plan_x", "plan_x", n, count + 1)
        + moved("plan_v", "plan_v", m, count)
        + moved("start", "sides", own, count)
    )
    if of.end:
        shift += f"        gt_stage_qp_copy(&start[{count * own}], &state->sides[{count * own}], {of.end});\n"
    old_d, commands = "state->d" if nd else "d", len(c.before)  # 1 or 0
    pair = [["sent", "&state->speeds"], [f"&sent[k * {m}]", "&state->speeds"]] if commands else [[], []]
    last = [f"&sent[{delay * m}]", "&state->speeds"][: 2 * commands]
    new = [f"&sent[{(delay + 1) * m}]"][:commands]
    now = "state->past" if delay else "plan_v"
    late = (
        f"    for (k = 0; k < {delay}; k++) {{\n"
        + call("advance", ["ahead", f"&state->past[k * {m}]", "d", "p", *pair[1]], ["next"], "        ")
        + f"        gt_stage_qp_copy(ahead, next, {n});\n    }}\n"
        if delay
        else ""
    )
    queue = (
        f"    for (k = 0; k < {(delay - 1) * m}; k++) {{\n        state->past[k] = state->past[k + {m}];\n    }}\n"
        f"    gt_stage_qp_copy(&state->past[{(delay - 1) * m}], plan_v, {m});\n"
        + (f"    gt_stage_qp_copy(state->sent, &sent[{m}], {delay * m});\n" if commands else "")
        if delay
        else ""
    )
    planned = [f"&plan_x[k * {n}]", f"&plan_v[k * {m}]", "d", at, f"&plan_x[(k + 1) * {n}]"]
    prepared = call("prepare", planned, [f"&data[k * {qp.stage.numbers}]"], "        ")
    start_finite = "".join(
        f"    if (gt_stage_qp_finite({k.address('start->')}, {k.count}) == 0) {{\n"
        "        return GT_NOT_FINITE;\n    }\n"
        for k in c.start
    )
    started = "".join(
        f"    gt_stage_qp_copy({k.address('state->')}, {k.address('start->')}, {k.count});\n" for k in c.start
    )
    earlier = "".join(
        f"    gt_stage_qp_copy(&sent[{delay * m}], {k.address('in->')}, {m});\n"
        f"    if (gt_stage_qp_finite(&sent[{delay * m}], {m}) == 0) {{\n        return GT_NOT_FINITE;\n    }}\n"
        + (f"    for (k = 0; k < {delay}; k++) {{\n"
           f"        gt_stage_qp_copy(&sent[k * {m}], "
           f"(state->begun != 0) ? &state->sent[k * {m}] : &sent[{delay * m}], {m});\n"
           "    }\n" if delay else "")
        for k in c.before
    )  # fmt: skip
    return (
        f"{of.table()}{init_text(symbol, started, start_finite)}"
        f"{step_prototype(symbol)}\n{{\n    static const double first[{m}] = {{{first}}};\n"
        "    gt_stage_qp_work work;\n    gt_stage_qp_call call;\n    gt_stage_qp_outcome found;\n"
        f"    gt_status status;\n    const double *arg[{5 + commands}];\n    double *res[{3 + commands}];\n"
        "    double far = 0.0;\n"
        f"    double clipped = 0.0;\n    int lost = 0;\n    int failed = 0;\n"
        f"    int k;\n{'    int j;' + chr(10) if qp.stage.sides else ''}{locals_}{arrays}\n"
        f"{_gathered(c.readings, 'reading')}{_goals(c, rows)}"
        f"    if (gt_stage_qp_finite(p, {rows * np_}) == 0) {{\n        return GT_NOT_FINITE;\n    }}\n"
        f"{earlier}    /* the reading */\n"
        f"    gt_stage_qp_copy(d, {old_d}, {nd});\n"
        + f"    gt_stage_qp_copy(next, state->x, {n});\n    if (state->begun == 0) {{\n"
        f"        for (k = 0; k < {LOCATING}; k++) {{\n"
        + call("locate", ["next", "reading"], ["hat", "innovation", "own"], "            ")
        + f"            gt_stage_qp_copy(next, hat, {n});\n        }}\n    }}\n"
        + call("locate", ["next", "reading"], ["near", "innovation", "own"])
        + call("correct", ["next" if nd else "near", old_d, "innovation", "own"], ["hat", "d", "&far"])
        + f"    if ((gt_stage_qp_finite(reading, {ny}) == 0) || !(far <= 1.0) || (gt_stage_qp_finite(hat, {n}) == 0)\n"
        f"        || (gt_stage_qp_finite(d, {nd}) == 0)) {{\n"
        f"        gt_stage_qp_copy(hat, next, {n});\n        gt_stage_qp_copy(d, {old_d}, {nd});\n"
        "        lost = state->lost + 1;\n"
        "        if (state->begun == 0) {\n            return GT_NOT_FINITE;\n        }\n"
        f"        if (lost > {horizon.patience}) {{\n            return GT_STALE_INPUT;\n        }}\n    }}\n"
        f"    /* the delay */\n    gt_stage_qp_copy(ahead, hat, {n});\n{late}"
        f"    /* the last plan, moved on */\n    if (state->begun != 0) {{\n{shift}    }} else {{\n"
        f"        for (k = 0; k <= {count}; k++) {{\n"
        f"            gt_stage_qp_copy(&plan_x[k * {n}], ahead, {n});\n        }}\n"
        f"        for (k = 0; k < {count}; k++) {{\n"
        f"            gt_stage_qp_copy(&plan_v[k * {m}], first, {m});\n        }}\n"
        f"    }}\n    for (k = 0; k < {count}; k++) {{\n"
        + prepared
        + "    }\n"
        + call("finish", [f"&plan_x[{count * n}]", "d", end], ["last_data"])
        + f"    /* the program */\n{pointers}    call.f = &{symbol}_qp;\n    call.data = data;\n"
        f"    call.last_data = last_data;\n    call.w = &work;\n    for (k = 0; k < {n}; k++) {{\n"
        f"        x[k] = ahead[k] - plan_x[k];\n    }}\n    for (k = 0; k < {count * m}; k++) {{\n"
        "        u[k] = 0.0;\n    }\n"
        "    status = gt_stage_qp_solve(&call, ((state->begun != 0) && (state->failed == 0)) ? start : 0, &found);\n"
        "    if (status == GT_OK) {\n"
        f"        for (k = 0; k < {(count + 1) * n}; k++) {{\n            plan_x[k] += x[k];\n        }}\n"
        f"        for (k = 0; k < {count * m}; k++) {{\n            plan_v[k] += u[k];\n        }}\n"
        f"        gt_stage_qp_copy(start, sides, {of.sides});\n    }} else {{\n        failed = state->failed + 1;\n"
        f"        if ((state->begun == 0) || (failed > {horizon.patience})) {{\n"
        "            return status;\n        }\n"
        "    }\n    /* the output */\n"
        + call("command", ["ahead", "plan_v", "d", "p", *last], ["command", "&clipped", "shown", *new])
        + call("advance", ["hat", now, "d", "p", *pair[0]], ["next"])
        + f"    if ((gt_stage_qp_finite(command, {forces}) == 0) || (gt_stage_qp_finite(&clipped, 1) == 0)\n"
        f"        || (gt_stage_qp_finite(shown, {shown}) == 0) || (gt_stage_qp_finite(next, {n}) == 0)"
        + "".join(f"\n        || (gt_stage_qp_finite({a}, {m}) == 0)" for a in new) + ") {\n"
        "        return GT_NOT_FINITE;\n    }\n"
        + _scattered(c.commands, "command") + _scattered(c.sent, "sent", (delay + 1) * m) + _scattered(c.shown, "shown")
        + "    out->clipped = clipped;\n    out->cost = (gt_stage_qp_finite(&found.cost, 1) != 0) ? found.cost : 0.0;\n"
        "    out->iterations = found.iterations;\n    out->failed = failed;\n    out->lost = lost;\n"
        + _diagnostics(qp, own)
        + f"    gt_stage_qp_copy(state->x, next, {n});\n{queue}    state->lost = lost;\n    state->failed = failed;\n"
        "    state->begun = 1;\n"
        + (f"    gt_stage_qp_copy(state->d, d, {nd});\n" if nd else "")
        + f"    gt_stage_qp_copy(state->plan_x, plan_x, {(count + 1) * n});\n"
        f"    gt_stage_qp_copy(state->plan_v, plan_v, {count * m});\n"
        + (f"    gt_stage_qp_copy(state->sides, start, {of.sides});\n" if of.sides else "")
        + "    return GT_OK;\n}\n\n"
    )  # fmt: skip


def _diagnostics(qp: StageQP, own: int) -> str:
    """Residual of the program; stages in which a limit is active: its multiplier is larger than the distance."""
    limits = len(qp.stage.sides)
    text = (
        "    out->residual = -1.0;\n"
        "    if ((gt_stage_qp_finite(&found.gap, 1) != 0) && (gt_stage_qp_finite(&found.residual, 1) != 0)\n"
        "        && (gt_stage_qp_finite(&found.gradient, 1) != 0) && (gt_stage_qp_finite(&found.cost, 1) != 0)) {\n"
        "        const double size = 1.0 + ((found.cost < 0.0) ? -found.cost : found.cost);\n\n"
        "        out->residual = found.residual;\n"
        "        out->residual = ((found.gap / size) > out->residual) ? (found.gap / size) : out->residual;\n"
        "        out->residual = ((found.gradient / size) > out->residual) ? (found.gradient / size) : out->residual;\n"
        "    }\n"
    )
    if not limits:
        return text
    at = f"start[(k * {own}) + j"
    return text + (
        f"    for (j = 0; j < {limits}; j++) {{\n        out->active[j] = 0;\n"
        f"        for (k = 0; k < {qp.count}; k++) {{\n"
        f"            out->active[j] += ({at} + {limits}] > {at}]) ? 1 : 0;\n        }}\n    }}\n"
    )


def _scattered(members: Any, source: str, first: int = 0) -> str:
    lines = []
    for k in members:
        lines.append(f"    gt_stage_qp_copy({k.address('out->')}, &{source}[{first}], {k.count});\n")
        first += k.count
    return "".join(lines)
