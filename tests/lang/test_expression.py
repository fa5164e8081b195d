"""Expressions: the same formula on symbols and on NumPy arrays, shapes, units and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel.lang.expression import Expr, Relation
from gtmodel.lang.scope import Scope
from gtmodel.lang.units import parse_unit
from tests.support.examples import examples

ROUNDING = 1e-14  # a few operations on numbers of order one

NUMBERS: dict[str, Any] = {
    "s": 0.7,
    "t": -1.3,
    "u": np.array([0.4, -2.0, 1.1]),
    "w": np.array([1.5, 0.2, -0.6]),
    "M": np.array([[1.0, 2.0, -1.0], [0.5, -0.3, 0.8]]),
    "N": np.array([[0.2, -1.0], [2.0, 0.7], [1.0, 1.0]]),
}


class Symbols:
    """The names of NUMBERS as expressions of one scope, each with the unit it is asked for."""

    def __init__(self, **units: str) -> None:
        self.scope = Scope()
        self.values: list[float] = []
        for name, value in NUMBERS.items():
            a = np.asarray(value)
            symbols = [self.scope.new_chain(f"{name}{k}") for k in range(a.size)]
            column = ca.vertcat(*symbols)
            sx = ca.reshape(column, a.shape[1], a.shape[0]).T if a.ndim == 2 else column
            unit = units.get(name, "1")
            dimension = None if unit == "?" else parse_unit(unit).dimension
            setattr(self, name, Expr(sx, a.shape, dimension, self.scope))
            self.values += list(a.reshape(-1))

    def number(self, e: Expr) -> np.ndarray:
        """An expression's value at NUMBERS, in its shape."""
        symbols = ca.vertcat(*[self.scope.symbol(i, 0) for i in range(len(self.values))])
        value = ca.Function("value", [symbols], [e.sx])(self.values).full()
        return value.reshape(e.shape)


class Numbers:
    def __init__(self) -> None:
        for name, value in NUMBERS.items():
            setattr(self, name, value)


BOTH: dict[str, Callable[[Any], Any]] = {
    "sum": lambda a: a.s + a.t + 2.0,
    "number first": lambda a: 2.0 - a.s,
    "numpy scalar first": lambda a: np.float64(2.0) - a.s,
    "array first": lambda a: np.array([1.0, 2.0, 3.0]) - a.u,
    "array times": lambda a: np.array([1.0, 2.0, 3.0]) * a.u,
    "array over": lambda a: np.array([1.0, 2.0, 3.0]) / a.u,
    "over array": lambda a: a.u / np.array([1.0, 2.0, 3.0]),
    "one over": lambda a: 1.0 / a.s,
    "zero": lambda a: a.u + 0,
    "scaled": lambda a: a.s * a.u / a.t,
    "elementwise": lambda a: a.u * a.w,
    "power": lambda a: a.s**3 + a.u[0] ** 2,
    "negative power": lambda a: a.t**-1,
    "root": lambda a: a.s**0.5,
    "signs": lambda a: -(+a.u),
    "matrix vector": lambda a: a.M @ a.u,
    "vector matrix": lambda a: a.w @ a.N,
    "matrix matrix": lambda a: a.M @ a.N,
    "vector vector": lambda a: a.u @ a.w,
    "array matrix": lambda a: np.array([[1.0, 2.0], [3.0, 4.0]]) @ a.M,
    "array vector": lambda a: np.array([1.0, -2.0, 3.0]) @ a.u,
    "matrix array": lambda a: a.M @ np.array([1.0, -2.0, 3.0]),
    "index": lambda a: a.u[1] * a.u[-1],
    "slices": lambda a: a.u[::-1] + 2 * a.u[-3:3],
    "slice by slice": lambda a: a.M[::-1, 0:2],
    "rows of a column": lambda a: a.N[1:, -1],
    "columns of a row": lambda a: a.M[1, 1:] * a.M[-1][:2],
    "slice of none": lambda a: a.M[1:1],
    "slice": lambda a: a.u[1:],
    "matrix element": lambda a: a.M[1, 2] + a.M[0, -1],
    "matrix row": lambda a: a.M[1],
    "matrix rows": lambda a: a.N[0:2],
    "iteration": lambda a: sum((x * x for x in a.u), 0.0),
    "length": lambda a: a.s * len(a.u) * len(a.M),
    "sine": lambda a: np.sin(a.u) + np.cos(a.w) * np.tan(a.s),
    "arcs": lambda a: np.arcsin(a.s) + np.arccos(a.s) * np.arctan(a.t),
    "arctan2": lambda a: np.arctan2(a.s, a.t),
    "exponential": lambda a: np.exp(a.s) - np.log(a.s),
    "tanh": lambda a: np.tanh(a.u),
    "square root": lambda a: np.sqrt(a.s) + np.square(a.t),
    "absolute": lambda a: np.abs(a.t) * abs(a.u),
    "array of scalars": lambda a: a.u - np.array([a.s, a.t, 1.0]),
    "array of scalars first": lambda a: np.array([a.s, a.t, 1.0]) * a.u,
    "sign": lambda a: np.sign(a.u),
    "extrema": lambda a: np.minimum(a.u, a.w) + np.maximum(a.u, a.w) * 2,
    "extremum with a number": lambda a: np.maximum(0.3, a.u) - np.minimum(a.w, 0.1),
}

