"""The variables of a functional mock-up unit, from which both versions of its description and its C are made."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ..compiler.flat import FlatModel
else:
    from .._lazy import hint

    FlatModel = hint("gtmodel.compiler.flat", "FlatModel")

Role = Literal["time", "input", "fixed", "tunable", "state", "derivative", "output"]
SETTABLE = ("input", "fixed", "tunable", "state")
_DERIVATIVE = re.compile(r"der\((?P<inner>.*?)(?:,(?P<order>\d+))?\)")
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_ESCAPED = re.compile(r"[\\'\"]")
_INDEX = re.compile(r"\[(\d+(?:,\s*\d+)*)\]")


@dataclass(frozen=True)
class FmuVariable:
    """One scalar variable: its value reference, name, unit, what it is for.

    least, most: of a parameter of the model; infinite where there is none. start: where it can be set, and of what
    remembers; None of what is computed. of_state: of a derivative the value
    reference of the state whose rate it is. integer: a flag or a counter. sampled: it changes at samples only.
    """

    reference: int
    name: str
    unit: str
    description: str
    role: Role
    start: float | int | None = None
    of_state: int | None = None
    nominal: float = 1.0
    integer: bool = False
    sampled: bool = False
    least: float = -math.inf
    most: float = math.inf


@dataclass(frozen=True)
class FmuTable:
    """All variables of a unit in the order of their value references, and what depends on what.

    name: model identifier, also of the library. states, rates: value references of the states and of their derivatives,
    which may be states themselves. dependencies: of each computed variable on inputs, parameters, states and the time.
    step: largest step of the integrator inside [s]; stop: end of the default experiment [s]; period: of samples [s], 0
    where there are none. error: of the integrator inside, where there are states. derivatives: exact ones are offered.
    remembers: Newton's last solution is part of the state. hold: outputs are held where there is no answer, and an
    integer output says so. parameters: value references, in line, of the parameters of the model that can be set;
    part_error: the largest error of one part of a step inside, where there are some.
    """

    name: str
    title: str
    variables: Sequence[FmuVariable]
    dependencies: Mapping[int, Sequence[int]]
    states: Sequence[int] = ()
    rates: Sequence[int] = ()
    step: float = 1e-3
    stop: float = 1.0
    period: float = 0.0
    error: float | None = None
    derivatives: bool = True
    remembers: bool = False
    hold: bool = False
    parameters: Sequence[int] = ()
    part_error: float = 0.0

    @property
    def numbers(self) -> list[FmuVariable]:
        """The real variables; their value reference is their place."""
        return [v for v in self.variables if not v.integer]

    @property
    def integers(self) -> list[FmuVariable]:
        """The integer ones, whose value references follow."""
        return [v for v in self.variables if v.integer]

    @property
    def computed(self) -> list[int]:
        """Value references of what is computed from the others, in order."""
        return [v.reference for v in self.variables if v.role in ("derivative", "output")]

    def of(self, *roles: Role) -> list[FmuVariable]:
        """The variables of these roles."""
        return [v for v in self.variables if v.role in roles]


def texts_of(flat: FlatModel) -> tuple[str, ...]:
    """Paths of the components of a model that come from Modelica text, whose names count from one."""
    return tuple(c._path for c in flat.tree.components if getattr(type(c), "_counts_from_one", False))


def fmi_name(name: str, texts: Collection[str] = ()) -> str:
    """A name as the structured naming of FMI has it: indices from one, identifiers of other letters in quotes.

    texts: paths of components, "" for the whole model, inside of which names count from one already.

    >>> from gtmodel.fmu.table import fmi_name
    >>> fmi_name("der(robot.T[0],2)"), fmi_name("arm[0].rod.tension")
    ('der(robot.T[1],2)', 'arm[1].rod.tension')
    >>> fmi_name("der(tank[1].h[2])", texts=[""]), fmi_name("row[0].h[2]", texts=["row[0]"])
    ('der(tank[1].h[2])', 'row[1].h[2]')
    >>> print(fmi_name("\u03b8[0]"))
    '\\\\u03b8'[1]
    """
    derivative = _DERIVATIVE.fullmatch(name)
    if derivative:
        order = f",{derivative['order']}" if derivative["order"] else ""
        return f"der({fmi_name(derivative['inner'], texts)}{order})"
    python = min((len(t) for t in texts if not t or name.startswith(f"{t}.")), default=len(name))
    parts, at = [], 0
    for part in name.split("."):
        counts = at < python
        at += len(part) + 1
        word, bracket, rest = part.partition("[")
        if not _PLAIN.fullmatch(word):
            plain = word.encode("ascii", "backslashreplace").decode()  # letters beyond ASCII have no place in a name
            word = "'" + _ESCAPED.sub(r"\\\g<0>", plain) + "'"
        parts.append(word + (_INDEX.sub(_from_one, bracket + rest) if counts else bracket + rest))
    return ".".join(parts)


def _from_one(index: re.Match[str]) -> str:
    return "[" + ",".join(str(int(k) + 1) for k in index[1].split(",")) + "]"


def unused(name: str, taken: Collection[str]) -> str:
    """The name itself, or with underscores before its index where another variable has it.

    >>> from gtmodel.fmu.table import unused
    >>> unused("T_out[1]", {"T_out[1]", "T"}), unused("T_out[2]", {"T_out[1]"})
    ('T_out_[1]', 'T_out[2]')
    """
    while name in taken:
        word, bracket, index = name.partition("[")
        name = longer(word, "_") + bracket + index
    return name


def longer(word: str, end: str) -> str:
    """A name with something behind it, inside of the quotes where it has some."""
    return f"{word[:-1]}{end}'" if word.endswith("'") else f"{word}{end}"


def base_and_order(name: str) -> tuple[str, int]:
    """A name such as der(T,2) as ("T", 2)."""
    derivative = _DERIVATIVE.fullmatch(name)
    if not derivative:
        return name, 0
    base, order = base_and_order(derivative["inner"])
    return base, order + int(derivative["order"] or 1)
