"""A sampled block as a step function: its `step` is run once on symbols, and what it did is written in C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.analysis.events import BlockSignal, FlatBlock, block_numbers
from ...compiler.flat_cache import flat_of
from ...lang.model import Model
from ...results.status import Status
from ..newton_steps import run
from ..real import DOUBLE, GenerationError, Real
from .function import StepFunction, StepMember, StepTwin, dtype_of, step_prototype

POINTS = 20  # at which the traced step is compared with the one on numbers
SAME = 1e-12
LARGEST = 3.0  # of the numbers of these points, and of examples


class BlockFunction(StepFunction):
    """A `gt.SampledBlock` of a model as a step function in C.

    Its `step` is run on CasADi symbols, so it may hold no branch on a number and no function that does not know
    symbols; NumPy's elementary functions do. The delay of its outputs is a matter of the loop that calls it.

    Args:
        model: the model that holds the block, with its parameters.
        name: of the block in the model, such as "law".

    Raises GenerationError where there is no such block, and where its step cannot be run on symbols.

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
            there = ", ".join(f"'{n}'" for n in blocks) or "none"
            raise GenerationError(f"there is no sampled block '{name}'; there are {there}", "name")
        block, p = blocks[name], np.asarray(flat.p0, float)
        times = ca.Function("times", [flat.p], [block.period])(p)
        self.title, self.period = f"sampled block '{name}'", float(times)
        held = (*block.state, *block.outputs)
        self.inputs = [_member(s) for s in block.inputs]
        self.outputs = [_member(s) for s in block.outputs]
        self.state = self.start = [_member(s) for s in held]
        self.defaults: Mapping[str, Any] = {s.name: _shaped(s, p[s.places]) for s in held}
        self._symbols, self._results = self._traced(block, block_numbers(block.model, flat, p))

    def _traced(self, block: FlatBlock, view: Any) -> tuple[list[Any], list[Any]]:
        """Symbols of inputs and state, and results: new state."""
        held = (*block.state, *block.outputs)
        sizes = [sum(m.count for m in members) for members in (self.inputs, self.state)]
        u, s = ca.SX.sym("u", sizes[0]), ca.SX.sym("s", sizes[1])
        after = self._stepped(view, block.inputs, held, ca.vertsplit(u), ca.vertsplit(s))
        results: Any = [ca.densify(ca.cse(ca.vertcat(*after)))]
        f = ca.Function("step", [u, s], results)
        rng = np.random.default_rng(0)
        for _ in range(POINTS):
            a, b = (LARGEST * rng.normal(size=n) for n in sizes)
            wanted = np.array(self._stepped(view, block.inputs, held, a.tolist(), b.tolist()), float)
            far = np.abs(np.asarray(f(a, b)).ravel() - wanted)
            if not np.all(far <= SAME * (1 + np.abs(wanted))):
                raise GenerationError(
                    f"{self.title}: its step on symbols gives other numbers; it may keep values of its own"
                )
        return [u, s], results

    def _stepped(
        self, view: Any, inputs: Sequence[BlockSignal], held: Sequence[BlockSignal], u: Any, s: Any
    ) -> list[Any]:
        """Entries of what it remembers after a step."""
        given, before = _named(inputs, u), _named(held, s)
        try:
            made = view.step(SimpleNamespace(**given), SimpleNamespace(**before))
            after = {name: np.asarray(value, object).reshape(-1).tolist() for name, value in {**before, **made}.items()}
        except Exception as error:
            raise GenerationError(
                f"{self.title}: its step cannot be run on symbols ({type(error).__name__}: {error}); write it without "
                "branches on numbers, by NumPy's elementary functions",
                "name",
            ) from error
        return [x for signal in held for x in after[signal.name]]

    def kernels(self, symbol: str) -> list[ca.Function]:
        """The generated body."""
        return [ca.Function(f"{symbol}_body", self._symbols, self._results)]

    def text(self, symbol: str, real: Real) -> str:
        """C of init and step."""
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
        """The same in Python."""
        return BlockTwin(self, real)

    def facts(self) -> Mapping[str, Any]:
        """What it was made from."""
        start = [float(x).hex() for value in self.defaults.values() for x in np.ravel(value)]
        return {"period": self.period.hex(), "start": start, "step": str(self._results[0])}

    def notes(self) -> list[str]:
        """What its statuses mean."""
        return ["- GT_NOT_FINITE: an input or what is remembered is no number, or an output would be none"]

    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Random inputs, some of them no numbers."""
        rng = np.random.default_rng(seed)
        made = np.zeros(rows, dtype_of(self.inputs, real))
        for m in self.inputs:
            values = LARGEST * rng.normal(size=made[m.identifier].shape)
            values[rng.random(rows) < 0.1] = np.nan
            made[m.identifier] = real.array(values)
        return made

    def complete(self, real: Real) -> np.ndarray:
        """Inputs of zero."""
        return np.zeros((), dtype_of(self.inputs, real))


class BlockTwin(StepTwin):
    """A `BlockFunction` in Python, by CasADi's virtual machine."""

    def __init__(self, made: BlockFunction, real: Real) -> None:
        self.made, self.real = made, real
        self.body = made.kernels("block")[0]

    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """A new state from a record of the start."""
        if not all(np.all(np.isfinite(start[m.identifier])) for m in self.made.start):
            return Status.NOT_FINITE
        for m in self.made.state:
            state[m.identifier] = start[m.identifier]
        return Status.OK

    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """One sample."""
        made, real = self.made, self.real
        none = np.zeros(0, real.dtype)
        u = np.concatenate([none, *[inputs[m.identifier].reshape(-1) for m in made.inputs]])
        s = np.concatenate([state[m.identifier].reshape(-1) for m in made.state])
        if not (np.all(np.isfinite(u)) and np.all(np.isfinite(s))):
            return Status.NOT_FINITE
        if real is DOUBLE:
            after = np.asarray(self.body(u, s)).ravel()
        else:
            after = run(self.body, [u.reshape(-1, 1), s.reshape(-1, 1)])[0][:, 0]
        if not np.all(np.isfinite(after)):
            return Status.NOT_FINITE
        first = 0
        for m in made.state:
            state[m.identifier] = after[first : first + m.count].reshape(state[m.identifier].shape)
            first += m.count
        for m in made.outputs:
            outputs[m.identifier] = state[m.identifier]
        return Status.OK


def _member(signal: BlockSignal) -> StepMember:
    return StepMember(signal.name, int(np.prod(signal.shape)) if signal.shape else None, signal.unit or "1")


def _shaped(signal: BlockSignal, values: np.ndarray) -> Any:
    return float(values[0]) if not signal.shape else values


def _named(signals: Sequence[BlockSignal], entries: Sequence[Any]) -> dict[str, Any]:
    """Values by name, of a vector as an array."""
    made, first = {}, 0
    for s in signals:
        own = list(entries[first : first + len(s.places)])
        first += len(s.places)
        numbers = all(isinstance(x, float) for x in own)
        made[s.name] = own[0] if not s.shape else np.array(own, float if numbers else object).reshape(s.shape)
    return made


def _copied(members: Sequence[StepMember], struct: str, array: str, into: bool) -> str:
    """Members copied into an array, or from it."""
    lines, first = [], 0
    for m in members:
        places = (f"&{array}[{first}]", m.address(struct))
        lines.append(f"    gt_copy({', '.join(places if into else places[::-1])}, {m.count});\n")
        first += m.count
    return "".join(lines)
