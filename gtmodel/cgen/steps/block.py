"""A sampled block as a step function: its `step` is traced once with symbols, and the trace is written in C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ..._pickling import Portable
from ...compiler.analysis.events import BlockSignal, FlatBlock, block_numbers
from ...compiler.flat_cache import flat_of
from ...lang.model import Model
from ...results.status import Status
from ..newton_steps import run
from ..real import DOUBLE, GenerationError, Real
from .function import StepFunction, StepMember, StepTwin, dtype_of, step_prototype

POINTS = 20  # random points at which the trace is compared with `step`
SAME = 1e-12
LARGEST = 3.0  # standard deviation of the numbers of these points, and of examples


class BlockFunction(StepFunction, Portable):
    """A `gt.SampledBlock` of a model as a step function in C.

    Its `step` is traced with CasADi symbols, so it must not branch on a number, and its functions must accept symbols,
    as NumPy's elementary functions do. The loop that calls the function must realise the delay of the outputs.

    Args:
        model: the model that holds the block, with its parameters.
        name: of the block in the model, such as "law".

    Raises GenerationError if there is no such block, or if its step cannot be traced.

    >>> class PI(gt.SampledBlock):
    ...     kp = gt.parameter(4.0, unit="1/s")
    ...     ki = gt.parameter(2.0, unit="1/s2")
    ...     error = gt.input(unit="m")
    ...     integral = gt.discrete(0.0, unit="m.s")
    ...     speed = gt.output(unit="m/s")
    ...     def step(self, inputs, state):
    ...         integral = state.integral + self.period * inputs.error
    ...         return {"speed": self.kp * inputs.error + self.ki * integral, "integral": integral}
    >>> class Loop(gt.Model):
    ...     x = gt.variable(unit="m", start=0.0, fixed=True)
    ...     law = gt.part(PI, period=0.004)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.law.speed
    ...         yield self.law.error == 0.1 - self.x
    >>> law = gt.cgen.BlockFunction(Loop(), "law")
    >>> [m.identifier for m in law.inputs], [m.identifier for m in law.outputs]
    (['error_m'], ['speed_m_s'])
    """

    def __init__(self, model: Model, name: str) -> None:
        flat = flat_of(model)
        blocks = {b.name: b for b in flat.events.blocks} if flat.events is not None else {}
        if name not in blocks:
            names = ", ".join(f"'{n}'" for n in blocks) or "none"
            raise GenerationError(f"there is no sampled block '{name}'; there are {names}", "name")
        block, p = blocks[name], np.asarray(flat.p0, float)
        times = ca.Function("times", [flat.p], [block.period])(p)
        self.title, self.period = f"sampled block '{name}'", float(times)
        remembered = (*block.state, *block.outputs)
        self.inputs = [_member(s) for s in block.inputs]
        self.outputs = [_member(s) for s in block.outputs]
        self.state = self.start = [_member(s) for s in remembered]
        self.defaults: Mapping[str, Any] = {s.name: _shaped(s, p[s.places]) for s in remembered}
        self._symbols, self._results = self._traced(block, block_numbers(block.model, flat, p))

    def _traced(self, block: FlatBlock, view: Any) -> tuple[list[Any], list[Any]]:
        """Trace the step. Returns the symbols of inputs and state, and the new state."""
        remembered = (*block.state, *block.outputs)
        sizes = [sum(m.count for m in members) for members in (self.inputs, self.state)]
        u, s = ca.SX.sym("u", sizes[0]), ca.SX.sym("s", sizes[1])
        after = self._stepped(view, block.inputs, remembered, ca.vertsplit(u), ca.vertsplit(s))
        results: Any = [ca.densify(ca.cse(ca.vertcat(*after)))]
        f = ca.Function("step", [u, s], results)
        rng = np.random.default_rng(0)
        for _ in range(POINTS):
            a, b = (LARGEST * rng.normal(size=n) for n in sizes)
            expected = np.array(self._stepped(view, block.inputs, remembered, a.tolist(), b.tolist()), float)
            difference = np.abs(np.asarray(f(a, b)).ravel() - expected)
            if not np.all(difference <= SAME * (1 + np.abs(expected))):
                raise GenerationError(
                    f"{self.title}: its step gives other values on symbols than on numbers; keep memory in the state"
                )
        return [u, s], results

    def _stepped(
        self, view: Any, inputs: Sequence[BlockSignal], remembered: Sequence[BlockSignal], u: Any, s: Any
    ) -> list[Any]:
        """Return the entries of state and outputs after a step."""
        input_values, state_values = _named(inputs, u), _named(remembered, s)
        try:
            updated = view.step(SimpleNamespace(**input_values), SimpleNamespace(**state_values))
            updated = {**state_values, **updated}
            after = {name: np.asarray(value, object).reshape(-1).tolist() for name, value in updated.items()}
        except Exception as error:
            raise GenerationError(
                f"{self.title}: its step cannot be run on symbols ({type(error).__name__}: {error}); write it without "
                "branches on numbers, with NumPy's elementary functions",
                "name",
            ) from error
        return [x for signal in remembered for x in after[signal.name]]

    def kernels(self, symbol: str) -> list[ca.Function]:
        """Return the generated body."""
        return [ca.Function(f"{symbol}_body", self._symbols, self._results)]

    def text(self, symbol: str, real: Real) -> str:
        """Return the C text of init and step."""
        macro, n = symbol.upper(), sum(m.count for m in self.state)
        numbers = sum(m.count for m in self.inputs)
        read = _copied(self.inputs, "in->", "u", True) + _copied(self.state, "state->", "s", True)
        kept = _copied(self.state, "next.", "after", False)
        out = "".join(f"    gt_copy({m.address('out->')}, {m.address('next.')}, {m.count});\n" for m in self.outputs)
        begin = _copied(self.start, "start->", "s", True)
        return (
            f'#if ({macro}_SZ_IW > 0) || ({macro}_SZ_W > 0)\n#error "{symbol} must not need scratch"\n#endif\n'
            f"gt_status {symbol}_init({symbol}_state *state, const {symbol}_start *start)\n{{\n"
            f"    {symbol}_state next;\n    double s[{n}];\n\n{begin}    if (gt_all_finite(s, {n}) == 0) {{\n"
            f"        return GT_NOT_FINITE;\n    }}\n{_copied(self.state, 'next.', 's', False)}"
            "    *state = next;\n    return GT_OK;\n}\n\n"
            f"{step_prototype(symbol)}\n{{\n    {symbol}_state next;\n    const double *arg[2];\n    double *res[1];\n"
            f"    double u[{max(1, numbers)}];\n    double s[{n}];\n    double after[{n}];\n\n{read}"
            f"    if ((gt_all_finite(u, {numbers}) == 0) || (gt_all_finite(s, {n}) == 0)) {{\n"
            "        return GT_NOT_FINITE;\n    }\n    arg[0] = u;\n    arg[1] = s;\n    res[0] = after;\n"
            f"    (void){symbol}_body(arg, res, 0, 0, 0);\n    if (gt_all_finite(after, {n}) == 0) {{\n"
            f"        return GT_NOT_FINITE;\n    }}\n{kept}{out}    *state = next;\n    return GT_OK;\n}}\n\n"
        )

    def twin(self, real: Real = DOUBLE) -> StepTwin:
        """Return the twin in Python."""
        return BlockTwin(self, real)

    def facts(self) -> Mapping[str, Any]:
        """Return period, start and traced step."""
        start = [float(x).hex() for value in self.defaults.values() for x in np.ravel(value)]
        return {"period": self.period.hex(), "start": start, "step": str(self._results[0])}

    def notes(self) -> list[str]:
        """Return lines on the statuses."""
        return ["- GT_NOT_FINITE: an input or a number of the state is not finite, or a result would not be finite"]

    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Return random inputs, some of them NaN."""
        rng = np.random.default_rng(seed)
        records = np.zeros(rows, dtype_of(self.inputs, real))
        for m in self.inputs:
            values = LARGEST * rng.normal(size=records[m.identifier].shape)
            values[rng.random(rows) < 0.1] = np.nan
            records[m.identifier] = real.array(values)
        return records

    def complete(self, real: Real) -> np.ndarray:
        """Return inputs of zero."""
        return np.zeros((), dtype_of(self.inputs, real))


