"""gt_<name>_selftest.c: inputs, statuses and outputs computed by Python, for whole functions, for their single bodies
and for runs of step functions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..compiler.rows import map_columns
from ..results.status import Status
from .body import casadi_functions
from .interface import Interface, Member, places
from .newton_steps import run
from .points import awkward, draw, evaluate
from .real import DOUBLE, comment, hexadecimal
from .steps.function import StepFace, StepMember, dtype_of
from .wrapper import elements, scratch

ROWS = 3  # inputs with a solution, for the bodies of each function


def part_vectors(face: Interface, inputs: np.ndarray, outputs: np.ndarray) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """Return arguments and results (rows, m) of each body at inputs with a solution; Newton kernels at the solution."""
    evaluated = map_columns if face.real is DOUBLE else run
    columns = [inputs[:, span].T for span, _ in places(face.inputs)]
    first, vectors = face.output_size, []
    functions = iter(casadi_functions(face))
    for stage in face.newton:
        z = outputs[:, first : first + stage.size].T
        prepared = evaluated(next(functions), columns)
        kernel_results = evaluated(next(functions), [z, prepared[0]])
        vectors += [_rows(columns, prepared), _rows([z, prepared[0]], kernel_results)]
        first += stage.size
        columns = [*columns, z]
    results = evaluated(next(functions), columns) if face.loops is None else face.loops.body.evaluate(columns)
    vectors.append(_rows(columns, results))
    return vectors


def _rows(arguments: list[np.ndarray], results: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    return [a.T for a in arguments], np.vstack(results).T


def part_comparisons(face: Interface, inputs: np.ndarray, outputs: np.ndarray) -> tuple[str, list[str]]:
    """Return the text of a static test function for each body, with its tables, and the functions' names."""
    text, names = "", []
    sizes_of = [[g.numel_out(k) for k in range(g.n_out())] for g in casadi_functions(face)]
    sizes_of += [face.loops.body.outputs] if face.loops is not None else []
    vectors = part_vectors(face, inputs, outputs)
    for symbol, (arguments, results), sizes in zip(face.bodies, vectors, sizes_of, strict=True):
        name = f"{face.key}{symbol.removeprefix(face.symbol)}"
        names.append(f"{name}_differences")
        text += _part_comparison(symbol, name, arguments, results, sizes)
    return text, names


def _part_comparison(symbol: str, name: str, arguments: list[np.ndarray], results: np.ndarray, sizes: list[int]) -> str:
    rows, width = results.shape
    stacked = np.column_stack([*arguments, *([] if any(a.shape[1] for a in arguments) else [np.zeros(rows)])])
    offsets = np.cumsum([0, *[a.shape[1] for a in arguments]])[:-1].tolist()
    lines = [
        table(f"{name}_given[{rows}][{stacked.shape[1]}]", [list(map(hexadecimal, r)) for r in stacked.tolist()]),
        table(f"{name}_found[{rows}][{width}]", [list(map(hexadecimal, r)) for r in results.tolist()]),
        f"static int {name}_differences(double *worst)\n{{\n",
        *scratch(symbol),
        f"    double y[{width}];\n    int failures = 0;\n    int row;\n\n",
        f"    for (row = 0; row < {rows}; row++) {{\n",
        *[f"        arg[{k}] = &{name}_given[row][{offset}];\n" for k, offset in enumerate(offsets)],
        *[f"        res[{k}] = &y[{offset}];\n" for k, offset in enumerate(np.cumsum([0, *sizes])[:-1]) if sizes[k]],
        *[f"        res[{k}] = y;\n" for k, size in enumerate(sizes) if not size],
        f"        (void){symbol}(arg, res, iw, w, 0);\n",
        f"        failures += (gt_all_equal(y, {name}_found[row], {width}, worst) != 0) ? 0 : 1;\n    }}\n",
        "    return failures;\n}\n\n",
    ]
    return "".join(lines)


def table(declarator: str, rows: list[list[str]]) -> str:
    """Return the text of a constant array of rows of numbers."""
    lines = ",\n".join("    {" + ", ".join(row) + "}" for row in rows)
    return f"static const double {declarator} = {{\n{lines}\n}};\n\n"


