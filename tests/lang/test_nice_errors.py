"""Sentences that a person reads when a model is wrong: what was found, what was expected, and the line to look at."""

from __future__ import annotations

import inspect
import re
from typing import Any

import pytest

import gtmodel as gt
from gtmodel import der


def scalars(*names: str, unit: str | None = "1") -> dict[str, Any]:
    return {n: gt.variable(unit=unit) for n in names}


def model(declarations: dict[str, Any], equations: Any) -> gt.Model:
    return type("Wrong", (gt.Model,), {**declarations, "equations": equations})()


def line_of(function: Any, text: str) -> int:
    """Number of the line of a function that holds a text."""
    lines, first = inspect.getsourcelines(function)
    return first + next(i for i, line in enumerate(lines) if text in line)


class Rod(gt.Model):
    """A rod with a mass, for tests only."""

    L = gt.parameter(unit="m", positive=True)
    m = gt.parameter(1.0, unit="kg", positive=True)
    length = gt.variable(unit="m")

    def equations(self):
        yield self.length == self.L


def yields_true(self):
    yield self.x == 1
    yield 1 == 1  # HERE


def forgets_to_yield(self):
    self.x == 1  # noqa: B015  # HERE


def returns_nothing(self):  # HERE
    _ = self.x == 1


def returns_one(self):  # HERE
    return self.x == 1


def is_trivial(self):
    yield self.x == 1
    yield self.y == self.y  # HERE


def has_no_variable(self):
    yield self.x == 1
    yield self.k == 2  # HERE


def is_an_inequality(self):
    yield self.x <= 1  # HERE


def has_other_shapes(self):
    yield self.v == self.w  # HERE


def has_a_number_for_a_vector(self):
    yield self.v == 1.0  # HERE


def has_other_units(self):
    yield self.length == self.force  # HERE


def has_other_units_inside(self):
    sum_of_two = 2 * self.length + self.force  # HERE
    yield sum_of_two == 0


def has_a_bare_number_with_a_unit(self):
    yield self.force == 1000.0 * self.length  # HERE


def has_a_chain(self):
    yield -1 <= self.x <= 1  # HERE


def asks_for_truth(self):
    if self.x == 1:  # HERE
        yield self.x == 1


def assigns(self):
    self.x = 1  # HERE
    yield self.x == 1


def connects_a_variable(self):
    yield gt.connect(self.x, self.y)  # HERE


def has_an_angle_in_metres(self):
    yield self.y == gt.sin(self.length)  # HERE


def says_it_twice(self):
    yield self.x == self.y
    yield self.y - self.x == 0  # HERE


ONE = scalars("x")
TWO = scalars("x", "y")
LENGTH_AND_FORCE = {**scalars("length", unit="m"), **scalars("force", unit="N"), **TWO}
VECTORS = {"v": gt.variable(2, unit="m"), "w": gt.variable(3, unit="m"), **ONE}
WITH_K = {"k": gt.parameter(2.0, unit="1"), **ONE}

