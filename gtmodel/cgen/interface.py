"""The C face of a causal function: names of its type, its function and its members, and the box of validity inside
which it must answer."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..compiler.analysis.sizes import Sizes
from ..compiler.blocks import Margin
from ..compiler.causal import CausalFunction, CausalSignal, c_name
from .lanes import Lanes
from .newton_stages import NewtonStage, Stages, stages
from .real import DOUBLE, GenerationError, Real

Intervals = tuple[tuple[float, float], ...]


def box_of(function: CausalFunction, box: Mapping[str, Sequence[Sequence[float]]]) -> Intervals | None:
    """Least and greatest value of every number of the inputs, in their order; None where the box lacks one.

    box: intervals by name of a signal such as "der(T)", one for each of its numbers, or one for all. Raises
    GenerationError for an interval that is none, and for another number of them.
    """
    intervals: list[tuple[float, float]] = []
    for s in function.inputs:
        if s.name not in box:
            return None
        given = [tuple(float(x) for x in interval) for interval in box[s.name]]
        if len(given) not in (1, s.size):
            raise GenerationError(
                f"the box gives {len(given)} intervals for '{s.name}'; give {s.size}, or one for all", "box"
            )
        for interval in given * (s.size if len(given) == 1 else 1):
            if len(interval) != 2 or not np.all(np.isfinite(interval)) or interval[0] > interval[1]:
                raise GenerationError(f"the box gives {list(interval)} for '{s.name}'; give [least, greatest]", "box")
            intervals.append((interval[0], interval[1]))
    return None if function.plan.uses_time else tuple(intervals)


def check_names(functions: Mapping[str, CausalFunction], box: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """GenerationError for a name in the box that is the input of no function."""
    known = {s.name for f in functions.values() for s in f.inputs}
    for name in box:
        if name not in known:
            raise GenerationError(
                f"the box speaks of '{name}', which no function takes; it knows {', '.join(sorted(known))}",
                "box",
            )


_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")
_UNITLESS = {"", "1", "?"}
_KEYWORDS = """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char class compl concept const
    const_cast constexpr continue decltype default delete do double dynamic_cast else enum explicit export extern
    false float for friend goto if inline int long mutable namespace new noexcept not not_eq nullptr operator or
    or_eq private protected public register reinterpret_cast restrict return short signed sizeof static
    static_assert static_cast struct switch template this thread_local throw true try typedef typeid typename union
    unsigned using virtual void volatile wchar_t while xor xor_eq
