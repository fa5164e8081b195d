"""A step function, such as a filter or a sampled block, as the content of an FMU: one step at each sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..cgen.generation import contents
from ..cgen.real import DOUBLE
from ..cgen.steps.function import StepFunction, StepMember, faces_of
from .causal_content import KEY, needed
from .content import FmuContent
from .table import FmuTable, FmuVariable, fmi_name, longer, unused

_SAME = """\
gt_status gt_fmu_compute(gt_fmu_memory *memory, double *v)
{
    (void)memory;
    (void)v;
    return GT_OK;
}

"""
_NO_DERIVATIVES = """\
gt_status gt_fmu_along(const gt_fmu_memory *memory, const double *v, const double *seed, double *made, int adjoint)
{
    (void)memory;
    (void)v;
    (void)seed;
    (void)made;
    (void)adjoint;
    return GT_SINGULAR;
}
"""


def step_content(
    f: StepFunction, name: str, *, title: str = "", stop: float = 1.0, provenance: Mapping[str, str] | None = None
) -> FmuContent:
    """Return the content of the FMU `name`: inputs and outputs of the step, and its declared start as parameters.

    The FMU takes samples at the start and after every period, with the inputs of that instant; outputs change only
    then. Before the first sample an output has the value of the parameter `start.NAME` if there is one, otherwise zero.
    """
    _, (face,) = faces_of({KEY: f}, name, (), DOUBLE, None)
    step_table = _StepTable(f)
    symbol = face.symbol
    texts = contents([], name, dict(provenance or {}), [face])
    files = needed(texts, name)
    parameters = step_table.parameters
    started = {r: [parameters[key]] for key, r in step_table.outputs.items() if key in parameters}
    depends = {v.reference: started.get(v.reference, []) for v in step_table.variables if v.role == "output"}
    table = FmuTable(
        name, title or f.title, step_table.variables, depends,
        period=f.period, stop=stop, derivatives=False,
    )  # fmt: skip
    begin = [
        f"gt_status gt_fmu_begin(gt_fmu_memory *memory, double *v)\n{{\n    {symbol}_start start;\n"
        "    gt_status status;\n\n",
        f"    {symbol}_defaults(&start);\n",
        *[f"    {place} = v[{r}];\n" for place, r in step_table.places(f.start, "start.", parameters)],
        "" if parameters else "    (void)v;\n",
        f"    status = {symbol}_init(&memory->state, &start);\n",
        "    if (status != GT_OK) {\n        return status;\n    }\n",
        *[f"    v[{r}] = v[{parameters[key]}];\n" for key, r in step_table.outputs.items() if key in parameters],
        "    return GT_OK;\n}\n\n",
    ]
    sample = [
        f"gt_status gt_fmu_sample(gt_fmu_memory *memory, double *v, int *n)\n{{\n    {symbol}_in in;\n"
        f"    {symbol}_out out;\n    gt_status status;\n\n",
        "" if f.inputs else "    in.unused = 0.0;\n",
        *[f"    {p} = {_value(m, r, table)};\n" for p, r, m in step_table.members(f.inputs, "in.", step_table.inputs)],
        *[
            f"    {p} = {_value(m, r, table)};\n"
            for p, r, m in step_table.members(f.outputs, "out.", step_table.outputs)
        ],
        f"    status = {symbol}_step(&memory->state, &in, &out);\n",
        "    if (status != GT_OK) {\n        return status;\n    }\n",
        *[
            f"    {_value(m, r, table)} = {p};\n"
            for p, r, m in step_table.members(f.outputs, "out.", step_table.outputs)
        ],
        "" if table.integers else "    (void)n;\n",
        "    return GT_OK;\n}\n\n",
    ]
    functions = "".join([*begin, _SAME, *sample, _NO_DERIVATIVES])
    memory = f"    {symbol}_state state;\n"
    return FmuContent(table, files, f"gt_{name}.h", memory, functions)


def _value(m: StepMember, reference: int, table: FmuTable) -> str:
    return f"n[{reference - len(table.numbers)}]" if m.integer else f"v[{reference}]"


class _StepTable:
    """Value references of the members of a step function: numbers first, then integers."""

    def __init__(self, f: StepFunction) -> None:
        self.variables: list[FmuVariable] = [FmuVariable(0, "time", "s", "", "time")]
        self.inputs: dict[tuple[str, int], int] = {}
        self.parameters: dict[tuple[str, int], int] = {}
        self.outputs: dict[tuple[str, int], int] = {}
        begin = {m.identifier: f.complete(DOUBLE)[m.identifier] for m in f.inputs}
        for integer in (False, True):
            self._add(f.inputs, self.inputs, "input", begin, integer)
            if not integer:
                declared = {m.identifier: f.defaults[m.name] for m in f.start}
                self._add(f.start, self.parameters, "fixed", declared, integer, "start.")
            initial = {m.identifier: f.defaults[m.name] for m in f.outputs if m.name in f.defaults and not integer}
            self._add(f.outputs, self.outputs, "output", initial, integer)

    def _add(
        self,
        members: Sequence[StepMember],
        places: dict[tuple[str, int], int],
        role: Any,
        start: Mapping[str, Any],
        integer: bool,
        before: str = "",
    ) -> None:
        for m in members:
            if m.integer is not integer:
                continue
            values = np.ravel(np.asarray(start.get(m.identifier, 0.0), float))
            if integer:
                values = np.zeros(m.count)
            for k in range(m.count):
                word = before + fmi_name(m.name)
                index = "" if m.size is None else f"[{k + 1}]"
                taken = {v.name for v in self.variables}
                name = f"{word}{index}"
                name = unused(name if name not in taken else longer(word, "_out") + index, taken)
                number = float(values[k] if len(values) == m.count else values[0])
                places[m.identifier, k] = len(self.variables)
                self.variables.append(
                    FmuVariable(
                        len(self.variables), name, "1" if m.unit in ("", "?") else m.unit, m.description, role,
                        start=int(number) if integer else number, integer=integer, sampled=True,
                    )
                )  # fmt: skip

    def members(
        self, members: Sequence[StepMember], struct: str, places: Mapping[tuple[str, int], int]
    ) -> list[tuple[str, int, StepMember]]:
        """Return C expression, value reference and member of each number."""
        return [(e, places[m.identifier, k], m) for m in members for k, e in enumerate(m.elements(struct))]

    def places(
        self, members: Sequence[StepMember], struct: str, places: Mapping[tuple[str, int], int]
    ) -> list[tuple[str, int]]:
        """Return C expressions of the numbers of members, and their value references."""
        reals = [m for m in members if not m.integer]
        return [(e, places[m.identifier, k]) for m in reals for k, e in enumerate(m.elements(struct))]