# (declarations, equations, sentence): the sentence is a regular expression for everything before the location
SENTENCES = [
    (ONE, yields_true, r"Wrong\.equations\(\) yielded True, which is not an equation; expected 'a == b' with "
     r"expressions of the model, gt\.connect, gt\.branch or gt\.when"),
    (ONE, forgets_to_yield, r"the result of this '==' is discarded; write yield in front of it, or pass it to "
     r"Builder\.add\(\)"),
    (ONE, returns_nothing, r"equations\(\) of Wrong returned nothing; write 'yield' in front of each equation"),
    (ONE, returns_one, r"equations\(\) of Wrong returned one relation; write 'yield' in front of each equation"),
    (TWO, is_trivial, r"an equation of 'the model' is always true; remove or correct it"),
    (WITH_K, has_no_variable, r"an equation of 'the model' has no variable \(\(k-2\) == 0\); "
     r"remove or correct it"),
    (ONE, is_an_inequality, r"a relation with '<=' is not an equation; put inequalities into constraints\(\)"),
    (VECTORS, has_other_shapes, r"shapes \(2,\) and \(3,\) differ in '=='; expected equal shapes"),
    (VECTORS, has_a_number_for_a_vector, r"shapes \(2,\) and \(\) differ in '=='; expected equal shapes"),
    (LENGTH_AND_FORCE, has_other_units, r"units differ in '==': left is m, right is N; a plain number in a "
     r"product has no unit: declare it as a parameter with its unit"),
    (LENGTH_AND_FORCE, has_other_units_inside, r"units differ in '\+': left is m, right is N; .*"),
    (LENGTH_AND_FORCE, has_a_bare_number_with_a_unit, r"units differ in '==': left is N, right is m; a plain "
     r"number in a product has no unit: declare it as a parameter with its unit"),
    (ONE, has_a_chain, r"an equation or inequality \('>='\) has no truth value while a model is being built: yield "
     r"it\. Instead of a <= x <= b write gt\.between\(a, x, b\); instead of if use gt\.If, gt\.branch or .*"),
    (ONE, asks_for_truth, r"an equation or inequality \('=='\) has no truth value while a model is being built: .*"),
    (ONE, assigns, r"models are immutable: 'x' cannot be assigned; .*"),
    (TWO, connects_a_variable, r"connect\(\) takes ports; found Expr"),
    (LENGTH_AND_FORCE, has_an_angle_in_metres, r"sin\(\) takes a dimensionless number or radians; found m"),
    (TWO, says_it_twice, r"'Wrong equation 2' is redundant: it follows from connections and other .*; remove it"),
]  # fmt: skip


@pytest.mark.parametrize("declarations, equations, sentence", SENTENCES, ids=[e.__name__ for _, e, _ in SENTENCES])
def test_equations_quote_their_own_line(declarations, equations, sentence):
    with pytest.raises(gt.ModelError) as error:
        model(declarations, equations).causal((), "x")
    where = f"lang/test_nice_errors.py:{line_of(equations, 'HERE')}"
    assert re.fullmatch(rf"{sentence} \({re.escape(where)}\)", str(error.value), re.DOTALL)
    assert str(error.value.where) == where


def unknown_modifier():
    return Rod(LL=2.0)  # HERE


def negative_length():
    return Rod(L=-2.0)  # HERE


def negative_mass_by_name():
    return Rod(L=1.0).with_(m=-3.0)  # HERE


def text_for_a_number():
    return Rod(L="2 m")  # HERE


def assigned_afterwards():
    rod = Rod(L=2.0)
    rod.L = 3.0  # HERE


CONFIGURATIONS = [
    (unknown_modifier, r"Rod has no declaration 'LL'; did you mean 'L'\?"),
    (negative_length, r"parameter 'L' is declared positive; found -2\.0"),
    (negative_mass_by_name, r"parameter 'm' is declared positive; found -3\.0"),
    (text_for_a_number, r"parameter 'L' takes a number; found '2 m'"),
    (assigned_afterwards, r"models are immutable: 'L' cannot be assigned; .*use model\.with_\(L=\.\.\.\)"),
]


@pytest.mark.parametrize("make, sentence", CONFIGURATIONS, ids=[m.__name__ for m, _ in CONFIGURATIONS])
def test_configurations_quote_the_line_that_makes_them(make, sentence):
    with pytest.raises(gt.ModelError) as error:
        make()
    where = f"lang/test_nice_errors.py:{line_of(make, 'HERE')}"
    assert re.fullmatch(rf"{sentence} \({re.escape(where)}\)", str(error.value), re.DOTALL)


