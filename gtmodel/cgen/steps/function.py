"""What a step function is, whatever it computes, its C, structs of C that are records of NumPy, and the C faces of
what a folder is to hold."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.causal import CausalFunction, c_name
from ...results.status import Status
from ..interface import KEYWORDS, Interface, check_identifier, interfaces, unit_suffix
from ..real import GenerationError, Real, comment, decimal

INTEGER = np.int32


@dataclass(frozen=True)
class StepMember:
    """One member of a struct: so many numbers, of a scalar none; flags and counters where `integer`."""

    name: str
    size: int | None = None
    unit: str = "1"
    description: str = ""
    integer: bool = False

    @property
    def identifier(self) -> str:
        """Its name in C, which ends in its unit."""
        suffix = "" if self.integer else unit_suffix(self.unit)
        return f"{c_name(self.name)}_{suffix}" if suffix else c_name(self.name)

    @property
    def count(self) -> int:
        """How many numbers."""
        return 1 if self.size is None else self.size

    @property
    def declaration(self) -> str:
        """Such as `double p_m[3];`."""
        kind = "int" if self.integer else "double"
        return f"{kind} {self.identifier};" if self.size is None else f"{kind} {self.identifier}[{self.size}];"

    def elements(self, struct: str) -> list[str]:
        """C expressions of its numbers, `struct` being `in->` or `out.`."""
        if self.size is None:
            return [f"{struct}{self.identifier}"]
        return [f"{struct}{self.identifier}[{k}]" for k in range(self.size)]

    def address(self, struct: str) -> str:
        """C expression of the address of the first number."""
        return f"&{struct}{self.identifier}" if self.size is None else f"{struct}{self.identifier}"


def check_members(members: Sequence[StepMember], what: str) -> None:
    """GenerationError for two members of one identifier, and for one that is a word of C."""
    taken = set[str]()
    for m in members:
        if m.identifier in taken or m.identifier in KEYWORDS:
            raise GenerationError(f"'{m.name}' of the {what} cannot be called '{m.identifier}' in C; rename it")
        taken.add(m.identifier)


def dtype_of(members: Sequence[StepMember], real: Real) -> np.dtype:
    """The record of a struct, with the padding of C."""
    fields = [
        (m.identifier, INTEGER if m.integer else real.dtype, () if m.size is None else (m.size,)) for m in members
    ]
    return np.dtype(fields or [("unused", real.dtype)], align=True)


def record(members: Sequence[StepMember], real: Real, values: Mapping[str, Any] | None = None) -> np.ndarray:
    """A record with these values by the names of members, zero elsewhere."""
    made = np.zeros((), dtype_of(members, real))
    for m in members:
        if values and m.name in values:
            made[m.identifier] = values[m.name] if m.integer else real.array(values[m.name])
    return made


def copied(made: np.ndarray) -> np.ndarray:
    """A record of its own, its padding too, which a copy of NumPy leaves out."""
    return np.frombuffer(bytearray(made.tobytes()), made.dtype).reshape(())


def struct(name: str, members: Sequence[StepMember]) -> str:
    """Its declaration in C."""
    rows = [f"    {m.declaration} {comment([_described(m)]).rstrip()}\n" for m in members]
    rows = rows or ["    double unused; /* C knows no empty struct */\n"]
    return f"typedef struct {name} {{\n{''.join(rows)}}} {name};\n\n"


def _described(m: StepMember) -> str:
    unit = "" if m.integer else f" [{m.unit if m.unit not in ('', '?') else '1'}]"
    return f"{m.name}{unit}{': ' if m.description else ''}{m.description}"


class StepTwin(ABC):
    """A step function in Python, operation by operation as in C: its records hold the same bytes."""

    @abstractmethod
    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """A new state from a record of the start; written with OK only."""

    @abstractmethod
    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """One cycle; state and outputs are written with OK only."""


class StepFunction(ABC):
    """What is computed once in a cycle from inputs and from what it remembers: a filter, a sampled block.

    Base class. A subclass says what its structs hold and how C and Python compute; the folder, the header, the
    self-test and the comparison with Python are made from that, see docs/c_contract.md.

    title: one line. period: of a cycle [s]. start, inputs, outputs, state: members of its structs.
    defaults: values of the start by name. runtime: hand-written headers that it needs, the one that
    includes the others first.
    """

    title: str
    period: float
    start: Sequence[StepMember]
    inputs: Sequence[StepMember]
    outputs: Sequence[StepMember]
    state: Sequence[StepMember]
    defaults: Mapping[str, Any]
    runtime: Sequence[str] = ()

    @abstractmethod
    def kernels(self, symbol: str) -> list[ca.Function]:
        """The generated bodies under their C names."""

    @abstractmethod
    def text(self, symbol: str, real: Real) -> str:
        """C of `symbol`_init and `symbol`_step, with its tables; in double."""

    @abstractmethod
    def twin(self, real: Real) -> StepTwin:
        """The same in Python."""

    @abstractmethod
    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Records of inputs, one after the other, as a run meets them."""

    @abstractmethod
    def complete(self, real: Real) -> np.ndarray:
        """A record of inputs with which the declared start goes on well, nothing missing: where it costs most."""

    @abstractmethod
    def facts(self) -> Mapping[str, Any]:
        """What it was made from, for manifest and hash: numbers exact to the last bit."""

    def explain(self, full: bool = True) -> str:
        """What it computes, in words; `full` changes nothing."""
        return "\n".join([self.title, *self.notes()])

    def notes(self) -> Sequence[str]:
        """What its statuses mean, for the header."""
        return ()


@dataclass(frozen=True)
class StepFace:
    """A step function under the C name `symbol`."""

    key: str
    symbol: str
    function: StepFunction
    real: Real

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of all names that it defines for others."""
        return ("start", "in", "out", "state", "defaults", "init", "step")

    def started(self) -> tuple[np.ndarray, np.ndarray]:
        """The records of the declared start and of an empty state."""
        f = self.function
        return record(f.start, self.real, f.defaults), record(f.state, self.real)


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
