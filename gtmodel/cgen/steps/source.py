"""C of step functions: what the header declares, the start, the rest from the function itself."""

from __future__ import annotations

from ..text import comment, decimal
from .function import StepFace
from .records import StepMember, record, struct

_SAME = (
    "State and outputs are written with GT_OK only. A step that ends otherwise has not happened: the state stays where "
    "it was before this cycle."
)


def declarations(face: StepFace) -> str:
    """Structs and functions of one face, for the header."""
    f, symbol = face.function, face.symbol
    title = f"{face.key}: {f.title}. A step function: one step every {decimal(f.period)} s."
    return "".join(
        [
            comment([title, _SAME, *f.notes()]),
            struct(f"{symbol}_start", f.start),
            struct(f"{symbol}_in", f.inputs),
            struct(f"{symbol}_out", f.outputs),
            comment(["What it remembers, yours to keep; one for each that runs."]),
            struct(f"{symbol}_state", f.state),
            comment(["Writes the start that was declared."]),
            f"void {symbol}_defaults({symbol}_start *start);\n\n",
            comment(["Begins: the start is what is known one period before the first step."]),
            f"gt_status {symbol}_init({symbol}_state *state, const {symbol}_start *start);\n\n",
            comment(["One cycle."]),
            f"{step_prototype(symbol)};\n\n",
        ]
    )


def step_prototype(symbol: str) -> str:
    """Declaration of the step, without the semicolon."""
    return f"gt_status {symbol}_step({symbol}_state *state, const {symbol}_in *in, {symbol}_out *out)"


def definitions(face: StepFace) -> str:
    """The start, init and step."""
    f, symbol = face.function, face.symbol
    start = record(f.start, face.real, f.defaults)
    lines = [line for m in f.start for line in _assigned(m, start[m.identifier].reshape(-1).tolist())]
    return (
        f"void {symbol}_defaults({symbol}_start *start)\n{{\n"
        + ("".join(lines) or "    start->unused = 0.0;\n")
        + "}\n\n"
        + f.text(symbol, face.real)
    )


def _assigned(m: StepMember, values: list[float]) -> list[str]:
    written = [str(int(v)) if m.integer else decimal(v) for v in values]
    return [f"    {target} = {v};\n" for target, v in zip(m.elements("start->"), written, strict=True)]