class TestWholeSystems:
    """Errors of the system as a whole name its title, its sizes and the next thing to try."""

    def test_missing_value(self):
        sentence = rf"parameter 'L' of Rod has no value; set it \(lang/test_nice_errors\.py:{line_of(Rod, 'L = gt')}\)"
        with pytest.raises(gt.ModelError, match=f"^{sentence}$"):
            Rod().causal((), "length")

    def test_unknown_target(self):
        with pytest.raises(
            gt.ModelError,
            match=r"^Rod has no variable 'lenght'; did you mean 'length'\? \(lang/test_nice_errors\.py:\d+\)$",
        ):
            Rod(L=1.0).causal((), "lenght")

    def test_unknown_target_without_a_close_name(self):
        with pytest.raises(
            gt.ModelError,
            match=r"^Rod has no variable 'tau'; top-level names are length \(lang/test_nice_errors\.py:\d+\)$",
        ):
            Rod(L=1.0).causal((), "tau")

    def test_too_many_knowns(self):
        with pytest.raises(gt.ModelError) as error:
            Rod(L=1.0).causal("length", "length")
        where = f"lang/test_nice_errors.py:{line_of(Rod, 'yield')}"
        assert str(error.value) == (
            f"Rod: 1 equation for 0 unknowns; too many equations or knowns among: Rod equation 1 ({where})"
        )

    def test_too_few_equations(self):
        def one(self):
            yield self.x == 2 * self.y

        with pytest.raises(gt.ModelError) as error:
            model(TWO, one).causal((), "x")
        where = f"lang/test_nice_errors.py:{line_of(type(self).test_too_few_equations, 'causal')}"
        assert str(error.value) == (
            "Wrong: 1 equation for 2 unknowns; not determined: x, y (too few equations or too few known variables) "
            f"({where})"
        )

    def test_conflicting_fixed_starts(self):
        declared = {name: gt.variable(unit="1", start=s, fixed=True) for name, s in (("x", 1.0), ("y", 2.0))}

        def equations(self):
            yield self.x == self.y
            yield der(self.x) == self.rate

        rate = {"rate": gt.input(unit="1/s")}
        here = rf"\(lang/test_nice_errors\.py:{line_of(type(self).test_conflicting_fixed_starts, 'declared =')}\)"
        sentence = rf"'y' starts at 2 {here} and 'x' at 1 {here}, but they are the same quantity; set only one of them"
        with pytest.raises(gt.ModelError, match=f"^{sentence}$"):
            model({**declared, **rate}, equations).causal("rate", "x")

    def test_unknown_branch(self):
        def equations(self):
            yield self.x**2 == self.y
            yield gt.branch("right", self.x)

        with pytest.raises(
            gt.ModelError, match=r"^Wrong has no branch 'rihgt'; it has right \(lang/test_nice_errors\.py:\d+\)$"
        ):
            model(TWO, equations).causal("y", "x", branches={"rihgt": 1})

    def test_wrong_arguments(self):
        f = Rod(L=1.0).causal((), "length")
        with pytest.raises(TypeError, match=r"^length takes 0 arguments \(\); found 1$"):
            f(1.0)


# part and parts take any keyword as a modifier and check it when the model is put together: see test_model.py
FUNCTIONS = sorted(
    name for name in gt.lang.__all__ if inspect.isfunction(getattr(gt.lang, name)) and name not in ("part", "parts")
)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_misspelt_keyword_raises(name):
    with pytest.raises(TypeError, match="misspelt"):
        getattr(gt.lang, name)(misspelt=1)


