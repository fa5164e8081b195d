"""The variables of an FMU by name: which can be read or set, and their conversion to SI."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._near import meant
from ..lang.units import UnitError, parse_unit
from ..results.refusal import ArgumentError

SHOWN = 12  # names in a sentence
NEAR = 0.5  # cutoff of difflib: "tau_1" is near "tau[1]"
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")


@dataclass(frozen=True)
class UnitSignal:
    """A real variable of a description.

    unit: name, empty if it has none. base: exponents of kg, m, s, A, K, mol, cd, with factor and offset:
    SI = factor * value + offset; None if the description does not define the unit.
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
        """Whether it is an output or a local variable."""
        return self.causality in ("output", "local", "calculatedParameter")

    @property
    def taken(self) -> bool:
        """Whether it is an input."""
        return self.causality == "input"


class UnitSignals:
    """The real variables of a description read by FMPy. The methods raise ArgumentError if a name does not fit."""

    def __init__(self, name: str, description: Any) -> None:
        self.name = name
        defined = {u.name: u.baseUnit for u in description.unitDefinitions if u.baseUnit is not None}
        self.all = {v.name: _signal(v, defined) for v in description.modelVariables if v.type in ("Real", "Float64")}

    def of(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Return variables by name; the error for an unknown name lists similar names."""
        for name in names:
            if name not in self.all:
                others = meant(name, self.all, f"it has {self._some(lambda s: True)}", most=3, cutoff=NEAR)
                raise ArgumentError(f"'{self.name}' has no real variable '{name}'; {others}", argument)
            if not self.all[name].scalar:
                raise ArgumentError(f"'{name}' of '{self.name}' is an array; name scalars", argument)
        return [self.all[name] for name in names]

    def computed(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Return variables that the FMU computes."""
        return self._which(names, argument, lambda s: s.computed, "expected an output")

    def taken(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Return inputs."""
        return self._which(names, argument, lambda s: s.taken, "expected an input")

    def settable(self, names: Sequence[str], argument: str) -> list[UnitSignal]:
        """Return variables with a start value."""
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
    """Conversion of some variables: SI = factor * value + offset; None if all are in SI, so that no bit changes."""

    factor: np.ndarray | None = None
    offset: np.ndarray | None = None

    def si(self, values: np.ndarray) -> np.ndarray:
        """Convert the FMU's values to SI."""
        return values if self.factor is None else self.factor * values + self.offset

    def own(self, values: np.ndarray) -> np.ndarray:
        """Convert SI values to the FMU's own units."""
        return values if self.factor is None else (values - self.offset) / self.factor


def scaling(signals: Sequence[UnitSignal], expected: str, declared: str, argument: str) -> Scaling:
    """Return the conversion of variables to a quantity in the SI unit `expected`, such as "m".

    declared: unit from the caller, for variables without one. Raises ArgumentError for a unit of another dimension, a
    missing unit, and a conflict between description and caller.
    """
    pairs: list[tuple[float, float]] = []
    for s in signals:
        if not s.unit and not declared:
            raise ArgumentError(
                f"'{s.name}' has no unit in its description, and {expected} is not assumed; add it to units",
                argument,
            )
        described = _base(s.unit, s.base, s, argument) if s.unit else None
        stated = _base(declared, None, s, "units") if declared else None
        if described is not None and stated is not None and described != stated:
            raise ArgumentError(f"'{s.name}' is in {s.unit} according to its description, not in {declared}", "units")
        base = described or stated
        assert base is not None
        if base[0] != _base(expected, None, s, argument)[0]:
            raise ArgumentError(f"'{s.name}' is in {s.unit or declared}; expected a unit such as {expected}", argument)
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
