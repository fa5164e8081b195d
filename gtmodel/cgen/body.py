"""gt_<name>_body.c and .h: CasADi's code without the parts that a controller does not need."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path

import casadi as ca

from ..results.disk import scratch
from .interface import Interface, linkage, macro
from .jacobian_function import renamed
from .loops import SOLVER, loop_text
from .real import GenerationError, comment

_EXPORTED = re.compile(r"^CASADI_SYMBOL_EXPORT [^\n]*?(\w+)\([^\n]*\{(?:[^\n]*\}\n|.*?^\}\n)\n?", re.M | re.S)
_CONSTANT = re.compile(r"^static const casadi_int (casadi_s\d+)\[[^\n]*;\n", re.M)
# CasADi's helpers, such as casadi_sq, have external linkage: a compiler for shared code must call them, not inline them
_HELPER = re.compile(r"^(casadi_real|casadi_int|void) (?=casadi_\w+\()", re.M)
# gcc calls libm for fmin and fmax, because no instruction treats NaN as they do. This expression gives the same bits,
# also for NaN (the result is the other argument) and for zeros of different signs (the result is the first); if y is
# constant it takes one comparison.
_INLINE = {
    name: (
        re.compile(rf"^(casadi_real casadi_{name}\(casadi_real x, casadi_real y\) \{{)\n.*?^\}}\n", re.M | re.S),
        rf"\1 return (x {order} y || y != y) ? x : y;}}\n",
    )
    for name, order in (("fmin", "<="), ("fmax", ">="))
}
_INLINE["fabs"] = (
    re.compile(r"^(casadi_real casadi_fabs\(casadi_real x\) \{)\n.*?^\}\n", re.M | re.S),
    r"\1 return fabs(x);}\n",
)
# CasADi's helpers for tables convert an integer and declare a name twice, of which strict compilers warn
_STRICT = (
    ("(x-g0)*(ng-1)/dg", "(x-g0)*(casadi_real) (ng-1)/dg"),
    ("  do {\n    casadi_int i, j;\n", "  do {\n    casadi_int j;\n"),
)
_FUNCTION = re.compile(r"^/\* (\w+):\([^\n]*\n.*?^\}\n", re.M | re.S)
# our own calls pass no null pointer: CasADi's test of each pointer costs two instructions. Calls of external functions
# by CasADi do.
_NULL_CHECKS = (
    (re.compile(r"\bif \(res\[\d+\]!=0\) (?=res\[)"), ""),
    (re.compile(r"\barg\[(\d+)\]\? (arg\[\1\]\[\d+\]) : 0;"), r"\2;"),
)
_ABOUT_HEADER = (
    "Generated bodies without guards: call the functions of gt_{name}.h instead. "
    "No pointer may be NULL. SZ_*: numbers of argument pointers, result pointers, scratch integers and scratch doubles."
)
_END = '} /* extern "C" */\n#endif\n'
# a body: signature and declarations, then the statements
_BODY = re.compile(
    r"^(static int casadi_f\d+\(const casadi_real\*\* arg, casadi_real\*\* res, casadi_int\* iw, casadi_real\* w, "
    r"int mem\) \{\n"
    r"(?:  casadi_(?:real|int) [^;=]*;\n)*)(.*?^\}\n)",
    re.M | re.S,
)
# a kernel: residual, then Jacobian
_RESIDUAL = re.compile(r"\A(?P<residual>.*^  res\[0\]\[\d+\]=[^\n]*\n)(?P<jacobian>.*)\Z", re.M | re.S)
_PARAMETERS = ("arg", "res", "iw", "w", "mem")
# return statements of bodies; helpers return values
_RETURNED = re.compile(r"^  return ([^;]*);$", re.M)
SIZES = ("SZ_ARG", "SZ_RES", "SZ_IW", "SZ_W")


def casadi_functions(face: Interface) -> list[ca.Function]:
    """Return the functions of `face` under their C names, with the instructions that Python evaluates; without a body
    that is written with loops.

    The functions are built again instead of called, because a call would simplify and might round differently. Raises
    GenerationError if an output is not dense.
    """
    if face.stages is None:
        functions = [renamed(face.function, face.body).closed]
    else:
        functions = [g for stage in face.newton for g in (stage.prepare, stage.kernel)]
        functions += [face.stages.body] if face.loops is None else []
    for name, g in zip(face.bodies, functions, strict=face.loops is None):
        if g.name() != name or not all(g.sparsity_out(n).is_dense() for n in range(g.n_out())):
            raise GenerationError(
                f"the function '{face.key}' has a sparse output or no C name; this is a gtmodel error"
            )
    return functions


def body(name: str, faces: list[Interface], kernels: Sequence[ca.Function] = ()) -> tuple[str, str]:
    """Return the texts of the C file and of its header; `kernels` are further bodies under their C names."""
    prefix = f"gt_{name}_body"
    generator = ca.CodeGenerator(f"{prefix}.c", {"with_header": True, "prefix": prefix})
    for face in faces:
        for function in casadi_functions(face):
            generator.add(function)
    for kernel in kernels:
        generator.add(kernel)
    with scratch() as folder:
        source = Path(generator.generate(f"{folder}/"))
        text, declarations = source.read_text(), source.with_suffix(".h").read_text()
        # CasADi reports no error if the disk is full
        if not all(part.endswith(_END) for part in (text, declarations)):
            raise GenerationError(f"the code in the temporary folder {folder} is incomplete; free space, or set TMPDIR")
    if "#error" in text:
        raise GenerationError("CasADi cannot write C for one of the functions: its text holds an #error line")
    rolled = [(face.body, face.loops) for face in faces if face.loops is not None]
    symbols = {symbol for face in faces for symbol in face.bodies} - {symbol for symbol, _ in rolled}
    symbols |= {kernel.name() for kernel in kernels}
    text = trimmed(text, prefix, symbols, [stage.kernel.name() for face in faces for stage in face.newton])
    if rolled:
        text += "\n" + SOLVER + "\n".join(loop_text(symbol, loops) for symbol, loops in rolled)
    return text, _header(declarations, name, faces, kernels)


def trimmed(text: str, prefix: str, symbols: set[str], kernels: Collection[str] = ()) -> str:
    """Return CasADi's text without its functions for introspection and with our headers included. The bodies `kernels`
    return before the Jacobian if the caller passes no pointer for it."""
    text = _EXPORTED.sub(lambda m: m[0] if m[1] in symbols else "", text)
    text = text.replace("/* Configuration this file was compiled with */\n", "")
    for constant in _CONSTANT.findall(text):
        if len(re.findall(rf"\b{constant}\b", text)) == 2:  # its #define and its definition
            text = re.sub(rf"^(#define {constant} |static const casadi_int {constant}\[)[^\n]*\n", "", text, flags=re.M)
    include = "#include <math.h>\n"
    if text.count(include) != 1 or any(f" {symbol}(" not in text for symbol in symbols):
        raise GenerationError(f"CasADi {ca.CasadiMeta.version()} writes C in a form that gtmodel does not know")
    text = text.replace(include, f'#include "gt_float.h"\n#include "{prefix}.h"\n\n{include}')
    for name, (definition, inline) in _INLINE.items():
        text, replaced = definition.subn(inline, text)
        if replaced != (f" casadi_{name}(" in text):
            raise GenerationError(f"CasADi {ca.CasadiMeta.version()} writes {name} in an unknown form")
    if any(returned != "0" and not returned.startswith("casadi_f") for returned in _RETURNED.findall(text)):
        raise GenerationError(
            f"CasADi {ca.CasadiMeta.version()} writes a body that can fail, which gtmodel does not know"
        )
    text = _BODY.sub(_with_unused, text)
    text = _FUNCTION.sub(lambda m: _direct(m[0]) if m[1] in symbols else m[0], text)
    for loose, strict in _STRICT:
        text = text.replace(loose, strict)
    text = _HELPER.sub(r"static inline \1 ", text)
    for kernel in sorted(kernels):
        text = _residual_alone(text, kernel)
    lines = [line.rstrip() for line in text.splitlines()]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip("\n") + "\n"


def _direct(function: str) -> str:
    for null_check, direct in _NULL_CHECKS:
        function = null_check.sub(direct, function)
    return function


def _residual_alone(text: str, kernel: str) -> str:
    """Insert a return after the residual of a kernel, for calls without a pointer for the Jacobian."""
    head, begin, rest = text.partition(f"/* {kernel}:(")
    function, end, rest = rest.partition("\n}\n")
    parts = _RESIDUAL.match(function)
    if not begin or parts is None or "res[1]" in parts["residual"]:
        raise GenerationError(
            f"CasADi {ca.CasadiMeta.version()} writes '{kernel}' in a form that gtmodel does not know"
        )
    function = f"{parts['residual']}  if (res[1] == 0) {{ return 0; }}\n{parts['jacobian']}"
    return f"{head}{begin}{function}{end}{rest}"


def _with_unused(function: re.Match[str]) -> str:
    """Mark the unused parameters of a body with (void); CasADi gives the same parameters to all bodies."""
    unused = [name for name in _PARAMETERS if not re.search(rf"\b{name}\b", function[2])]
    return function[1] + "".join(f"  (void){name};\n" for name in unused) + function[2]


def _header(declarations: str, name: str, faces: list[Interface], kernels: Sequence[ca.Function]) -> str:
    guard = f"GT_{name.upper()}_BODY_H"
    parts = [
        comment([_ABOUT_HEADER.format(name=name)]),
        f'#ifndef {guard}\n#define {guard}\n\n#ifdef __cplusplus\nextern "C" {{\n#endif\n\n',
        f"#ifndef {linkage(name)}\n#define {linkage(name)}\n#endif\n\n",
    ]
    rolled = {face.body: face.loops.body for face in faces if face.loops is not None}
    for symbol in [*[symbol for face in faces for symbol in face.bodies], *[kernel.name() for kernel in kernels]]:
        if symbol in rolled:
            numbers = [rolled[symbol].arguments, len(rolled[symbol].outputs), 0, 0]
        else:
            numbers = [_stated(declarations, symbol, size) for size in SIZES]
        parts += [f"#define {macro(symbol)}_{size} {n}\n" for size, n in zip(SIZES, numbers, strict=True)]
        parts.append(
            f"{linkage(name)} int {symbol}"
            "(const double **arg, double **res, long long int *iw, double *w, int mem);\n\n"
        )
    parts.append("#ifdef __cplusplus\n}\n#endif\n\n#endif\n")
    return "".join(parts)


def _stated(declarations: str, symbol: str, size: str) -> int:
    number = re.search(rf"^#define {symbol}_{size} (\d+)$", declarations, re.M)
    if number is None:
        raise GenerationError(f"CasADi {ca.CasadiMeta.version()} does not state {size} of '{symbol}'")
    return int(number[1])
