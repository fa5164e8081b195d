"""Costs of a generated folder: machine code, stack and instructions of each function, and the symbols it defines."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..compiler.causal import CausalFunction
from ..compiler.toolchain import LINK, STANDARD, Toolchain, find
from ..results.disk import scratch
from ..results.status import Status
from .interface import Interface
from .manifest import read
from .points import draw, evaluate
from .real import DOUBLE, hexadecimal, real_of, single
from .steps.function import StepFace, StepFunction, faces_of
from .wrapper import elements

CALLS = 100  # counted calls; one more precedes them, so that the dynamic linker has done its work
EXTERNAL = "external functions"
SHARED = ("gt_filter", "gt_stage_qp")  # functions of the runtime that steps share; they count for the first step
DRAWS = 200  # random points; the first one with a solution is used

_BEHIND = re.compile(r"^CASADI_SYMBOL_EXPORT int (\w+)\([^\n]*\{\n *return casadi_(f\d+)\(", re.M)
_COUNTED = re.compile(r"Collected : (\d+)")


@dataclass(frozen=True)
class Costs:
    """Costs of generated functions, each by C name.

    text_bytes: machine code. Code that the compiler merged counts for the function that keeps it; the one copy of
        Newton's method counts for the first function that calls it, and so do external functions (gt.external).
    newton_bytes: part of text_bytes in Newton blocks and their guards, without the closed form after them.
    stack_bytes: stack of a call, including the functions that it calls. A table of several arguments calls itself for
        each of them, which counts once.
    instructions: of one call with its guards.
    symbols: external symbols that the folder defines.
    missing: one sentence on what could not be counted, or "".
    """

    text_bytes: dict[str, int] = field(default_factory=dict)
    newton_bytes: dict[str, int] = field(default_factory=dict)
    stack_bytes: dict[str, int] = field(default_factory=dict)
    instructions: dict[str, int] = field(default_factory=dict)
    symbols: tuple[str, ...] = ()
    missing: str = ""


def costs(folder: Path, functions: Mapping[str, CausalFunction | StepFunction]) -> Costs:
    """Compile a generated folder at -O2 and measure its costs; valgrind, if present, counts the instructions.

    Args:
        folder: as `generate` wrote it.
        functions: the functions from which it was generated, under the same names.

    The stack of a function is the sum of the frames of its guards, of the functions that these call, and of its largest
    body. A cost that cannot be measured on this machine is omitted, and `missing` says why.

    >>> import tempfile
    >>> from pathlib import Path
    >>> class Square(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     area = gt.variable(unit="m2")
    ...     def equations(self):
    ...         yield self.area == self.x**2
    >>> functions = {"area": Square().causal(known="x", targets="area")}
    >>> with tempfile.TemporaryDirectory() as place:
    ...     made = gt.cgen.generate(functions, place, name="square")
    ...     found = gt.cgen.costs(Path(place), functions)
    >>> found.text_bytes["gt_square_area"] < 2000
    True
    """
    content, tools = read(folder), find()
    if content is None or isinstance(tools, str):
        return Costs(missing="" if content is None else str(tools))
    name = content["name"]
    faces, steps = faces_of(functions, name, (), real_of(content["real"]), None)
    with scratch() as temporary:
        sizes, frames, symbols = _compiled(tools, folder, name, temporary)
        parts = {f.symbol: [f.symbol, *f.bodies, *[f"solve_{f.key}{k}" for k in range(len(f.newton))]] for f in faces}
        # the one copy of Newton's method counts for the first function that calls it
        for first in [f.symbol for f in faces if f.newton][:1]:
            parts[first].append("solve")
        calling = {f.symbol for f in faces if f.function.plan.flat.scope.calls}
        for first in [f.symbol for f in faces if f.symbol in calling][:1]:
            parts[first].append(EXTERNAL)
        text = {symbol: sum(sizes.get(p, 0) for p in names) for symbol, names in parts.items()}
        newton = {f.symbol: text[f.symbol] - sizes.get(f.body, 0) for f in faces if f.newton}
        stack = {
            f.symbol: frames.get(f.symbol, 0)
            + sum(frames.get(f"solve_{f.key}{k}", 0) for k in range(len(f.newton)))
            + (frames.get("solve", 0) if f.newton else 0)
            + max(frames.get(p, 0) for p in f.bodies)
            + (frames.get(EXTERNAL, 0) if f.symbol in calling else 0)
            for f in faces
        }
        for step in steps:
            step_symbols = {s for s in sizes if s == step.symbol or s.startswith(f"{step.symbol}_")}
            shared = {s for s in sizes if s.startswith(SHARED)} if step is steps[0] else set[str]()
            text[step.symbol] = sum(sizes[s] for s in step_symbols | shared)
            stack[step.symbol] = frames.get(f"{step.symbol}_step", 0) + sum(
                frames.get(s, 0) for s in frames if s.startswith(SHARED)
            )
        valgrind = shutil.which("valgrind")
        if valgrind is None:
            why = "no instruction was counted: there is no valgrind on this machine"
            return Costs(text, newton, stack, {}, symbols, why)
        counts = {f.symbol: _instructions(tools, valgrind, f, temporary, folder) for f in faces}
        counts |= {s.symbol: _step_instructions(tools, valgrind, s, temporary, folder) for s in steps}
    return Costs(text, newton, stack, {key: n for key, n in counts.items() if n is not None}, symbols)


def _compiled(
    tools: Toolchain, folder: Path, name: str, temporary: Path
) -> tuple[dict[str, int], dict[str, int], tuple[str, ...]]:
    """Return code size and stack frame by function name, and the external symbols of the two files."""
    objects = []
    for file in (f"gt_{name}", f"gt_{name}_body"):
        objects.append(temporary / f"{file}.o")
        command = (tools.cc, *STANDARD, "-fstack-usage", "-c", folder / f"{file}.c")
        tools.run(*command, "-o", objects[-1])
    _, listing = tools.run(tools.nm, "-S", *objects)
    sizes: dict[str, int] = {}
    symbols = []
    for line in listing.splitlines():
        match line.split():
            case [_, size, "T" | "t" as kind, symbol]:
                base = symbol.partition(".")[0]  # the compiler puts rarely executed code apart, as gt_l1_fk.cold
                sizes[base] = sizes.get(base, 0) + int(size, 16)
                symbols += [symbol] if kind == "T" else []
    frames: dict[str, int] = {}
    for usage in sorted(temporary.glob("*.su")):
        for line in usage.read_text().splitlines():
            where, size, _ = line.split("\t")
            frames[where.rpartition(":")[2].partition(".")[0]] = int(size)
    # a body calls a static function with its statements, unless the compiler inlined it
    behind = _BEHIND.findall((folder / f"gt_{name}_body.c").read_text())
    own = {f"{prefix}_{static}" for _, static in behind for prefix in (f"gt_{name}_body", "casadi")}
    for counted in (sizes, frames):  # of external functions, each called within the other at worst
        helpers = [s for s in counted if s.startswith((f"gt_{name}_body_", "casadi_")) and s not in own]
        counted[EXTERNAL] = sum(counted[s] for s in helpers)
    for symbol, static in behind:
        sizes[symbol] = sizes.get(symbol, 0) + sizes.get(f"gt_{name}_body_{static}", 0)
        frames[symbol] = frames.get(symbol, 0) + frames.get(
            f"gt_{name}_body_{static}", frames.get(f"casadi_{static}", 0)
        )
    return sizes, frames, tuple(sorted(symbols))


def _instructions(tools: Toolchain, valgrind: str, face: Interface, temporary: Path, folder: Path) -> int | None:
    """Return the mean over CALLS calls with GT_OK; None if no point has a solution or the program does not run."""
    rows = draw(face, DRAWS, seed=2)
    good = np.flatnonzero(evaluate(face, rows)[1] == Status.OK)
    return _counted(tools, valgrind, face, _program(face, rows[good[0]]), temporary, folder) if len(good) else None


def _step_instructions(tools: Toolchain, valgrind: str, face: StepFace, temporary: Path, folder: Path) -> int | None:
    """Return the mean over CALLS steps with GT_OK in which every sensor has a reading."""
    inputs = face.function.complete(face.real)
    return _counted(tools, valgrind, face, _step_program(face, inputs), temporary, folder)


def _counted(
    tools: Toolchain, valgrind: str, face: Interface | StepFace, text: str, temporary: Path, folder: Path
) -> int | None:
    """Return the instructions per call of a program that makes one call for each of its arguments."""
    main, program = temporary / f"{face.key}_main.c", temporary / f"{face.key}_main"
    main.write_text(text if face.real is DOUBLE else single(text))
    prefix = face.symbol.removesuffix(f"_{face.key}")
    objects = [temporary / f"{prefix}.o", temporary / f"{prefix}_body.o"]
    built, _ = tools.run(tools.cc, *STANDARD, f"-I{folder}", main, *objects, "-o", program, *LINK, "-Wl,-z,now")
    if not built:
        return None
    totals = []
    for calls in (1, CALLS + 1):
        log = f"--callgrind-out-file={temporary / 'callgrind.out'}"
        ran, text = tools.run(valgrind, "--tool=callgrind", log, program, *["x"] * calls)
        counted = _COUNTED.search(text)
        if not ran or counted is None:
            return None
        totals.append(int(counted[1]))
    return round((totals[1] - totals[0]) / CALLS)


def _step_program(face: StepFace, inputs: np.ndarray) -> str:
    """A program that runs steps with the same inputs from the declared start, one for each argument."""
    s, f = face.symbol, face.function
    fill = []
    for m in f.inputs:
        for target, value in zip(m.elements("in."), inputs[m.identifier].reshape(-1).tolist(), strict=True):
            fill.append(f"    {target} = {int(value) if m.integer else hexadecimal(value)};\n")
    return (
        f'#include "{s.removesuffix(f"_{face.key}")}.h"\n\nint main(int calls, char **none)\n{{\n'
        f"    {s}_start start;\n    {s}_state state;\n    {s}_in in = {{0}};\n    {s}_out out;\n    int k;\n\n"
        f"    (void)none;\n    {s}_defaults(&start);\n    if ({s}_init(&state, &start) != GT_OK) {{\n"
        f"        return 1;\n    }}\n{''.join(fill)}    for (k = 1; k < calls; k++) {{\n"
        f"        if ({s}_step(&state, &in, &out) != GT_OK) {{\n            return 1;\n        }}\n    }}\n"
        "    return 0;\n}\n"
    )


def _program(face: Interface, row: np.ndarray) -> str:
    """A program that calls the function once for each of its arguments."""
    s = face.symbol
    numbers = iter(row.tolist())
    fill = [f"    {target} = {hexadecimal(next(numbers))};\n" for m in face.inputs for target in elements(m, "in.")]
    fill += [f"    {target} = {hexadecimal(next(numbers))};\n" for m in face.state for target in elements(m, "state.")]
    state = f"    {s}_state state;\n" if face.newton else ""
    state_argument = "&state, " if face.newton else ""
    return (
        f'#include "{face.symbol.removesuffix(f"_{face.key}")}.h"\n\nint main(int calls, char **none)\n{{\n'
        f"    {s}_in in = {{0}};\n    {s}_out out;\n{state}    int k;\n\n    (void)none;\n{''.join(fill)}"
        f"    for (k = 1; k < calls; k++) {{\n        if ({s}({state_argument}&in, &out) != GT_OK) {{\n"
        "            return 1;\n        }\n    }\n    return 0;\n}\n"
    )
