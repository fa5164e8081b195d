"""Directional derivatives of a causal function in C, also through Newton's solutions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ..cgen.body import body
from ..cgen.interface import Interface
from ..cgen.wrapper import scratch
from ..compiler.causal import CausalFunction
from ..compiler.derivative import given_by


@dataclass(frozen=True)
class TangentFiles:
    """C files by name, header to include, and text of the static function `along`: (a: inputs and Newton's unknowns,
    da: their changes, computed for the unknowns) -> dy."""

    files: dict[str, str]
    header: str
    text: str


def tangents(f: CausalFunction, face: Interface, name: str) -> TangentFiles:
    """Return files and functions for the FMU `name`."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    z = ca.vertcat(*zs) if zs else ca.SX(0, 1)
    n = x.numel()
    full = ca.vertcat(x, z)
    seed = ca.SX.sym("s", full.numel())
    prefix = f"gt_{name}_slope"
    kernels = [_function(f"{prefix}_out", [full, seed], [ca.jtimes(outputs, full, seed)])]
    first = n
    for k, kernel in enumerate(f.kernels):
        size = len(kernel.z0)
        a, u, s = (ca.SX.sym(c, w) for c, w in (("a", first), ("z", size), ("s", first)))
        r, jacobian = kernel.residual.call([u, a])
        kernels += [
            _function(f"{prefix}_matrix{k}", [a, u], [ca.vec(ca.densify(jacobian).T)]),
            _function(f"{prefix}_out{k}", [a, u, s], [ca.jtimes(r, a, s)]),
        ]
        first += size
    source, header = body(f"{name}_slope", [], kernels)
    file = f"gt_{name}_slope_body"
    return TangentFiles({f"{file}.c": source, f"{file}.h": header}, f"{file}.h", _along(face, prefix, n))


def _function(name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> ca.Function:
    return ca.Function(name, list(inputs), ca.cse([ca.densify(ca.SX(e)) for e in outputs]))


def _call(symbol: str, arguments: Sequence[str], result: str) -> str:
    lines = [*scratch(symbol), "\n"]
    lines += [f"    arg[{k}] = {a};\n" for k, a in enumerate(arguments)]
    lines += [f"    res[0] = {result};\n", f"    (void){symbol}(arg, res, iw, w, 0);\n"]
    return "    {\n" + "".join(f"    {line}" if line != "\n" else line for line in lines) + "    }\n"


def _solve(size: int, k: int, least: float) -> str:
    return (
        f"    smallest = DBL_MAX;\n    if (gt_newton_lu(matrix{k}, right, {size}, {least!r}, &smallest) == 0) {{\n"
        "        return GT_SINGULAR;\n    }\n"
    )


def _declared(face: Interface) -> str:
    if not face.newton:
        return ""
    most = max(s.size for s in face.newton)
    matrices = "".join(f"    double matrix{k}[{s.size**2}];\n" for k, s in enumerate(face.newton))
    return f"{matrices}    double right[{most}];\n    double smallest;\n    int k;\n\n"


def _along(face: Interface, prefix: str, n: int) -> str:
    """Return C that computes da of Newton's unknowns from da of the inputs, then dy."""
    lines = [
        f"static gt_status along(const double *a, double *da, double *dy)\n{{\n{_declared(face)}",
    ]
    offset = n
    for k, stage in enumerate(face.newton):
        lines += [
            _call(f"{prefix}_matrix{k}", ["a", f"&a[{offset}]"], f"matrix{k}"),
            _call(f"{prefix}_out{k}", ["a", f"&a[{offset}]", "da"], "right"),
            _solve(stage.size, k, 1e-300),
            f"    for (k = 0; k < {stage.size}; k++) {{\n        da[{offset} + k] = -right[k];\n    }}\n",
        ]
        offset += stage.size
    return "".join([*lines, _call(f"{prefix}_out", ["a", "da"], "dy"), "    return GT_OK;\n}\n\n"])