"""
KEYWORDS = frozenset(_KEYWORDS.split())


@dataclass(frozen=True)
class Member:
    """One member of a struct: `size` doubles, an array unless the signal is a scalar."""

    identifier: str
    size: int
    is_array: bool
    signal: str
    shape: tuple[int, ...]
    unit: str
    description: str
    where: str

    @property
    def declaration(self) -> str:
        """Such as `double q_m[3];`."""
        return f"double {self.identifier}[{self.size}];" if self.is_array else f"double {self.identifier};"

    def address(self, struct: str) -> str:
        """C expression for the address of the first number, `struct` being `in->` or `out.`."""
        return f"{struct}{self.identifier}" if self.is_array else f"&{struct}{self.identifier}"


@dataclass(frozen=True)
class Interface:
    """A causal function under the C name `symbol`, with typed inputs and outputs.

    `along`: it is also offered along a sampled reference; `real`: the numbers it computes with;
    `box`: where it must answer. A function with Newton blocks has `stages`, and a `state` of
    its last solution that the caller owns.
    """

    key: str
    symbol: str
    function: CausalFunction
    inputs: tuple[Member, ...]
    outputs: tuple[Member, ...]
    stages: Stages | None = None
    state: tuple[Member, ...] = ()
    along: bool = False
    real: Real = DOUBLE
    box: Intervals | None = None

    @cached_property
    def sizes(self) -> Sizes:
        """How large the numbers of each input may be; beyond, the status is OUT_OF_RANGE."""
        return self.function.sizes if self.real is DOUBLE else self.function.sizes_in(self.real.precision)

    @property
    def body(self) -> str:
        """C name of the generated body."""
        return f"{self.symbol}_body"

    @property
    def macro(self) -> str:
        """Prefix of the macros of this function."""
        return macro(self.body)

    @property
    def newton(self) -> tuple[NewtonStage, ...]:
        """The Newton blocks; none of a closed form."""
        return self.stages.newton if self.stages else ()

    @property
    def loops(self) -> Lanes | None:
        """What of the body is written as loops; None where it is written out."""
        return self.stages.loops if self.stages else None

    @property
    def margins(self) -> list[Margin]:
        """What decides the status of C, block by block."""
        if self.stages is None or self.loops is None:
            return self.function.margins
        return [*[m for stage in self.newton for m in stage.margins], *self.stages.margins]

    @property
    def bodies(self) -> list[str]:
        """C names of all that is generated for this function."""
        parts = [f"{self.symbol}_{part}{k}" for k in range(len(self.newton)) for part in ("prepare", "kernel")]
        return [*parts, self.body]

    @property
    def state_size(self) -> int:
        """How many unknowns of Newton blocks there are."""
        return sum(m.size for m in self.state)

    @property
    def input_size(self) -> int:
        """How many doubles the struct of inputs holds."""
        return sum(m.size for m in self.inputs)

    @property
    def output_size(self) -> int:
        """How many doubles the struct of outputs holds."""
        return sum(m.size for m in self.outputs)


def interfaces(
    functions: Mapping[str, CausalFunction],
    name: str,
    along: Collection[str] = (),
    real: Real = DOUBLE,
    box: Mapping[str, Sequence[Sequence[float]]] | None = None,
) -> list[Interface]:
    """C faces of the functions, in their order; those named in `along` also along a sampled reference. `box`: intervals
    by name of a signal; a function all of whose inputs have one must answer everywhere inside.

    Raises GenerationError for a name that is no identifier, and for two names that meet in C.
    """
    check_identifier(name, "the name of the generated code", "name")
    check_names(functions, box or {})
    unknown = [key for key in along if key not in functions]
    if unknown:
        raise GenerationError(f"there is no function '{unknown[0]}' to offer along a reference", "along")
    if not functions:
        raise GenerationError("there is no function to generate; give at least one", "functions")
    result = []
    for key, function in functions.items():
        check_identifier(key, "a function", "functions")
        time = (CausalSignal("time", (), "s", ()),) if function.plan.uses_time else ()
        inputs = _members(function, (*function.inputs, *time))
        symbol = f"gt_{name}_{key}"
        cut = stages(function, symbol, real) if function.plan.newton else None
        unknowns = [s for block in cut.newton for s in block.unknowns] if cut else []
        face = Interface(
            key, symbol, function, inputs, _members(function, function.outputs), cut, _members(function, unknowns),
            key in along, real, box_of(function, box or {}),
        )  # fmt: skip
        if face.along and (face.newton or function.plan.uses_time or not inputs):
            raise GenerationError(
                f"'{key}' cannot be offered along a reference: that takes a closed form of inputs without time",
                "along",
            )
        result.append(face)
    _check_distinct(result, name)
    return result


def places(members: Iterable[Member], first: int = 0) -> list[tuple[slice, Member]]:
    """Where the numbers of each member stand in a row of all, from `first` on."""
    slices = []
    for m in members:
        slices.append((slice(first, first + m.size), m))
        first += m.size
    return slices


def macro(symbol: str) -> str:
    """Prefix of the macros of a body."""
    return symbol.removesuffix("_body").upper()


def check_identifier(name: str, what: str, argument: str) -> None:
    """GenerationError unless the name can be part of a C identifier."""
    if not _IDENTIFIER.fullmatch(name):
        raise GenerationError(
            f"'{name}' cannot name {what}: use letters, digits and single underscores, beginning with a letter",
            argument,
        )


def unit_suffix(unit: str) -> str:
    """A unit as a word of an identifier: N.m -> Nm, m/s2 -> m_s2, 1/s -> per_s, "" for a pure number."""
    if unit in _UNITLESS:
        return ""
    text = f"per_{unit[2:]}" if unit.startswith("1/") else unit
    return re.sub(r"[^A-Za-z0-9_]+", "", text.replace("/", "_")).strip("_")


def _members(function: CausalFunction, signals: Iterable[CausalSignal]) -> tuple[Member, ...]:
    taken: set[str] = set()
    result = []
    for s in signals:
        v = function.flat.variables[s.pairs[0][0]] if s.pairs else None  # none is that of the time
        suffix = unit_suffix(s.unit)
        base = _ascii(f"{c_name(s.name)}_{suffix}" if suffix else c_name(s.name))
        identifier, n = base, 1
        while identifier in taken or identifier in KEYWORDS:
            n += 1
            identifier = f"{base}_{n}"
        taken.add(identifier)
        about = (v.description, str(v.where)) if v else ("", "")
        result.append(Member(identifier, max(len(s.pairs), 1), bool(s.shape), s.name, s.shape, s.unit, *about))
    return tuple(result)


def _ascii(text: str) -> str:
    """A Python identifier as a C99 identifier: letters outside ASCII by their code point."""
    return "".join(c if c.isascii() else f"u{ord(c):04x}" for c in text)


def _check_distinct(faces: list[Interface], name: str) -> None:
    taken = {f"gt_{name}_{own}".lower(): "the self-test" for own in ("selftest", "selftest_difference")}
    for face in faces:
        state = (f"{face.symbol}_state", f"{face.symbol}_start") if face.newton else ()
        state += (f"{face.symbol}_at",) if face.along else ()
        for symbol in (face.symbol, *face.bodies, f"{face.symbol}_in", f"{face.symbol}_out", *state):
            # macros are written in capitals
            if symbol.lower() in taken:
                other = taken[symbol.lower()]
                raise GenerationError(
                    f"the function '{face.key}' needs the C name {symbol}, which {other} has; rename it",
                    "functions",
                )
            taken[symbol.lower()] = f"the function '{face.key}'"
