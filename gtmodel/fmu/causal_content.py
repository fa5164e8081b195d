"""A causal function as the content of a unit: its table, and C that joins table and function."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..cgen.generation import contents
from ..cgen.interface import Interface, interfaces
from ..compiler.causal import CausalFunction, c_name
from ..results.refusal import ArgumentError
from .content import FmuContent
from .parameters import with_parameters
from .table import FmuTable, FmuVariable, fmi_name, texts_of, unused
from .tangents import depends, tangents
from .with_states import WithStates, starts, with_states

KEY = "model"  # of the function in C: gt_<name>_model
# of what `contents` makes: what tests it
LEFT_OUT = ("gt_{}_selftest.c", "gt_{}_main.c", "gt_compare.h", "Makefile", "README.md")
Pair = tuple[int, int]


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
    """What the unit `name` holds, and the function that it computes.

    Raises ArgumentError for a model with events, names that are no inputs, a start without an answer.
    """
    made = with_states(f)
    if hold and made.states:
        raise ArgumentError("outputs can be held only where there are no states; leave it out", "on_fault")
    unknown = [n for n in tunable if n not in {s.name for s in made.known}]
    if unknown:
        known = ", ".join(s.name for s in made.known)
        raise ArgumentError(f"'{unknown[0]}' is no known variable of it; there are {known}", "tunable")
    begin = starts(made, start or {})
    if parameters:
        function, kept = with_parameters(made.function, parameters)
        made = replace(made, function=function, parameters=kept)
    (face,) = interfaces({KEY: made.function}, name)
    builder = _Table(made, face, begin, tunable, hold)
    table = FmuTable(
        name, title or f.flat.title, builder.variables, builder.dependencies(),
        [builder.place[p] for p in builder.states],
        [builder.rate(p) for p in builder.states], step=step, stop=stop, remembers=bool(face.newton), hold=hold,
        parameters=[builder.place[p] for s in made.parameters for p in s.pairs], part_error=part_error,
    )  # fmt: skip
    exact = tangents(made.function, face, name)
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
        table, {**files, **exact.files}, f"gt_{name}.h", memory, functions, made.function.plan.uses_time
    )
    return content, made


def needed(texts: Mapping[str, str], name: str) -> dict[str, str]:
    """The files that a library is made of."""
    out = {file.format(name) for file in LEFT_OUT}
    return {file: text for file, text in texts.items() if file not in out}


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
        made: WithStates,
        face: Interface,
        start: Mapping[Pair, float],
        tunable: Collection[str],
        hold: bool,
    ) -> None:
        self.made, self.face, self.f = made, face, made.function
        self.states = [p for s in made.states for p in s.pairs]
        self.place: dict[Pair, int] = {}  # of inputs and states, then of derivatives
        self.outputs: list[list[int]] = []  # value references of each number of the outputs of the function
        self.variables: list[FmuVariable] = []
        self.own = {self._name(p) for s in (*self.f.inputs, *self.f.outputs) for p in s.pairs}  # names of the model
        self._add("time", "s", "", "time")
        for s in sorted(made.known, key=lambda s: s.name in tunable):
            role = "tunable" if s.name in tunable else "input"
            for p in s.pairs:
                self.place[p] = self._signal(p, role, start=start[p])
        for i, k in (p for s in made.parameters for p in s.pairs):
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
        asked = sum(s.size for s in self.f.outputs[: made.asked])
        for p in numbers:
            own = p in rates and p not in self.place
            if own:
                self.place[p] = self._signal(p, "derivative", of_state=self.place[p[0], p[1] - 1])
            self.outputs.append([self.place[p]] if own else [])
        for n, p in enumerate(numbers[:asked]):
            self.outputs[n].append(self._output(p))
        if hold:
            self._add(self._new("status"), "1", "0: there is an answer; else the outputs are the last ones", "output",
                      integer=True)  # fmt: skip

    def rate(self, p: Pair) -> int:
        """Value reference of the derivative of a state."""
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
        """A variable of its own where the number is a state, a derivative or an input too."""
        if p not in self.place:
            return self._signal(p, "output")
        v = self.f.flat.variables[p[0]]
        base, bracket, index = self._named(v.name).rpartition("[")
        stem = base if bracket else index
        word = c_name(stem.replace("'", "")) if p[1] == 0 else f"{'d' if p[1] == 1 else f'd{p[1]}'}_{c_name(stem)}"
        name = f"{word}_out" + (f"[{index}" if bracket else "")
        return self._add(self._new(name), self.f.flat.unit_of(*p), f"{self._name(p)} as an output", "output")

    def _new(self, name: str) -> str:
        """A name that the model does not have."""
        return unused(name, self.own | {v.name for v in self.variables})

    def dependencies(self) -> dict[int, list[int]]:
        """By value reference of what is computed."""
        inputs = self.references()
        result = {}
        for places, on in zip(self.outputs, depends(self.f), strict=True):
            for r in places:
                result[r] = sorted({inputs[k] for k in on})
        return result | {v.reference: sorted(inputs) for v in self.variables if v.integer}

    def references(self) -> list[int]:
        """Of the numbers that the function takes, in their order."""
        return [*[self.place[p] for s in self.f.inputs for p in s.pairs], *([0] if self.f.plan.uses_time else [])]

    def begin(self) -> str:
        """C: Newton's start from the parameters."""
        lines = ["gt_status gt_fmu_begin(gt_fmu_memory *memory, double *v)\n{\n"]
        if self.face.newton:
            lines.append(f"    {self.face.symbol}_start(&memory->newton);\n")
            at = self.guess
            for m in self.face.state:
                lines.append(f"    gt_copy({m.address('memory->newton.')}, &v[{at}], {m.size});\n")
                at += m.size
        else:
            lines.append("    memory->none = (char)0;\n    (void)v;\n")
        return "".join([*lines, "    return GT_OK;\n}\n\n"])

    def compute(self) -> str:
        """C: the struct of inputs filled, the function called, its outputs copied."""
        symbol, refs = self.face.symbol, self.references()
        state = "&memory->newton, " if self.face.newton else ""
        lines = [
            f"gt_status gt_fmu_compute(gt_fmu_memory *memory, double *v)\n{{\n"
            f"    {symbol}_in in;\n    {symbol}_out out;\n"
            "    gt_status status;\n\n",
            "" if self.face.newton else "    (void)memory;\n",
            "" if self.face.inputs else "    in.unused = 0.0;\n",
        ]
        at = 0
        for m in self.face.inputs:
            lines += _copies(m.address("in."), refs[at : at + m.size], into=True)
            at += m.size
        lines.append(
            f"    status = {symbol}({state}&in, &out);\n    if (status != GT_OK) {{\n        return status;\n    }}\n"
        )
        at = 0
        for m in self.face.outputs:
            places = self.outputs[at : at + m.size]
            for which in range(max(map(len, places), default=0)):
                lines += _copies(m.address("out."), [p[which] for p in places], into=False)
            at += m.size
        return "".join([*lines, "    return GT_OK;\n}\n\n"])

    def along(self) -> str:
        """C: derivatives along a seed and against one."""
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
        at = n
        for member in self.face.state:
            lines.append(f"    gt_copy(&a[{at}], {member.address('memory->newton.')}, {member.size});\n")
            at += member.size
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
        """C: the adjoint, one input after the other; a function of its own would double the code."""
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
    """One copy where the references are in line, else one for each number."""
    first, n = references[0], len(references)
    if list(references) == list(range(first, first + n)):
        there = f"&v[{first}]"
        return [f"    gt_copy({address}, {there}, {n});\n" if into else f"    gt_copy({there}, {address}, {n});\n"]
    base = address if address.startswith("&") else f"&{address}"
    lines = []
    for k, r in enumerate(references):
        there, here = f"&v[{r}]", f"{base}[{k}]" if not address.startswith("&") else base
        lines.append(f"    gt_copy({here}, {there}, 1);\n" if into else f"    gt_copy({there}, {here}, 1);\n")
    return lines
