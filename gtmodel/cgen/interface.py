"""The C interface of a causal function: names of its structs, its function and its members, and its box of validity."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..compiler.analysis.sizes import Sizes
from ..compiler.blocks import Margin
from ..compiler.causal import CausalFunction, CausalSignal, c_name
from .lanes import Lanes
from .newton_stages import NewtonStage, Stages, stages
from .real import DOUBLE, GenerationError, Real

Intervals = tuple[tuple[float, float], ...]


def box_of(function: CausalFunction, box: Mapping[str, Sequence[Sequence[float]]]) -> Intervals | None:
    """Return least and greatest value of every number of the inputs, in their order; None if the box lacks an input.

    box: intervals by name of a signal such as "der(T)", one for each of its numbers, or one for all. None also if the
    function depends on the time. Raises GenerationError for an invalid interval or a wrong number of intervals.
    """
    intervals: list[tuple[float, float]] = []
    for s in function.inputs:
        if s.name not in box:
            return None
        rows = [tuple(float(x) for x in interval) for interval in box[s.name]]
        if len(rows) not in (1, s.size):
            raise GenerationError(
                f"the box gives {len(rows)} intervals for '{s.name}'; give {s.size}, or one for all", "box"
            )
        for interval in rows * (s.size if len(rows) == 1 else 1):
            if len(interval) != 2 or not np.all(np.isfinite(interval)) or interval[0] > interval[1]:
                raise GenerationError(f"the box gives {list(interval)} for '{s.name}'; give [least, greatest]", "box")
            intervals.append((interval[0], interval[1]))
    return None if function.plan.uses_time else tuple(intervals)


def check_names(functions: Mapping[str, CausalFunction], box: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """Raise GenerationError if a name in the box is not an input of any function."""
    names = {s.name for f in functions.values() for s in f.inputs}
    for name in box:
        if name not in names:
            raise GenerationError(
                f"the box holds '{name}', not an input; the inputs are {', '.join(sorted(names))}",
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

    along: also generate the variant along a sampled reference. real: number type in C. box: intervals inside which
    the function must have a solution. A function with Newton blocks has `stages`, and a `state` that holds its last
    solution and that the caller owns.
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
        """Limits of the inputs; larger inputs give the status OUT_OF_RANGE."""
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
        """The Newton blocks; empty for a closed form."""
        return self.stages.newton if self.stages else ()

    @property
    def loops(self) -> Lanes | None:
        """The body as loops over its lanes; None if it is written out."""
        return self.stages.loops if self.stages else None

    @property
    def margins(self) -> list[Margin]:
        """Margins that decide the status in C, block by block."""
        if self.stages is None or self.loops is None:
            return self.function.margins
        return [*[m for stage in self.newton for m in stage.margins], *self.stages.margins]

    @property
    def bodies(self) -> list[str]:
        """C names of all bodies of this function."""
        parts = [f"{self.symbol}_{part}{k}" for k in range(len(self.newton)) for part in ("prepare", "kernel")]
        return [*parts, self.body]

    @property
    def state_size(self) -> int:
        """Number of unknowns of all Newton blocks."""
        return sum(m.size for m in self.state)

    @property
    def input_size(self) -> int:
        """Number of doubles in the struct of inputs."""
        return sum(m.size for m in self.inputs)

    @property
    def output_size(self) -> int:
        """Number of doubles in the struct of outputs."""
        return sum(m.size for m in self.outputs)


def interfaces(
    functions: Mapping[str, CausalFunction],
    name: str,
    along: Collection[str] = (),
    real: Real = DOUBLE,
    box: Mapping[str, Sequence[Sequence[float]]] | None = None,
) -> list[Interface]:
    """Return the C interfaces of the functions, in their order; those named in `along` also along a sampled reference.

    box: intervals by name of a signal; a function whose inputs all have intervals must have a solution everywhere
    inside. Raises GenerationError if a name is not an identifier, or if two functions need the same C name.
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
        calls = function.plan.flat.scope.calls
        if calls and real is not DOUBLE:
            raise GenerationError(
                f"'{key}' cannot become C in {real.name}, since its model calls the external function "
                f"'{calls[0].name()}'; generate double, or give gt.external a function whose operations CasADi can "
                "write out",
                "real",
            )
        if wrong := next((f for f in calls if not _has_c(f)), None):
            raise GenerationError(
                f"'{key}' cannot become C, since its model calls the external function '{wrong.name()}', for which "
                "CasADi writes no C, as for a callback, a solver or a compiled library; give gt.external a function of "
                "CasADi's operations, or a table with gt.interpolate",
                "functions",
            )
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
                f"'{key}' cannot be offered along a reference; give a closed form with inputs and without time",
                "along",
            )
        result.append(face)
    _check_distinct(result, name)
    return result


def _has_c(f: ca.Function) -> bool:
    """Return whether CasADi writes all of the C of a function."""
    if any(g.is_a("External", True) for g in (f, *f.find_functions())):
        return False  # its C only declares what a library defines
    generator = ca.CodeGenerator("f")
    with contextlib.redirect_stderr(io.StringIO()):  # CasADi warns; the caller says it
        generator.add(f)
        return "#error" not in generator.dump()


def places(members: Iterable[Member], first: int = 0) -> list[tuple[slice, Member]]:
    """Return the slice of each member in a row of all numbers, which starts at `first`."""
    slices = []
    for m in members:
        slices.append((slice(first, first + m.size), m))
        first += m.size
    return slices


def linkage(name: str) -> str:
    """Return the macro before the declarations of the bodies: empty, or static where their file is included."""
    return f"GT_{name.upper()}_LINKAGE"


def macro(symbol: str) -> str:
    """Prefix of the macros of a body."""
    return symbol.removesuffix("_body").upper()


def check_identifier(name: str, subject: str, argument: str) -> None:
    """Raise GenerationError unless the name can be part of a C identifier."""
    if not _IDENTIFIER.fullmatch(name):
        raise GenerationError(
            f"'{name}' cannot name {subject}: use letters, digits and single underscores, beginning with a letter",
            argument,
        )


def unit_suffix(unit: str) -> str:
    """Return a unit as part of an identifier: N.m -> Nm, m/s2 -> m_s2, 1/s -> per_s, "" for a pure number."""
    if unit in _UNITLESS:
        return ""
    text = f"per_{unit[2:]}" if unit.startswith("1/") else unit
    return re.sub(r"[^A-Za-z0-9_]+", "", text.replace("/", "_")).strip("_")


def _members(function: CausalFunction, signals: Iterable[CausalSignal]) -> tuple[Member, ...]:
    taken: set[str] = set()
    result = []
    for s in signals:
        v = function.flat.variables[s.pairs[0][0]] if s.pairs else None  # the time has no symbols
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
    """Return a Python identifier as a C99 identifier, with code points for letters outside ASCII."""
    return "".join(c if c.isascii() else f"u{ord(c):04x}" for c in text)


def _check_distinct(faces: list[Interface], name: str) -> None:
    taken = {f"gt_{name}_{suffix}".lower(): "the self-test" for suffix in ("selftest", "selftest_difference")}
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
