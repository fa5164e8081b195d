"""A guess refuses nothing; a declared start does. What is preferred as a state and cannot be one is said."""

from __future__ import annotations

import pytest

import gtmodel as gt
from gtmodel import der


def steered(guess: float | None) -> gt.Optimization:
    class Steered(gt.Optimization):
        x = gt.variable(start=1.0, fixed=True, min=0.1)
        y1 = gt.variable(start=0.0, min=-2.0)
        y2 = gt.variable(start=0.0)
        u = gt.input(start=guess)
        final_time = 5.0

        def equations(self):
            yield der(self.x) == self.y1 + self.y2 + 2
            yield 3 * self.y1 + self.y2 == self.x + self.u
            yield self.y1 + 2 * self.y2 == gt.sqrt(self.x + 1) + self.x + self.u + 2 * der(self.x)

        def objective(self):
            return gt.integral(self.x**2 + self.u**2)

    return Steered()


def test_a_guess_of_an_input_refuses_nothing():
    without, guessed = (gt.solve(steered(guess), gt.Mesh(20)) for guess in (None, 0.0))
    assert guessed.objective == pytest.approx(without.objective, rel=1e-6)  # of IPOPT
    assert guessed.objective == pytest.approx(88.74, rel=1e-3)  # of 20 elements, the report's 88.74045881


class Crank(gt.Model):
    x = gt.variable(start=0.6)
    y = gt.variable(start=0.8)

    def equations(self):
        yield self.x**2 + self.y**2 == 1.0
        yield gt.branch("above", self.y)


class Doubled(Crank):
    z = gt.variable(start=1.6)

    def equations(self):
        yield from super().equations()
        yield self.z == 2 * self.y


def test_a_declared_start_that_cannot_be_assembled_is_refused_and_a_guess_is_not():
    assert Doubled(z={"start": 3.0}).causal("x", "z")(0.6)[0] == pytest.approx(1.6, abs=1e-9)
    assert Doubled(z={"start": 0.4, "fixed": True}).causal("x", "z")(0.6)[0] == pytest.approx(1.6, abs=1e-9)
    with pytest.raises(gt.ModelError, match="z = 3"):
        Doubled(z={"start": 3.0, "fixed": True}).causal("x", "z")


class Osc(gt.Model):
    x = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    y = gt.variable()

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield self.y == self.x**2


def test_a_simulation_says_which_preferred_variable_is_no_state():
    assert "'y'" in Osc().simulate(0.1, prefer="y").message
    assert "'" not in Osc().simulate(0.1, prefer="x").message


def test_an_optimisation_refuses_a_preferred_variable_that_cannot_be_a_state():
    class Go(gt.Optimization):
        x = gt.variable(start=1.0, fixed=True)
        y = gt.variable()
        u = gt.input()
        final_time = 1.0

        def equations(self):
            yield der(self.x) == self.u
            yield self.y == self.x**2

        def objective(self):
            return gt.integral(self.y + self.u**2)

    with pytest.raises(gt.ModelError, match=r"'y' .* states are x"):
        gt.solve(Go(), gt.Mesh(3), solver=gt.SolverOptions(prefer=("y",)))


def planar(closed_by: type[gt.Model] | None) -> gt.Builder:
    """A four-bar linkage of parallel axes, whose loop is closed by a part or by a mere connection."""
    bench = gt.Builder("linkage")
    ground = bench.part("ground", gt.mechanics.Ground())
    crank, coupler, rocker, pin = (
        bench.part(n, gt.mechanics.Revolute()) for n in ("crank", "coupler", "rocker", "pin")
    )
    lengths = {"bar": 0.3, "top": 0.5, "base": 0.5, "arm": 0.3}
    bar, top, base, arm = (bench.part(n, gt.mechanics.FixedTranslation(d=[d, 0, 0])) for n, d in lengths.items())
    bench.add(gt.connect([ground.frame, crank.b, bar.b, coupler.b], [crank.a, bar.a, coupler.a, top.a]))
    bench.add(gt.connect([ground.frame, base.b, rocker.b, top.b], [base.a, rocker.a, arm.a, pin.a]))
    if closed_by is None:
        bench.add(gt.connect(pin.b, arm.b))
    else:
        closure = bench.part("closure", closed_by())
        bench.add(gt.connect([pin.b, arm.b], [closure.a, closure.b]))
    return bench


@pytest.mark.parametrize("closed_by", [None, gt.mechanics.LoopClosure])
def test_a_planar_loop_in_space_names_the_part_that_closes_it(closed_by: type[gt.Model] | None):
    with pytest.raises(gt.ModelError, match=r"gt\.mechanics\.PlanarLoopClosure"):
        planar(closed_by).causal("crank.shaft.phi", "rocker.shaft.phi")


def test_three_ports_are_joined_by_two_connections():
    bench = gt.Builder("three")
    a, b, c = (bench.part(n, gt.mechanics.FixedFlange()) for n in "abc")
    with pytest.raises(gt.ModelError, match="3: yield 2 connections"):
        gt.connect(a.flange, b.flange, c.flange)