STEPS = 24  # steps of a run
SEED = 0


def selftest_run(face: StepFace, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run the twin from the declared start. Returns outputs (rows,), zero until first written, statuses (rows,) and the
    last state.

    Raises ValueError if `init` returns an error for the declared start.
    """
    f = face.function
    start, state = face.started()
    twin = f.twin(face.real)
    status = twin.init(state, start)
    if status != Status.OK:
        raise ValueError(f"the declared start cannot be used: {status.message}")
    rows = np.zeros(len(inputs), dtype_of(f.outputs, face.real))
    codes = np.zeros(len(inputs), int)
    out = np.zeros((), dtype_of(f.outputs, face.real))
    for k in range(len(inputs)):
        codes[k] = twin.step(state, inputs[k : k + 1].reshape(()), out)
        rows[k] = out
    return rows, codes, state


def step_test(face: StepFace) -> tuple[str, str]:
    """Return the text of the test of a step function, and the name of the C function that counts its failures."""
    f, key, symbol = face.function, face.key, face.symbol
    inputs = f.examples(STEPS, SEED, face.real)
    outputs, codes, _ = selftest_run(face, inputs)
    input_rows, flags = _numbers(inputs, f.inputs)
    output_rows, counts = _numbers(outputs, f.outputs)
    text = table(f"{key}_step_inputs[{STEPS}][{len(input_rows[0])}]", [list(map(hexadecimal, r)) for r in input_rows])
    wide = len(output_rows[0])
    text += table(f"{key}_step_outputs[{STEPS}][{wide}]", [list(map(hexadecimal, r)) for r in output_rows])
    if flags[0]:
        text += _integers(f"{key}_step_flags[{STEPS}][{len(flags[0])}]", flags)
    if counts[0]:
        text += _integers(f"{key}_step_counts[{STEPS}][{len(counts[0])}]", counts)
    names = ", ".join(Status(int(s)).c_name for s in codes)
    text += f"static const gt_status {key}_step_status[{STEPS}] = {{{names}}};\n\n"
    lines = [
        f"static int {key}_step_failures(double *worst)\n{{\n",
        f"    {symbol}_start start;\n    {symbol}_state state;\n    {symbol}_in in;\n    {symbol}_out out;\n",
        "    int failures;\n    int row;\n\n",
        f"    {symbol}_defaults(&start);\n",
        f"    failures = ({symbol}_init(&state, &start) == GT_OK) ? 0 : 1;\n",
        *["        in.unused = 0.0;\n" for _ in range(not f.inputs)],
        *[f"    {e} = {'0' if m.integer else '0.0'};\n" for m in f.outputs for e in m.elements("out.")],
        f"    for (row = 0; row < {STEPS}; row++) {{\n        int good = 1;\n\n",
        *_places(f.inputs, "in.", key, "inputs", "flags", fill=True),
        f"        good &= ({symbol}_step(&state, &in, &out) == {key}_step_status[row]) ? 1 : 0;\n",
        *_places(f.outputs, "out.", key, "outputs", "counts", fill=False),
        "        failures += (good != 0) ? 0 : 1;\n    }\n    return failures;\n}\n\n",
    ]
    return text + "".join(lines), f"{key}_step_failures"


def _numbers(rows: np.ndarray, members: Sequence[StepMember]) -> tuple[list, list]:
    """Return the rows of all reals and of all integers."""
    reals = [[float(x) for m in members if not m.integer for x in np.ravel(row[m.identifier])] or [0.0] for row in rows]
    return reals, [[int(x) for m in members if m.integer for x in np.ravel(row[m.identifier])] for row in rows]


def _integers(declarator: str, rows: list[list[int]]) -> str:
    lines = ",\n".join("    {" + ", ".join(map(str, row)) + "}" for row in rows)
    return f"static const int {declarator} = {{\n{lines}\n}};\n\n"


def _places(members: Sequence[StepMember], struct: str, key: str, reals: str, integers: str, fill: bool) -> list[str]:
    lines, column, integer_column = [], 0, 0
    for m in members:
        if m.integer:
            for e in m.elements(struct):
                stored = f"{key}_step_{integers}[row][{integer_column}]"
                lines.append(f"        {e} = {stored};\n" if fill else f"        good &= ({e} == {stored}) ? 1 : 0;\n")
                integer_column += 1
            continue
        stored = f"&{key}_step_{reals}[row][{column}]"
        if fill:
            lines.append(f"        gt_copy({m.address(struct)}, {stored}, {m.count});\n")
        else:
            lines.append(f"        good &= gt_all_equal({m.address(struct)}, {stored}, {m.count}, worst);\n")
        column += m.count
    return lines


CANDIDATES = 400
GOOD, BAD = 12, 3  # vectors of each function with GT_OK, and with each other status that turns up


def vectors(face: Interface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return chosen inputs (rows, n), with a NaN and an infinity among them, outputs (rows, m) and statuses (rows,)."""
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
    """Return the text of the self-test; vectors with a status other than OK test that the outputs are held."""
    tests = [_tests(face) for face in faces]
    tests += [(text, [test]) for text, test in map(step_test, steps)]
    calls = "".join(f"    failures += {test}(worst);\n" for _, names in tests for test in names)
    parts = [
        comment([f"gt_{name}: results of Python with all their bits, compared with those of C."]),
        f'#include "gt_{name}.h"\n\n#include "gt_{name}_body.h"\n',
        '#include "gt_compare.h"\n#include "gt_guard.h"\n\n#include <math.h>\n\n',
        comment(["Value of the outputs before a call, and after a call that failed."]),
        f"#define GT_HELD ({[*faces, *steps][0].real.held!r})\n\n",
        *[text for text, _ in tests],
        f"static int total(double *worst)\n{{\n    int failures = 0;\n\n{calls}    return failures;\n}}\n\n",
        f"int gt_{name}_selftest(void)\n{{\n    double worst = 0.0;\n\n    return total(&worst);\n}}\n\n",
        f"double gt_{name}_selftest_difference(void)\n{{\n    double worst = 0.0;\n\n"
        "    (void)total(&worst);\n    return worst;\n}\n",
    ]
    return "".join(parts)


def _tests(face: Interface) -> tuple[str, list[str]]:
    """Return the tests of a function and of its bodies, and the names of the C functions that count failures."""
    inputs, outputs, status = vectors(face)
    good = np.flatnonzero(status == Status.OK)[:ROWS]
    text, names = part_comparisons(face, inputs[good], outputs[good]) if len(good) else ("", [])
    tables = _tables(face, inputs, outputs, status)
    return f"{tables}{_comparison(face)}{text}", [f"{face.key}_failures", *names]


def _tables(face: Interface, inputs: np.ndarray, outputs: np.ndarray, status: np.ndarray) -> str:
    output_rows = [
        list(map(hexadecimal, row))
        if s == Status.OK
        else ["GT_HELD"] * face.output_size + list(map(hexadecimal, start[face.input_size :]))
        for row, start, s in zip(outputs.tolist(), inputs.tolist(), status.tolist(), strict=True)
    ]
    input_rows = [list(map(hexadecimal, row)) for row in inputs.tolist()]
    codes = ", ".join(Status(int(s)).c_name for s in status)
    n = len(status)
    home = [[hexadecimal(x) for stage in face.newton for x in face.real.array(stage.home).tolist()]]
    tables = [
        table(f"{face.key}_home[1][{face.state_size}]", home) if face.newton else "",
        table(f"{face.key}_inputs[{n}][{inputs.shape[1]}]", input_rows) if inputs.shape[1] else "",
        table(f"{face.key}_outputs[{n}][{outputs.shape[1]}]", output_rows),
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
        f"        gt_copy({m.address(struct)}, &{table}[row][{span.start}], {m.size});\n"
        for span, m in places(members, first)
    ]


def _compare(members: tuple[Member, ...], struct: str, table: str, first: int = 0, row: str = "row") -> list[str]:
    return [
        f"        good &= gt_all_equal({m.address(struct)}, &{table}[{row}][{span.start}], {m.size}, worst);\n"
        for span, m in places(members, first)
    ]
