"""The variables of a unit by name: which can be read, which can be set, and how they become SI."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._near import meant
from ..lang.units import UnitError, parse_unit
from ..results.refusal import ArgumentError

SHOWN = 12  # names in a sentence
NEAR = 0.5  # of difflib: "tau_1" is near "tau[1]"
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")


@dataclass(frozen=True)
class UnitSignal:
    """A real variable as its description has it.

    unit: its name, empty where it has none. base: exponents of kg, m, s, A, K, mol, cd, with factor and offset:
    SI = factor * value + offset; None where the description does not define the unit.
    """

    name: str
    reference: int
    causality: str
    settable: bool
    scalar: bool
    unit: str = ""
    base: tuple[tuple[int, ...], float, float] | None = None

    @property
    def computed(self) -> bool:
        """An output, or a variable inside."""
        return self.causality in ("output", "local", "calculatedParameter")

    @property
    def taken(self) -> bool:
        """An input."""
        return self.causality == "input"


class UnitSignals:
    """The real variables of a description that FMPy read. Its methods raise ArgumentError for names that do not fit."""

    def __init__(self, name: str, description: Any) -> None:
        self.name = name
        defined = {u.name: u.baseUnit for u in description.unitDefinitions if u.baseUnit is not None}
        self.all = {v.name: _signal(v, defined) for v in description.modelVariables if v.type in ("Real", "Float64")}

    def of(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Variables by name; where there is none of that name, those with near names are said."""
        for name in names:
            if name not in self.all:
                others = meant(name, self.all, f"it has {self._some(lambda s: True)}", most=3, cutoff=NEAR)
                raise ArgumentError(f"'{self.name}' has no real variable '{name}'; {others}", argument)
            if not self.all[name].scalar:
                raise ArgumentError(f"'{name}' of '{self.name}' is an array; name scalars", argument)
        return [self.all[name] for name in names]

    def computed(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Variables that the unit computes."""
        return self._which(names, argument, lambda s: s.computed, "expected an output")

    def taken(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Inputs."""
        return self._which(names, argument, lambda s: s.taken, "expected an input")

    def settable(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Variables that have a start value."""
        return self._which(names, argument, lambda s: s.settable, "expected a variable with a start value")

    def _which(
        self, names: Sequence[str], argument: str, good: Callable[[UnitSignal], bool], expected: str
    ) -> list[UnitSignal]:
        signals = self.of(names, argument)
        for s in signals:
            if not good(s):
                raise ArgumentError(
                    f"'{s.name}' of '{self.name}' has causality {s.causality}; {expected}, such as {self._some(good)}",
                    argument,
                )
        return signals

    def _some(self, good: Callable[[UnitSignal], bool]) -> str:
        names = [s.name for s in self.all.values() if good(s)]
        return ", ".join(names[:SHOWN]) + (", ..." if names[SHOWN:] else "") if names else "none"


@dataclass(frozen=True)
class Scaling:
    """SI = factor * value + offset, for each of some variables; None where all are in SI: not a bit changes."""

    factor: np.ndarray | None = None
    offset: np.ndarray | None = None

    def si(self, values: np.ndarray) -> np.ndarray:
        """Numbers of the unit in SI."""
        return values if self.factor is None else self.factor * values + self.offset

    def own(self, values: np.ndarray) -> np.ndarray:
        """Numbers in SI as the unit has them."""
        return values if self.factor is None else (values - self.offset) / self.factor


def scaling(signals: Sequence[UnitSignal], wanted: str, said: str, argument: str) -> Scaling:
    """How variables become a quantity in the unit `wanted`, such as "m".

    said: the unit as the caller says it, for variables that have none. Raises ArgumentError for a unit of another
    dimension, for one that neither side says, and where both say different ones.
    """
    pairs: list[tuple[float, float]] = []
    for s in signals:
        if not s.unit and not said:
            raise ArgumentError(
                f"'{s.name}' has no unit in its description, and {wanted} is not to be guessed; say it in units",
                argument,
            )
        own = _base(s.unit, s.base, s, argument) if s.unit else None
        given = _base(said, None, s, "units") if said else None
        if own is not None and given is not None and own != given:
            raise ArgumentError(f"'{s.name}' is in {s.unit} by its description, not in {said}", "units")
        base = own or given
        assert base is not None
        if base[0] != _base(wanted, None, s, argument)[0]:
            raise ArgumentError(f"'{s.name}' is in {s.unit or said}; expected a unit such as {wanted}", argument)
        if not (np.isfinite(base[1]) and np.isfinite(base[2]) and base[1] != 0.0):
            raise ArgumentError(
                f"the unit {s.unit} of '{s.name}' has the factor {base[1]:g} and the offset {base[2]:g}; expected "
                "finite numbers, the factor not zero",
                argument,
            )
        pairs.append(base[1:])
    if all(pair == (1.0, 0.0) for pair in pairs):
        return Scaling()
    factors, offsets = np.array(pairs).T
    return Scaling(factors, offsets)


def _base(
    unit: str, base: tuple[tuple[int, ...], float, float] | None, s: UnitSignal, argument: str
) -> tuple[tuple[int, ...], float, float]:
    if base is not None:
        return base
    try:
        parsed = parse_unit(unit)
    except UnitError as error:
        raise ArgumentError(f"the unit of '{s.name}' cannot be read: {error}", argument) from error
    kg, m, seconds, *others = parsed.dimension.exponents
    return (tuple(int(x) for x in (kg, m, seconds, *others)), parsed.scale, 0.0)


def _signal(v: Any, defined: Any) -> UnitSignal:
    unit = v.unit or (v.declaredType.unit if v.declaredType is not None else None) or ""
    base = defined.get(unit)
    factors = None
    if base is not None:
        factors = (tuple(int(getattr(base, name)) for name in _BASES), float(base.factor), float(base.offset))
    return UnitSignal(
        name=v.name,
        reference=int(v.valueReference),
        causality=v.causality or "local",
        settable=v.start is not None and v.variability != "constant" and v.causality != "structuralParameter",
        scalar=not v.dimensions,
        unit=unit,
        base=factors,
    )
