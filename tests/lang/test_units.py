"""Units: the algebra of dimensions, reading of texts, scales, and the sentences of its errors."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from gtmodel.lang.units import (
    BASE_SYMBOLS,
    DIMENSIONLESS,
    Dimension,
    UnitError,
    convert,
    parse_unit,
    rate_unit,
    si_unit,
)

ONE_ULP = 2 * np.finfo(float).eps  # one factor and one divisor round once each

sixths = st.integers(-24, 24).map(lambda i: Fraction(i, 6))
few = st.lists(st.integers(-4, 4) | sixths, min_size=3, max_size=3)
dimensions = st.builds(lambda e, at: Dimension((*[0] * at, *e, *[0] * (4 - at))), few, st.integers(0, 4))
powers = st.integers(-12, 12).map(lambda i: Fraction(i, 4))
quick = settings(max_examples=60, deadline=None)


def dim(**powers: int) -> Dimension:
    """Dimension by base symbols, written without the parser."""
    return Dimension(tuple(powers.pop(symbol, 0) for symbol in BASE_SYMBOLS))


@quick
@given(dimensions, dimensions, dimensions)
def test_dimensions_form_an_abelian_group(a: Dimension, b: Dimension, c: Dimension) -> None:
    assert a * b == b * a
    assert (a * b) * c == a * (b * c)
    assert a * DIMENSIONLESS == a
    assert a / a == DIMENSIONLESS
    assert (a * b) / b == a


@quick
@given(dimensions, dimensions, powers, powers)
def test_power_laws(a: Dimension, b: Dimension, p: Fraction, q: Fraction) -> None:
    assert (a * b) ** p == a**p * b**p
    assert a**p * a**q == a ** (p + q)
    assert (a**p) ** q == a ** (p * q)
    assert a**0 == DIMENSIONLESS


@quick
@given(dimensions, dimensions)
def test_equal_dimensions_have_equal_hash_and_text(a: Dimension, b: Dimension) -> None:
    same = Dimension(tuple(Fraction(e) for e in (a * b / b).exponents))
    assert same == a and hash(same) == hash(a) and str(same) == str(a)
    assert (a == b) == (str(a) == str(b))


@quick
@given(dimensions)
def test_text_of_a_dimension_is_read_back(a: Dimension) -> None:
    unit = parse_unit(str(a))
    assert unit.dimension == a
    assert unit.is_si


def test_dimension_is_immutable_and_refuses_other_operands() -> None:
    metre = parse_unit("m").dimension
    with pytest.raises(AttributeError):
        metre.exponents = (0,) * 7  # type: ignore[misc]
    with pytest.raises(TypeError):
        metre * 2  # type: ignore[operator]
    with pytest.raises(TypeError):
        metre / "s"  # type: ignore[operator]


@pytest.mark.parametrize("power", [0.5, np.float64(0.5), Fraction(1, 2)])
def test_root_of_an_area_is_a_length(power: float) -> None:
    assert parse_unit("m2").dimension ** power == dim(m=1)


@pytest.mark.parametrize("power", [2, 2.0, np.int64(2)])
def test_square_of_a_length_is_an_area(power: int) -> None:
    assert str(parse_unit("m").dimension ** power) == "m2"


def test_cube_root_as_a_float() -> None:
    assert parse_unit("m3").dimension ** (1 / 3) == dim(m=1)


# Definitions of the SI brochure (9th edition, table 4), in base units by hand.
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", dim()),
        ("1", dim()),
        ("  ", dim()),
        ("rad", dim()),
        ("N", dim(kg=1, m=1, s=-2)),
        ("Pa", dim(kg=1, m=-1, s=-2)),
        ("J", dim(kg=1, m=2, s=-2)),
        ("W", dim(kg=1, m=2, s=-3)),
        ("C", dim(s=1, A=1)),
        ("V", dim(kg=1, m=2, s=-3, A=-1)),
        ("Ohm", dim(kg=1, m=2, s=-3, A=-2)),
        ("S", dim(kg=-1, m=-2, s=3, A=2)),
        ("F", dim(kg=-1, m=-2, s=4, A=2)),
        ("H", dim(kg=1, m=2, s=-2, A=-2)),
        ("Wb", dim(kg=1, m=2, s=-2, A=-1)),
        ("T", dim(kg=1, s=-2, A=-1)),
        ("Hz", dim(s=-1)),
        ("m2", dim(m=2)),
        ("m^2", dim(m=2)),
        ("s-1", dim(s=-1)),
        ("s^-1", dim(s=-1)),
        ("1/s", dim(s=-1)),
        ("m/s^2", dim(m=1, s=-2)),
        ("m s-2", dim(m=1, s=-2)),
        ("m/s/s", dim(m=1, s=-2)),
        ("kg.m2/s2", dim(kg=1, m=2, s=-2)),
        ("kg * m2 / s2", dim(kg=1, m=2, s=-2)),
        ("N/m", dim(kg=1, s=-2)),
        ("N.m", dim(kg=1, m=2, s=-2)),
        ("N.s/m", dim(kg=1, s=-1)),
        ("kg/(m.s)", dim(kg=1, m=-1, s=-1)),
        ("(kg/(m.s))^2", dim(kg=2, m=-2, s=-2)),
        ("N.m/rad", dim(kg=1, m=2, s=-2)),
        ("J/(mol.K)", dim(kg=1, m=2, s=-2, mol=-1, K=-1)),
        ("cd", dim(cd=1)),
        ("kg0", dim()),
    ],
)
def test_si_texts(text: str, expected: Dimension) -> None:
    unit = si_unit(text)
    assert unit.dimension == expected
    assert unit.scale == 1.0
    assert unit.text == (text.strip() or "1")
    assert expected.is_one == (expected == DIMENSIONLESS)


def test_fractional_power_in_a_text() -> None:
    assert parse_unit("m^(1/2)").dimension == dim(m=1) ** Fraction(1, 2)
    assert parse_unit("Hz^(-1/2)").dimension == dim(s=1) ** Fraction(1, 2)


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("1", "1"),
        ("rad", "1"),
        ("kg.m/s2", "N"),
        ("N.m", "J"),
        ("Hz", "1/s"),
        ("m/s", "m/s"),
        ("N/m", "kg/s2"),
        ("Pa.s", "kg/(m.s)"),
        ("m^(1/2)/s", "m^(1/2)/s"),
    ],
)
def test_canonical_text_of_a_dimension(unit: str, text: str) -> None:
    assert str(parse_unit(unit).dimension) == text


@pytest.mark.parametrize(
    ("text", "scale", "si_text"),
    [
        ("um", 1e-6, "m"),
        ("mm", 1e-3, "m"),
        ("km", 1e3, "m"),
        ("us", 1e-6, "s"),
        ("ms", 1e-3, "s"),
        ("min", 60.0, "s"),
        ("g", 1e-3, "kg"),
        ("deg", math.radians(1), "rad"),
        ("rpm", 2 * math.pi / 60, "rad/s"),
        ("kN", 1e3, "N"),
        ("MN", 1e6, "N"),
        ("kPa", 1e3, "Pa"),
        ("MPa", 1e6, "Pa"),
        ("GPa", 1e9, "Pa"),
        ("bar", 1e5, "Pa"),
        ("mm2", 1e-6, "m2"),
        ("N.mm", 1e-3, "N.m"),
        ("mm/ms", 1.0, "m/s"),
        ("kN/mm", 1e6, "N/m"),
        ("g.mm2", 1e-9, "kg.m2"),
        ("rpm/min", 2 * math.pi / 3600, "(rad/s)/s"),
        ("(deg/s)^2", math.radians(1) ** 2, "(rad/s)^2"),
    ],
)
def test_scaled_texts(text: str, scale: float, si_text: str) -> None:
    unit = parse_unit(text)
    assert unit.scale == pytest.approx(scale, rel=ONE_ULP)
    assert unit.si_text == si_text
    assert parse_unit(si_text).dimension == unit.dimension
    assert parse_unit(si_text).is_si


@quick
@given(st.integers(min_value=0, max_value=10**6))
def test_decimal_scales_are_exact(count: int) -> None:
    assert convert(count, "ms", "s") == float(f"{count}e-3")
    assert convert(count, "um", "m") == float(f"{count}e-6")
    assert convert(float(count), "mm", "um") == 1000 * count
    assert convert(count, "kN/mm", "N/m") == 10**6 * count


@pytest.mark.parametrize(("a", "b"), [("mm", "km"), ("deg", "rad"), ("rpm", "rad/s"), ("bar", "MPa"), ("min", "ms")])
@quick
@given(value=st.floats(min_value=-1e9, max_value=1e9, allow_subnormal=False))
def test_conversion_there_and_back(a: str, b: str, value: float) -> None:
    assert convert(convert(value, a, b), b, a) == pytest.approx(value, rel=4 * ONE_ULP, abs=1e-300)


def test_conversion_of_arrays_keeps_the_shape() -> None:
    angles = np.array([[0.0, 90.0], [180.0, -360.0]])
    np.testing.assert_allclose(convert(angles, "deg", "rad"), np.deg2rad(angles), rtol=ONE_ULP)
    assert angles[0, 1] == 90.0  # the input is left alone
    assert convert(90.0, "deg", "rad") == pytest.approx(math.pi / 2, rel=ONE_ULP)
    assert convert(1500.0, "rpm", "rad/s") == pytest.approx(50 * math.pi, rel=ONE_ULP)
    assert convert(2, "N.m", "J") == 2.0


GRAMMAR = "expected symbols joined by '.', '*', a space or '/', with powers such as 'm2', 's-1' or 'm^2'"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("kgg.m", "unit 'kgg.m' has the unknown symbol 'kgg'; close matches are 'kg', 'g', 'kg.g'"),
        ("ohm", "unit 'ohm' has the unknown symbol 'ohm'; close matches are 'Ohm', 'kOhm', 'm'"),
        ("Nm", "unit 'Nm' has the unknown symbol 'Nm'; close matches are 'm', 'N', 'um', 'N.m'"),
        (
            "parsec",
            "unit 'parsec' has the unknown symbol 'parsec'; known symbols: kg, m, s, A, K, mol, cd, rad, N, "
            "Pa, J, W, C, V, Ohm, S, F, Wb, H, T, Hz, um, mm, km, ns, us, ms, min, g, deg, rev, urad, rpm, kN, MN, "
            "kPa, MPa, GPa, bar, kHz, kW, mA, mV, mH, uF, kOhm",
        ),
        (
            "J/kg.K",
            "unit 'J/kg.K' has a product after '/', which is ambiguous; put the denominator in "
            "parentheses, as in 'J/(kg.K)', or the product first, as in 'J.K/kg'",
        ),
        (
            "1000.m",
            "unit '1000.m' has the factor 1000; the only number allowed is 1, as in '1/s': "
            "put the factor in front, with a blank, as in '100 ns', or into the value",
        ),
        ("0 ns", "unit '0 ns' has the factor 0; expected more than zero"),
        ("(m/s", "unit '(m/s' has a '(' that is never closed; add the missing ')'"),
        ("m/", "unit 'm/' ends where a symbol was expected; complete or remove the last operator"),
        ("m²", f"unit 'm²' has an unexpected '²' at character 2; {GRAMMAR}"),
        ("m)", f"unit 'm)' has an unexpected ')' at character 2; {GRAMMAR}"),
        ("m(s)", f"unit 'm(s)' has an unexpected '(' at character 2; {GRAMMAR}"),
        ("m^x", f"unit 'm^x' has an unexpected '^' at character 2; {GRAMMAR}"),
        ("/s", f"unit '/s' has an unexpected '/' at character 1; {GRAMMAR}"),
        ("m^(1/0)", "unit 'm^(1/0)' has a power with denominator 0; write a fraction such as '^(1/2)'"),
        ("mm^(1/2)", "unit 'mm^(1/2)' has a root of a scaled unit; use SI units instead"),
        ("mm999", "unit 'mm999' has a scale outside the range of a double; use smaller powers"),
        ("(mm^99)^99", "unit '(mm^99)^99' has a scale outside the range of a double; use smaller powers"),
        ("mm-99.mm-99", "unit 'mm-99.mm-99' has a scale outside the range of a double; use smaller powers"),
        ("deg900", "unit 'deg900' has a scale outside the range of a double; use smaller powers"),
        ("(" * 101, "a unit text has 101 characters; expected at most 100"),
        (None, "unit None is of type NoneType; expected a string such as 'm' or 'N.m/rad'"),
    ],
)
def test_error_sentences(text: str, sentence: str) -> None:
    with pytest.raises(UnitError) as caught:
        parse_unit(text)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("text", "si", "scale"),
    [
        ("kOhm", "Ohm", 1e3), ("mA", "A", 1e-3), ("mV", "V", 1e-3), ("mH", "H", 1e-3), ("uF", "F", 1e-6),
        ("kHz", "Hz", 1e3), ("kW", "W", 1e3), ("mV/mA", "Ohm", 1.0), ("A/V", "S", 1.0), ("Wb/A", "H", 1.0),
        ("mH/kOhm", "us", None),
    ],
)  # fmt: skip
def test_electrical_units_as_logs_write_them(text: str, si: str, scale: float | None) -> None:
    unit, same = parse_unit(text), parse_unit(si)
    assert unit.dimension == same.dimension and math.isclose(unit.scale, scale or same.scale, rel_tol=1e-15)


@quick
@given(st.text(alphabet="kgmsNPa1290./*^()- ", max_size=20))
def test_any_text_is_read_or_refused_with_a_sentence(text: str) -> None:
    try:
        unit = parse_unit(text)
    except UnitError as error:
        assert repr(text.strip()) in str(error)
    else:
        assert math.isfinite(unit.scale) and unit.scale > 0
        assert parse_unit(unit.si_text).dimension == unit.dimension


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("mm", "unit 'mm' has a scale of 0.001; declare lengths in 'm' and convert at the boundary"),
        ("deg", "unit 'deg' has a scale of 0.0174533; declare angles in 'rad' and convert at the boundary"),
        (
            "kN/m",
            "unit 'kN/m' has a scale of 1000; declare the quantity in 'N/m' and convert at the boundary",
        ),
    ],
)
def test_declarations_must_be_si(text: str, sentence: str) -> None:
    with pytest.raises(UnitError) as caught:
        si_unit(text)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("from_unit", "to_unit", "sentence"),
    [
        (
            "mm",
            "s",
            "unit 'mm' has dimension m and 's' has s; units can be converted only within one dimension",
        ),
        (
            "Hz",
            "rad/s",
            "unit 'Hz' counts cycles and 'rad/s' measures angle; multiply or divide by 2 pi explicitly",
        ),
        (
            "rpm",
            "Hz",
            "unit 'Hz' counts cycles and 'rpm' measures angle; multiply or divide by 2 pi explicitly",
        ),
        (
            "1/min",
            "rpm",
            "unit '1/min' counts cycles and 'rpm' measures angle; multiply or divide by 2 pi explicitly",
        ),
        (
            "rad/s",
            "1/ms",
            "unit '1/ms' counts cycles and 'rad/s' measures angle; multiply or divide by 2 pi explicitly",
        ),
        (
            "1/s",
            "rpm",
            "unit '1/s' counts cycles and 'rpm' measures angle; multiply or divide by 2 pi explicitly",
        ),
    ],
)
def test_conversions_without_meaning(from_unit: str, to_unit: str, sentence: str) -> None:
    with pytest.raises(UnitError) as caught:
        convert(1.0, from_unit, to_unit)
    assert str(caught.value) == sentence


@pytest.mark.parametrize("unit", ["Hz", "1/min", "1/ms", "1/min2", "min-1", "1/(s.ms)"])
def test_what_counts_cycles_measures_no_angle(unit: str) -> None:
    """A unit that is both would turn one rpm into one hertz, or lose 2 pi on the way."""
    per = "s2" if parse_unit(unit).dimension == dim(s=-2) else "s"
    for angle in (f"rad/{per}", f"deg/{per}", "rpm" if per == "s" else "rpm/min"):
        for way in ((unit, angle), (angle, unit)):
            with pytest.raises(UnitError, match="counts cycles"):
                convert(1.0, *way)
    assert convert(60.0, "1/min", "Hz") == 1.0 and convert(1.0, "1/s", "rad/s") == 1.0


def test_irrational_power_and_wrong_length() -> None:
    with pytest.raises(UnitError) as caught:
        parse_unit("m").dimension ** math.pi
    assert str(caught.value) == (
        "a dimension is raised to the power 3.141592653589793; expected an integer or a fraction with a "
        "denominator up to 64, for example fractions.Fraction(1, 3)"
    )
    with pytest.raises(UnitError) as caught:
        Dimension((1, 2))
    assert str(caught.value) == "a dimension needs seven exponents, of kg, m, s, A, K, mol, cd; found 2"


@pytest.mark.parametrize(
    ("unit", "order", "rate"),
    [
        ("m", 1, "m/s"),
        ("m", 2, "m/s2"),
        ("1", 1, "1/s"),
        ("m/s", 1, "m/s2"),
        ("rad/s2", 2, "rad/s4"),
        ("1/s", 1, "1/s2"),
        ("m3/s/m", 1, "m3/s/m/s"),
    ],
)
def test_rates_have_the_dimension_of_a_derivative(unit: str, order: int, rate: str) -> None:
    assert rate_unit(unit, order) == rate
    assert parse_unit(rate).dimension == parse_unit(unit).dimension / parse_unit("s").dimension ** order
