"""Derivatives of a causal function in C along a seed: exact, through Newton's solutions too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ..cgen.body import body
from ..cgen.interface import Interface
from ..cgen.wrapper import scratch
from ..compiler.causal import CausalFunction


@dataclass(frozen=True)
class TangentFiles:
    """C files by name, the header to include, and text of the static function `along`: (a: inputs and unknowns of
    Newton, da: their changes, of the unknowns computed) -> dy."""

    files: dict[str, str]
    header: str
    text: str


def given_by(f: CausalFunction) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
    """Symbols of the inputs, of the unknowns of Newton, and all outputs as a column."""
    args = f.closed.sx_in()
    blocks = len(f.kernels)
    inputs = args[: len(args) - blocks]
    results = f.closed.call(args)[: len(f.outputs)]
    return inputs, args[len(args) - blocks :], ca.vertcat(*[ca.densify(ca.SX(r)) for r in results])


def depends(f: CausalFunction) -> list[set[int]]:
    """Of each output number which input numbers it depends on."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    n = x.numel()
    of_z: list[set[int]] = []
    for kernel, z in zip(f.kernels, zs, strict=True):
        a, own = ca.SX.sym("a", len(kernel.a0)), ca.SX.sym("z", z.numel())
        r = kernel.residual.call([own, a])[0]
        columns = set(ca.jacobian_sparsity(r, a).get_triplet()[1])
        inner = {c for c in columns if c < n}
        for c in columns - inner:
            inner |= of_z[c - n]
        of_z += [inner] * z.numel()
    full = ca.vertcat(x, *zs)
    rows, columns = ca.jacobian_sparsity(outputs, full).get_triplet()
    result: list[set[int]] = [set() for _ in range(outputs.numel())]
    for r, c in zip(rows, columns, strict=True):
        result[r] |= {c} if c < n else of_z[c - n]
    return result


def tangents(f: CausalFunction, face: Interface, name: str) -> TangentFiles:
    """Files and functions for the unit `name`."""
    inputs, zs, outputs = given_by(f)
    x = ca.vertcat(*inputs) if inputs else ca.SX(0, 1)
    z = ca.vertcat(*zs) if zs else ca.SX(0, 1)
    n = x.numel()
    full = ca.vertcat(x, z)
    seed = ca.SX.sym("s", full.numel())
    own = f"gt_{name}_slope"
    kernels = [_function(f"{own}_out", [full, seed], [ca.jtimes(outputs, full, seed)])]
    first = n
    for k, kernel in enumerate(f.kernels):
        size = len(kernel.z0)
        a, u, s = (ca.SX.sym(c, w) for c, w in (("a", first), ("z", size), ("s", first)))
        r, jacobian = kernel.residual.call([u, a])
        kernels += [
            _function(f"{own}_matrix{k}", [a, u], [ca.vec(ca.densify(jacobian).T)]),
            _function(f"{own}_out{k}", [a, u, s], [ca.jtimes(r, a, s)]),
        ]
        first += size
    source, header = body(f"{name}_slope", [], kernels)
    file = f"gt_{name}_slope_body"
    return TangentFiles({f"{file}.c": source, f"{file}.h": header}, f"{file}.h", _along(face, own, n))


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
    own = "".join(f"    double matrix{k}[{s.size**2}];\n" for k, s in enumerate(face.newton))
    return f"{own}    double right[{most}];\n    double smallest;\n    int k;\n\n"


def _along(face: Interface, own: str, n: int) -> str:
    """da of the inputs is given, that of Newton's unknowns follows, then dy."""
    lines = [
        f"static gt_status along(const double *a, double *da, double *dy)\n{{\n{_declared(face)}",
    ]
    at = n
    for k, stage in enumerate(face.newton):
        lines += [
            _call(f"{own}_matrix{k}", ["a", f"&a[{at}]"], f"matrix{k}"),
            _call(f"{own}_out{k}", ["a", f"&a[{at}]", "da"], "right"),
            _solve(stage.size, k, 1e-300),
            f"    for (k = 0; k < {stage.size}; k++) {{\n        da[{at} + k] = -right[k];\n    }}\n",
        ]
        at += stage.size
    return "".join([*lines, _call(f"{own}_out", ["a", "da"], "dy"), "    return GT_OK;\n}\n\n"])
