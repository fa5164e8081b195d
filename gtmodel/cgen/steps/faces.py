"""The C faces of what a folder is to hold: causal functions and step functions, with names that do not meet."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from ...compiler.causal import CausalFunction
from ..interface import Interface, check_identifier, interfaces
from ..real import Real
from ..text import GenerationError
from .function import StepFace, StepFunction
from .records import check_members


def faces_of(
    functions: Mapping[str, CausalFunction | StepFunction],
    name: str,
    along: Collection[str],
    real: Real,
    box: Mapping[str, Sequence[Sequence[float]]] | None,
) -> tuple[list[Interface], list[StepFace]]:
    """C faces of causal functions and of step functions. Raises GenerationError for names that do not fit."""
    stepping = {key: f for key, f in functions.items() if isinstance(f, StepFunction)}
    causal = {key: f for key, f in functions.items() if not isinstance(f, StepFunction)}
    faces = [] if stepping and not causal and not along and not box else interfaces(causal, name, along, real, box)
    check_identifier(name, "the name of the generated code", "name")
    steps = step_faces(stepping, name, real)
    check_apart(steps, [symbol for f in faces for symbol in (f.symbol, f"{f.symbol}_in", f"{f.symbol}_out", *f.bodies)])
    return faces, steps


def step_faces(functions: Mapping[str, StepFunction], name: str, real: Real) -> list[StepFace]:
    """C faces of step functions. Raises GenerationError for names that do not fit C."""
    faces = []
    for key, function in functions.items():
        check_identifier(key, "a function", "functions")
        for what in ("start", "inputs", "outputs", "state"):
            check_members(getattr(function, what), what)
        faces.append(StepFace(key, f"gt_{name}_{key}", function, real))
    return faces


def check_apart(faces: Sequence[StepFace], others: Sequence[str]) -> None:
    """GenerationError where a name of a step function is one of the others in C."""
    taken = {symbol.lower() for symbol in others}
    for face in faces:
        for symbol in (face.symbol, *[f"{face.symbol}_{suffix}" for suffix in face.suffixes]):
            if symbol.lower() in taken:
                raise GenerationError(
                    f"the function '{face.key}' needs the C name {symbol}, which is taken", "functions"
                )
            taken.add(symbol.lower())