class TestParameters:
    def test_a_mass_that_a_part_gets_from_its_owner_is_checked_too(self):
        class Load(gt.Model):
            heavy = gt.parameter(-2.0, unit="kg")
            body = gt.part(gt.mechanics.PointMass, m=heavy)

        with pytest.raises(
            gt.ModelError,
            match=r"parameter 'body.m' must be at least 0.0; found -2.0, which follows from heavy = -2 \(.*errors.py",
        ):
            Load().causal(targets="body.frame.f", known="body.frame.r")

    @pytest.mark.parametrize(
        "given, words",
        [
            (dict(a=0.0, b=0.0), r"'ratio.k' must be finite; found nan, which follows from a = 0 and b = 0"),
            (dict(a=1.0, b=0.0), r"'ratio.k' must be finite; found inf, which follows from a = 1 and b = 0"),
            (dict(a=1.0, b=-1.0), r"'ratio.k' must be at least 0.0; found -1.0, which follows from a = 1 and b = -1"),
            (dict(root=dict(k=float("nan"))), r"'root.k' must be finite; found nan"),
            (dict(root=dict(k=-4.0)), r"'root.k' must be at least 0.0; found -4.0"),
            (dict(pair=[{}, dict(k=float("inf"))]), r"'pair\[1\].k' must be finite; found inf"),
            (dict(nested=dict(inner=dict(k=-3.0))), r"'nested.inner.k' must be at least 0.0; found -3.0"),
        ],
    )
    def test_what_a_part_gets_is_told_by_its_name_and_the_line_that_gave_it(self, given, words):
        class Part(gt.Model):
            k = gt.parameter(unit="1", min=0.0)
            y = gt.variable(unit="1")

            def equations(self):
                yield self.y == self.k

        class Outside(gt.Model):
            inner = gt.part(Part, k=1.0)

        class Owner(gt.Model):
            a = gt.parameter(1.0, unit="1")
            b = gt.parameter(1.0, unit="1")
            ratio = gt.part(Part, k=lambda self: self.a / self.b)
            root = gt.part(Part, k=1.0)
            pair = gt.parts(2, Part, k=[1.0, 2.0])
            nested = gt.part(Outside)

        model = Owner(**given)
        assert model.where.file == "lang/test_nice_errors.py"
        with pytest.raises(gt.ModelError, match=rf"^parameter {words} \({model.where}\)$"):
            model.causal((), "root.y")

    @pytest.mark.parametrize(
        "attributes, words",
        [
            (dict(kind="rotate", shape=(3, 3)), "kind must be one of rotation, unit, .*; found 'rotate'"),
            (dict(kind="rotation", shape=3), r"kind 'rotation' must have shape \(3, 3\); found \(3,\)"),
            (dict(kind="semidefinite", shape=(2, 3)), r"kind 'semidefinite' must have shape \(n, n\); found \(2, 3\)"),
            (dict(kind="unit"), r"kind 'unit' must have shape rows; found \(\)"),
        ],
    )
    def test_a_kind_of_value_that_does_not_fit(self, attributes, words):
        with pytest.raises(gt.ModelError, match=rf"{words} \(lang/test_nice_errors.py:\d+\)"):
            gt.parameter(**attributes)

    def test_a_builder_checks_the_kind_of_a_value(self):
        with pytest.raises(
            gt.ModelError, match=r"parameter 'n' must have length 1; found .* of length 5; divide it by"
        ):
            gt.Builder("b").parameter("n", [3.0, 4.0], kind="unit")

    def test_values_keep_to_min_and_max(self):
        class Rate(gt.Model):
            k = gt.parameter(0.5, min=0.0, max=[1.0, 2.0], shape=2)

        for value, side in (([-1.0, 0.0], "at least 0.0"), ([0.0, 3.0], r"at most \[1.0, 2.0\]")):
            with pytest.raises(gt.ModelError, match=f"parameter 'k' must be {side}"):
                Rate(k=value)

    def test_with_keeps_what_it_does_not_name(self):
        class Rod(gt.Model):
            L = gt.parameter(1.0, unit="m")
            m = gt.parameter(1.0, unit="kg")

        class Pair(gt.Model):
            rod = gt.part(Rod)

        pair = Pair(rod=dict(L=2.0, m=3.0)).with_(rod=dict(m=4.0))
        assert repr(pair) == "Pair(rod={'L': 2.0, 'm': 4.0})"

    def test_a_free_constant_takes_no_modifier(self):
        class Fit(gt.Model):
            k = gt.free(1.0)

        with pytest.raises(gt.ModelError, match="'k' of Fit is chosen by the optimisation and takes no modif"):
            Fit(k=2.0)