NAMED: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "dot": (lambda a: gt.dot(a.u, a.w), lambda a: a.u @ a.w),
    "dot with a list": (lambda a: gt.dot([1.0, a.s, 0.0], a.w), lambda a: np.dot([1.0, a.s, 0.0], a.w)),
    "cross": (lambda a: gt.cross(a.u, a.w), lambda a: np.cross(a.u, a.w)),
    "cross with an array": (lambda a: gt.cross([0, 0, 1], a.w), lambda a: np.cross([0, 0, 1], a.w)),
    "norm": (lambda a: gt.norm(a.u), lambda a: np.linalg.norm(a.u)),
    "vector": (lambda a: gt.vector([a.s, 2.0, a.t]), lambda a: np.array([a.s, 2.0, a.t])),
    "matrix": (lambda a: gt.vector([a.u, a.w]), lambda a: np.array([a.u, a.w])),
    "nested list": (lambda a: gt.vector([[a.s, 1.0], [a.t, 2.0]]), lambda a: np.array([[a.s, 1.0], [a.t, 2.0]])),
    "list": (lambda a: a.u - [a.s, a.t, 1.0], lambda a: a.u - np.array([a.s, a.t, 1.0])),
    "atan2": (lambda a: gt.atan2(1.0, a.t), lambda a: np.arctan2(1.0, a.t)),
    "clip": (lambda a: gt.clip(a.u, -1.0, 1.0), lambda a: np.clip(a.u, -1.0, 1.0)),
}  # fmt: skip


class TestValues:
    @pytest.mark.parametrize("name", BOTH)
    def test_like_numpy(self, name):
        symbols = Symbols()
        e = BOTH[name](symbols)
        expected = np.asarray(BOTH[name](Numbers()))
        assert e.shape == expected.shape
        assert np.allclose(symbols.number(e), expected, rtol=ROUNDING, atol=ROUNDING)

    @pytest.mark.parametrize("name", NAMED)
    def test_named_functions(self, name):
        symbols = Symbols()
        ours, theirs = NAMED[name]
        e, expected = ours(symbols), np.asarray(theirs(Numbers()))
        assert e.shape == expected.shape
        assert np.allclose(symbols.number(e), expected, rtol=ROUNDING, atol=ROUNDING)

    @pytest.mark.parametrize("name", ["sqrt", "absolute", "sign", "sin", "tanh", "exp"])
    def test_functions_pass_plain_numbers_through(self, name):
        assert np.isclose(getattr(gt, name)(0.3), getattr(np, name)(0.3), rtol=ROUNDING)

    @examples(60)
    @given(st.lists(st.sampled_from(["+s", "*t", "-u", "neg", "*w", "half", "@"]), max_size=8))
    def test_chains_of_operations(self, steps):
        def run(a: Any) -> Any:
            x = a.u
            for step in steps:
                if step == "+s":
                    x = x + a.s * a.w
                elif step == "*t":
                    x = a.t * x
                elif step == "-u":
                    x = a.u - x
                elif step == "neg":
                    x = -x
                elif step == "*w":
                    x = x * a.w
                elif step == "half":
                    x = x / 2
                else:
                    x = (a.M @ x) @ a.M
            return x

        symbols = Symbols()
        assert np.allclose(symbols.number(run(symbols)), run(Numbers()), rtol=1e-12, atol=1e-12)


