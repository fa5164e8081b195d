"""Choice of states and rank decisions: at consistent points, with redundant constraints named and never dropped."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from tests.support.models import Pendulum, SeriesRLC
from tests.support.rods import FourRods, ThreeRods

RODS = ThreeRods()


def states(model: gt.Model, known: str | tuple[str, ...] = (), target: str = "", **options: object) -> list[str]:
    plan = model.causal(known, target, **options).plan
    return [plan.flat.symbol_name(*p) for p in plan.states]


def pendulum(angle: float) -> Pendulum:
    """Released at an angle from the lower rest position."""
    return Pendulum(x=dict(start=np.sin(angle)), y=dict(start=-np.cos(angle)))


class TwoRods(Pendulum):
    """A pendulum on two rods; the second one's length is for a subclass to give."""

    second = gt.variable(unit="N/m")

    def equations(self):
        pull = self.tension + self.second
        yield self.m * der(self.x, 2) == -pull * self.x
        yield self.m * der(self.y, 2) == -pull * self.y - self.m * self.g
        yield self.x**2 + self.y**2 == self.L**2


class TestPendulum:
    @pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2, 1.4, 1.7, 2 * np.pi / 3])
    def test_beside_the_pivot_the_height_is_the_state(self, angle):
        # at x = L the state x stands still to first order: with it, every motion would be invisible
        assert states(pendulum(angle), target="der(x,2)") == ["y", "der(y)"]

    @pytest.mark.parametrize("angle", [0.0, 0.1, -0.3, np.pi])
    def test_below_and_above_it_the_side(self, angle):
        assert states(pendulum(angle), target="der(y,2)") == ["x", "der(x)"]

    @pytest.mark.parametrize("prefer", ["x", "y"])
    def test_between_them_the_wish_decides(self, prefer):
        assert states(pendulum(np.pi / 4), target="tension", prefer=prefer) == [prefer, f"der({prefer})"]

    def test_state_preference_of_the_declaration_decides_too(self):
        class Preferring(Pendulum):
            x = gt.variable(unit="m", start=0.6, prefer=1)

        class Avoiding(Pendulum):
            x = gt.variable(unit="m", start=0.6, prefer=-1)

        assert states(Preferring(), target="tension") == ["x", "der(x)"]
        assert states(Avoiding(), target="tension") == ["y", "der(y)"]

    def test_asked_for_the_still_coordinate_it_says_what_is_wrong(self):
        with pytest.raises(gt.ModelError, match=r"y has two solutions and nothing distinguishes them"):
            pendulum(np.pi / 2).causal((), "der(y,2)", prefer="x")


class TestOthers:
    def test_circuit(self):
        # the aliases of the loop current are one state
        found = states(SeriesRLC(), "u", "der(capacitor.v)", prefer=["capacitor.v", "inductor.i"])
        assert sorted(found) == ["capacitor.v", "inductor.i"]

    @pytest.mark.parametrize("prefer", ["T", "q"])
    def test_rods(self, prefer):
        names = [f"{prefer}[{i}]" for i in range(3)]
        found = states(RODS, "tau", "der(T,2)", prefer=prefer)
        assert sorted(found) == sorted(names + [f"der({n})" for n in names])

    def test_a_servo_constraint_leaves_the_free_chain(self):
        # two carts driven as prescribed, one by a given force: one free coordinate (Dressler 2012, section 3.5)
        assert states(RODS, ("q[0]", "q[1]", "tau[2]"), "der(q[2],2)", prefer="q[2]") == ["q[2]", "der(q[2])"]


class Platform(gt.Model):
    """A planar rigid platform on three equal rods whose ends form equal triangles; it is turned by (c, s)."""

    corners = ([0.0, 0.0], [1.0, 0.0], [0.3, 0.7])
    L = gt.parameter(1.0, positive=True)
    m = gt.parameter(2.0, positive=True)
    J = gt.parameter(0.3, positive=True)
    T = gt.variable(2)
    c = gt.variable(start=1.0)
    s = gt.variable(start=0.0)
    spin = gt.variable()
    pull = gt.variable(3)

    def equations(self):
        yield self.c**2 + self.s**2 == 1
        yield self.spin == self.c * der(self.s) - self.s * der(self.c)
        force, moment = 0 * self.T, 0 * self.c
        for i, b in enumerate(self.corners):
            arm = gt.vector([self.c * b[0] - self.s * b[1], self.s * b[0] + self.c * b[1]])
            rod = self.T + arm - np.array(b)
            yield gt.dot(rod, rod) == self.L**2
            force = force - self.pull[i] * rod
            moment = moment - self.pull[i] * (arm[0] * rod[1] - arm[1] * rod[0])
        yield self.m * der(self.T, 2) == force
        yield self.J * der(self.spin) == moment


