"""Differentiation counts, index, degrees of freedom, and what a system that is not square is told."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel import der
from gtmodel.compiler.alias import eliminate
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.flat import FlatEquation, FlatModel
from gtmodel.compiler.structure import EquationStructure, analyse
from tests.oracle.pantelides import differentiation_counts
from tests.support.examples import examples
from tests.support.models import Bridge, FourBar, Pendulum, SeriesRLC, SliderCrank
from tests.support.rods import ThreeRods

RODS = ThreeRods()


def system(model: gt.Model, known: list[str], aliases: bool) -> tuple[FlatModel, list[FlatEquation], list[int]]:
    """Equations and unknowns, with aliases still in or eliminated."""
    flat = flat_of(model)
    given_ = [i for name in known for i in flat.lookup(name)[1]]
    if aliases:
        equations, removed = flat.equations, set()
    else:
        result = eliminate(flat, frozenset(given_))
        equations, removed = result.equations, set(result.removed)
    return flat, equations, [v.index for v in flat.variables if v.index not in removed and v.index not in given_]


def structure(model: gt.Model, *known: str) -> EquationStructure:
    return analyse(*system(model, list(known), aliases=False))


MODELS = {
    "pendulum": (Pendulum(), [], 2, 3),
    "slider-crank by forces": (SliderCrank(), ["torque", "force"], 2, 3),
    "slider-crank by the slider": (SliderCrank(), ["s", "force"], 0, 3),
    "four-bar": (FourBar(), ["theta"], 0, 1),
    "circuit by the source": (SeriesRLC(), ["u"], 2, 1),
    "circuit by the capacitor": (SeriesRLC(), ["capacitor.v"], 0, 2),
    "bridge": (Bridge(), ["u"], 0, 1),
    "rods by q": (RODS, ["q"], 0, 3),
    "rods by T": (RODS, ["T"], 0, 3),
    "rods by forces": (RODS, ["tau"], 6, 3),
    "rods on a prescribed path": (RODS, ["tau[0]", "T[1]", "T[2]"], 2, 3),
    "rods with one servo": (RODS, ["tau[0]", "tau[1]", "q[2]"], 4, 3),
}


class TestSigmaMethod:
    @pytest.mark.parametrize("name", MODELS)
    @pytest.mark.parametrize("aliases", [False, True], ids=["without aliases", "with aliases"])
    def test_agrees_with_pantelides(self, name, aliases):
        model, known, *_ = MODELS[name]
        flat, equations, unknowns = system(model, known, aliases)
        column = set(unknowns)
        pairs = [{p for p in flat.scope.symbols_in(e.residual) if p[0] in column} for e in equations]
        assert analyse(flat, equations, unknowns).c.tolist() == differentiation_counts(pairs)

    @pytest.mark.parametrize("name", MODELS)
    def test_freedom_and_index(self, name):
        model, known, degrees_of_freedom, index = MODELS[name]
        s = structure(model, *known)
        assert (s.degrees_of_freedom, s.index) == (degrees_of_freedom, index)

    @pytest.mark.parametrize("name", MODELS)
    def test_offsets_are_a_certificate(self, name):
        # dual feasible, and tight on a transversal: no other offsets are smaller (Pryce 2001, section 3)
        model, known, *_ = MODELS[name]
        s = structure(model, *known)
        slack = {(i, j): s.d[j] - s.c[i] - order for (i, j), order in s.sigma.items()}
        assert min(slack.values()) >= 0
        assert s.c.min() == 0
        tight = [key for key, value in slack.items() if value == 0]
        assert {i for i, _ in tight} == set(range(len(s.c)))
        assert {j for _, j in tight} == set(range(len(s.d)))

    @examples(60)
    @given(st.data())
    def test_agrees_with_pantelides_on_random_systems(self, data):
        n = data.draw(st.integers(1, 6))
        diagonal = data.draw(st.permutations(range(n)))  # a transversal, so that the system is regular
        pairs = [{(diagonal[i], data.draw(st.integers(0, 2)))} for i in range(n)]
        for i, j in data.draw(st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=2 * n)):
            pairs[i].add((j, data.draw(st.integers(0, 2))))
        x = gt.variable(n)

        def equations(self):
            for i in range(n):
                # distinct prime factors: no two rows are alike, and no row looks like an alias
                yield sum((2.0 + i + 7 * j + k) * der(self.x[j], k) for j, k in sorted(pairs[i])) == 1.0 + 0.1 * i

        model = type("Random", (gt.Model,), {"x": x, "equations": equations})()
        flat, rows, unknowns = system(model, [], aliases=True)
        highest = [{(j, max(k for jj, k in p if jj == j)) for j, _ in p} for p in pairs]
        assert analyse(flat, rows, unknowns).c.tolist() == differentiation_counts(highest)


class TestRaisedOffsets:
    def test_freedom_and_index_stay(self):
        before = RODS.causal("tau", "der(T,2)").plan.structure
        after = RODS.causal("tau", "der(T,5)").plan.structure
        assert np.array_equal(after.c, before.c + 3)
        assert (after.index, after.degrees_of_freedom) == (before.index, before.degrees_of_freedom) == (3, 6)

    def test_derivatives_above_the_offset_are_computed(self):
        # tension itself has offset 0; its derivative needs jerk. Central difference along q(t) as the other road.
        f = RODS.causal("q", ["rod[0].tension", "der(rod[0].tension)"])
        assert [s.name for s in f.inputs] == ["q", "der(q)", "der(q,2)", "der(q,3)"]
        q, v, a, j = np.array([[0.1, -0.2, 0.15], [0.3, -0.2, 0.5], [2.0, 1.0, -3.0], [4.0, -5.0, 6.0]])

        def at(t: float) -> list[np.ndarray]:
            return [q + v * t + a * t**2 / 2 + j * t**3 / 6, v + a * t + j * t**2 / 2, a + j * t, j]

        h = 1e-3  # sixth order: error about 1e-16 of the value, round-off 1e-13 / h
        samples = [f(*at(k * h))[0] for k in range(-3, 4)]
        rate = np.dot(samples, [-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
        assert f(*at(0.0))[1] == pytest.approx(rate, rel=1e-8)


class TestNotSquare:
    def test_too_few_knowns(self):
        with pytest.raises(gt.ModelError, match=r"ThreeRods: 57 equations for 60 unknowns; not determined: .*too few"):
            RODS.causal((), "T")

    def test_too_many_knowns(self):
        with pytest.raises(gt.ModelError, match=r"too many equations or knowns among: .*mechanics/rod\.py:\d+"):
            RODS.causal(["q", "T"], "tau")

    def test_square_but_over_and_underdetermined(self):
        class Odd(gt.Model):
            x = gt.variable(unit="1")
            y = gt.variable(unit="1")

            def equations(self):
                yield self.x**2 == 4
                yield self.x**3 == 8

        with pytest.raises(gt.ModelError, match=r"not determined: y .*Odd equation 1.*Odd equation 2") as error:
            Odd().causal((), "x")
        assert "compiler/test_structure.py" in str(error.value)

    def test_a_known_that_no_equation_uses(self):
        class Spare(gt.Model):
            x = gt.variable(unit="1")
            z = gt.variable(unit="1")

            def equations(self):
                yield self.x == 1

        with pytest.raises(gt.ModelError, match="'z' is known, but no equation uses it"):
            Spare().causal("z", "x")

    def test_a_known_that_only_aliases_use_is_used(self):
        class Renamed(gt.Model):
            a = gt.variable(2, unit="1")
            x = gt.variable(unit="1")
            y = gt.variable(unit="1")

            def equations(self):
                yield self.a == [self.x, -self.y]

        x, y, status = Renamed().causal("a", ["x", "y"])([3.0, 4.0])
        assert (x, y, status) == (3.0, -4.0, gt.Status.OK)

    def test_two_names_of_one_quantity_cannot_both_be_known(self):
        class Renamed(gt.Model):
            x = gt.variable(unit="1")
            y = gt.variable(unit="1")
            z = gt.variable(unit="1")

            def equations(self):
                yield self.x == self.y
                yield self.z == 2 * self.x

        with pytest.raises(gt.ModelError, match=r"too many equations or knowns among: Renamed equation 1"):
            Renamed().causal(["x", "y"], "z")