class TestDerivatives:
    def test_chain_rule(self):
        a = Symbols()
        f = a.s**2 * gt.sin(a.t) + gt.dot(a.u, a.u)
        scope = a.scope
        symbols = [scope.symbol(i, k) for i in range(len(a.values)) for k in range(3)]
        rng = np.random.default_rng(0)
        w = rng.normal(size=(len(a.values), 3))
        rate, second = (
            float(ca.Function("d", [ca.vertcat(*symbols)], [gt.der(f, k).sx])(w.reshape(-1))) for k in (1, 2)
        )

        def at(t: float) -> float:
            x = w[:, 0] + w[:, 1] * t + w[:, 2] * t**2 / 2
            return x[0] ** 2 * np.sin(x[1]) + x[2:5] @ x[2:5]

        h = 1e-3  # central differences of sixth order: error h^6 = 1e-18, round-off 1e-16 / h^2 = 1e-10
        steps = np.array([at(k * h) for k in range(-3, 4)])
        assert rate == pytest.approx(steps @ [-1, 9, -45, 0, 45, -9, 1] / (60 * h), rel=1e-9)
        assert second == pytest.approx(steps @ [2, -27, 270, -490, 270, -27, 2] / (180 * h**2), rel=1e-7)

    def test_of_a_derivative_and_of_nothing(self):
        a = Symbols(s="m")
        assert str(gt.der(gt.der(a.s)).sx) == str(gt.der(a.s, 2).sx) == "der(s0,2)"
        assert gt.der(a.s, 0).sx.element_hash() == a.s.sx.element_hash()
        assert gt.der(a.s, 2).dimension == parse_unit("m/s2").dimension


class TestUnits:
    @pytest.mark.parametrize(
        "formula, unit",
        [
            (lambda a: a.s * a.t, "m.N"),
            (lambda a: a.s / a.t, "m/N"),
            (lambda a: 2.0 / a.s, "1/m"),
            (lambda a: a.s**2, "m2"),
            (lambda a: gt.sqrt(a.s * a.s), "m"),
            (lambda a: gt.norm(a.u), "kg"),
            (lambda a: gt.dot(a.u, a.w), "kg.A"),
            (lambda a: gt.cross(a.u, a.w), "kg.A"),
            (lambda a: a.s + 1.0, "m"),
            (lambda a: gt.maximum(a.s, 1.0), "m"),
            (lambda a: gt.absolute(a.s), "m"),
            (lambda a: gt.sign(a.s), "1"),
            (lambda a: gt.atan2(a.s, 2 * a.s), "1"),
            (lambda a: gt.der(a.s), "m/s"),
            (lambda a: gt.vector([a.s, 2 * a.s]), "m"),
            (lambda a: a.u[1], "kg"),
        ],
    )
    def test_follow_the_algebra(self, formula, unit):
        assert formula(Symbols(s="m", t="N", u="kg", w="A")).dimension == parse_unit(unit).dimension

    @pytest.mark.parametrize(
        "formula",
        [
            lambda a: a.s + a.t,
            lambda a: a.s - a.t,
            lambda a: a.s == a.t,
            lambda a: a.s <= a.t,
            lambda a: a.u == [a.s, a.s, a.s],
            lambda a: a.u - [a.s, a.s, a.s],
            lambda a: (a.u * [a.t, a.t, a.t]) == (a.u * a.s),
            lambda a: gt.dot(a.u, [a.t, a.t, a.t]) == gt.dot(a.u, [a.s, a.s, a.s]),
            lambda a: gt.minimum(a.s, a.t),
            lambda a: gt.atan2(a.s, a.t),
            lambda a: gt.vector([a.s, a.t]),
            lambda a: [a.s, a.t] - a.u[:2],
        ],
    )
    def test_that_do_not_fit_are_refused(self, formula):
        with pytest.raises(gt.ModelError, match="unit"):
            formula(Symbols(s="m", t="N", u="kg", w="A"))

    def test_angles_are_dimensionless(self):
        with pytest.raises(gt.ModelError, match=r"sin\(\) takes a dimensionless number or radians"):
            gt.sin(Symbols(s="m").s)

    def test_no_unit_switches_the_check_off(self):
        a = Symbols(s="?", t="N")
        assert (a.s + a.t).dimension == parse_unit("N").dimension
        assert (a.s * a.t).dimension is None

    def test_a_number_adopts_the_other_side(self):
        assert (Symbols(s="m").s == 3.0).dimension == parse_unit("m").dimension


