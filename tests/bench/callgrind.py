"""Instructions per call of C functions, counted by callgrind: reproducible, independent of other processes.

One program calls each function at given points from a caller of its own; what callgrind books on the way from that
caller to the function, with all that it calls, is the cost. Start of the program, loop and call are not in it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import numpy as np

from gtmodel import cgen
from gtmodel.compiler.causal import CausalFunction

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")  # as generated code is to be compiled
SECONDS = 300.0
NAME = "bench"  # of the generated folder; its functions are gt_bench_<key>

_EDGE = re.compile(r"^calls=(\d+) .*\n\S+ (\d+)$", re.M)


@dataclass(frozen=True)
class Call:
    """The C function `function`, called by `statement` on `const double *in` and `double *out`.

    points (n, inputs): one call each; outputs: how many doubles a call writes; header: declares the function.
    """

    function: str
    statement: str
    points: np.ndarray
    outputs: int
    header: str


@dataclass(frozen=True)
class Count:
    """Instructions of a mean call, and what all calls wrote (n, outputs)."""

    instructions: float
    outputs: np.ndarray


def missing() -> str | None:
    """One sentence on what this machine lacks, or None."""
    for tool, what in (("gcc", "nothing can be compiled"), ("valgrind", "no instruction can be counted")):
        if shutil.which(tool) is None:
            return f"there is no {tool} on this machine, so {what}: install the package {tool}"
    return None


def generate(functions: Mapping[str, CausalFunction], folder: Path) -> list[Path]:
    """Write the C of the functions into `folder`; the files to compile."""
    cgen.generate(functions, folder, name=NAME)
    return [folder / f"gt_{NAME}_body.c", folder / f"gt_{NAME}.c"]


def body_call(key: str, f: CausalFunction, points: np.ndarray) -> Call:
    """The generated body of function `key`, without the guards round it. points: all its inputs side by side."""
    symbol = f"gt_{NAME}_{key}"
    *inputs, _ = accumulate([s.size for s in f.inputs], initial=0)
    *outputs, width = accumulate([*(s.size for s in f.outputs), len(f.margins)], initial=0)
    statement = f"""{{
            const double *arg[{len(inputs)} + {symbol.upper()}_SZ_ARG] = {{{", ".join(f"in + {k}" for k in inputs)}}};
            double *res[{len(outputs)} + {symbol.upper()}_SZ_RES] = {{{", ".join(f"out + {k}" for k in outputs)}}};
            long long int iw[1 + {symbol.upper()}_SZ_IW];
            double w[1 + {symbol.upper()}_SZ_W];
            {symbol}_body(arg, res, iw, w, 0);
        }}"""
    return Call(f"{symbol}_body", statement, points, width, f"gt_{NAME}_body.h")


def guarded_call(key: str, f: CausalFunction, points: np.ndarray) -> Call:
    """The whole generated function `key`: inputs, margins and outputs are tested. Its structs hold doubles only."""
    symbol = f"gt_{NAME}_{key}"
    statement = f"(void){symbol}((const {symbol}_in *)(const void *)in, ({symbol}_out *)(void *)out);"
    return Call(symbol, statement, points, sum(s.size for s in f.outputs), f"gt_{NAME}.h")


def count(
    calls: Mapping[str, Call], sources: Sequence[Path], preamble: str = "", flags: Sequence[str] = FLAGS
) -> dict[str, Count]:
    """Counts by the keys of `calls`; preamble: C text before the first statement, such as their constants.

    Raises RuntimeError with the output of the tool that failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        program, log = _build(calls, sources, Path(folder), preamble, flags), Path(folder) / "callgrind.out"
        options = ("--compress-strings=no", "--compress-pos=no", "--dump-line=no", f"--callgrind-out-file={log}")
        outputs = _outputs(calls, _run("valgrind", "--tool=callgrind", *options, program))
        edges = _edges(log.read_text())
    result = {}
    for n, (key, call) in enumerate(calls.items()):
        times, cost = edges.get((f"case_{n}", call.function), (0, 0))
        if times != len(call.points):
            raise RuntimeError(f"callgrind saw {times} calls of {call.function}; expected {len(call.points)}")
        result[key] = Count(cost / times, outputs[key])
    return result


def run(
    calls: Mapping[str, Call], sources: Sequence[Path], preamble: str = "", flags: Sequence[str] = FLAGS
) -> dict[str, np.ndarray]:
    """What the calls write (n, outputs), without counting: needs no valgrind."""
    with tempfile.TemporaryDirectory() as folder:
        return _outputs(calls, _run(_build(calls, sources, Path(folder), preamble, flags)))


_CASE = """\
static const double in_{n}[][{inputs}] = {{
    {points}
}};
static double out_{n}[{count}][{outputs}];

__attribute__((noinline)) static void case_{n}(void)
{{
    for (int k = 0; k < {count}; k++) {{
        const double *in = in_{n}[k];
        double *out = out_{n}[k];
        {statement}
    }}
}}

static void print_{n}(void)
{{
    for (int k = 0; k < {count}; k++) {{
        for (int j = 0; j < {outputs}; j++) {{
            printf("%a\\n", out_{n}[k][j]);
        }}
    }}
}}
"""


def _build(
    calls: Mapping[str, Call], sources: Sequence[Path], folder: Path, preamble: str, flags: Sequence[str]
) -> Path:
    """The program that makes the calls, case by case, and prints what they wrote."""
    parts = ["#include <stdio.h>\n", *(f'#include "{h}"\n' for h in dict.fromkeys(c.header for c in calls.values()))]
    parts.append(f"\n{preamble}\n")
    for n, call in enumerate(calls.values()):
        rows, inputs = call.points.shape
        points = ",\n    ".join("{" + ", ".join(float(x).hex() for x in row) + "}" for row in call.points)
        parts.append(
            _CASE.format(n=n, count=rows, inputs=inputs, outputs=call.outputs, points=points, statement=call.statement)
        )
    steps = "".join(f"    case_{n}();\n    print_{n}();\n" for n in range(len(calls)))
    parts.append(f"\nint main(void)\n{{\n{steps}    return 0;\n}}\n")
    main, program = folder / "main.c", folder / "program"
    main.write_text("".join(parts))
    includes = [f"-I{p}" for p in dict.fromkeys(s.parent for s in sources)]
    # -z now: else the first call of tanh would also pay for finding it
    _run("gcc", *flags, *includes, "-Wl,-z,now", main, *sources, "-o", program, "-lm")
    return program


def _run(*command: str | Path) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=SECONDS)
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return done.stdout


def _outputs(calls: Mapping[str, Call], text: str) -> dict[str, np.ndarray]:
    numbers = iter([float.fromhex(x) for x in text.split()])
    return {key: np.array([[next(numbers) for _ in range(c.outputs)] for _ in c.points]) for key, c in calls.items()}


def _edges(text: str) -> dict[tuple[str, str], tuple[int, int]]:
    """(calls, instructions with all that is called) by (caller, callee) from an uncompressed callgrind file."""
    result: dict[tuple[str, str], tuple[int, int]] = {}
    for block in re.split(r"^fn=", text, flags=re.M)[1:]:
        caller, _, rest = block.partition("\n")
        for edge in re.split(r"^cfn=", rest, flags=re.M)[1:]:
            callee, _, numbers = edge.partition("\n")
            found = _EDGE.search(numbers)
            if found:
                times, cost = result.get((caller, callee), (0, 0))
                result[caller, callee] = (times + int(found[1]), cost + int(found[2]))
    return result
