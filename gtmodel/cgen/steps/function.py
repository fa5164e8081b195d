"""Step functions: base class, C text, structs of C as records of NumPy, and the C interfaces of all functions of a
folder."""

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
    """One member of a struct: `size` numbers, None for a scalar. Flags and counters are `integer`."""

    name: str
    size: int | None = None
    unit: str = "1"
    description: str = ""
    integer: bool = False

    @property
    def identifier(self) -> str:
        """Name in C, which ends in the unit."""
        suffix = "" if self.integer else unit_suffix(self.unit)
        return f"{c_name(self.name)}_{suffix}" if suffix else c_name(self.name)

    @property
    def count(self) -> int:
        """Number of numbers."""
        return 1 if self.size is None else self.size

    @property
    def declaration(self) -> str:
        """Such as `double p_m[3];`."""
        kind = "int" if self.integer else "double"
        return f"{kind} {self.identifier};" if self.size is None else f"{kind} {self.identifier}[{self.size}];"

    def elements(self, struct: str) -> list[str]:
        """Return the C expressions of its numbers; `struct` is `in->` or `out.`."""
        if self.size is None:
            return [f"{struct}{self.identifier}"]
        return [f"{struct}{self.identifier}[{k}]" for k in range(self.size)]

    def address(self, struct: str) -> str:
        """Return the C expression of the address of its first number."""
        return f"&{struct}{self.identifier}" if self.size is None else f"{struct}{self.identifier}"


def check_members(members: Sequence[StepMember], side: str) -> None:
    """Raise GenerationError if two members have the same identifier, or if one is a keyword of C."""
    taken = set[str]()
    for m in members:
        if m.identifier in taken or m.identifier in KEYWORDS:
            raise GenerationError(f"'{m.name}' of the {side} cannot be called '{m.identifier}' in C; rename it")
        taken.add(m.identifier)


def dtype_of(members: Sequence[StepMember], real: Real) -> np.dtype:
    """Return the NumPy type of a struct, with the padding of C."""
    fields = [
        (m.identifier, INTEGER if m.integer else real.dtype, () if m.size is None else (m.size,)) for m in members
    ]
    return np.dtype(fields or [("unused", real.dtype)], align=True)


def record(members: Sequence[StepMember], real: Real, values: Mapping[str, Any] | None = None) -> np.ndarray:
    """Return a record with these values by names of members, and zeros elsewhere."""
    result = np.zeros((), dtype_of(members, real))
    for m in members:
        if values and m.name in values:
            result[m.identifier] = values[m.name] if m.integer else real.array(values[m.name])
    return result


def copied(source: np.ndarray) -> np.ndarray:
    """Return a copy of a record, including the padding, which a copy by NumPy omits."""
    return np.frombuffer(bytearray(source.tobytes()), source.dtype).reshape(())


def struct(name: str, members: Sequence[StepMember]) -> str:
    """Return the declaration of a struct in C."""
    rows = [f"    {m.declaration} {comment([_described(m)]).rstrip()}\n" for m in members]
    rows = rows or ["    double unused; /* C knows no empty struct */\n"]
    return f"typedef struct {name} {{\n{''.join(rows)}}} {name};\n\n"


def _described(m: StepMember) -> str:
    unit = "" if m.integer else f" [{m.unit if m.unit not in ('', '?') else '1'}]"
    return f"{m.name}{unit}{': ' if m.description else ''}{m.description}"


class StepTwin(ABC):
    """A step function in Python, with the same operations as in C: its records hold the same bytes."""

    @abstractmethod
    def init(self, state: np.ndarray, start: np.ndarray) -> Status:
        """Write a new state from a record of the start, only with OK."""

    @abstractmethod
    def step(self, state: np.ndarray, inputs: np.ndarray, outputs: np.ndarray) -> Status:
        """Run one cycle; state and outputs are written only with OK."""