class TestRelations:
    @pytest.mark.parametrize(
        "formula, op",
        [
            (lambda a: a.s == a.t, "=="),
            (lambda a: a.s <= a.t, "<="),
            (lambda a: a.s >= 2.0, ">="),
            (lambda a: 2.0 <= a.s, ">="),
            (lambda a: np.array([1.0, 2.0, 3.0]) == a.u, "=="),
            (lambda a: [1.0, 2.0, 3.0] == a.u, "=="),
            (lambda a: np.array([1.0, 2.0, 3.0]) <= a.u, ">="),
            (lambda a: a.u == 0, "=="),
            (lambda a: a.u <= 1.0, "<="),
        ],
    )
    def test_kind(self, formula, op):
        relation = formula(Symbols())
        assert isinstance(relation, Relation)
        assert relation.op == op

    def test_a_vector_relation_has_one_residual_per_element(self):
        a = Symbols()
        residual = (a.u == [1.0, 2.0, 3.0]).residual
        e = Expr(residual, (3,), None, a.scope)
        assert np.allclose(a.number(e), NUMBERS["u"] - [1.0, 2.0, 3.0], rtol=0, atol=ROUNDING)

    def test_between_is_two(self):
        low, high = gt.between(-1.0, Symbols().s, 1.0)
        assert (low.op, high.op) == (">=", "<=")

    @pytest.mark.parametrize(
        "formula, sentence",
        [
            (lambda a: a.u == a.M, r"shapes \(3,\) and \(2, 3\) differ in '=='"),
            (lambda a: a.u == 1.0, r"shapes \(3,\) and \(\) differ in '=='"),
            (lambda a: a.u + 1.0, r"shapes \(3,\) and \(\) differ in '\+'"),
            (lambda a: a.u * a.M, r"shapes \(3,\) and \(2, 3\) differ in '\*'"),
            (lambda a: a.u @ a.M, r"shapes \(3,\) and \(2, 3\) do not fit in '@'"),
            (lambda a: gt.dot(a.u, a.M), "dot\\(\\) takes two vectors of equal length"),
            (lambda a: gt.cross(a.u, [1.0, 2.0]), "cross\\(\\) takes two vectors of length 3"),
            (lambda a: gt.vector([a.s, a.u]), "expected equal shapes"),
            (lambda a: a.s != a.t, "'!=' is not an equation"),
            (lambda a: a.s**a.t, "an exponent must be a number"),
            (lambda a: a.s + float("nan"), "must be finite"),
            (lambda a: a.s + "two", "expected an expression, a number or an array; found str 'two'"),
            (lambda a: a.s + np.zeros((1, 1, 1)), "at most two dimensions"),
            (lambda a: bool(a.s == a.t), "no truth value"),
            (lambda a: -1 <= a.s <= 1, r"write gt\.between\(a, x, b\)"),
            (lambda a: a.s[0], "a scalar cannot be indexed"),
            (lambda a: a.u[1.9], "must be an integer"),
            (lambda a: a.s + Symbols().s, "expressions of two different models"),
            (lambda a: gt.der(1.0), "der\\(\\) takes an expression of the model"),
            (lambda a: gt.der(a.s, -1), "must be 0 or more"),
            (lambda a: gt.dot([1.0], [2.0]), "for numbers use numpy.dot"),
        ],
    )
    def test_nonsense_is_refused_with_file_and_line(self, formula, sentence):
        with pytest.raises(gt.ModelError, match=sentence) as error:
            formula(Symbols())
        assert error.value.where is not None
        assert error.value.where.file == "lang/test_expression.py"

    @pytest.mark.parametrize(
        "call, words",
        [
            (
                lambda a: a.u[5:9],
                r"slice 5:9 is out of range for an expression of shape \(3,\); expected limits from -3 to 3",
            ),
            (lambda a: a.u[2:9], "slice 2:9 is out of range"),
            (lambda a: a.u[-9:], "slice -9: is out of range"),
            (lambda a: a.M[3], "index 3 is out of range"),
            (lambda a: a.M[0, 7], "index 7 is out of range"),
            (lambda a: a.M[-1, -9], "index -9 is out of range"),
            (lambda a: a.M[:, 1:9], "slice 1:9 is out of range"),
            (lambda a: a.u[0, 1], r"shape \(3,\) has 1 dimensions; found 2 indices \(0, 1\)"),
            (lambda a: a.M[0, 0, 0], r"shape \(2, 3\) has 2 dimensions; found 3 indices \(0, 0, 0\)"),
            (lambda a: a.u[::0], "the step of a slice must not be 0"),
        ],
    )
    def test_what_is_not_there(self, call, words):
        with pytest.raises(IndexError, match=rf"{words}.* \(lang/test_expression\.py:\d+\)") as error:
            call(Symbols())
        assert isinstance(error.value, gt.ModelError)

    @pytest.mark.parametrize("index", [1.5, slice(1.0, 2), None, [0, 1], ..., (0, 1.5), (slice("a", None), 0)])
    def test_what_is_no_index(self, index):
        with pytest.raises(gt.ModelError, match=r"an index must be an integer; found"):
            Symbols().M[index]

    def test_index_out_of_range(self):
        with pytest.raises(IndexError, match="index 3 is out of range"):
            Symbols().u[3]


@pytest.mark.parametrize("parts", [3, None, "ab"])
def test_a_vector_of_what_are_no_parts_is_refused(parts):
    with pytest.raises(gt.ModelError):
        gt.vector(parts)
