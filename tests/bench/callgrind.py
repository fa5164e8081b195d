"""Instructions per call of C functions, counted by callgrind: the same number at every run, whatever else runs.

One program calls each function at the given points from a caller of its own; what callgrind books on the way from
that caller to the function, all it calls included, is the cost. Loop, call and start of the program are not in it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtmodel import cgen
from gtmodel.compiler.causal import CausalFunction

# as the generated code is compiled: -ffp-contract=off makes it equal to Python bit for bit
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
NAME = "bench"  # of the generated folder: gt_bench_<function>

_EDGE = re.compile(r"^calls=(\d+) .*\n\S+ (\d+)$", re.M)


@dataclass(frozen=True)
class Call:
    """One call of the C function `function`, written as `statement` on `const double *in` and `double *out`.

    points (n, inputs): the arguments of the calls; outputs: how many doubles one call writes; header: what declares
    the function.
    """

    function: str
    statement: str
    points: np.ndarray
    outputs: int
    header: str


@dataclass(frozen=True)
class Count:
    """Instructions of a mean call, and the outputs (n, outputs) of all calls."""

    instructions: float
    outputs: np.ndarray


def missing() -> str | None:
    """One sentence on what this machine lacks for counting, or None."""
    if shutil.which("gcc") is None:
        return "there is no gcc on this machine, so nothing can be compiled: install the package gcc"
    if shutil.which("valgrind") is None:
        return "there is no valgrind on this machine, so no instruction can be counted: install the package valgrind"
    return None


def generated_call(key: str, f: CausalFunction, points: np.ndarray) -> Call:
    """The call of a generated body, without the guards round it; `points` are all its inputs side by side."""
    body, starts = f"gt_{NAME}_{key}_body", np.cumsum([0, *[s.size for s in f.inputs]])
    ends = np.cumsum([0, *[s.size for s in f.outputs], len(f.margins)])
    arguments = ", ".join(f"in + {n}" for n in starts[:-1])
    results = ", ".join(f"out + {n}" for n in ends[:-1])
    sizes = ", ".join(f"{what}[{body.upper()[:-5]}_SZ_{size} + 1]" for what, size in (("iw", "IW"), ("w", "W")))
    iw, w = sizes.split(", ")
    statement = (
        f"const double *arg[{len(f.inputs)} + {body.upper()[:-5]}_SZ_ARG] = {{{arguments}}};\n"
        f"        double *res[{len(f.outputs) + 1} + {body.upper()[:-5]}_SZ_RES] = {{{results}}};\n"
        f"        long long int {iw};\n        double {w};\n"
        f"        {body}(arg, res, iw, w, 0);"
    )
    return Call(body, statement, points, int(ends[-1]), f"gt_{NAME}_body.h")


def write_generated(functions: Mapping[str, CausalFunction], folder: Path) -> list[Path]:
    """Generate the bodies of the functions into `folder`; the C files to compile."""
    cgen.generate(functions, folder, name=NAME)
    return [folder / f"gt_{NAME}_body.c"]


def count(calls: Mapping[str, Call], sources: Sequence[Path], preamble: str = "", flags: Sequence[str] = FLAGS) -> dict[str, Count]:
    """Counts by the keys of `calls`; `preamble` is C text in front of the program, e.g. constants of the statements.

    Raises RuntimeError with the output of the tool that failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        program, log = build(calls, sources, Path(folder), preamble, flags), Path(folder) / "callgrind.out"
        output = _run(
            "valgrind", "--tool=callgrind", "--compress-strings=no", "--compress-pos=no", "--dump-line=no",
            f"--callgrind-out-file={log}", program,
        )  # fmt: skip
        costs = _costs(log.read_text())
    outputs = _outputs(calls, output)
    result = {}
    for n, (key, call) in enumerate(calls.items()):
        times, total = costs.get((f"case_{n}", call.function), (0, 0))
        if times != len(call.points):
            raise RuntimeError(f"callgrind saw {times} calls of {call.function}; expected {len(call.points)}")
        result[key] = Count(total / times, outputs[key])
    return result


def run(calls: Mapping[str, Call], sources: Sequence[Path], preamble: str = "", flags: Sequence[str] = FLAGS) -> dict[str, np.ndarray]:
    """Outputs (n, outputs) of the calls, without counting: needs no valgrind."""
    with tempfile.TemporaryDirectory() as folder:
        return _outputs(calls, _run(build(calls, sources, Path(folder), preamble, flags)))


def build(calls: Mapping[str, Call], sources: Sequence[Path], folder: Path, preamble: str, flags: Sequence[str]) -> Path:
    """The program that makes the calls and prints what they write."""
    parts = ["#include <stdio.h>\n"]
    parts += [f'#include "{h}"\n' for h in dict.fromkeys(c.header for c in calls.values())]
    parts += [f"\n{preamble}\n"]
    for n, call in enumerate(calls.values()):
        rows = ",\n    ".join("{" + ", ".join(float(x).hex() for x in row) + "}" for row in call.points)
        parts.append(
            f"static const double in_{n}[][{call.points.shape[1]}] = {{\n    {rows}}};\n"
            f"static double out_{n}[{len(call.points)}][{call.outputs}];\n"
            f"__attribute__((noinline)) static void case_{n}(void)\n{{\n"
            f"    for (int k = 0; k < {len(call.points)}; k++) {{\n"
            f"        const double *in = in_{n}[k];\n        double *out = out_{n}[k];\n"
            f"        {call.statement}\n    }}\n"
            f"    for (int k = 0; k < {len(call.points)}; k++) {{\n"
            f"        for (int j = 0; j < {call.outputs}; j++) {{\n"
            f'            printf("%a\\n", out_{n}[k][j]);\n        }}\n    }}\n}}\n\n'
        )
    body = "".join(f"    case_{n}();\n" for n in range(len(calls)))
    parts.append(f"int main(void)\n{{\n{body}    return 0;\n}}\n")
    main, program = folder / "bench_main.c", folder / "bench"
    main.write_text("".join(parts))
    includes = [f"-I{p}" for p in dict.fromkeys(s.parent for s in sources)]
    # symbols resolved at the start, or the first call of tanh would cost more than the others
    _run("gcc", *flags, *includes, "-Wl,-z,now", "-o", program, main, *sources, "-lm")
    return program


def _run(*command: str | Path) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return done.stdout


def _outputs(calls: Mapping[str, Call], text: str) -> dict[str, np.ndarray]:
    numbers = iter([float.fromhex(x) for x in text.split()])
    return {
        key: np.array([[next(numbers) for _ in range(c.outputs)] for _ in c.points]) for key, c in calls.items()
    }


def _costs(text: str) -> dict[tuple[str, str], tuple[int, int]]:
    """(calls, inclusive instructions) by (caller, callee) from a callgrind file without compression."""
    result: dict[tuple[str, str], tuple[int, int]] = {}
    for block in re.split(r"^fn=", text, flags=re.M)[1:]:
        caller = block.split("\n", 1)[0]
        for edge in re.split(r"^cfn=", block, flags=re.M)[1:]:
            callee = edge.split("\n", 1)[0]
            found = _EDGE.search(edge)
            if found:
                times, total = result.get((caller, callee), (0, 0))
                result[(caller, callee)] = (times + int(found[1]), total + int(found[2]))
    return result
