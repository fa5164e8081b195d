"""A causal function as the content of an FMU: its states and their rates, its table and C, and the step of the
integrator for co-simulation."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..cgen.generation import contents
from ..cgen.interface import Interface, interfaces
from ..cgen.newton_stages import samples_of
from ..compiler.causal import CausalFunction, CausalSignal, c_name, compile_causal
from ..compiler.consistency.home import home_of
from ..compiler.derivative import depends
from ..compiler.tunable import with_parameters
from ..lang.scope import derivative_name
from ..lang.source import ModelError
from ..results.refusal import ArgumentError
from ..results.status import Status
from .content import FmuContent
from .table import FmuTable, FmuVariable, base_and_order, fmi_name, texts_of, unused
from .tangents import tangents

Pair = tuple[int, int]
MOST_TURNS = 6  # of adding rates of states, whose computation may need further states
SMALLEST = 1e-9
EXACT, ROUGH = 15, 6  # digits of a start value in the description


@dataclass(frozen=True)
class WithStates:
    """A function that also computes the rates of its states.

    function: its outputs are the original targets, then the missing rates. asked: number of original targets. states:
    inputs that are states; known: the other inputs except parameters. parameters: of the model, the last inputs.
    """

    function: CausalFunction
    asked: int
    states: Sequence[CausalSignal]
    known: Sequence[CausalSignal]
    parameters: Sequence[CausalSignal] = ()


def with_states(f: CausalFunction) -> WithStates:
    """Extend the function by outputs for the rates of all its states.

    Raises ArgumentError if the model has events, which an FMU does not detect.
    """
    if f.flat.events is not None:
        raise ArgumentError(
            f"{f.flat.title} has events or sampled blocks, which cannot be exported; export a sampled block as "
            "gt.cgen.BlockFunction, and smooth switching equations",
            "function",
        )
    known = {i for _, _, indices in f.groups for i in indices}
    names = [f.flat.variables[i].name for i in f.preferred]
    asked, full = len(f.outputs), f
    for _ in range(MOST_TURNS):
        states = [s for s in full.inputs if s.pairs[0][0] not in known]
        computed = {p for s in (*states, *full.outputs) for p in s.pairs}
        targets = [s.name for s in full.outputs]
        for s in states:
            if not all((i, k + 1) in computed for i, k in s.pairs):
                base, order = base_and_order(s.name)
                targets.append(derivative_name(base, order + 1))
        if len(targets) == len(full.outputs):
            return WithStates(full, asked, states, [s for s in full.inputs if s not in states])
        # a rate may need states that the targets do not
        full = compile_causal(f.flat, [name for name, _, _ in f.groups], targets, names, f.branches, f.name)
    raise ArgumentError("the rates of its states keep needing further states; prefer other states", "function")


def starts(extended: WithStates, options: Mapping[str, Sequence[float] | float]) -> dict[Pair, float]:
    """Return a start value of each input: from `options` by name, otherwise the home pose at rest, with known variables
    that keep it there, such as the forces that hold a robot.

    Raises ArgumentError for an unknown input, a wrong number of values, and a start at which the function fails.
    """
    f = extended.function
    pose = home_of(f.flat)
    near = {p: x for s in f.inputs for p, x in zip(s.pairs, map(float, samples_of(f, s.pairs)[0]), strict=True)}
    declared = {p: start for p in near if (start := f.flat.variables[p[0]].start) is not None}
    home = {p: pose.get(p[0], declared.get(p, x)) for p, x in near.items()}
    inputs = {s.name: s for s in f.inputs}
    fixed: dict[Pair, float] = {}
    for name, value in options.items():
        if name not in inputs:
            raise ArgumentError(f"there is no input '{name}'; inputs are {', '.join(inputs)}", "start")
        try:
            numbers = np.ravel(np.asarray(value, float))
        except (TypeError, ValueError):
            numbers = np.array([])
        if len(numbers) != inputs[name].size or not np.all(np.isfinite(numbers)):
            raise ArgumentError(f"'{name}' takes {inputs[name].size} finite numbers; found {value}", "start")
        fixed |= dict(zip(inputs[name].pairs, map(float, numbers), strict=True))
    status = Status.OK
    # six digits may be too few, for example for a quaternion; and a declared start may not fit this causality
    for base, digits in ((home, ROUGH), (home, EXACT), (near, EXACT)):
        values = {p: _short(x, digits) if p[1] == 0 else 0.0 for p, x in base.items()} | fixed
        if extended.states:
            values |= _holding(extended, values, set(fixed))
        status = _status(f, values)
        if status is Status.OK:
            return values
    raise ArgumentError(f"the function fails at the start: {status.message}; change the start", "start")


def _short(x: float, digits: int = ROUGH) -> float:
    """Round to few digits: rounding noise of different linear algebra libraries must not reach the description."""
    return 0.0 if abs(x) < SMALLEST else float(f"{x:.{digits}g}")


def _status(f: CausalFunction, values: Mapping[Pair, float]) -> Status:
    arguments = [np.array([values[p] for p in s.pairs]) for s in f.inputs]
    shaped = [a.reshape(s.shape) if s.shape else float(a[0]) for a, s in zip(arguments, f.inputs, strict=True)]
    *_, status = f(*shaped, *([0.0] if f.plan.uses_time else []))
    return Status(int(status))


def _holding(extended: WithStates, values: Mapping[Pair, float], fixed: set[Pair]) -> dict[Pair, float]:
    """Return known variables that hold the states at the start; empty if there is no solution."""
    f = extended.function
    free = [s for s in extended.known if s.pairs[0][1] == 0 and not set(s.pairs) & fixed]
    if not free:
        return {}
    positions = [s for s in extended.states if s.pairs[0][1] == 0]
    others = [s.name for s in extended.known if s.pairs[0][1] == 0 and s not in free]
    try:
        back = compile_causal(f.flat, [*[s.name for s in positions], *others], [s.name for s in free])
    except ModelError:
        return {}
    if any(p[1] == 0 and p not in values for s in back.inputs for p in s.pairs):
        return {}
    arguments = [np.array([values.get(p, 0.0) for p in s.pairs]) for s in back.inputs]
    shaped = [a.reshape(s.shape) if s.shape else float(a[0]) for a, s in zip(arguments, back.inputs, strict=True)]
    *results, status = back(*shaped, *([0.0] if back.plan.uses_time else []))
    if Status(int(status)) is not Status.OK:
        return {}
    numbers = {}
    for s, result in zip(free, results, strict=True):
        numbers |= dict(zip(s.pairs, map(_short, np.ravel(result)), strict=True))
    return numbers


KEY = "model"  # of the function in C: gt_<name>_model
# test files from `contents` that a unit does not need
LEFT_OUT = ("gt_{}_selftest.c", "gt_{}_main.c", "gt_compare.h", "Makefile", "README.md")


def causal_content(
    f: CausalFunction,
    name: str,
    *,
    title: str = "",
    start: Mapping[str, Sequence[float] | float] | None = None,
    tunable: Collection[str] = (),
    parameters: Sequence[str] = (),
    hold: bool = False,
    step: float = 1e-3,
    part_error: float = 0.0,
    stop: float = 1.0,
    provenance: Mapping[str, str] | None = None,
) -> tuple[FmuContent, WithStates]:
    """Return the content of the FMU `name` and the function that it computes.

    Raises ArgumentError for a model with events, unknown inputs, and a start at which the function fails.
    """
    extended = with_states(f)
    if hold and extended.states:
        raise ArgumentError("only FMUs without states can hold outputs; leave it out", "on_fault")
    unknown = [n for n in tunable if n not in {s.name for s in extended.known}]
    if unknown:
        known = ", ".join(s.name for s in extended.known)
        raise ArgumentError(f"'{unknown[0]}' is not a known variable; known variables are {known}", "tunable")
    begin = starts(extended, start or {})
    if parameters:
        function, signals = with_parameters(extended.function, parameters, "parameters")
        extended = replace(extended, function=function, parameters=signals)
    (face,) = interfaces({KEY: extended.function}, name)
    builder = _Table(extended, face, begin, tunable, hold)
    table = FmuTable(
        name, title or f.flat.title, builder.variables, builder.dependencies(),
        [builder.place[p] for p in builder.states],
        [builder.rate(p) for p in builder.states], step=step, stop=stop, remembers=bool(face.newton), hold=hold,
        parameters=[builder.place[p] for s in extended.parameters for p in s.pairs], part_error=part_error,
    )  # fmt: skip
    exact = tangents(extended.function, face, name)
    texts = contents([face], name, dict(provenance or {}))
    files = needed(texts, name)
    functions = "".join(
        [
            f'#include "{exact.header}"\n\n' + ('#include "gt_newton.h"\n\n' if face.newton else ""),
            exact.text,
            builder.begin(),
            builder.compute(),
            _NO_SAMPLE,
            builder.along(),
        ]
    )
    memory = f"    {face.symbol}_state newton;\n" if face.newton else "    char none;\n"
    content = FmuContent(
        table, {**files, **exact.files}, f"gt_{name}.h", memory, functions, extended.function.plan.uses_time
    )
    return content, extended


def needed(texts: Mapping[str, str], name: str) -> dict[str, str]:
    """Return the files that a library is built from."""
    omitted = {file.format(name) for file in LEFT_OUT}
    return {file: text for file, text in texts.items() if file not in omitted}


_NO_SAMPLE = """\
gt_status gt_fmu_sample(gt_fmu_memory *memory, double *v, int *n)
{
    (void)memory;
    (void)v;
    (void)n;
    return GT_OK;
}

