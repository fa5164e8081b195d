"""gt_<name>.c: guards round each body, so that a call returns either a checked result or the reason why not."""

from __future__ import annotations

from collections.abc import Sequence

from ..compiler.blocks import Margin
from ..compiler.emission import express
from ..results.status import Status
from .bounds import surely_finite
from .interface import Interface, Member, linkage, macro, places
from .newton_stages import NewtonStage
from .real import GenerationError, comment, decimal
from .steps.function import StepFace, definitions

_EACH_FINITE = """\
/* 1 if all numbers of n arrays, with `size` numbers each, are finite. Called only if a sum of them is not finite. */
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


_BOUNDED = "The limits of the inputs and the margins bound the outputs: they are finite."

_INLINE = """\
/* The bodies are small: a compiler that sees them here puts them into their guards, without pointers to arguments. */
#define CASADI_SYMBOL_EXPORT static
#define {macro} static
"""


_NEWTON = """\
/* Newton's method: one copy, shared by all functions of this file. */
static GT_SHARED gt_status solve(gt_newton_kernel kernel, const double **arg, double **res, long long int *iw,
                                 double *w, int n, const double *nominal, const double *largest, double least,
                                 double *z, gt_newton_marks *marks)
{
    return gt_newton(kernel, arg, res, iw, w, n, nominal, largest, least, z, marks);
}