# Home positions of the plate, all with some reach to spare.
HOMES = np.array([1.5, -0.5, 0.8]) + 0.3 * np.random.default_rng(0).uniform(-1, 1, (10, 3))


class TestRedundancy:
    @pytest.mark.parametrize("home", HOMES, ids=range(len(HOMES)))
    def test_a_fourth_parallel_rod_is_refused_and_named(self, home):
        with pytest.raises(gt.ModelError) as error:
            FourRods(home=home).causal("tau", "der(T,2)")
        sentence = str(error.value)
        assert "19 equations have rank 18 in stage -2 (positions)" in sentence
        assert "redundant or contradict each other" in sentence
        for culprit in ("rod[2] equation 1 (mechanics/rod.py:", "fourth equation 1 (mechanics/rod.py:"):
            assert culprit in sentence
        for innocent in ("rod[0]", "rod[1]", "cart", "motor"):
            assert f"{innocent} equation" not in sentence.replace("at_cart", "")

    @pytest.mark.parametrize("known, target", [("q", "T"), ("T", "q")])
    def test_it_is_refused_in_every_causality(self, known, target):
        with pytest.raises(gt.ModelError, match=r"too many equations or knowns among: .*fourth equation 1"):
            FourRods().causal(known, target)

    def test_a_rod_that_contradicts_the_others_has_no_solution(self):
        class Contradicting(TwoRods):
            def equations(self):
                yield from super().equations()
                yield (self.x - 0.1 * self.L) ** 2 + self.y**2 == (1.3 * self.L) ** 2

        with pytest.raises(gt.ModelError, match=r"no common solution near the start values \(closest residual 0"):
            Contradicting().causal((), "tension")

    def test_structurally_sound_but_identically_singular(self):
        # x' + y' + y = u, x + y = w: the Sigma-method says one degree of freedom, the truth is none (y = u - w')
        class Hidden(gt.Model):
            x = gt.variable()
            y = gt.variable()
            u = gt.input()
            w = gt.input()

            def equations(self):
                yield der(self.x) + der(self.y) + self.y == self.u
                yield self.x + self.y == self.w

        with pytest.raises(gt.ModelError) as error:
            Hidden().causal(["u", "w"], ["x", "y"])
        assert error.match(
            r"2 equations have rank 1 .*undetermined \(singular\): Hidden equation 1 .*Hidden equation 2"
        )

    @pytest.mark.parametrize("angle", [0.3, 1.0, 2.0])
    def test_a_platform_on_three_parallel_rods(self, angle):
        # the rods are redundant in the platform's upright position only, which they enforce themselves
        model = Platform(T=dict(start=[np.cos(angle), np.sin(angle)]))
        with pytest.raises(gt.ModelError, match=r"4 equations have rank 3 in stage -2 \(positions\)"):
            model.causal((), ["T", "c", "s"])

    def test_poor_geometry_is_not_redundancy(self):
        # two circles whose centres are a tenth of a millimetre apart: three digits are lost, no more
        class Close(gt.Model):
            P = gt.variable(2, unit="m", start=[0.3, 0.9])
            r = gt.input(2, unit="m", start=[1.0, 0.99995])

            def equations(self):
                d = self.P - [1e-4, 0.0]
                yield gt.dot(self.P, self.P) == self.r[0] ** 2
                yield gt.dot(d, d) == self.r[1] ** 2
                yield gt.branch("up", self.P[1])

        P, status = Close().causal("r", "P")([1.0, 0.99996])
        x = (1e-8 + 1 - 0.99996**2) / 2e-4
        assert status == gt.Status.OK
        assert np.allclose(P, [x, np.sqrt(1 - x**2)], rtol=1e-9)

    def test_a_rod_twice(self):
        # two rods between the same points: the simplest redundancy
        class Doubled(TwoRods):
            def equations(self):
                yield from super().equations()
                yield (self.x / self.L) ** 2 + (self.y / self.L) ** 2 == 1

        with pytest.raises(gt.ModelError, match=r"2 equations have rank 1 in stage -2 \(positions\)"):
            Doubled().causal((), "tension")