"""


class _Table:
    """Value references of one causal function, and the C that copies between them and the structs."""

    def __init__(
        self,
        extended: WithStates,
        face: Interface,
        start: Mapping[Pair, float],
        tunable: Collection[str],
        hold: bool,
    ) -> None:
        self.extended, self.face, self.f = extended, face, extended.function
        self.states = [p for s in extended.states for p in s.pairs]
        self.place: dict[Pair, int] = {}  # of inputs and states, then of derivatives
        self.outputs: list[list[int]] = []  # value references of each output number of the function
        self.variables: list[FmuVariable] = []
        self.names = {self._name(p) for s in (*self.f.inputs, *self.f.outputs) for p in s.pairs}
        self._add("time", "s", "", "time")
        for s in sorted(extended.known, key=lambda s: s.name in tunable):
            role = "tunable" if s.name in tunable else "input"
            for p in s.pairs:
                self.place[p] = self._signal(p, role, start=start[p])
        for i, k in (p for s in extended.parameters for p in s.pairs):
            v = self.f.flat.variables[i]
            self.place[i, k] = self._signal((i, k), "tunable", start=v.start, least=v.min, most=v.max)
        self.guess = len(self.variables)
        home = iter([x for stage in face.newton for x in stage.home])
        for m in face.state:
            for k in range(m.size):
                base = self._named(m.signal + (f"[{k}]" if m.is_array else "")).replace("der(", "der.").replace(")", "")
                about = f"where Newton begins: {m.signal}"
                self._add(self._new(f"guess.{base.replace(',', '_')}"), m.unit, about, "fixed", start=next(home))
        first = len(self.variables)
        self.place |= {p: first + n for n, p in enumerate(self.states)}
        for i, k in self.states:
            rate_of = self.place.get((i, k - 1)) if (i, k - 1) in self.states else None
            self._signal((i, k), "state", start=start[i, k], nominal=True, of_state=rate_of)
        numbers = [p for s in self.f.outputs for p in s.pairs]
        rates = [(i, k + 1) for i, k in self.states]
        asked = sum(s.size for s in self.f.outputs[: extended.asked])
        for p in numbers:
            is_rate = p in rates and p not in self.place
            if is_rate:
                self.place[p] = self._signal(p, "derivative", of_state=self.place[p[0], p[1] - 1])
            self.outputs.append([self.place[p]] if is_rate else [])
        for n, p in enumerate(numbers[:asked]):
            self.outputs[n].append(self._output(p))
        if hold:
            self._add(self._new("status"), "1", "0: there is an answer; else the outputs are the last ones", "output",
                      integer=True)  # fmt: skip

    def rate(self, p: Pair) -> int:
        """Return the value reference of the derivative of a state."""
        return self.place[p[0], p[1] + 1]

    def _add(self, name: str, unit: str, description: str, role: Any, **more: Any) -> int:
        reference = len(self.variables)
        unit = "1" if unit in ("", "?") else unit
        self.variables.append(FmuVariable(reference, name, unit, description, role, **more))
        return reference

    def _signal(self, p: Pair, role: Any, nominal: bool = False, **more: Any) -> int:
        v = self.f.flat.variables[p[0]]
        if nominal and p[1] == 0:
            more["nominal"] = v.nominal
        return self._add(self._name(p), self.f.flat.unit_of(*p), v.description if p[1] == 0 else "", role, **more)

    def _name(self, p: Pair) -> str:
        return self._named(self.f.flat.symbol_name(*p))

    def _named(self, name: str) -> str:
        return fmi_name(name, texts_of(self.f.flat))

    def _output(self, p: Pair) -> int:
        """Add an output; one that is also a state, derivative or input gets a name of its own."""
        if p not in self.place:
            return self._signal(p, "output")
        v = self.f.flat.variables[p[0]]
        base, bracket, index = self._named(v.name).rpartition("[")
        stem = base if bracket else index
        word = c_name(stem.replace("'", "")) if p[1] == 0 else f"{'d' if p[1] == 1 else f'd{p[1]}'}_{c_name(stem)}"
        name = f"{word}_out" + (f"[{index}" if bracket else "")
        return self._add(self._new(name), self.f.flat.unit_of(*p), f"{self._name(p)} as an output", "output")

    def _new(self, name: str) -> str:
        """Return a name that the model does not use."""
        return unused(name, self.names | {v.name for v in self.variables})

    def dependencies(self) -> dict[int, list[int]]:
        """Return the dependencies of each computed variable, as value references."""
        inputs = self.references()
        result = {}
        for places, on in zip(self.outputs, depends(self.f), strict=True):
            for r in places:
                result[r] = sorted({inputs[k] for k in on})
        return result | {v.reference: sorted(inputs) for v in self.variables if v.integer}

    def references(self) -> list[int]:
        """Return the value references of the function's inputs, in order."""
        return [*[self.place[p] for s in self.f.inputs for p in s.pairs], *([0] if self.f.plan.uses_time else [])]

    def begin(self) -> str:
        """Return the C that starts Newton's method from the parameters."""
        lines = ["gt_status gt_fmu_begin(gt_fmu_memory *memory, double *v)\n{\n"]
        if self.face.newton:
            lines.append(f"    {self.face.symbol}_start(&memory->newton);\n")
            offset = self.guess
            for m in self.face.state:
                lines.append(f"    gt_copy({m.address('memory->newton.')}, &v[{offset}], {m.size});\n")
                offset += m.size
        else:
            lines.append("    memory->none = (char)0;\n    (void)v;\n")
        return "".join([*lines, "    return GT_OK;\n}\n\n"])

    def compute(self) -> str:
        """Return the C that fills the struct of inputs, calls the function and copies its outputs."""
        symbol, refs = self.face.symbol, self.references()
        state = "&memory->newton, " if self.face.newton else ""
        lines = [
            f"gt_status gt_fmu_compute(gt_fmu_memory *memory, double *v)\n{{\n"
            f"    {symbol}_in in;\n    {symbol}_out out;\n"
            "    gt_status status;\n\n",
            "" if self.face.newton else "    (void)memory;\n",
            "" if self.face.inputs else "    in.unused = 0.0;\n",
        ]
        offset = 0
        for m in self.face.inputs:
            lines += _copies(m.address("in."), refs[offset : offset + m.size], into=True)
            offset += m.size
        lines.append(
            f"    status = {symbol}({state}&in, &out);\n    if (status != GT_OK) {{\n        return status;\n    }}\n"
        )
        offset = 0
        for m in self.face.outputs:
            places = self.outputs[offset : offset + m.size]
            for which in range(max(map(len, places), default=0)):
                lines += _copies(m.address("out."), [p[which] for p in places], into=False)
            offset += m.size
        return "".join([*lines, "    return GT_OK;\n}\n\n"])

    def along(self) -> str:
        """Return the C of directional and adjoint derivatives."""
        refs, n = self.references(), len(self.references())
        total = n + self.face.state_size
        m = len(self.outputs)
        double_states = [r for r in (self.rate(p) for p in self.states) if self.variables[r].role == "state"]
        lines = [
            "gt_status gt_fmu_along(const gt_fmu_memory *memory, const double *v, const double *seed, double *made,\n"
            "                       int adjoint)\n{\n"
            f"    double a[{max(1, total)}];\n    double da[{max(1, total)}] = {{0.0}};\n"
            f"    double dy[{m}] = {{0.0}};\n"
            "    gt_status status = GT_OK;\n\n",
            "" if self.face.newton else "    (void)memory;\n",
            "" if refs else "    (void)v;\n    a[0] = 0.0;\n",
            *[f"    a[{k}] = v[{r}];\n" for k, r in enumerate(refs)],
        ]
        offset = n
        for member in self.face.state:
            lines.append(f"    gt_copy(&a[{offset}], {member.address('memory->newton.')}, {member.size});\n")
            offset += member.size
        lines += [
            "    if (adjoint == 0) {\n",
            *[f"        da[{k}] = seed[{r}];\n" for k, r in enumerate(refs)],
            "        status = along(a, da, dy);\n",
            *[f"        made[{r}] = dy[{k}];\n" for k, places in enumerate(self.outputs) for r in places],
            "    }\n",
            *self._against(refs),
            *[f"    made[{r}] += seed[{r}];\n" for r in double_states],
            "    if ((status == GT_OK) && (gt_all_finite(made, GT_FMU_REALS) == 0)) {\n"
            "        status = GT_NOT_FINITE;\n    }\n    return status;\n}\n",
        ]  # fmt: skip
        return "".join(lines)

    def _against(self, refs: Sequence[int]) -> list[str]:
        """Return the C of the adjoint, one input after the other; a separate function would double the code."""
        if not refs:
            return []
        n = len(refs)
        terms = [f"(seed[{r}] * dy[{k}])" for k, places in enumerate(self.outputs) for r in places]
        rows = [" + ".join(terms[k : k + 4]) for k in range(0, len(terms), 4)]
        return [
            f"    if (adjoint != 0) {{\n        static const int known[{n}] = {{{', '.join(map(str, refs))}}};\n"
            f"        int k;\n\n        for (k = 0; (k < {n}) && (status == GT_OK); k++) {{\n            int i;\n\n"
            f"            for (i = 0; i < {n}; i++) {{\n                da[i] = (i == k) ? 1.0 : 0.0;\n            }}\n"
            "            status = along(a, da, dy);\n            made[known[k]] = "
            + " +\n                ".join(rows) + ";\n        }\n    }\n"
        ]  # fmt: skip


