"""Aliases: what is eliminated, with which sign and derivative, and that nothing is forgotten."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.compiler.alias import eliminate
from gtmodel.compiler.causal import flat_of


def made(declarations: dict[str, Any], equations: Any) -> gt.Model:
    return type("Made", (gt.Model,), {**declarations, "equations": equations})()


def scalars(*names: str, unit: str = "1") -> dict[str, Any]:
    return {n: gt.variable(unit=unit) for n in names}


def removed(model: gt.Model, *protected: str) -> dict[str, tuple[int, str]]:
    """Name -> (sign, name with derivative that it stands for)."""
    flat = flat_of(model)
    result = eliminate(flat, frozenset(flat.lookup(n)[1][0] for n in protected))
    found = {}
    for i in sorted(result.removed):
        sign, kept, order = result.resolve(i, 0)
        found[flat.variables[i].name] = (sign, flat.symbol_name(kept, order))
    return found


class TestWhatIsRemoved:
    def test_equal_and_opposite(self):
        def equations(self):
            yield self.x == self.y
            yield self.z == -self.y
            yield self.x + self.w == 0
            yield 2 * self.v - 2 * self.w == 0
            yield self.x**2 == 2

        aliases = removed(made(scalars("x", "y", "z", "w", "v"), equations), "x")
        assert aliases == {"y": (1, "x"), "z": (-1, "x"), "w": (-1, "x"), "v": (-1, "x")}

    def test_not_removed(self):
        def equations(self):
            yield self.x == 2 * self.y  # a factor
            yield self.y == self.z + 1  # a constant
            yield der(self.z) == der(self.w)  # a constant is free
            yield self.k * self.w == self.k * self.v  # a parameter, which may be zero

        declared = {**scalars("x", "y", "z", "w", "v"), "k": gt.parameter(2.0, unit="1")}
        assert removed(made(declared, equations)) == {}

    def test_derivative_goes_and_not_the_function(self):
        def equations(self):
            yield self.v == der(self.r)
            yield self.a == -der(self.v)

        declared = scalars("r", unit="m") | scalars("v", unit="m/s") | scalars("a", unit="m/s2")
        assert removed(made(declared, equations)) == {"v": (1, "der(r)"), "a": (-1, "der(r,2)")}
        assert "r" not in removed(made(declared, equations), "v", "a")

    def test_preference_path_and_protection_decide_who_stays(self):
        class Part(gt.Model):
            x = gt.variable(unit="1")

        class Top(gt.Model):
            part = gt.part(Part)
            long_name = gt.variable(unit="1")
            y = gt.variable(unit="1")
            wanted = gt.variable(unit="1", prefer=1)

            def equations(self):
                yield self.part.x == self.long_name
                yield self.y == self.long_name
                yield self.y == self.wanted

        assert {sign_name for sign_name in removed(Top()).values()} == {(1, "wanted")}
        assert {sign_name for sign_name in removed(Top(), "part.x").values()} == {(1, "part.x")}

    def test_a_long_chain_collapses_to_one(self):
        names = [f"x{i}" for i in range(30)]

        def equations(self):
            for a, b in pairwise(names):
                yield getattr(self, a) == -getattr(self, b)
            yield self.x0**2 == 2

        aliases = removed(made(scalars(*names), equations), "x0")
        assert aliases == {f"x{i}": ((-1) ** i, "x0") for i in range(1, 30)}


class TestValues:
    def test_signs_and_derivatives_reach_the_caller(self):
        def equations(self):
            yield self.v == -der(self.r)
            yield self.a == der(self.v)
            yield self.r == self.s

        declared = scalars("r", "s", unit="m") | scalars("v", unit="m/s") | scalars("a", unit="m/s2")
        f = made(declared, equations).causal("s", ["r", "v", "a", "der(a)", "der(v,2)"])
        assert [x.name for x in f.inputs] == ["s", "der(s)", "der(s,2)", "der(s,3)"]
        assert f(2.0, 3.0, 5.0, 7.0) == (2.0, -3.0, -5.0, -7.0, -7.0, gt.Status.OK)

    def test_opposite_and_equal_is_zero(self):
        def equations(self):
            yield self.x == self.y
            yield self.y == -self.x

        assert made(scalars("x", "y"), equations).causal((), ["x", "y"])()[:2] == (0.0, 0.0)

    def test_prefer_keeps_the_name_that_was_asked_for(self):
        # with "longer" eliminated the state would be "x" with the opposite sign
        def equations(self):
            yield self.x == -self.longer
            yield der(self.x) == self.u

        declared = scalars("x", "longer") | {"u": gt.input(unit="1/s")}
        f = made(declared, equations).causal("u", ["der(longer)", "x"], prefer="longer")
        assert [s.name for s in f.inputs] == ["longer", "u"]
        assert f(2.0, 3.0)[:2] == (-3.0, -2.0)

    def test_start_values_of_removed_names_count(self):
        def equations(self):
            yield self.x == -self.a_longer_name
            yield self.x**2 == self.u

        declared = scalars("x") | {"a_longer_name": gt.variable(unit="1", start=3.0), "u": gt.input(unit="1")}
        assert made(declared, equations).causal("u", "x")(4.0)[0] == -2.0


class TestConflicts:
    def test_two_different_fixed_starts(self):
        def equations(self):
            yield self.x == -self.y
            yield der(self.x) == self.u

        declared = {
            "x": gt.variable(unit="1", start=1.0, fixed=True),
            "y": gt.variable(unit="1", start=1.0, fixed=True),
            "u": gt.input(unit="1/s"),
        }
        with pytest.raises(gt.ModelError) as error:
            made(declared, equations).causal("u", "x")
        here = r"\(compiler/test_alias\.py:\d+\)"
        assert error.match(rf"'y' starts at 1 {here} and 'x' at 1 {here}, but they are the same quantity")
        declared["y"] = gt.variable(unit="1", start=-1.0, fixed=True)  # the same start, seen with the sign
        made(declared, equations).causal("u", "x")

    def test_guesses_may_differ(self):
        def equations(self):
            yield self.x == self.y
            yield self.x**2 == self.u

        declared = {
            "x": gt.variable(unit="1", start=1.0),
            "y": gt.variable(unit="1", start=1.2, fixed=True),
            "u": gt.input(unit="1"),
        }
        assert made(declared, equations).causal("u", "y")(4.0)[0] == 2.0

    def test_an_equation_said_twice(self):
        def equations(self):
            yield self.x == self.y
            yield self.y == self.x

        with pytest.raises(gt.ModelError, match=r"'Made equation 2' is redundant: .*\(compiler/test_alias\.py:\d+\)"):
            made(scalars("x", "y"), equations).causal((), "x")
