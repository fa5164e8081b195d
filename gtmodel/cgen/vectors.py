"""gt_<name>_selftest.c: inputs, statuses and outputs as Python computed them, with all their bits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..results.status import Status
from .interface import Interface, Member, places
from .part_vectors import ROWS, part_comparisons, table
from .points import awkward, draw, evaluate
from .steps.function import StepFace
from .steps.selftest import step_test
from .text import comment, hexadecimal
from .wrapper import elements

CANDIDATES = 400
GOOD, BAD = 12, 3  # vectors of each function with GT_OK, and with each other status that turns up


def vectors(face: Interface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Chosen inputs (rows, n), outputs (rows, m) and statuses (rows,), a NaN and an infinity among them."""
    inputs = np.concatenate([draw(face, CANDIDATES, seed=0), awkward(face)])
    _, status = evaluate(face, inputs)
    chosen: list[int] = []
    for code in Status:
        chosen += np.flatnonzero(status == code)[: GOOD if code == Status.OK else BAD].tolist()
    inputs = inputs[chosen]
    if inputs.shape[1]:
        bad = np.repeat(inputs[:1], 2, axis=0)
        bad[0, 0], bad[1, -1] = np.nan, np.inf
        inputs = np.concatenate([inputs, bad])
    outputs, status = evaluate(face, inputs)
    return inputs, outputs, status


def selftest(name: str, faces: list[Interface], steps: Sequence[StepFace] = ()) -> str:
    """Text of the self-test; a vector whose status is not ok proves that the outputs are held."""
    tests = [_tests(face) for face in faces]
    tests += [(text, [test]) for text, test in map(step_test, steps)]
    calls = "".join(f"    failures += {test}(worst);\n" for _, names in tests for test in names)
    parts = [
        comment([f"gt_{name}: results of Python with all their bits, and the comparison with them."]),
        f'#include "gt_{name}.h"\n\n#include "gt_{name}_body.h"\n',
        '#include "gt_compare.h"\n#include "gt_guard.h"\n\n#include <math.h>\n\n',
        comment(["What stands in the outputs before a call, and after one that fails."]),
        f"#define GT_HELD ({[*faces, *steps][0].real.held!r})\n\n",
        *[text for text, _ in tests],
        f"static int total(double *worst)\n{{\n    int failures = 0;\n\n{calls}    return failures;\n}}\n\n",
        f"int gt_{name}_selftest(void)\n{{\n    double worst = 0.0;\n\n    return total(&worst);\n}}\n\n",
        f"double gt_{name}_selftest_difference(void)\n{{\n    double worst = 0.0;\n\n"
        "    (void)total(&worst);\n    return worst;\n}\n",
    ]
    return "".join(parts)


def _tests(face: Interface) -> tuple[str, list[str]]:
    """Text of the comparisons of a function and of its bodies, and the names of what returns their failures."""
    inputs, outputs, status = vectors(face)
    good = np.flatnonzero(status == Status.OK)[:ROWS]
    text, names = part_comparisons(face, inputs[good], outputs[good]) if len(good) else ("", [])
    tables = _tables(face, inputs, outputs, status)
    return f"{tables}{_comparison(face)}{text}", [f"{face.key}_failures", *names]


def _tables(face: Interface, inputs: np.ndarray, outputs: np.ndarray, status: np.ndarray) -> str:
    held = [
        list(map(hexadecimal, row))
        if s == Status.OK
        else ["GT_HELD"] * face.output_size + list(map(hexadecimal, start[face.input_size :]))
        for row, start, s in zip(outputs.tolist(), inputs.tolist(), status.tolist(), strict=True)
    ]
    given = [list(map(hexadecimal, row)) for row in inputs.tolist()]
    codes = ", ".join(Status(int(s)).c_name for s in status)
    n = len(status)
    home = [[hexadecimal(x) for stage in face.newton for x in face.real.array(stage.home).tolist()]]
    tables = [
        table(f"{face.key}_home[1][{face.state_size}]", home) if face.newton else "",
        table(f"{face.key}_inputs[{n}][{inputs.shape[1]}]", given) if inputs.shape[1] else "",
        table(f"{face.key}_outputs[{n}][{outputs.shape[1]}]", held),
        f"static const gt_status {face.key}_status[{n}] = {{{codes}}};\n\n",
    ]
    return "".join(tables)


def _comparison(face: Interface) -> str:
    symbol, key = face.symbol, face.key
    rows = f"(int)(sizeof({key}_status) / sizeof({key}_status[0]))"
    lines = [
        f"static int {key}_failures(double *worst)\n{{\n",
        f"    const int rows = {rows};\n    int failures = 0;\n    int row;\n\n",
        "    for (row = 0; row < rows; row++) {\n",
        f"        {symbol}_in in;\n        {symbol}_out out;\n",
        f"        {symbol}_state state;\n" if face.newton else "",
        "        int good = 1;\n\n",
        f"        {symbol}_start(&state);\n" if face.newton else "",
        *_compare(face.state, "state.", f"{key}_home", row="0"),
        *([] if face.inputs else ["        in.unused = 0.0;\n"]),
        *_fill(face.inputs, "in.", f"{key}_inputs"),
        *_fill(face.state, "state.", f"{key}_inputs", face.input_size),
        *[f"        {number} = GT_HELD;\n" for m in face.outputs for number in elements(m, "out.")],
        f"        good &= ({symbol}({'&state, ' if face.newton else ''}&in, &out) == {key}_status[row]) ? 1 : 0;\n",
        *_compare(face.outputs, "out.", f"{key}_outputs"),
        *_compare(face.state, "state.", f"{key}_outputs", face.output_size),
        "        failures += (good != 0) ? 0 : 1;\n    }\n    return failures;\n}\n\n",
    ]
    return "".join(lines)


def _fill(members: tuple[Member, ...], struct: str, table: str, first: int = 0) -> list[str]:
    return [
        f"        gt_copy({m.address(struct)}, &{table}[row][{at.start}], {m.size});\n"
        for at, m in places(members, first)
    ]


def _compare(members: tuple[Member, ...], struct: str, table: str, first: int = 0, row: str = "row") -> list[str]:
    return [
        f"        good &= gt_all_equal({m.address(struct)}, &{table}[{row}][{at.start}], {m.size}, worst);\n"
        for at, m in places(members, first)
    ]
