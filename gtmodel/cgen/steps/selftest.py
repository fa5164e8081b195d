"""The self-test of step functions: a run of inputs, the statuses and outputs of each step as Python computed them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...results.status import Status
from ..part_vectors import table
from ..text import hexadecimal
from .function import StepFace
from .records import StepMember, dtype_of

ROWS = 24  # steps of a run
SEED = 0


def run(face: StepFace, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outputs (rows,), zero where none were written yet, statuses (rows,) and the last state, from the declared start.

    Raises ValueError where the declared start is refused.
    """
    f = face.function
    start, state = face.started()
    twin = f.twin(face.real)
    status = twin.init(state, start)
    if status != Status.OK:
        raise ValueError(f"the declared start is refused: {status.message}")
    rows = np.zeros(len(inputs), dtype_of(f.outputs, face.real))
    codes = np.zeros(len(inputs), int)
    out = np.zeros((), dtype_of(f.outputs, face.real))
    for k in range(len(inputs)):
        codes[k] = twin.step(state, inputs[k : k + 1].reshape(()), out)
        rows[k] = out
    return rows, codes, state


def step_test(face: StepFace) -> tuple[str, str]:
    """Text of the comparison of a step function, and the name of what returns its failures."""
    f, key, symbol = face.function, face.key, face.symbol
    inputs = f.examples(ROWS, SEED, face.real)
    outputs, codes, _ = run(face, inputs)
    given, flags = _numbers(inputs, f.inputs)
    wanted, counts = _numbers(outputs, f.outputs)
    text = table(f"{key}_step_inputs[{ROWS}][{len(given[0])}]", [list(map(hexadecimal, r)) for r in given])
    text += table(f"{key}_step_outputs[{ROWS}][{len(wanted[0])}]", [list(map(hexadecimal, r)) for r in wanted])
    if flags[0]:
        text += _integers(f"{key}_step_flags[{ROWS}][{len(flags[0])}]", flags)
    if counts[0]:
        text += _integers(f"{key}_step_counts[{ROWS}][{len(counts[0])}]", counts)
    names = ", ".join(Status(int(s)).c_name for s in codes)
    text += f"static const gt_status {key}_step_status[{ROWS}] = {{{names}}};\n\n"
    lines = [
        f"static int {key}_step_failures(double *worst)\n{{\n",
        f"    {symbol}_start start;\n    {symbol}_state state;\n    {symbol}_in in;\n    {symbol}_out out;\n",
        "    int failures;\n    int row;\n\n",
        f"    {symbol}_defaults(&start);\n",
        f"    failures = ({symbol}_init(&state, &start) == GT_OK) ? 0 : 1;\n",
        *["        in.unused = 0.0;\n" for _ in range(not f.inputs)],
        *[f"    {e} = {'0' if m.integer else '0.0'};\n" for m in f.outputs for e in m.elements("out.")],
        f"    for (row = 0; row < {ROWS}; row++) {{\n        int good = 1;\n\n",
        *_places(f.inputs, "in.", key, "inputs", "flags", fill=True),
        f"        good &= ({symbol}_step(&state, &in, &out) == {key}_step_status[row]) ? 1 : 0;\n",
        *_places(f.outputs, "out.", key, "outputs", "counts", fill=False),
        "        failures += (good != 0) ? 0 : 1;\n    }\n    return failures;\n}\n\n",
    ]
    return text + "".join(lines), f"{key}_step_failures"


def _numbers(rows: np.ndarray, members: Sequence[StepMember]) -> tuple[list, list]:
    """Rows of all numbers and of all integers."""
    reals = [[float(x) for m in members if not m.integer for x in np.ravel(row[m.identifier])] or [0.0] for row in rows]
    return reals, [[int(x) for m in members if m.integer for x in np.ravel(row[m.identifier])] for row in rows]


def _integers(declarator: str, rows: list[list[int]]) -> str:
    lines = ",\n".join("    {" + ", ".join(map(str, row)) + "}" for row in rows)
    return f"static const int {declarator} = {{\n{lines}\n}};\n\n"


def _places(members: Sequence[StepMember], struct: str, key: str, reals: str, integers: str, fill: bool) -> list[str]:
    lines, at, of_integers = [], 0, 0
    for m in members:
        if m.integer:
            for e in m.elements(struct):
                stored = f"{key}_step_{integers}[row][{of_integers}]"
                lines.append(f"        {e} = {stored};\n" if fill else f"        good &= ({e} == {stored}) ? 1 : 0;\n")
                of_integers += 1
            continue
        stored = f"&{key}_step_{reals}[row][{at}]"
        if fill:
            lines.append(f"        gt_copy({m.address(struct)}, {stored}, {m.count});\n")
        else:
            lines.append(f"        good &= gt_all_equal({m.address(struct)}, {stored}, {m.count}, worst);\n")
        at += m.count
    return lines
