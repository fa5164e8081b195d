"""The operations of an SX function over boxes: enclosures of all results, and error bounds of the computed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..compiler.rewriting import Instruction
from ..results.refusal import ArgumentError
from .intervals import JUMPS, OPERATIONS, Array, Interval, add, checked, point, touches_cut
from .regularity import about, along
from .rounding import Arithmetic, error

CHUNK = 2048  # boxes at a time: every operation keeps three columns until it is read last


@dataclass(frozen=True)
class Enclosures:
    """Results (m, n) of m outputs over n boxes: `lo` and `hi` of the real values, and `error`, the bound of
    |computed - real|, or None without an arithmetic. `continuous`: no jump lies inside the box. `undefined`: the first
    step that may be undefined in a box, -1 if there is none. `decided`: no jump but a turn of an angle by 2 pi, which
    changes no derivative, lies inside the box."""

    lo: Array
    hi: Array
    error: Array | None
    continuous: Array
    undefined: Array
    decided: Array


class IntervalTape:
    """The operations of an SX function, in the order in which CasADi's machine and the generated C execute them.

    Inputs are the entries of all arguments in one column, but the last ones are fixed at the values `constants`;
    outputs are those of all results. Raises ArgumentError for an operation without an interval extension.
    """

    def __init__(self, f: ca.Function, constants: Sequence[float] = ()) -> None:
        if not f.is_a("SXFunction"):
            raise ArgumentError(
                f"'{f.name()}' is no function of scalar operations, so nothing can be proved", "function"
            )
        offsets = np.cumsum([0, *[f.nnz_in(k) for k in range(f.n_in())]])
        firsts = np.cumsum([0, *[f.numel_out(k) for k in range(f.n_out())]])
        dense = [np.array(f.sparsity_out(k).find(), dtype=int) for k in range(f.n_out())]
        self.function = f
        self.inputs, self.outputs = int(offsets[-1]) - len(constants), int(firsts[-1])
        self.steps: list[Instruction] = []
        self.sources: dict[int, int] = {}  # output -> step
        latest: dict[int, int] = {}
        for k in range(f.n_instructions()):
            op, read, written = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if op == ca.OP_OUTPUT:
                self.sources[int(firsts[written[0]] + dense[written[0]][written[1]])] = latest[read[0]]
                continue
            if op == ca.OP_CONST:
                step = Instruction(op, constant=float(f.instruction_constant(k)))
            elif op == ca.OP_INPUT:
                place = int(offsets[read[0]] + read[1])
                fixed = place - self.inputs
                step = (
                    Instruction(op, place=place) if fixed < 0 else Instruction(ca.OP_CONST, constant=constants[fixed])
                )
            elif op in OPERATIONS:
                step = Instruction(op, [latest[i] for i in read])
            else:
                names = {getattr(ca, n): n for n in dir(ca) if n.startswith("OP_")}
                raise ArgumentError(
                    f"'{f.name()}' uses the operation {names.get(op, op)}, which has no interval extension", "function"
                )
            self.steps.append(step)
            latest[written[0]] = len(self.steps) - 1

    @cached_property
    def depends(self) -> list[int]:
        """For each step the inputs that it depends on, as bits."""
        masks: list[int] = []
        for s in self.steps:
            mask = 1 << s.place if s.op == ca.OP_INPUT else 0
            for r in s.reads:
                mask |= masks[r]
            masks.append(mask)
        return masks

    @cached_property
    def _last(self) -> list[int]:
        """For each step the last step that reads it; outputs are kept."""
        last = [len(self.steps)] * len(self.steps)
        for k, s in enumerate(self.steps):
            for r in s.reads:
                last[r] = k
        for source in self.sources.values():
            last[source] = len(self.steps)
        return last

    @cached_property
    def varying(self) -> Array:
        """Which inputs some output depends on."""
        return np.logical_or.reduce([self.depending(s) for s in self.sources.values()], initial=False) | np.zeros(
            self.inputs, bool
        )

    def depending(self, step: int) -> Array:
        """Return which inputs a step depends on."""
        return np.array([bool(self.depends[step] >> k & 1) for k in range(self.inputs)])

    def over(
        self,
        lo: Array,
        hi: Array,
        arithmetic: Arithmetic | None = None,
        known: Mapping[int, Interval] | None = None,
        given: Array | None = None,
    ) -> Enclosures:
        """Evaluate over boxes, lo and hi (inputs, n).

        arithmetic: also bound the errors of the operations in this arithmetic, with inputs that are exact, or within
        `given` (inputs, n). known: enclosures of the real values of outputs that are known already, infinite where
        nothing is; operations after them gain.
        """
        parts = [slice(k, k + CHUNK) for k in range(0, max(lo.shape[1], 1), CHUNK)]
        narrowed = {self.sources[o]: x for o, x in (known or {}).items() if o in self.sources}
        with np.errstate(all="ignore"):
            results = [
                self._over(
                    lo[:, p],
                    hi[:, p],
                    arithmetic,
                    {s: Interval(x.lo[p], x.hi[p]) for s, x in narrowed.items()},
                    None if given is None else given[:, p],
                )
                for p in parts
            ]
        if len(results) == 1:
            return results[0]
        joined = [np.concatenate([getattr(r, name) for r in results], axis=-1) for name in ("lo", "hi")]
        errors = (
            None if arithmetic is None else np.concatenate([r.error for r in results if r.error is not None], axis=1)
        )
        flags = [np.concatenate([getattr(r, name) for r in results]) for name in ("continuous", "undefined", "decided")]
        return Enclosures(joined[0], joined[1], errors, flags[0], flags[1], flags[2])

    def _over(
        self,
        lo: Array,
        hi: Array,
        arithmetic: Arithmetic | None,
        narrowed: Mapping[int, Interval],
        given: Array | None,
    ) -> Enclosures:
        n = lo.shape[1]
        values: list[Interval | None] = []
        errors: list[Array | None] = []
        continuous, decided = np.ones(n, dtype=bool), np.ones(n, dtype=bool)
        undefined = np.full(n, -1)
        none = np.zeros(1)
        leaving: dict[int, list[int]] = {}
        for k, last in enumerate(self._last):
            leaving.setdefault(last, []).append(k)
        for k, s in enumerate(self.steps):
            e = none
            if s.op == ca.OP_CONST:
                x = point(np.full(1, s.constant))
                e = np.full(1, arithmetic.constant(s.constant)) if arithmetic else none
            elif s.op == ca.OP_INPUT:
                x = Interval(lo[s.place], hi[s.place])
                e = none if given is None or arithmetic is None else given[s.place]
            else:
                operands = [values[r] for r in s.reads]
                carried = [errors[r] for r in s.reads]
                assert all(x is not None for x in operands)
                x, e, smooth = _applied(s.op, operands, carried, arithmetic)  # type: ignore[arg-type]
                if smooth is not None:
                    continuous &= smooth
                    decided &= smooth | (s.op == ca.OP_ATAN2)
                if k in narrowed:
                    x = Interval(np.maximum(x.lo, narrowed[k].lo), np.minimum(x.hi, narrowed[k].hi))
                new = np.isnan(x.lo) & (undefined < 0)
                if new.any():
                    undefined[new] = k
            values.append(x)
            errors.append(e)
            for gone in leaving.get(k, ()):
                values[gone] = errors[gone] = None
        low, high = np.zeros((self.outputs, n)), np.zeros((self.outputs, n))
        bounds = None if arithmetic is None else np.zeros((self.outputs, n))
        for place, source in self.sources.items():
            x, e = values[source], errors[source]
            assert x is not None and e is not None
            low[place], high[place] = x
            if bounds is not None:
                bounds[place] = e
        return Enclosures(low, high, bounds, continuous, undefined, decided)


def _applied(
    op: int, given: list[Interval], errors: list[Array], arithmetic: Arithmetic | None
) -> tuple[Interval, Array, Array | None]:
    """Return enclosure and error of one operation, and where it has no jump; None if it never has one."""
    smooth = None
    if arithmetic is not None:
        if op in JUMPS:
            given = [x.widened(e) if e.any() else x for x, e in zip(given, errors, strict=True)]
        elif op == ca.OP_IF_ELSE_ZERO and errors[0].any():
            given = [given[0].widened(errors[0]), given[1]]
    x = OPERATIONS[op](*given)
    if op in JUMPS:
        smooth = x.lo == x.hi
    elif op == ca.OP_IF_ELSE_ZERO:
        smooth = ((given[0].lo == 0) & (given[0].hi == 0)) | ~given[0].contains(0.0)
    elif op == ca.OP_ATAN2:
        smooth = ~touches_cut(*given)
    if arithmetic is None:
        return x, errors[0], smooth
    e = error(op, given, errors, x, arithmetic)
    bad = np.isnan(e)
    return (checked(np.where(bad, np.nan, x.lo), np.where(bad, np.nan, x.hi)) if bad.any() else x), e, smooth


def with_jacobian(
    tape: IntervalTape, outputs: Sequence[int], beside: bool = False
) -> tuple[IntervalTape, IntervalTape]:
    """Return tapes of chosen outputs as one column, and of their derivatives (outputs, inputs), column after column;
    `beside`: the latter begins with the outputs.

    Constants are symbols while CasADi differentiates: it would round their products, so that the derivative would be
    that of another function in its last digits.
    """
    x, entries, symbols, values = _lifted(tape)
    wanted = ca.vertcat(*[entries[o] for o in outputs]) if outputs else ca.SX(0, 1)
    slope = ca.densify(ca.jacobian(wanted, x))
    both = [ca.densify(wanted), slope] if beside else [slope]
    name = tape.function.name()
    chosen = ca.Function(f"{name}_chosen", [x, symbols], ca.cse([ca.densify(wanted)]))
    return (
        IntervalTape(chosen, values),
        IntervalTape(ca.Function(f"{name}_jacobian", [x, symbols], ca.cse(both)), values),
    )


def _lifted(tape: IntervalTape) -> tuple[ca.SX, list[ca.SX], ca.SX, list[float]]:
    """Return the inputs of a tape, its outputs as expressions of these and of symbols for its constants, these symbols,
    and their values."""
    powers = {s.reads[1] for s in tape.steps if s.op in (ca.OP_POW, ca.OP_CONSTPOW)}
    x = ca.SX.sym("x", tape.inputs)
    symbols: dict[float, ca.SX] = {}
    made: list[ca.SX] = []
    for k, s in enumerate(tape.steps):
        if s.op == ca.OP_INPUT:
            made.append(x[s.place])
        elif s.op != ca.OP_CONST:
            given = [made[r] for r in s.reads]
            made.append(ca.SX.unary(s.op, *given) if len(given) == 1 else ca.SX.binary(s.op, *given))
        elif abs(s.constant) in (0.0, 1.0) or (k in powers and 2 * s.constant == round(2 * s.constant)):
            made.append(ca.SX(s.constant))  # what CasADi computes with these is exact
        else:
            made.append(symbols.setdefault(s.constant, ca.SX.sym(f"c{len(symbols)}")))
    outputs = [made[tape.sources[o]] if o in tape.sources else ca.SX(0.0) for o in range(tape.outputs)]
    return x, outputs, ca.vertcat(*symbols.values()) if symbols else ca.SX(0, 1), list(symbols)


class MeanValue:
    """Mean-value form of chosen outputs of a tape: f(c) + f'(X) (X - c), with errors of second order in the size.

    Only where the tape has no jump inside the box. `slopes` (m, inputs, n) are those of the last boxes.
    """

    def __init__(self, tape: IntervalTape, outputs: Sequence[int]) -> None:
        self.count, self.inputs = len(outputs), tape.inputs
        self._value, self.slope = with_jacobian(tape, outputs)

    def slopes(self, lo: Array, hi: Array) -> Interval:
        """Return the Jacobian over boxes, (m, inputs, n)."""
        e = self.slope.over(lo, hi)
        shape = (self.inputs, self.count, lo.shape[1])
        return Interval(*(x.reshape(shape).transpose(1, 0, 2) for x in (e.lo, e.hi)))

    def over(self, lo: Array, hi: Array) -> tuple[Interval, Interval]:
        """Return the values (m, n) and the slopes (m, inputs, n); NaN where a slope is undefined."""
        at, slopes, way = self.parts(lo, hi)
        with np.errstate(all="ignore"):
            return add(at, along(slopes, way)), slopes

    def parts(self, lo: Array, hi: Array) -> tuple[Interval, Interval, Interval]:
        """Return the values at the midpoints (m, n), the slopes (m, inputs, n), and the ways from there."""
        middle, way = about(lo, hi)
        at = self._value.over(middle, middle)
        return Interval(at.lo, at.hi), self.slopes(lo, hi), way