class StepFunction(ABC):
    """Base class of functions with a state that run once in a cycle: a filter, a sampled block.

    A subclass declares the members of the structs, the C text and the twin in Python; the folder, the header, the
    self-test and the comparison with Python are generated from these, see docs/c_contract.md.

    title: one line. period: of a cycle [s]. start, inputs, outputs, state: members of the structs. defaults: values of
    the start by name. runtime: hand-written headers that it needs; the first one includes the others.
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
        """Return the generated bodies under their C names."""

    @abstractmethod
    def text(self, symbol: str, real: Real) -> str:
        """Return the C text of `symbol`_init and `symbol`_step, with its tables; in double."""

    @abstractmethod
    def twin(self, real: Real) -> StepTwin:
        """Return the twin in Python."""

    @abstractmethod
    def examples(self, rows: int, seed: int, real: Real) -> np.ndarray:
        """Return records of inputs for consecutive steps of a run."""

    @abstractmethod
    def complete(self, real: Real) -> np.ndarray:
        """Return inputs, none missing, with which steps from the declared start return OK: the costliest case."""

    @abstractmethod
    def facts(self) -> Mapping[str, Any]:
        """Return the data from which it was made, for manifest and hash: numbers exact to the last bit."""

    def explain(self, full: bool = True) -> str:
        """Return a description of the function and of its statuses; `full` changes nothing."""
        return "\n".join([self.title, *self.notes()])

    def notes(self) -> Sequence[str]:
        """Return lines on the statuses, for the header."""
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
        """Suffixes of the C names that it defines."""
        return ("start", "in", "out", "state", "defaults", "init", "step")

    def started(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the records of the declared start and of an empty state."""
        f = self.function
        return record(f.start, self.real, f.defaults), record(f.state, self.real)


_SAME = (
    "State and outputs are written only with GT_OK. A step with another status has not happened: the state is that "
    "before this cycle."
)


def declarations(face: StepFace) -> str:
    """Return structs and functions of one step function, for the header."""
    f, symbol = face.function, face.symbol
    title = f"{face.key}: {f.title}. A step function: one step every {decimal(f.period)} s."
    return "".join(
        [
            comment([title, _SAME, *f.notes()]),
            struct(f"{symbol}_start", f.start),
            struct(f"{symbol}_in", f.inputs),
            struct(f"{symbol}_out", f.outputs),
            comment(["The state; the struct is yours. Each running instance needs its own."]),
            struct(f"{symbol}_state", f.state),
            comment(["Writes the declared start."]),
            f"void {symbol}_defaults({symbol}_start *start);\n\n",
            comment(["Initialises the state: the start holds the values one period before the first step."]),
            f"gt_status {symbol}_init({symbol}_state *state, const {symbol}_start *start);\n\n",
            comment(["Runs one cycle."]),
            f"{step_prototype(symbol)};\n\n",
        ]
    )


def step_prototype(symbol: str) -> str:
    """Return the declaration of the step, without the semicolon."""
    return f"gt_status {symbol}_step({symbol}_state *state, const {symbol}_in *in, {symbol}_out *out)"


def definitions(face: StepFace) -> str:
    """Return the C text of defaults, init and step."""
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
    """Return the C interfaces of causal and of step functions. Raises GenerationError for names unusable in C."""
    stepping = {key: f for key, f in functions.items() if isinstance(f, StepFunction)}
    causal = {key: f for key, f in functions.items() if not isinstance(f, StepFunction)}
    faces = [] if stepping and not causal and not along and not box else interfaces(causal, name, along, real, box)
    check_identifier(name, "the name of the generated code", "name")
    steps = step_faces(stepping, name, real)
    check_apart(steps, [symbol for f in faces for symbol in (f.symbol, f"{f.symbol}_in", f"{f.symbol}_out", *f.bodies)])
    return faces, steps


def step_faces(functions: Mapping[str, StepFunction], name: str, real: Real) -> list[StepFace]:
    """Return the C interfaces of step functions. Raises GenerationError for names that cannot be used in C."""
    faces = []
    for key, function in functions.items():
        check_identifier(key, "a function", "functions")
        for side in ("start", "inputs", "outputs", "state"):
            check_members(getattr(function, side), side)
        faces.append(StepFace(key, f"gt_{name}_{key}", function, real))
    return faces


def check_apart(faces: Sequence[StepFace], others: Sequence[str]) -> None:
    """Raise GenerationError if a C name of a step function is already used."""
    taken = {symbol.lower() for symbol in others}
    for face in faces:
        for symbol in (face.symbol, *[f"{face.symbol}_{suffix}" for suffix in face.suffixes]):
            if symbol.lower() in taken:
                raise GenerationError(
                    f"the function '{face.key}' needs the C name {symbol}, which is already used; rename it",
                    "functions",
                )
            taken.add(symbol.lower())
