"""SI units: parsing of unit texts such as ``"kg.m2/s2"``, and conversion at the boundary.

Inside gtmodel every number is in SI. Only this module reads scaled units (``mm``, ``deg``, ``ms``): `si_unit`
refuses them in declarations, `convert` converts input data to SI and output data from SI.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational
from typing import Any, NoReturn

BASE_SYMBOLS = ("kg", "m", "s", "A", "K", "mol", "cd")
MAX_TEXT_LENGTH = 100  # a unit is a short word; this bounds the recursion over parentheses
MAX_DENOMINATOR = 64  # a float power is read as a fraction with at most this denominator: 0.5, 1/3, 0.125
MAX_SCALE_BITS = 1000  # keeps every scale well inside the range of a double (2**-1022 .. 2**1024)


class UnitError(ValueError):
    """A unit text, or a combination of units, without a meaning."""


class UnknownSymbol(UnitError):
    """A unit text with an unknown symbol; close matches are searched only when the message is read."""

    def __init__(self, text: str, symbol: str) -> None:
        super().__init__(text, symbol)
        self._text, self._symbol = text, symbol

    def __str__(self) -> str:
        symbol = self._symbol
        close = difflib.get_close_matches(symbol, _SYMBOLS, n=3, cutoff=0.5)
        close += [
            f"{symbol[:i]}.{symbol[i:]}"
            for i in range(1, len(symbol))
            if symbol[:i] in _SYMBOLS and symbol[i:] in _SYMBOLS
        ]
        hint = "close matches are " + ", ".join(map(repr, close)) if close else "known symbols: " + ", ".join(_SYMBOLS)
        return f"unit {self._text!r} has the unknown symbol {symbol!r}; {hint}"


@dataclass(frozen=True)
class Dimension:
    """Product of powers of the seven SI base units; immutable and hashable.

    exponents : the powers of (kg, m, s, A, K, mol, cd), seven ints or Fractions; integral Fractions become ints.

    An angle has dimension one, and torque and energy have the same dimension. Messages should therefore quote the
    declared unit text, not ``str`` of its dimension.

    Raises UnitError when there are not exactly seven exponents.
    """

    exponents: tuple[int | Fraction, ...] = (0,) * 7

    def __post_init__(self) -> None:
        exponents = tuple(e if type(e) is int else _rational(e) for e in self.exponents)
        if len(exponents) != len(BASE_SYMBOLS):
            raise UnitError(f"a dimension needs seven exponents, of {', '.join(BASE_SYMBOLS)}; found {len(exponents)}")
        object.__setattr__(self, "exponents", exponents)

    @property
    def is_one(self) -> bool:
        """True for a dimensionless quantity."""
        return not any(self.exponents)

    def __mul__(self, other: Dimension) -> Dimension:
        if not isinstance(other, Dimension):
            return NotImplemented
        return Dimension(tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        if not isinstance(other, Dimension):
            return NotImplemented
        return Dimension(tuple(a - b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __pow__(self, power: int | float | Fraction) -> Dimension:
        """Return a rational power. A float must equal a fraction with a denominator up to 64."""
        exact = _rational(power)
        return Dimension(tuple(a * exact for a in self.exponents))

    def __str__(self) -> str:
        """Return the derived unit (``"N"``) if there is one, else base units such as ``"kg.m/s"``.

        1/s never becomes ``"Hz"``: it may be an angular velocity. `parse_unit` reads the text back.
        """
        return _DERIVED_NAME.get(self) or _base_text(self)


def _rational(power: int | float | Fraction) -> int | Fraction:
    """Return the exact power, as an int if possible; raises UnitError for a float that is not a simple fraction."""
    if type(power) is int:
        return power
    exact = None
    if isinstance(power, Rational):
        exact = Fraction(int(power.numerator), int(power.denominator))
    elif isinstance(power, float) and math.isfinite(power):
        exact = Fraction(power).limit_denominator(MAX_DENOMINATOR)
    if exact is not None and (exact == power or float(exact) == power):
        return int(exact) if exact.denominator == 1 else exact
    raise UnitError(
        f"a dimension is raised to the power {power!r}; expected an integer or a fraction with a "
        f"denominator up to {MAX_DENOMINATOR}, for example fractions.Fraction(1, 3)"
    )


def _base_text(dimension: Dimension) -> str:
    numerator, denominator = [], []
    for symbol, exponent in zip(BASE_SYMBOLS, dimension.exponents, strict=True):
        if exponent:
            size = Fraction(abs(exponent))
            power = "" if size == 1 else str(size) if size.denominator == 1 else f"^({size})"
            (numerator if exponent > 0 else denominator).append(symbol + power)
    text = ".".join(numerator) or "1"
    if not denominator:
        return text
    return f"{text}/{denominator[0]}" if len(denominator) == 1 else f"{text}/({'.'.join(denominator)})"


DIMENSIONLESS = Dimension()
_BASE = {
    symbol: Dimension(tuple(int(i == j) for j in range(len(BASE_SYMBOLS)))) for i, symbol in enumerate(BASE_SYMBOLS)
}


@dataclass(frozen=True)
class _ScaledSymbol:
    """A scaled symbol: 1 symbol = factor * pi**pi_power of ``si``; ``noun`` is for messages."""

    si: str
    factor: Fraction
    noun: str
    pi_power: int = 0


# Derived SI units, each a product of those above it. The order decides the canonical name of a dimension.
_DERIVED = {
    "N": "kg.m/s2",
    "Pa": "N/m2",
    "J": "N.m",
    "W": "J/s",
    "C": "A.s",
    "V": "W/A",
    "Ohm": "V/A",
    "S": "A/V",
    "F": "C/V",
    "Wb": "V.s",
    "H": "Wb/A",
    "T": "Wb/m2",
}
_SCALED = {
    "um": _ScaledSymbol("m", Fraction(1, 10**6), "lengths"),
    "mm": _ScaledSymbol("m", Fraction(1, 10**3), "lengths"),
    "km": _ScaledSymbol("m", Fraction(10**3), "lengths"),
    "ns": _ScaledSymbol("s", Fraction(1, 10**9), "times"),
    "us": _ScaledSymbol("s", Fraction(1, 10**6), "times"),
    "ms": _ScaledSymbol("s", Fraction(1, 10**3), "times"),
    "min": _ScaledSymbol("s", Fraction(60), "times"),
    "g": _ScaledSymbol("kg", Fraction(1, 10**3), "masses"),
    "deg": _ScaledSymbol("rad", Fraction(1, 180), "angles", pi_power=1),
    "rev": _ScaledSymbol("rad", Fraction(2), "angles", pi_power=1),
    "urad": _ScaledSymbol("rad", Fraction(1, 10**6), "angles"),
    "rpm": _ScaledSymbol("rad/s", Fraction(1, 30), "angular velocities", pi_power=1),
    "kN": _ScaledSymbol("N", Fraction(10**3), "forces"),
    "MN": _ScaledSymbol("N", Fraction(10**6), "forces"),
    "kPa": _ScaledSymbol("Pa", Fraction(10**3), "pressures"),
    "MPa": _ScaledSymbol("Pa", Fraction(10**6), "pressures"),
    "GPa": _ScaledSymbol("Pa", Fraction(10**9), "pressures"),
    "bar": _ScaledSymbol("Pa", Fraction(10**5), "pressures"),
    "kHz": _ScaledSymbol("Hz", Fraction(10**3), "frequencies"),
    "kW": _ScaledSymbol("W", Fraction(10**3), "powers"),
    "mA": _ScaledSymbol("A", Fraction(1, 10**3), "currents"),
    "mV": _ScaledSymbol("V", Fraction(1, 10**3), "voltages"),
    "mH": _ScaledSymbol("H", Fraction(1, 10**3), "inductances"),
    "uF": _ScaledSymbol("F", Fraction(1, 10**6), "capacitances"),
    "kOhm": _ScaledSymbol("Ohm", Fraction(10**3), "resistances"),
}
_RADIAN_SYMBOLS = {"rad", "deg", "rev", "urad", "rpm"}


@dataclass(frozen=True)
class ParsedUnit:
    """The result of `parse_unit`.

    text      : the text as written, stripped; ``"1"`` if it was empty.
    dimension : its `Dimension`.
    factor    : exact rational part of the scale.
    pi_power  : power of pi in the scale (1 for ``deg``, ``rev`` and ``rpm``).

    Two texts with the same meaning ("J", "N.m") are not equal: compare ``dimension`` and ``scale``.
    """

    text: str
    dimension: Dimension
    factor: Fraction = Fraction(1)
    pi_power: int = 0

    @property
    def scale(self) -> float:
        """Value in SI of one of this unit: 0.001 for ``"mm"``."""
        return float(self.factor) * math.pi**self.pi_power

    @property
    def is_si(self) -> bool:
        """True if the scale is exactly one."""
        return self.factor == 1 and self.pi_power == 0

    @property
    def si_text(self) -> str:
        """The same unit with every scaled symbol replaced by its SI symbol: ``"N.mm"`` -> ``"N.m"``."""
        text = _LEADING.sub("", self.text)
        if text in _SCALED:
            return _SCALED[text].si
        return re.sub(r"[A-Za-z]+", lambda match: _si_symbol(match.group()), text)


def _si_symbol(symbol: str) -> str:
    si = _SCALED[symbol].si if symbol in _SCALED else symbol
    return f"({si})" if "/" in si else si


@dataclass(frozen=True)
class _Value:
    """A partly read unit: dimension, exact scale factor, power of pi."""

    dimension: Dimension
    factor: Fraction = Fraction(1)
    pi_power: int = 0

    def __mul__(self, other: _Value) -> _Value:
        return _Value(self.dimension * other.dimension, self.factor * other.factor, self.pi_power + other.pi_power)


_LEADING = re.compile(r"(?P<factor>\d+(?:\.\d+)?) +(?=[A-Za-z(])")  # of "100 ns"
_SYMBOL = re.compile(r"[A-Za-z]+")
_NUMBER = re.compile(r"[0-9]+")
_POWER = re.compile(r"\^?(?P<whole>-?[0-9]+)|\^\((?P<above>-?[0-9]+)(?:/(?P<below>[0-9]+))?\)")


class _Reader:
    """Recursive descent parser of a unit text.

    product = factor {("." | "*" | " " | "/") factor}, factor = (symbol | "1" | "(" product ")") [power].
    """

    def __init__(self, text: str, begin: int = 0) -> None:
        self.text = text
        self.at = begin

    def read(self) -> _Value:
        value = self.product()
        if self.at < len(self.text):
            self.fail_here()
        return value

    def product(self) -> _Value:
        value, divided = self.factor(), False
        while True:
            spaced = self.skip_spaces()
            mark = self.text[self.at : self.at + 1]
            if mark in ("", ")"):
                return value
            if mark in ("/", ".", "*"):
                self.at += 1
            elif not spaced:
                self.fail_here()
            if mark == "/":
                value, divided = value * self.power(self.factor(), -1), True
            elif divided:
                raise UnitError(
                    f"unit {self.text!r} has a product after '/', which is ambiguous; put the denominator in "
                    "parentheses, as in 'J/(kg.K)', or the product first, as in 'J.K/kg'"
                )
            else:
                value = value * self.factor()

    def factor(self) -> _Value:
        self.skip_spaces()
        if match := _SYMBOL.match(self.text, self.at):
            value = self.symbol(match.group())
            self.at = match.end()
        elif match := _NUMBER.match(self.text, self.at):
            if match.group() != "1":
                raise UnitError(
                    f"unit {self.text!r} has the factor {match.group()}; the only number allowed is 1, as in '1/s': "
                    "put the factor in front, with a blank, as in '100 ns', or into the value"
                )
            self.at = match.end()
            return _Value(DIMENSIONLESS)
        elif self.text.startswith("(", self.at):
            self.at += 1
            value = self.product()
            if not self.text.startswith(")", self.at):
                raise UnitError(f"unit {self.text!r} has a '(' that is never closed; add the missing ')'")
            self.at += 1
        else:
            self.fail_here()
        if match := _POWER.match(self.text, self.at):
            self.at = match.end()
            below = int(match["below"] or 1)
            if below == 0:
                raise UnitError(f"unit {self.text!r} has a power with denominator 0; write a fraction such as '^(1/2)'")
            above = int(match["whole"] or match["above"])
            value = self.power(value, above if below == 1 else Fraction(above, below))
        return value

    def symbol(self, symbol: str) -> _Value:
        if symbol not in _SYMBOLS:
            raise UnknownSymbol(self.text, symbol)
        return _SYMBOLS[symbol]

    def power(self, value: _Value, power: int | Fraction) -> _Value:
        if power.denominator == 1:
            bits = max(value.factor.numerator.bit_length(), value.factor.denominator.bit_length()) - 1
            if max(bits, 2 * abs(value.pi_power)) * abs(power) > MAX_SCALE_BITS:
                raise UnitError(f"unit {self.text!r} has a scale outside the range of a double; use smaller powers")
            whole = int(power)
            return _Value(value.dimension**power, value.factor**whole, value.pi_power * whole)
        if value.factor != 1 or value.pi_power:
            raise UnitError(f"unit {self.text!r} has a root of a scaled unit; use SI units instead")
        return _Value(value.dimension**power)

    def skip_spaces(self) -> bool:
        start = self.at
        while self.text.startswith(" ", self.at):
            self.at += 1
        return self.at > start

    def fail_here(self) -> NoReturn:
        if self.at >= len(self.text):
            raise UnitError(
                f"unit {self.text!r} ends where a symbol was expected; complete or remove the last operator"
            )
        raise UnitError(
            f"unit {self.text!r} has an unexpected {self.text[self.at]!r} at character {self.at + 1}; "
            "expected symbols joined by '.', '*', a space or '/', with powers such as 'm2', 's-1' or 'm^2'"
        )


_SYMBOLS: dict[str, _Value] = {symbol: _Value(dimension) for symbol, dimension in _BASE.items()}
_SYMBOLS["rad"] = _Value(DIMENSIONLESS)
for _name, _text in _DERIVED.items():
    _SYMBOLS[_name] = _Reader(_text).read()
_DERIVED_NAME = {_SYMBOLS[_name].dimension: _name for _name in _DERIVED}
_SYMBOLS["Hz"] = _Reader("1/s").read()
for _name, _scaled in _SCALED.items():
    _SYMBOLS[_name] = _Reader(_scaled.si).read() * _Value(DIMENSIONLESS, _scaled.factor, _scaled.pi_power)


SECOND = _BASE["s"]


@functools.lru_cache(maxsize=1024)
def _parse(text: str) -> ParsedUnit:
    leading = _LEADING.match(text)
    value = _Reader(text, leading.end() if leading else 0).read() if text else _Value(DIMENSIONLESS)
    if leading:
        factor = Fraction(leading["factor"])
        if not factor:
            raise UnitError(f"unit {text!r} has the factor 0; expected more than zero")
        value = value * _Value(DIMENSIONLESS, factor)
    bits = max(value.factor.numerator.bit_length(), value.factor.denominator.bit_length()) + 2 * abs(value.pi_power)
    if bits > MAX_SCALE_BITS:
        raise UnitError(f"unit {text!r} has a scale outside the range of a double; use smaller powers")
    return ParsedUnit(text or "1", value.dimension, value.factor, value.pi_power)


def parse_unit(text: str) -> ParsedUnit:
    """Parse a unit text, SI or scaled.

    Symbols: kg m s A K mol cd rad, N Pa J W V Ohm S F H Hz C Wb T, and with a scale um mm km ns us ms min g deg
    rev urad rpm kN MN kPa MPa GPa bar kHz kW mA mV mH uF kOhm. Products are written with ".", "*" or a space, quotients
    with "/", powers as "m2", "m^2", "s-1" or "m^(1/2)"; parentheses are allowed. "" and "1" are dimensionless. A
    product after "/" is ambiguous and raises an error. A decimal factor in front belongs to the unit: "100 ns".

    Raises UnitError if the text is not a string, has an unknown symbol (with close matches), or has a syntax error
    (with its position).
    """
    if not isinstance(text, str):
        raise UnitError(f"unit {text!r} is of type {type(text).__name__}; expected a string such as 'm' or 'N.m/rad'")
    text = text.strip()
    if len(text) > MAX_TEXT_LENGTH:
        raise UnitError(f"a unit text has {len(text)} characters; expected at most {MAX_TEXT_LENGTH}")
    return _parse(text)


def si_unit(text: str) -> ParsedUnit:
    """Parse a unit text that must be SI, as in declarations.

    Raises UnitError as `parse_unit` does, and for a scaled unit, naming the SI unit to use instead.
    """
    unit = parse_unit(text)
    if not unit.is_si:
        noun = _SCALED[unit.text].noun if unit.text in _SCALED else "the quantity"
        raise UnitError(
            f"unit {unit.text!r} has a scale of {unit.scale:g}; declare {noun} in {unit.si_text!r} and "
            "convert at the boundary"
        )
    return unit


def rate_unit(unit: str, order: int = 1) -> str:
    """Return the unit of a quantity's time derivative: "m" -> "m/s2" at order 2, "m/s" -> "m/s2" at order 1."""
    if (rate := re.fullmatch(r"([^/]+)/s(\d*)", unit)) is not None:
        unit, order = rate[1], order + int(rate[2] or 1)
    per = "s" if order == 1 else f"s{order}"
    return f"1/{per}" if unit in ("1", "") else f"{unit}/{per}"


