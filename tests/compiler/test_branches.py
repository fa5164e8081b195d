"""Branches are geometric: named by components, independent of declaration order and of start values' luck."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import gtmodel as gt
from tests.support.compare import relative_error
from tests.support.models import FourBar, SliderCrank
from tests.support.rods import ThreeRods

ROUND_OFF = 1e-12

RODS = ThreeRods()
T = np.array([1.5, -0.5, 0.8])


def by_hand(sides: tuple[int, ...]) -> np.ndarray:
    """q of the ThreeRods at T, by the quadratic formula."""
    A, v, L = (np.asarray(x) for x in (RODS.A, RODS.v, RODS.L))
    d = T - A
    dv, vv = np.sum(d * v, axis=1), np.sum(v * v, axis=1)
    return (dv - np.array(sides) * np.sqrt(dv**2 - vv * (np.sum(d * d, axis=1) - L**2))) / vv


class TestNames:
    @pytest.mark.parametrize("sides", list(product([1, -1], repeat=3)))
    def test_every_combination_of_three_independent_signs(self, sides):
        f = RODS.causal("T", "q", branches={f"ahead[{i}]": s for i, s in enumerate(sides)})
        q, status = f(T)
        assert status == gt.Status.OK
        assert relative_error(q, by_hand(sides)) < ROUND_OFF

    def test_default_is_the_positive_side(self):
        assert np.array_equal(RODS.causal("T", "q")(T)[0], RODS.causal("T", "q", branches={"ahead[1]": 1})(T)[0])
        assert relative_error(RODS.causal("T", "q")(T)[0], by_hand((1, 1, 1))) < ROUND_OFF

    def test_each_root_is_settled_by_its_own_branch(self):
        roots = [r for b in RODS.causal("T", "q").plan.blocks for r in b.roots]
        assert [r.settled_by for r in roots] == ["ahead[0]", "ahead[1]", "ahead[2]"]

    def test_of_two_names_the_one_that_only_changes_sign_decides(self):
        # turning the plate to the other side of the carts' plane turns it to the other side of cart 0 as well, near
        # home; but only the plane tells the two positions apart at every pose
        class Named(ThreeRods):
            def equations(self):
                yield from super().equations()
                p = [rod.a.r for rod in self.rod]
                normal = gt.cross(p[1] - p[0], p[2] - p[0])
                yield gt.branch("plate_ahead", gt.dot(self.T - p[0], normal) * normal[0])

        named = Named()
        q = by_hand((1, 1, 1))
        ahead, behind = (named.causal("q", "T", branches={"plate_ahead": s})(q)[0] for s in (1, -1))
        assert relative_error(ahead, T) < ROUND_OFF
        assert behind[0] < 0 < ahead[0]
        whole = {"plate_ahead": 1, "ahead[0]": -1}  # a whole configuration, as inverse kinematics would need it
        assert np.array_equal(named.causal("q", "T", branches=whole)(q)[0], ahead)

    def test_a_name_that_was_asked_for_decides_if_no_other_can(self):
        q = by_hand((1, 1, 1))
        ahead, behind = (RODS.causal("q", "T", branches={"ahead[0]": s})(q)[0] for s in (1, -1))
        assert relative_error(ahead, T) < ROUND_OFF
        assert behind[0] - q[0] < 0

    def test_a_fourth_name_for_the_same_side_may_be_asked_for(self):
        class Renamed(SliderCrank):
            def equations(self):
                yield from super().equations()
                yield gt.branch("pin_high", self.P[1] * (self.r**2 + self.P[1] ** 2))

        model = Renamed()
        low = model.causal(["s", "force"], "P", branches={"pin_high": -1, "up": -1})(0.9)[0]
        assert low[1] < 0
        assert relative_error(low * [1, -1], model.causal(["s", "force"], "P")(0.9)[0]) < ROUND_OFF

    def test_an_expression_that_is_not_odd_in_the_root_will_do(self):
        # height of C above a slanted line; changes sign between the two assemblies, but not its size alone
        class Slanted(FourBar):
            def equations(self):
                *rest, _ = super().equations()
                yield from rest
                yield gt.branch("above", self.C[1] - 0.1 * self.C[0])

        for side in (1, -1):
            C, status = Slanted().causal("theta", "C", branches={"above": side})(0.7)
            assert status == gt.Status.OK
            assert np.sign(C[1] - 0.1 * C[0]) == side
            assert relative_error(C, FourBar().causal("theta", "C", branches={"open": side})(0.7)[0]) < ROUND_OFF

    def test_without_a_name_the_start_values_decide(self):
        class Silent(FourBar):
            def equations(self):
                *rest, _ = super().equations()
                return rest

        for side in (1, -1):
            C = FourBar().causal("theta", "C", branches={"open": side})(0.7)[0]
            silent = Silent(C=dict(start=C), theta=dict(start=0.7)).causal("theta", "C")
            assert [r.settled_by for b in silent.plan.blocks for r in b.roots] == [""]
            assert relative_error(silent(0.7)[0], C) < ROUND_OFF

    def test_with_neither_it_is_an_error(self):
        class Silent(gt.Model):
            x = gt.variable(unit="1")
            u = gt.input(unit="1", start=1.0)

            def equations(self):
                yield self.x**2 == self.u

        with pytest.raises(gt.ModelError, match="x has two solutions and nothing distinguishes them"):
            Silent().causal("u", "x")

    def test_wrong_names_and_signs(self):
        with pytest.raises(gt.ModelError, match=r"has no branch 'ahed'; it has ahead\[0\], ahead\[1\], ahead\[2\]"):
            RODS.causal("T", "q", branches={"ahed": 1})
        with pytest.raises(gt.ModelError, match=r"branch 'ahead\[0\]' takes \+1 or -1; found 0"):
            RODS.causal("T", "q", branches={"ahead[0]": 0})

    def test_a_branch_takes_a_scalar(self):
        class Odd(FourBar):
            def equations(self):
                yield gt.branch("both", self.C)

        with pytest.raises(gt.ModelError, match=r"branch 'both' takes a scalar expression .*test_branches\.py:\d+"):
            Odd().causal("theta", "C")

    def test_a_chain_of_two_roots(self):
        # the second root's quantities depend on the first one's sign
        for up, right in product([1, -1], repeat=2):
            f = SliderCrank().causal(["P[0]", "force"], ["P[1]", "s"], branches={"up": up, "right": right})
            y, s, status = f(0.2)
            assert (np.sign(y), np.sign(s - 0.2), status) == (up, right, gt.Status.OK)


CARTS = np.array([[0.0, 0.0, 1.4], [0.2, -1.3, 1.5], [0.0, 0.0, 0.0]])
LENGTHS = np.array([2.0, 1.8, 1.9])


def three_spheres(variables: tuple[int, ...], equations: tuple[int, ...], local: bool) -> gt.Model:
    """A point P at three distances from three points, its declarations and equations in a given order.

    local: the difference vectors are expressions; else they are variables of their own.
    """
    declared = {
        "P": gt.variable(3, unit="m"),
        "d0": gt.variable(3, unit="m"),
        "d1": gt.variable(3, unit="m"),
        "d2": gt.variable(3, unit="m"),
    }
    names = [list(declared)[i] for i in variables]
    body = {n: declared[n] for n in names if n == "P" or not local}

    def rows(self):
        for i in range(3):
            d = self.P - CARTS[i] if local else getattr(self, f"d{i}")
            if not local:
                yield d == self.P - CARTS[i]
            yield gt.dot(d, d) == LENGTHS[i] ** 2

    def everything(self):
        items = list(rows(self))
        step = len(items) // 3
        order = [i * step + k for i in equations for k in range(step)]
        yield from (items[i] for i in order)
        normal = np.cross(CARTS[1] - CARTS[0], CARTS[2] - CARTS[0])
        yield gt.branch("ahead", gt.dot(self.P - CARTS[0], normal * np.sign(normal[0])))

    return type("Spheres", (gt.Model,), {**body, "equations": everything})()


class TestShuffledDeclarations:
    @pytest.mark.parametrize("local", [True, False])
    @pytest.mark.parametrize("side", [1, -1])
    def test_the_same_side_in_every_order(self, local, side):
        found = []
        orders = [(0, 1, 2, 3), (3, 1, 0, 2)]
        for variables, equations in product(orders, [(0, 1, 2), (1, 0, 2), (2, 0, 1)]):
            f = three_spheres(variables, equations, local).causal((), "P", branches={"ahead": side})
            P, status = f()
            assert status == gt.Status.OK
            found.append(P)
        assert relative_error(np.array(found), np.broadcast_to(found[0], (len(found), 3))) < ROUND_OFF
        assert np.allclose(np.linalg.norm(found[0] - CARTS, axis=1), LENGTHS, rtol=ROUND_OFF)
        assert np.sign(found[0][0]) == side  # the carts stand near x = 0


class Kepler(gt.Model):
    """No closed form gives x, which runs through the border of its branch as smoothly as u does."""

    x = gt.variable(start=0.5)
    u = gt.variable(start=0.5)
    y = gt.variable()

    def equations(self):
        yield self.x - 0.3 * gt.sin(self.x) == self.u
        yield self.y == self.x**2
        yield gt.branch("right", self.x)


class TestNewton:
    u = np.array([0.7, 1e-3, -1e-3, -0.7])

    @pytest.mark.parametrize("side", [1, -1])
    def test_its_answer_lies_on_the_wanted_branch_or_the_status_says_so(self, side):
        f = Kepler().causal("u", ["x", "y"], branches={} if side > 0 else {"right": -1})
        assert [m.kind for m in f.margins] == ["branch"]
        wanted = np.where(side * self.u > 0, gt.Status.OK, gt.Status.WRONG_BRANCH)
        x, y, status = f(self.u)
        np.testing.assert_array_equal(status, wanted)
        assert np.all(side * x[wanted == 0] > 0) and np.isnan(x[wanted != 0]).all() and np.isnan(y[wanted != 0]).all()
        np.testing.assert_array_equal(f.jacobian(self.u)[1], wanted)
        said = f.casadi.map(len(self.u))(self.u[None])[2]
        np.testing.assert_array_equal(np.asarray(said).ravel(), wanted)
        p = np.tile(f.flat.p0[:, None], len(self.u))
        said = f.casadi_parametric.map(len(self.u))(self.u[None], p)[2]
        np.testing.assert_array_equal(np.asarray(said).ravel(), wanted)
        assert f"branch right = {side:+d} is selected" in f.diagnose(-0.7 * side)
        assert f"branches of Newton's solutions: right = {side:+d}" in f.explain()

    @pytest.mark.parametrize("side", [1, -1])
    def test_a_guess_does_not_lead_off_it(self, side):
        f = Kepler().causal("u", "x", branches={"right": side})
        assert [f(-0.7 * side, guess={"x": g})[1] for g in (-1.0 * side, 1.0 * side)] == [gt.Status.WRONG_BRANCH] * 2
        assert f(0.7 * side, guess={"x": 1.0 * side})[1] is gt.Status.OK

    def test_a_home_pose_at_the_border_asks_for_no_side(self):
        class Border(Kepler):
            x = gt.variable(start=0.0)
            u = gt.variable(start=0.0)

        assert not np.any(Border().causal("u", "x")(self.u)[1])
        asked = Border().causal("u", "x", branches={"right": 1})
        assert asked(self.u)[1].tolist() == [0, 0, gt.Status.WRONG_BRANCH, gt.Status.WRONG_BRANCH]