def _copies(address: str, references: Sequence[int], into: bool) -> list[str]:
    """Return one copy if the references are consecutive, otherwise one for each number."""
    first, n = references[0], len(references)
    if list(references) == list(range(first, first + n)):
        value = f"&v[{first}]"
        return [f"    gt_copy({address}, {value}, {n});\n" if into else f"    gt_copy({value}, {address}, {n});\n"]
    base = address if address.startswith("&") else f"&{address}"
    lines = []
    for k, r in enumerate(references):
        value, member = f"&v[{r}]", f"{base}[{k}]" if not address.startswith("&") else base
        lines.append(f"    gt_copy({member}, {value}, 1);\n" if into else f"    gt_copy({value}, {member}, 1);\n")
    return lines


LONGEST = 1e-3  # first step tried [s]
HALVINGS = 6
AIM = 1e-8  # error of a chosen step
ORDER = 16.0  # halving the step divides the error by this: order 4
MOST_STEPS = 200_000
AWAY = 0.1


def step_and_error(
    extended: WithStates, start: dict[Pair, float], step: float | None, tolerance: float, stop: float,
    guarded: bool = False,
) -> tuple[float, float]:  # fmt: skip
    """Return the step [s] and its error: the largest difference of a state from a run with half the step, relative to
    max(1, |state|).

    The runs go from the start to `stop`, or until the function fails. Inputs are held off their start by a tenth of
    their size, so that the states move.

    step: refused if its error is above `tolerance`; None: the longest of 1 ms, 0.5 ms, ... with an error of at most
    1e-8; if friction is too sharp for that, the longest with an error of at most `tolerance`. guarded: the error
    estimate of each substep must also stay below `tolerance`, see `_ends`, as the FMU checks each of its substeps.
    Raises ArgumentError also if the function fails soon after the start.
    """
    if step is not None and stop / step > MOST_STEPS:
        raise ArgumentError(f"{stop:g} s in steps of {step:g} s are more than {MOST_STEPS} steps", "step")
    moved = {p: start[p] + AWAY * max(1.0, abs(start[p])) for s in extended.known for p in s.pairs if not p[1]}
    start = {**start, **moved}
    candidates = [step] if step is not None else [LONGEST / 2**k for k in range(HALVINGS)]
    coarse, rough = _ends(extended, start, candidates[0], stop)
    error, last, good = math.inf, math.inf, None
    aim = tolerance if step is not None else min(AIM, tolerance)
    for n, h in enumerate(candidates):
        fine, rough_half = _ends(extended, start, h / 2, stop)
        shared = fine[::2][: len(coarse)]
        error = float(np.max(np.abs(shared - coarse[: len(shared)]) / np.maximum(1.0, np.abs(shared)), initial=0.0))
        smooth = not guarded or rough <= tolerance
        if error <= aim and smooth:
            return h, error
        if error <= tolerance and smooth and good is None:
            good = h, error
        if good is not None and error / ORDER ** (len(candidates) - n - 1) > aim:
            break
        coarse, last, rough = fine, rough, rough_half
    if good is not None:
        return good
    if error <= tolerance:
        raise ArgumentError(
            f"the error of one inner step of {candidates[-1]:g} s is {last:.1e}, more than {tolerance:g}; choose a "
            "smaller step, a larger tolerance, or smoother friction",
            "step",
        )
    raise ArgumentError(
        f"inner steps of {candidates[-1]:g} s have an error of {error:.1e} within {stop:g} s, more than {tolerance:g}; "
        "choose a smaller step, a larger tolerance, or smoother friction",
        "step",
    )


