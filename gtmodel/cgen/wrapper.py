"""gt_<name>.c: each function guarded, so that a caller sees a status and never a guess."""

from __future__ import annotations

from collections.abc import Sequence

from ..compiler.blocks import Margin
from ..compiler.emission import express
from ..results.status import Status
from .interface import Interface, Member, macro, places
from .newton_stages import NewtonStage
from .real import GenerationError, comment, decimal
from .steps.function import StepFace, definitions

_EACH_FINITE = """\
/* 1 if all numbers at n places of so many numbers are finite. It is asked where a sum of them is not. */
static GT_RARE int each_finite(const double *const *place, const int *size, int n)
{
    int good = 1;
    int i;

    for (i = 0; i < n; i++) {
        good &= gt_all_finite(place[i], size[i]);
    }
    return good;
}

"""


_NEWTON = """\
/* Newton's method, once for all functions of this file. */
static GT_SHARED gt_status solve(gt_newton_kernel kernel, const double **arg, double **res, long long int *iw,
                                 double *w, int n, const double *nominal, const double *largest, double least,
                                 double *z, gt_newton_marks *marks)
{
    return gt_newton(kernel, arg, res, iw, w, n, nominal, largest, least, z, marks);
}

"""


def wrapper(name: str, faces: list[Interface], steps: Sequence[StepFace] = ()) -> str:
    """Text of the guarded functions.

    The order of the decisions is that of CausalFunction.status: inputs finite, not too large, margins in their order,
    outputs finite; the first cause wins. Before a Newton block come the margins that do not wait for it. A closed form
    is computed first and its margins judged then; one sum asks for all outputs.
    """
    newton = '#include "gt_newton.h"\n' if any(face.newton for face in faces) else ""
    newton += "".join(
        f'#include "{file}"\n' for file in dict.fromkeys(s.function.runtime[0] for s in steps if s.function.runtime)
    )
    parts = [
        comment([f"gt_{name}: guards round the bodies in gt_{name}_body.c; see gt_{name}.h."]),
        f'#include "gt_{name}.h"\n\n#include "gt_{name}_body.h"\n#include "gt_guard.h"\n{newton}\n',
        "#include <math.h>\n\n",
        comment(["Below this fraction of its typical size a pivot means singular, and a branch is left."]),
        f"#define GT_PIVOT_TOLERANCE ({decimal([*faces, *steps][0].real.pivot)})\n\n",
        _EACH_FINITE if faces else "",
        _NEWTON if any(face.newton for face in faces) else "",
        *[_start(face) + _function(face) + _along(face) for face in faces],
        *[definitions(face) for face in steps],
    ]
    return "".join(parts).rstrip("\n") + "\n"


def prototype(face: Interface) -> str:
    """Declaration of the guarded function, without the semicolon."""
    state = f"{face.symbol}_state *state, " if face.newton else ""
    return f"gt_status {face.symbol}({state}const {face.symbol}_in *in, {face.symbol}_out *out)"


def prototype_along(face: Interface) -> str:
    """Declaration of the function along a sampled reference."""
    return f"gt_status {face.symbol}_at(const gt_traj *reference, uint64_t time_ms, {face.symbol}_out *out)"


def _along(face: Interface) -> str:
    """The function at a time of a reference: its row becomes the inputs."""
    if not face.along:
        return ""
    size = face.input_size
    fill = [f"    gt_copy({m.address('in.')}, &row[{at.start}], {m.size});\n" for at, m in places(face.inputs)]
    return (
        f"{prototype_along(face)}\n{{\n    {face.symbol}_in in;\n    double row[{size}];\n    gt_status status;\n\n"
        + _guard(f"reference->columns == {size}U", Status.OUT_OF_RANGE)
        + f"    status = gt_traj_at(reference, time_ms, row);\n    if (status != {Status.OK.c_name}) {{\n"
        "        return status;\n    }\n"
        f"{''.join(fill)}    return {face.symbol}(&in, out);\n}}\n\n"
    )


