"""gt_<name>.c: each function guarded, so that a caller sees a status and never a guess."""

from __future__ import annotations

from ..compiler.blocks import Margin
from ..compiler.causal import PIVOT_TOLERANCE
from ..results.status import Status
from .errors import GenerationError
from .interface import Interface
from .text import comment, decimal


def wrapper(name: str, faces: list[Interface]) -> str:
    """Text of the guarded functions.

    The order of the decisions is that of CausalFunction.status: inputs finite, margins in their order,
    outputs finite; the first cause wins.
    """
    parts = [
        comment([f"gt_{name}: guards round the bodies in gt_{name}_body.c; see gt_{name}.h."]),
        f'#include "gt_{name}.h"\n\n#include "gt_{name}_body.h"\n#include "gt_guard.h"\n\n#include <math.h>\n\n',
        comment(["A pivot below this fraction of its typical size means singular."]),
        f"#define GT_PIVOT_TOLERANCE ({decimal(PIVOT_TOLERANCE)})\n\n",
        *[_function(face) for face in faces],
    ]
    return "".join(parts).rstrip("\n") + "\n"


def _function(face: Interface) -> str:
    m, margins = face.macro, face.function.margins
    arguments, results = len(face.inputs), len(face.outputs) + 1
    unused = "" if face.inputs else "    (void)in;\n"
    lines = [
        f"#if ({m}_SZ_ARG < {arguments}) || ({m}_SZ_RES < {results})\n"
        f'#error "the body of {face.symbol} is from another generation"\n#endif\n\n',
        f"gt_status {face.symbol}(const {face.symbol}_in *in, {face.symbol}_out *out)\n{{\n",
        f"    {face.symbol}_out y;\n",
        f"    double margins[{max(1, len(margins))}];\n",
        f"    const double *arg[{m}_SZ_ARG + 1]; /* + 1: C knows no empty array */\n",
        f"    double *res[{m}_SZ_RES + 1];\n",
        f"    long long int iw[{m}_SZ_IW + 1];\n",
        f"    double w[{m}_SZ_W + 1];\n\n",
        unused,
        *[_guard(f"gt_all_finite({x.address('in->')}, {x.size})", Status.NOT_FINITE) for x in face.inputs],
        *[f"    arg[{n}] = {x.address('in->')};\n" for n, x in enumerate(face.inputs)],
        *[f"    res[{n}] = {y.address('y.')};\n" for n, y in enumerate(face.outputs)],
        f"    res[{results - 1}] = margins;\n",
        _guard(f"{face.body}(arg, res, iw, w, 0) == 0", Status.NOT_CONVERGED),
        *[_margin(n, margin) for n, margin in enumerate(margins)],
        *[_guard(f"gt_all_finite({y.address('y.')}, {y.size})", Status.NOT_FINITE) for y in face.outputs],
        f"    *out = y;\n    return {Status.OK.c_name};\n}}\n\n",
    ]
    return "".join(lines)


def _guard(good: str, otherwise: Status, why: str = "") -> str:
    note = comment([why], "    ") if why else ""
    return f"{note}    if (!({good})) {{\n        return {otherwise.c_name};\n    }}\n"


def _margin(n: int, margin: Margin) -> str:
    if margin.kind == "discriminant":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"discriminant of {margin.label}")
    if margin.kind == "condition":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"condition on the inputs: {margin.label}")
    if margin.kind != "pivot":
        raise GenerationError(f"the margin of {margin.label} is of the kind '{margin.kind}', which C does not know yet")
    test = f"fabs(margins[{n}]) > (GT_PIVOT_TOLERANCE * {decimal(margin.scale)})"
    return _guard(test, Status.SINGULAR, f"pivot of {margin.label}")
