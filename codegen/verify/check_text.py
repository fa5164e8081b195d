"""Part of check_certificate.py: reads the operations of the bodies, and the tests, limits and results of the functions,
from the text of the C code. Whatever is unknown and could change their meaning is refused."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

# headers written by hand that the proofs rely on
PINNED = {
    "gt_float.h": "2e21774d2ede298e8b7015891df54d4fcefe01cd924ca8ca65e42718c6b10438",
    "gt_newton.h": "582f7df1f48a6a6a86db32cde37110016c0269bc21ec8af2cf9a968f46b83f22",
}
_BODY = re.compile(r"^/\* \w+:[^\n*]*\*/\nstatic int (casadi_f\d+)\([^\n]*\{\n(.*?)\n\}$", re.M | re.S)
_EXPORTED = re.compile(
    r"^CASADI_SYMBOL_EXPORT int (\w+)\([^\n]*\)\{\n  return (casadi_f\d+)\(arg, res, iw, w, mem\);\n\}$", re.M
)
_NUMBER = r"-?(?:\d+\.\d*|\d+)(?:[eE][-+]?\d+)?f?"
_PASSED = re.compile(r"  (casadi_real [\w, ]+;|\(void\)\w+;|return 0;)")
_GIVEN = re.compile(r"  (\w+)=arg\[(\d+)\]\[(\d+)\];")
_RESULT = re.compile(r"  res\[(\d+)\]\[(\d+)\]=(\w+);")
_CONSTANT = re.compile(rf"  (\w+)=({_NUMBER});")
_BINARY = re.compile(r"  (\w+)=\((\w+)([-+*/])(\w+)\);")
_UNARY = {
    "twice": re.compile(r"  (\w+)=\(2\.0?f?\*(\w+)\);"),
    "inverse": re.compile(r"  (\w+)=\(1\.0?f?/(\w+)\);"),
    "neg": re.compile(r"  (\w+)=\(- ?(\w+)\);"),
}
_CALL = re.compile(r"  (\w+)=(\w+)\((\w+)(?:,(\w+))?\);")
_NAMES = "sq|fmin|fmax|sqrt|fabs|floor|sin|cos|tanh|atan2|atan|asin|acos"
_CALLS = re.compile(rf"(?:casadi_)?({_NAMES})f?")
_HELPERS = {"sq": "(casadi_real x) { return x*x;}", "fabs": "(casadi_real x) { return fabs(x);}",
            "fmin": "(casadi_real x, casadi_real y) { return (x <= y || y != y) ? x : y;}",
            "fmax": "(casadi_real x, casadi_real y) { return (x >= y || y != y) ? x : y;}"}  # fmt: skip
_HELPER = re.compile(rf"\bcasadi_({'|'.join(_HELPERS)})\(")
_OTHER = re.compile(rf"\b(?:double|float|casadi_real)\s+(?:{_NAMES})f?\s*\(")
_DIRECTIVE = re.compile(
    r"#(?:ifdef __cplusplus|ifdef CASADI_CODEGEN_PREFIX|else|endif|ifndef (?:casadi_(?:real|int)|CASADI_SYMBOL_EXPORT)|"
    r"if defined\(STATIC_LINKED\)|if defined\(_WIN32\)[\w() |]*|elif defined\(__GNUC__\)[\w() &]*|include <math\.h>|"
    r'include "gt_(?:float|\w+_body)\.h"|define casadi_int long long int|define casadi_(\w+) CASADI_PREFIX\(\1\)|'
    r"define _CASADI_NAMESPACE_CONCAT\(NS, ID\) NS ## ID|define CASADI_PREFIX\(ID\) \w+ ## ID|"
    r"define CASADI_PREFIX\(ID\) CASADI_NAMESPACE_CONCAT\(CODEGEN_PREFIX, ID\)|"
    r"define CASADI_NAMESPACE_CONCAT\(NS, ID\) _CASADI_NAMESPACE_CONCAT\(NS, ID\)|"
    r'define CASADI_SYMBOL_EXPORT(?: __declspec\(dllexport\)| __attribute__ \(\(visibility \("default"\)\)\))?)'
)
# of generated headers and of the functions round the bodies
_PLAIN = re.compile(
    r"#(?:(?:ifn?def|if|elif|error)\b.*|else|endif.*|include (?:<\w+\.h>|\"gt_\w+\.[hc]\")|"
    r"define (?:GT_\w+|CASADI_SYMBOL_EXPORT)\b.*)"
)


class Refused(Exception):
    """A statement that does not hold, or cannot be checked."""


def headers(folder: Path, name: str) -> None:
    """Refuse headers that could give the text of the code another meaning."""
    for file, expected in PINNED.items():
        path = folder / file
        if path.exists() and hashlib.sha256(path.read_bytes()).hexdigest() != expected:
            raise Refused(f"{file} is not the one that this checker knows")
    for file in (f"gt_{name}.c", f"gt_{name}.h", f"gt_{name}_body.h"):
        _directives(file, (folder / file).read_text(), _PLAIN)


def _directives(file: str, text: str, known: re.Pattern[str]) -> None:
    for line in re.findall(r"^[ \t]*#.*", text, re.M):
        if not known.fullmatch(re.sub("^# +", "#", line.strip())) or line.endswith("\\"):
            raise Refused(f"{file} has the line '{line.strip()}', which may change the meaning of the code")


def operations(text: str, real: str, functions: Iterable[str]) -> dict[str, list[tuple]]:
    """Return the operations of the bodies of functions by their C symbols: (operator, target, operands)."""
    wanted = {f"{function}_{part}" for function in functions for part in ("prepare0", "kernel0", "body")}
    if f"#define casadi_real {real}\n" not in text or "\\" in text or "??" in text:
        raise Refused(f"the body is not the text of code in {real}")
    _directives("the body", text.replace(f"#define casadi_real {real}\n", ""), _DIRECTIVE)
    bodies = dict(_BODY.findall(text))
    rest = _BODY.sub("", text)
    for name in {n for body in bodies.values() for n in _HELPER.findall(body)}:
        if f"static inline casadi_real casadi_{name}{_HELPERS[name]}\n" not in rest:
            raise Refused(f"casadi_{name} is not the function of this name")
    if other := _OTHER.search(rest):
        raise Refused(f"'{other[0]}' takes the place of a function of libm")
    return {symbol: _read(symbol, bodies[name]) for symbol, name in _EXPORTED.findall(rest) if symbol in wanted}


def _read(symbol: str, body: str) -> list[tuple]:
    steps: list[tuple] = []
    for line in body.split("\n"):
        if _PASSED.fullmatch(line):
            continue
        if m := _GIVEN.fullmatch(line):
            steps.append(("in", m[1], int(m[2]), int(m[3])))
        elif m := _RESULT.fullmatch(line):
            steps.append(("out", m[3], int(m[1]), int(m[2])))
        elif m := _CONSTANT.fullmatch(line):
            steps.append(("const", m[1], m[2]))
        elif line == "  if (res[1] == 0) { return 0; }":  # of a kernel, whose residual must come before
            steps.append(("const", "stop", "0.0"))
        elif found := [(op, *m.groups()) for op, pattern in _UNARY.items() if (m := pattern.fullmatch(line))]:
            steps.append(found[0])
        elif m := _BINARY.fullmatch(line):
            steps.append((m[3], m[1], m[2], m[4]))
        elif (m := _CALL.fullmatch(line)) and (name := _CALLS.fullmatch(m[2])):
            steps.append((name[1], m[1], *[x for x in (m[3], m[4]) if x]))
        else:
            raise Refused(f"{symbol}: cannot read the operation '{line.strip()}'")
    return steps


def function(text: str, head: str) -> str:
    """Return the text of a C function, without comments."""
    found = re.sub(r"/\*.*?\*/", "", text, flags=re.S).split(f"\n{head}")
    if len(found) != 2 or "#" in (body := found[1].split("\n}\n")[0]):
        raise Refused(f"cannot read {head}...)")
    return body


def tests(text: str) -> list[tuple[int, str, float]]:
    """Return the tests of margins in a C function: (margin, kind, scale)."""
    above = r"margins\[(\d+)\] > \(GT_PIVOT_TOLERANCE \* ([-+.\de]+)f?\)"
    found = [(int(n), "discriminant", 0.0) for n in re.findall(r"if \(!\(margins\[(\d+)\] >= 0\.0f?\)\) \{", text)]
    found += [(int(n), "branch", float(x)) for n, x in re.findall(rf"if \(!\({above}\)\) \{{", text)]
    both = rf"if \(!\(\({above}\) \|\|\s+\(margins\[\1\] < -\(GT_PIVOT_TOLERANCE \* \2f?\)\)\)\) \{{"
    pivots = [(int(n), "pivot", float(x)) for n, x in re.findall(both, text)]
    if len(re.findall(r"[^e]margins\[", text)) != ("margins[" in text) + len(found) + 2 * len(pivots):
        raise Refused("a test of a margin cannot be read")
    return found + pivots


def guarded(entry: dict, wrapper: str, tolerance: float) -> None:
    """Refuse a function round a body whose inputs, results, tests or limits are not those of its entry in the manifest,
    or that refuses inputs of the box."""
    symbol, inputs, outputs = entry["symbol"], entry["inputs"], entry["outputs"]
    text = function(wrapper, f"gt_status {symbol}(")
    given = [("" if m["shape"] else "&") + f"in->{m['member']};" for m in inputs]
    lines = [f"arg[{k}] = {x}" for k, x in enumerate(given)]
    lines += [f"res[{k}] = {'' if m['shape'] else '&'}y.{m['member']};" for k, m in enumerate(outputs)]
    lines += [f"arg[{len(inputs)}] = z0;"] if "state" in entry else []
    lines += [f"res[{len(outputs)}] = margins;"] if "margins[" in text else []
    once = [*lines, f"(void){symbol}_body(arg, res, iw, w, 0);", "*out = y;\n    return GT_OK;"]
    once += [f"known[{k}] = {x}" for k, x in enumerate(given)] if "state" in entry else []
    written = re.findall(r"\b(?:arg|res)\[\d+\] [-+*/]?=|\by(?:\.\w+(?:\[\d+\])?)? [-+*/]?= |\breturn GT_OK;", text)
    calls = {name if name != "gt_copy" else f"{name}({first}" for name, first in re.findall(r"(\w+)\(&?(\w*)", text)}
    calls -= {"if", f"{symbol}_body", "fabs", "each_finite", f"solve_{entry['name']}0", "gt_copy(z0", "gt_copy(state"}
    if calls or any(text.count(f" {line}") != 1 for line in once) or len(written) != len(lines) + 1:
        raise Refused(f"{symbol}: its inputs and results cannot be read, or are not those of the manifest")
    least = re.findall(rf"\n#define GT_PIVOT_TOLERANCE \(({_NUMBER})\)\n", wrapper)
    if len(least) != 1 or not _near(tolerance, float(least[0].rstrip("f"))):
        raise Refused("the manifest has another limit of pivots than the code")
    for n, kind, scale in tests(text) if "state" not in entry else []:
        m = entry["margins"][n] if n < len(entry["margins"]) else {"kind": ""}
        zero = m["kind"] not in ("pivot", "branch", "")
        if not (zero if kind == "discriminant" else kind == m["kind"] and _near(scale, float(m["scale"]))):
            raise Refused(f"{symbol}: the test of margin {n} in the code is not that of the manifest")
    _limited(symbol, entry, text)


def _near(x: float, y: float) -> bool:
    """Return whether two limits are equal up to the digits that the checks of limits leave free."""
    return abs(x - y) <= 1e-6 * abs(y)


def _limited(symbol: str, entry: dict, text: str) -> None:
    """Refuse a box whose inputs may exceed the limits in the code, or limits that cannot be read."""
    most = {(m["member"], str(k) if m["shape"] else ""): max(map(abs, pair))
            for m in entry["inputs"] for k, pair in enumerate(entry["box"][m["signal"]])}  # fmt: skip
    found = re.search(rf"total = ([^;]*);\s*if \(!\(total <= ({_NUMBER})\)\) \{{", text)
    product = re.compile(r"in->(\w+)(?:\[(\d+)\])? \* in->\1(?:\[\2\])?")
    left, total, seen = " ".join(found[1].split()) if found else "?", 0.0, 0
    for weighted in re.findall(rf"\(({_NUMBER}) \* \(((?:[^()]|\([^()]*\))*)\)\)", left):
        places = product.findall(weighted[1])
        total += float(weighted[0].rstrip("f")) * sum(most[place] ** 2 for place in places)
        left, seen = left.replace(f"({weighted[0]} * ({weighted[1]}))", ""), seen + len(places)
    places = product.findall(left)
    total += sum(most[place] ** 2 for place in places)
    if product.sub("", left).strip("()+ ") or seen + len(places) != len(most) or found is None:
        raise Refused(f"{symbol}: the limits of the inputs cannot be read")
    if not total * (1 + 1e-6) <= float(found[2].rstrip("f")):
        raise Refused(f"{symbol}: inputs of the box exceed the limits of the code")