def _function(face: Interface) -> str:
    margins = face.stages.margins if face.stages else face.function.margins
    known = [x.address("in->") for x in face.inputs]
    unknowns = [f"z{k}" for k in range(len(face.newton))]
    results = [*[y.address("y.") for y in face.outputs], "margins"]
    blocks = [_block(face, k, stage) for k, stage in enumerate(face.newton)]
    solve = [
        f"    status = solve_{face.key}{k}({_given(k)}, z{k}, &state->marks);\n"
        f"    if (status != {Status.OK.c_name}) {{\n        return status;\n    }}\n"
        for k in range(len(blocks))
    ]
    gather = [f"    known[{n}] = {address};\n" for n, address in enumerate(known)] if blocks else []
    lines = [
        *blocks,
        _size_check(face.body, face.symbol, len(known) + len(blocks), len(results)),
        f"{prototype(face)}\n{{\n",
        f"    {face.symbol}_out y;\n",
        f"    double margins[{max(1, len(margins))}];\n",
        "    double total;\n" if face.inputs else "",
        *scratch(face.body),
        *[f"    double {z}[{stage.size}];\n" for z, stage in zip(unknowns, face.newton, strict=True)],
        *([f"    const double *known[{max(1, len(known))}];\n    gt_status status;\n"] if blocks else []),
        "\n",
        "" if face.inputs else "    (void)in;\n",
        _sizes(face),
        *([_finite(face.state, "state->")] if blocks else []),
        *gather,
        *_copies(face, into_state=False),
        *solve,
        *[f"    arg[{n}] = {address};\n" for n, address in enumerate([*known, *unknowns])],
        *[f"    res[{n}] = {address};\n" for n, address in enumerate(results)],
        f"    (void){face.body}(arg, res, iw, w, 0); /* it returns 0 whatever happens */\n",
        *[_margin(n, margins[n]) for n in _distinct(face)],
        _finite(face.outputs, "y."),
        *_copies(face, into_state=True),
        f"    *out = y;\n    return {Status.OK.c_name};\n}}\n\n",
    ]
    return "".join(lines)


def _start(face: Interface) -> str:
    """The function that puts a state to the home pose."""
    if not face.newton:
        return ""
    home = iter([x for stage in face.newton for x in stage.home])
    lines = [f"    {target} = {decimal(next(home))};\n" for m in face.state for target in elements(m, "state->")]
    marks = "".join(f"    state->marks.{mark} = 0.0;\n" for mark in ("step", "pivot", "residual"))
    return f"void {face.symbol}_start({face.symbol}_state *state)\n{{\n{''.join(lines)}{marks}}}\n\n"


def elements(m: Member, struct: str) -> list[str]:
    """C expressions of the numbers of a member."""
    return [f"{struct}{m.identifier}[{k}]" for k in range(m.size)] if m.is_array else [f"{struct}{m.identifier}"]


def _block(face: Interface, k: int, stage: NewtonStage) -> str:
    """A static function that solves one Newton block."""
    prepare, kernel = f"{face.symbol}_prepare{k}", f"{face.symbol}_kernel{k}"
    given = len(face.inputs) + k
    n = stage.size
    label = ", ".join(s.name for s in stage.unknowns)
    lines = [
        _size_check(prepare, face.symbol, given, 2),
        _size_check(kernel, face.symbol, 2, 2),
        comment([f"Newton in {label}, from z."]),
        f"static gt_status solve_{face.key}{k}({_parameters(k)}, double *z, gt_newton_marks *marks)\n",
        "{\n",
        f"    static const double nominal[{n}] = {{{', '.join(map(decimal, stage.nominal))}}};\n",
        f"    static const double largest[{n}] = {{{', '.join(map(decimal, stage.largest))}}};\n",
        f"    double constants[{max(1, stage.constants)}];\n",
        f"    double residual[{n}];\n    double jacobian[{n * n}];\n",
        *scratch(kernel),
        "\n    {\n",
        f"        double margins[{max(1, len(stage.margins))}];\n",
        *[f"    {line}" for line in scratch(prepare, "prepare_")],
        "\n",
        *[f"        prepare_arg[{i}] = known[{i}];\n" for i in range(len(face.inputs))],
        *[f"        prepare_arg[{len(face.inputs) + i}] = z{i};\n" for i in range(k)],
        "        prepare_res[0] = constants;\n        prepare_res[1] = margins;\n",
        f"        (void){prepare}(prepare_arg, prepare_res, prepare_iw, prepare_w, 0);\n",
        *[_indented(_margin(i, margin)) for i, margin in enumerate(stage.margins)],
        "    }\n",
        "    arg[0] = z;\n    arg[1] = constants;\n    res[0] = residual;\n    res[1] = jacobian;\n",
        f"    return solve({kernel}, arg, res, iw, w, {n}, nominal, largest, {decimal(stage.least)}, z, marks);\n",
        "}\n\n",
    ]
    return "".join(lines)


def _parameters(k: int) -> str:
    return ", ".join(["const double *const *known", *[f"const double *z{i}" for i in range(k)]])


def _given(k: int) -> str:
    return ", ".join(["known", *[f"z{i}" for i in range(k)]])


def _indented(text: str) -> str:
    return "".join(f"    {line}\n" for line in text.splitlines())


def scratch(body: str, prefix: str = "") -> list[str]:
    """Declarations of what a body is called with."""
    m = macro(body)
    return [
        f"    const double *{prefix}arg[{m}_SZ_ARG + 1]; /* + 1: C knows no empty array */\n",
        f"    double *{prefix}res[{m}_SZ_RES + 1];\n",
        f"    long long int {prefix}iw[{m}_SZ_IW + 1];\n",
        f"    double {prefix}w[{m}_SZ_W + 1];\n",
    ]


