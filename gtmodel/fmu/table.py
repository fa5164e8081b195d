"""The variables of a functional mock-up unit, from which its descriptions (FMI 2.0, 3.0) and its C are written."""

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
    """One scalar variable: value reference, name, unit and role.

    least, most: limits of a model parameter, infinite if it has none. start: start value of a settable variable or a
    state; None for a computed variable. of_state: for a derivative, the value reference of its state. integer: flag or
    counter. sampled: changes at samples only.
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
    """All variables of an FMU in the order of their value references, and their dependencies.

    name: model identifier, also of the library. states, rates: value references of the states and of their derivatives,
    which may be states themselves. dependencies: of each computed variable on inputs, parameters, states and time.
    step: largest step of the inner integrator [s]; stop: end of the default experiment [s]; period: sampling period
    [s], 0 without samples. error: of the inner integrator, if there are states. derivatives: the FMU offers exact
    derivatives. remembers: Newton's last solution is part of the state. hold: outputs are held if the function fails,
    and an integer output reports it. parameters: consecutive value references of settable model parameters;
    part_error: largest error of an inner step, if there are such parameters.
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
        """The real variables; their value reference is their index."""
        return [v for v in self.variables if not v.integer]

    @property
    def integers(self) -> list[FmuVariable]:
        """The integer variables, whose value references follow."""
        return [v for v in self.variables if v.integer]

    @property
    def computed(self) -> list[int]:
        """Value references of the computed variables, in order."""
        return [v.reference for v in self.variables if v.role in ("derivative", "output")]

    def of(self, *roles: Role) -> list[FmuVariable]:
        """Return the variables with these roles."""
        return [v for v in self.variables if v.role in roles]


def texts_of(flat: FlatModel) -> tuple[str, ...]:
    """Return the paths of a model's components from Modelica text, whose indices count from one."""
    return tuple(c._path for c in flat.tree.components if getattr(type(c), "_counts_from_one", False))


def fmi_name(name: str, texts: Collection[str] = ()) -> str:
    """Convert a name to FMI's structured naming: indices from one, identifiers with other characters in quotes.

    texts: paths of components, "" for the whole model, whose indices already count from one.

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
    parts, offset = [], 0
    for part in name.split("."):
        counts = offset < python
        offset += len(part) + 1
        word, bracket, rest = part.partition("[")
        if not _PLAIN.fullmatch(word):
            plain = word.encode("ascii", "backslashreplace").decode()  # names must be ASCII
            word = "'" + _ESCAPED.sub(r"\\\g<0>", plain) + "'"
        parts.append(word + (_INDEX.sub(_from_one, bracket + rest) if counts else bracket + rest))
    return ".".join(parts)


def _from_one(index: re.Match[str]) -> str:
    return "[" + ",".join(str(int(k) + 1) for k in index[1].split(",")) + "]"


def unused(name: str, taken: Collection[str]) -> str:
    """Return the name, with underscores before its index if another variable has it.

    >>> from gtmodel.fmu.table import unused
    >>> unused("T_out[1]", {"T_out[1]", "T"}), unused("T_out[2]", {"T_out[1]"})
    ('T_out_[1]', 'T_out[2]')
    """
    while name in taken:
        word, bracket, index = name.partition("[")
        name = longer(word, "_") + bracket + index
    return name


def longer(word: str, end: str) -> str:
    """Append to a name, inside its quotes if it has any."""
    return f"{word[:-1]}{end}'" if word.endswith("'") else f"{word}{end}"


def base_and_order(name: str) -> tuple[str, int]:
    """Split a name such as der(T,2) into ("T", 2)."""
    derivative = _DERIVATIVE.fullmatch(name)
    if not derivative:
        return name, 0
    base, order = base_and_order(derivative["inner"])
    return base, order + int(derivative["order"] or 1)