def convert(value: Any, from_unit: str, to_unit: str) -> Any:
    """Convert a quantity to another unit: ``convert(250.0, "mm", "m")`` is 0.25.

    value : number or array (any shape), in `from_unit`; the result has its shape, in `to_unit`. Decimal
    scales are applied as one exact factor or divisor, so 9 ms is 0.009 s and not 0.009000000000000001 s.

    Raises UnitError if the dimensions differ, and for a conversion between a unit of cycles and a unit of angle (rad/s,
    deg/s, rpm): the factor 2 pi must be explicit. Hz counts cycles, and so does a frequency without an angle: 1/min is
    1/60 Hz. 1/s alone also means rad/s, as in SI, but never revolutions.
    """
    source, target = parse_unit(from_unit), parse_unit(to_unit)
    if source.dimension != target.dimension:
        raise UnitError(
            f"unit {source.text!r} has dimension {source.dimension} and {target.text!r} has "
            f"{target.dimension}; units can be converted only within one dimension"
        )
    for cycles, angle in ((source, target), (target, source)):
        if _counts_cycles(cycles, angle) and _holds(angle, _RADIAN_SYMBOLS) and not _holds(angle, {"Hz"}):
            raise UnitError(
                f"unit {cycles.text!r} counts cycles and {angle.text!r} measures angle; multiply or divide "
                "by 2 pi explicitly"
            )
    ratio, pi_power = source.factor / target.factor, source.pi_power - target.pi_power
    if ratio.numerator != 1:
        value = value * float(ratio.numerator)
    value = value / float(ratio.denominator)
    return value * math.pi**pi_power if pi_power else value


def _counts_cycles(unit: ParsedUnit, other: ParsedUnit) -> bool:
    if _holds(unit, {"Hz"}):
        return True
    kg, m, seconds, *others = unit.dimension.exponents
    frequency = seconds < 0 and not any((kg, m, *others)) and not _holds(unit, _RADIAN_SYMBOLS)
    return frequency and (not unit.is_si or _holds(other, {"rpm"}))


def _holds(unit: ParsedUnit, symbols: set[str]) -> bool:
    return not symbols.isdisjoint(_SYMBOL.findall(unit.text))