def _size_check(body: str, symbol: str, arguments: int, results: int) -> str:
    m = macro(body)
    return (
        f"#if ({m}_SZ_ARG < {arguments}) || ({m}_SZ_RES < {results})\n"
        f'#error "the body of {symbol} is from another generation"\n#endif\n\n'
    )


def _copies(face: Interface, into_state: bool) -> list[str]:
    """Statements that copy the last solution to or from the unknowns of the blocks."""
    lines, block, first = [], 0, 0
    for m in face.state:
        here, there = f"&z{block}[{first}]", m.address("state->")
        to, of = (there, here) if into_state else (here, there)
        lines.append(f"    gt_copy({to}, {of}, {m.size});\n")
        first += m.size
        if first == face.newton[block].size:
            block, first = block + 1, 0
    return lines


def _distinct(face: Interface) -> list[int]:
    """Which margins of the body to test: of two that are the same expression the first decides."""
    margins = face.stages.margins if face.stages else face.function.margins
    expressions = express(face.function.plan, [m.expression for m in margins])
    first: dict[tuple[int, str, float], int] = {}
    for n, (m, e) in enumerate(zip(margins, expressions, strict=True)):
        first.setdefault((e.element_hash(), m.kind, m.scale), n)
    return sorted(first.values())


def _guard(good: str, otherwise: Status, why: str = "") -> str:
    note = comment([why], "    ") if why else ""
    return f"{note}    if (!({good})) {{\n        return {otherwise.c_name};\n    }}\n"


def _sizes(face: Interface) -> str:
    """The guard that inputs are not too large, which NaN and infinity are not either; it asks which only then."""
    if not face.inputs:
        return ""
    parts = []
    for weight, inputs in face.sizes.groups:
        squares = _sum([f"({x} * {x})" for n in inputs for x in elements(face.inputs[n], "in->")], 12, 2)
        parts.append(squares if weight == 1.0 else f"({decimal(weight)} * ({squares}))")
    given = [m.address("in->") for m in face.inputs] + [m.address("state->") for m in face.state]
    sizes = [m.size for m in (*face.inputs, *face.state)]
    total = " +\n            ".join(parts)
    return (
        comment(["The norm of the inputs, each in units of what it may be."], "    ")
        + f"    total = {total};\n    if (!(total <= {decimal(face.sizes.most)})) {{\n{_places(given, sizes)}"
        f"        return (each_finite(place, size, {len(given)}) != 0) ? {Status.OUT_OF_RANGE.c_name} : "
        f"{Status.NOT_FINITE.c_name};\n    }}\n"
    )


def _places(addresses: list[str], sizes: list[int]) -> str:
    """Declarations of what each_finite is asked about."""
    return (
        f"        static const int size[{len(sizes)}] = {{{', '.join(map(str, sizes))}}};\n"
        f"        const double *place[{len(sizes)}];\n\n"
        + "".join(f"        place[{n}] = {address};\n" for n, address in enumerate(addresses))
    )


def _finite(members: tuple[Member, ...], struct: str) -> str:
    """The guard that all numbers are finite: if their sum is, they are; only a sum that is not asks each of them."""
    terms = [x for m in members for x in elements(m, struct)]
    if not terms:
        return ""
    return (
        f"    if (!(fabs({_sum(terms, 15)}) <= DBL_MAX)) {{\n"
        + _places([m.address(struct) for m in members], [m.size for m in members])
        + _indented(_guard(f"each_finite(place, size, {len(members)})", Status.NOT_FINITE))
        + "    }\n"
    )


def _sum(terms: list[str], indent: int, width: int = 5) -> str:
    return (" +\n" + " " * indent).join(" + ".join(terms[k : k + width]) for k in range(0, len(terms), width))


def _margin(n: int, margin: Margin) -> str:
    """The guard of a margin. A pivot is positive at home: that side is asked first."""
    if margin.kind == "discriminant":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"discriminant of {margin.label}")
    if margin.kind == "condition":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"condition on the inputs: {margin.label}")
    least = f"GT_PIVOT_TOLERANCE * {decimal(margin.scale)}"
    if margin.kind == "branch":
        return _guard(f"margins[{n}] > ({least})", Status.WRONG_BRANCH, f"the solution lies on {margin.label}")
    if margin.kind != "pivot":
        raise GenerationError(f"the margin of {margin.label} is of the kind '{margin.kind}', which C does not know yet")
    test = f"(margins[{n}] > ({least})) ||\n          (margins[{n}] < -({least}))"
    return _guard(test, Status.SINGULAR, f"pivot of {margin.label}")
