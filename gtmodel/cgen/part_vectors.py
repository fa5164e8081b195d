"""What each generated body computes by itself, for the self-test.

A guard sees only on which side of its limit a margin lies, and Newton's method forgives a derivative that is a
little wrong: compared bit for bit, every constant of a body shows.
"""

from __future__ import annotations

import numpy as np

from ..compiler.rows import map_columns
from .body import casadi_functions
from .interface import Interface, places
from .real import DOUBLE
from .text import hexadecimal
from .virtual_machine import run
from .wrapper import scratch

ROWS = 3  # inputs with a solution of each function


def part_vectors(face: Interface, inputs: np.ndarray, outputs: np.ndarray) -> list[tuple[list[np.ndarray], np.ndarray]]:
    """Arguments and results (rows, m) of each body at inputs that have a solution; Newton's bodies at the solution."""
    evaluated = map_columns if face.real is DOUBLE else run
    known = [inputs[:, at].T for at, _ in places(face.inputs)]
    first, vectors = face.output_size, []
    functions = iter(casadi_functions(face))
    for stage in face.newton:
        z = outputs[:, first : first + stage.size].T
        prepared = evaluated(next(functions), known)
        seen = evaluated(next(functions), [z, prepared[0]])
        vectors += [_rows(known, prepared), _rows([z, prepared[0]], seen)]
        first += stage.size
        known = [*known, z]
    results = evaluated(next(functions), known) if face.loops is None else face.loops.body.evaluate(known)
    vectors.append(_rows(known, results))
    return vectors


def _rows(arguments: list[np.ndarray], results: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    return [a.T for a in arguments], np.vstack(results).T


def part_comparisons(face: Interface, inputs: np.ndarray, outputs: np.ndarray) -> tuple[str, list[str]]:
    """Text of a static function for each body, with its tables, and the functions' names."""
    text, names = "", []
    sizes_of = [[g.numel_out(k) for k in range(g.n_out())] for g in casadi_functions(face)]
    sizes_of += [face.loops.body.outputs] if face.loops is not None else []
    vectors = part_vectors(face, inputs, outputs)
    for symbol, (arguments, results), sizes in zip(face.bodies, vectors, sizes_of, strict=True):
        name = f"{face.key}{symbol.removeprefix(face.symbol)}"
        names.append(f"{name}_differences")
        text += _comparison(symbol, name, arguments, results, sizes)
    return text, names


def _comparison(symbol: str, name: str, arguments: list[np.ndarray], results: np.ndarray, sizes: list[int]) -> str:
    rows, width = results.shape
    given = np.column_stack([*arguments, *([] if any(a.shape[1] for a in arguments) else [np.zeros(rows)])])
    places = np.cumsum([0, *[a.shape[1] for a in arguments]])[:-1].tolist()
    lines = [
        table(f"{name}_given[{rows}][{given.shape[1]}]", [list(map(hexadecimal, r)) for r in given.tolist()]),
        table(f"{name}_found[{rows}][{width}]", [list(map(hexadecimal, r)) for r in results.tolist()]),
        f"static int {name}_differences(double *worst)\n{{\n",
        *scratch(symbol),
        f"    double y[{width}];\n    int failures = 0;\n    int row;\n\n",
        f"    for (row = 0; row < {rows}; row++) {{\n",
        *[f"        arg[{k}] = &{name}_given[row][{place}];\n" for k, place in enumerate(places)],
        *[f"        res[{k}] = &y[{place}];\n" for k, place in enumerate(np.cumsum([0, *sizes])[:-1]) if sizes[k]],
        *[f"        res[{k}] = y;\n" for k, size in enumerate(sizes) if not size],
        f"        (void){symbol}(arg, res, iw, w, 0);\n",
        f"        failures += (gt_all_equal(y, {name}_found[row], {width}, worst) != 0) ? 0 : 1;\n    }}\n",
        "    return failures;\n}\n\n",
    ]
    return "".join(lines)


def table(declarator: str, rows: list[list[str]]) -> str:
    """A constant array of rows of numbers."""
    lines = ",\n".join("    {" + ", ".join(row) + "}" for row in rows)
    return f"static const double {declarator} = {{\n{lines}\n}};\n\n"