class BlockTwin(StepTwin):
    """A `BlockFunction` in Python, evaluated by CasADi's virtual machine."""

    def __init__(self, function: BlockFunction, real: Real) -> None:
        self.function, self.real = function, real
        self.body = function.kernels("block")[0]

    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """Write a new state from a record of the start."""
        if not all(np.all(np.isfinite(start[m.identifier])) for m in self.function.start):
            return Status.NOT_FINITE
        for m in self.function.state:
            state[m.identifier] = start[m.identifier]
        return Status.OK

    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """Run one sample."""
        function, real = self.function, self.real
        none = np.zeros(0, real.dtype)
        u = np.concatenate([none, *[inputs[m.identifier].reshape(-1) for m in function.inputs]])
        s = np.concatenate([state[m.identifier].reshape(-1) for m in function.state])
        if not (np.all(np.isfinite(u)) and np.all(np.isfinite(s))):
            return Status.NOT_FINITE
        if real is DOUBLE:
            after = np.asarray(self.body(u, s)).ravel()
        else:
            after = run(self.body, [u.reshape(-1, 1), s.reshape(-1, 1)])[0][:, 0]
        if not np.all(np.isfinite(after)):
            return Status.NOT_FINITE
        first = 0
        for m in function.state:
            state[m.identifier] = after[first : first + m.count].reshape(state[m.identifier].shape)
            first += m.count
        for m in function.outputs:
            outputs[m.identifier] = state[m.identifier]
        return Status.OK


def _member(signal: BlockSignal) -> StepMember:
    return StepMember(signal.name, int(np.prod(signal.shape)) if signal.shape else None, signal.unit or "1")


def _shaped(signal: BlockSignal, values: np.ndarray) -> Any:
    return float(values[0]) if not signal.shape else values


def _named(signals: Sequence[BlockSignal], entries: Sequence[Any]) -> dict[str, Any]:
    """Return values by name, vectors as arrays."""
    values, first = {}, 0
    for s in signals:
        part = list(entries[first : first + len(s.places)])
        first += len(s.places)
        all_floats = all(isinstance(x, float) for x in part)
        values[s.name] = part[0] if not s.shape else np.array(part, float if all_floats else object).reshape(s.shape)
    return values


def _copied(members: Sequence[StepMember], struct: str, array: str, into: bool) -> str:
    """Return C statements that copy members into an array, or out of it."""
    lines, first = [], 0
    for m in members:
        places = (f"&{array}[{first}]", m.address(struct))
        lines.append(f"    gt_copy({', '.join(places if into else places[::-1])}, {m.count});\n")
        first += m.count
    return "".join(lines)