"""


def wrapper(name: str, faces: list[Interface], steps: Sequence[StepFace] = (), inline: bool = False) -> str:
    """Return the text of the guarded functions; `inline`: with the bodies as static functions of the same file.

    The checks are in the order of CausalFunction.status: inputs finite, not too large, margins in their order, outputs
    finite unless limits and margins imply it; the first cause wins. Margins that do not depend on a Newton block are
    checked before the block. A closed form is evaluated first and its margins are checked afterwards. One sum checks
    all outputs.
    """
    newton = '#include "gt_newton.h"\n' if any(face.newton for face in faces) else ""
    newton += "".join(
        f'#include "{file}"\n' for file in dict.fromkeys(s.function.runtime[0] for s in steps if s.function.runtime)
    )
    parts = [
        comment([f"gt_{name}: guards round the bodies in gt_{name}_body.c; see gt_{name}.h."]),
        f'#include "gt_{name}.h"\n\n{_INLINE.format(macro=linkage(name)) if inline else ""}',
        f'#include "gt_{name}_body.{"c" if inline else "h"}"\n#include "gt_guard.h"\n{newton}\n',
        "#include <math.h>\n\n",
        comment(["A pivot below this fraction of its typical size is singular; a branch below it is left."]),
        f"#define GT_PIVOT_TOLERANCE ({decimal([*faces, *steps][0].real.pivot)})\n\n",
        _EACH_FINITE if faces else "",
        _NEWTON if any(face.newton for face in faces) else "",
        *[_start(face) + _function(face) + _along(face) for face in faces],
        *[definitions(face) for face in steps],
    ]
    return "".join(parts).rstrip("\n") + "\n"


def prototype(face: Interface) -> str:
    """Return the declaration of the guarded function, without the semicolon."""
    state = f"{face.symbol}_state *state, " if face.newton else ""
    return f"gt_status {face.symbol}({state}const {face.symbol}_in *in, {face.symbol}_out *out)"


def prototype_along(face: Interface) -> str:
    """Return the declaration of the function along a sampled reference, without the semicolon."""
    return f"gt_status {face.symbol}_at(const gt_traj *reference, uint64_t time_ms, {face.symbol}_out *out)"


def _along(face: Interface) -> str:
    """The function along a reference: the row at a time becomes the inputs."""
    if not face.along:
        return ""
    size = face.input_size
    fill = [f"    gt_copy({m.address('in.')}, &row[{span.start}], {m.size});\n" for span, m in places(face.inputs)]
    return (
        f"{prototype_along(face)}\n{{\n    {face.symbol}_in in;\n    double row[{size}];\n    gt_status status;\n\n"
        + _guard(f"reference->columns == {size}U", Status.OUT_OF_RANGE)
        + f"    status = gt_traj_at(reference, time_ms, row);\n    if (status != {Status.OK.c_name}) {{\n"
        "        return status;\n    }\n"
        f"{''.join(fill)}    return {face.symbol}(&in, out);\n}}\n\n"
    )


def _function(face: Interface) -> str:
    margins = face.stages.margins if face.stages else face.function.margins
    inputs = [x.address("in->") for x in face.inputs]
    unknowns = [f"z{k}" for k in range(len(face.newton))]
    results = [*[y.address("y.") for y in face.outputs], "margins"]
    blocks = [_block(face, k, stage) for k, stage in enumerate(face.newton)]
    solve = [
        f"    status = solve_{face.key}{k}({_given(k)}, z{k}, &state->marks);\n"
        f"    if (status != {Status.OK.c_name}) {{\n        return status;\n    }}\n"
        for k in range(len(blocks))
    ]
    gather = [f"    known[{n}] = {address};\n" for n, address in enumerate(inputs)] if blocks else []
    lines = [
        *blocks,
        _size_check(face.body, face.symbol, len(inputs) + len(blocks), len(results)),
        f"{prototype(face)}\n{{\n",
        f"    {face.symbol}_out y;\n",
        f"    double margins[{max(1, len(margins))}];\n",
        "    double total;\n" if face.inputs else "",
        *scratch(face.body),
        *[f"    double {z}[{stage.size}];\n" for z, stage in zip(unknowns, face.newton, strict=True)],
        *([f"    const double *known[{max(1, len(inputs))}];\n    gt_status status;\n"] if blocks else []),
        "\n",
        "" if face.inputs else "    (void)in;\n",
        _sizes(face),
        *([_finite(face.state, "state->")] if blocks else []),
        *gather,
        *_copies(face, into_state=False),
        *solve,
        *[f"    arg[{n}] = {address};\n" for n, address in enumerate([*inputs, *unknowns])],
        *[f"    res[{n}] = {address};\n" for n, address in enumerate(results)],
        f"    (void){face.body}(arg, res, iw, w, 0); /* always returns 0 */\n",
        # as in `compiler.rows.status_codes`, a pose that cannot be reached is no singular one
        *[_margin(n, margins[n]) for n in sorted(_distinct(face), key=lambda n: margins[n].kind != "condition")],
        comment([_BOUNDED], "    ") if surely_finite(face) else _finite(face.outputs, "y."),
        *_copies(face, into_state=True),
        f"    *out = y;\n    return {Status.OK.c_name};\n}}\n\n",
    ]
    return "".join(lines)


def _start(face: Interface) -> str:
    """The function that sets a state to the home pose."""
    if not face.newton:
        return ""
    home = iter([x for stage in face.newton for x in stage.home])
    lines = [f"    {target} = {decimal(next(home))};\n" for m in face.state for target in elements(m, "state->")]
    marks = "".join(f"    state->marks.{mark} = 0.0;\n" for mark in ("step", "pivot", "residual"))
    return f"void {face.symbol}_start({face.symbol}_state *state)\n{{\n{''.join(lines)}{marks}}}\n\n"


def elements(m: Member, struct: str) -> list[str]:
    """Return the C expressions of the numbers of a member."""
    return [f"{struct}{m.identifier}[{k}]" for k in range(m.size)] if m.is_array else [f"{struct}{m.identifier}"]


def _block(face: Interface, k: int, stage: NewtonStage) -> str:
    """A static function that solves one Newton block."""
    prepare, kernel = f"{face.symbol}_prepare{k}", f"{face.symbol}_kernel{k}"
    arguments = len(face.inputs) + k
    n = stage.size
    label = ", ".join(s.name for s in stage.unknowns)
    lines = [
        _size_check(prepare, face.symbol, arguments, 2),
        _size_check(kernel, face.symbol, 2, 2),
        comment([f"Newton's method for {label}, starting at z."]),
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
    """Return the declarations of the arguments of a body: pointers and scratch memory."""
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
    """Statements that copy the last solution to the state, or from it to the unknowns of the blocks."""
    lines, block, first = [], 0, 0
    for m in face.state:
        unknown, member = f"&z{block}[{first}]", m.address("state->")
        target, source = (member, unknown) if into_state else (unknown, member)
        lines.append(f"    gt_copy({target}, {source}, {m.size});\n")
        first += m.size
        if first == face.newton[block].size:
            block, first = block + 1, 0
    return lines


def _distinct(face: Interface) -> list[int]:
    """Indices of the margins to test in the body; of margins with the same expression only the first."""
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
    """The guard against too large inputs. NaN and infinity fail it too; only then each number is checked."""
    if not face.inputs:
        return ""
    parts = []
    for weight, inputs in face.sizes.groups:
        squares = _sum([f"({x} * {x})" for n in inputs for x in elements(face.inputs[n], "in->")], 12, 2)
        parts.append(squares if weight == 1.0 else f"({decimal(weight)} * ({squares}))")
    addresses = [m.address("in->") for m in face.inputs] + [m.address("state->") for m in face.state]
    sizes = [m.size for m in (*face.inputs, *face.state)]
    total = " +\n            ".join(parts)
    return (
        comment(["Sum of the squares of the inputs, weighted by their limits."], "    ")
        + f"    total = {total};\n    if (!(total <= {decimal(face.sizes.most)})) {{\n{_places(addresses, sizes)}"
        f"        return (each_finite(place, size, {len(addresses)}) != 0) ? {Status.OUT_OF_RANGE.c_name} : "
        f"{Status.NOT_FINITE.c_name};\n    }}\n"
    )


def _places(addresses: list[str], sizes: list[int]) -> str:
    """Declarations of the arrays that each_finite checks."""
    return (
        f"        static const int size[{len(sizes)}] = {{{', '.join(map(str, sizes))}}};\n"
        f"        const double *place[{len(sizes)}];\n\n"
        + "".join(f"        place[{n}] = {address};\n" for n, address in enumerate(addresses))
    )


def _finite(members: tuple[Member, ...], struct: str) -> str:
    """The guard that all numbers are finite: if their sum is, they are; only otherwise each number is checked."""
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
    """The guard of a margin. A pivot is positive at home, so that side is tested first."""
    if margin.kind == "discriminant":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"discriminant of {margin.label}")
    if margin.kind == "condition":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"condition on the inputs: {margin.label}")
    if margin.kind == "solution":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"the solution satisfies the input: {margin.label}")
    if margin.kind == "limit":
        return _guard(f"margins[{n}] >= 0.0", Status.OUT_OF_RANGE, f"limits of {margin.label}")
    if margin.kind == "turn":
        return _guard(f"margins[{n}] >= 0.0", Status.NOT_CONVERGED, f"the solution is {margin.label}")
    least = f"GT_PIVOT_TOLERANCE * {decimal(margin.scale)}"
    if margin.kind == "branch":
        return _guard(f"margins[{n}] > ({least})", Status.WRONG_BRANCH, f"the solution lies on {margin.label}")
    if margin.kind != "pivot":
        raise GenerationError(f"the margin of {margin.label} has the unsupported kind '{margin.kind}'")
    test = f"(margins[{n}] > ({least})) ||\n          (margins[{n}] < -({least}))"
    return _guard(test, Status.SINGULAR, f"pivot of {margin.label}")