def _ends(extended: WithStates, start: dict[Pair, float], h: float, stop: float) -> tuple[np.ndarray, float]:
    """Return states (steps + 1, n) at the ends of equal steps until the function fails, and the largest error estimate.

    The estimate compares each step with a step of order 3, which uses the rates at its end as fourth stage; it is
    relative to max(1, |state|).
    """
    f, order = extended.function, [p for s in extended.states for p in s.pairs]
    targets = [p for s in f.outputs for p in s.pairs]
    place = {p: n for n, p in [*enumerate(targets, len(order)), *enumerate(order)]}
    rates = [place[i, m + 1] for i, m in order]
    inputs = [np.array([start[p] for p in s.pairs]) for s in f.inputs]
    moving = [
        (a, k, place[p]) for a, s in zip(inputs, f.inputs, strict=True) for k, p in enumerate(s.pairs) if p in order
    ]
    arguments = [a.reshape(s.shape) for a, s in zip(inputs, f.inputs, strict=True)]

    def rate(x: np.ndarray, t: float) -> np.ndarray | None:
        for a, k, state in moving:  # the arguments are views of these arrays
            a[k] = x[state]
        *results, status = f(*arguments, *([t] if f.plan.uses_time else []))
        return np.hstack([x, *[np.ravel(r) for r in results]])[rates] if status == Status.OK else None

    x = np.array([start[p] for p in order])
    rows = [x]
    n = max(1, math.ceil(stop / h - 1e-9))
    h = stop / n
    rough, k4 = 0.0, None
    for k in range(n):
        t = k * h
        k1 = rate(x, t)
        if k1 is not None and k4 is not None:
            rough = max(rough, float(np.max(np.abs(h / 6 * (k4 - k1)) / np.maximum(1.0, np.abs(x)), initial=0.0)))
        k2 = None if k1 is None else rate(x + h / 2 * k1, t + h / 2)
        k3 = None if k2 is None else rate(x + h / 2 * k2, t + h / 2)
        k4 = None if k3 is None else rate(x + h * k3, t + h)
        if k1 is None or k2 is None or k3 is None or k4 is None:
            break
        x = x + h / 6 * (k1 + k4 + 2 * (k2 + k3))
        rows.append(x)
    if len(rows) < min(n, 4):
        raise ArgumentError("the function fails within the first steps; change the start", "start")
    return np.array(rows), rough
