"""The same problem written or posed in another way has the same optimum."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, solve
from tests.optimize import features, problems

# IPOPT stops at 1e-8 of the scaled optimality conditions and relaxes bounds by as much: the cost keeps seven digits.
SOLVER = 1e-7
# Where the cost is flat, states and controls keep only half of the cost's digits.
FLAT = 1e-4


def cost(model, mesh=None, **options) -> float:
    return solve(model, mesh or Mesh(20, 3), solver=SolverOptions(**options)).objective


@pytest.mark.parametrize("mesh", [Mesh(20, 3), Mesh(20, 2, "gauss"), Mesh(30, 1), Mesh(20, 2, control="constant")])
def test_lagrange_is_mayer(mesh):
    assert cost(problems.VanDerPolMayer(), mesh) == pytest.approx(cost(problems.VanDerPol(), mesh), rel=SOLVER)


class FreeIntegral(problems.VanDerPolTime):
    """Time and energy, the time itself in the integrand, on a horizon that is free."""

    def objective(self):
        return self.final_time + gt.integral(self.time * self.u**2 / 10)


class FreeMayer(FreeIntegral):
    """The integral as a state."""

    cost = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield from super().equations()
        yield der(self.cost) == self.time * self.u**2 / 10

    def objective(self):
        return self.final_time + self.cost.at(self.final_time)


@pytest.mark.parametrize("mesh", [Mesh(20, 3), Mesh(15, 2, "gauss", control="linear", lengths=tuple(range(1, 16)))])
def test_lagrange_is_mayer_on_a_free_horizon(mesh):
    assert cost(FreeMayer(), mesh) == pytest.approx(cost(FreeIntegral(), mesh), rel=SOLVER)


class TestBounds:
    """u <= 0.75 in five ways: all of them act at the collocation points."""

    class Free(problems.VanDerPol):
        u = gt.input()

    class AsConstraint(Free):
        def constraints(self):
            yield self.u <= 0.75

    class AsRow(Free):
        def constraints(self):
            yield self.u**3 <= 0.75**3

    class Negated(Free):
        w = gt.variable(min=-0.75)

        def equations(self):
            yield from super().equations()
            yield self.w == -self.u

    class Eliminated(Free):
        w = gt.variable(max=1.5)

        def equations(self):
            yield from super().equations()
            yield self.w == 2 * self.u

    class Turned(Free):
        def constraints(self):
            yield -2 * self.u >= -1.5

    class Scaled(Free):
        limit = gt.parameter(0.75, positive=True)

        def constraints(self):
            yield 3 * self.u / self.limit <= 3

    @pytest.mark.parametrize("formulation", ["explicit", "inverse"])
    @pytest.mark.parametrize("cls", [AsConstraint, AsRow, Negated, Eliminated, Turned, Scaled])
    def test_optimum(self, cls, formulation):
        assert cost(cls(), formulation=formulation) == pytest.approx(cost(problems.VanDerPol()), rel=SOLVER)

    def test_the_bound_is_felt(self):
        assert cost(self.Free()) < cost(problems.VanDerPol()) - 1e-3

    def test_what_is_linear_in_one_variable_is_a_bound_of_it(self):
        for cls, rows in (
            (self.AsConstraint, 0), (self.Negated, 0), (self.Scaled, 0), (self.Turned, 0), (self.AsRow, 1),
            (self.Eliminated, 1),
        ):  # fmt: skip
            built = solve(cls(), Mesh(2, 1), throw=False, solver=SolverOptions(max_iterations=0)).problem
            assert len(built.path) == rows, cls.__name__
            if not rows:
                assert built.u_bounds.high == pytest.approx([0.75], abs=1e-15)


class TestStateBounds:
    class Bounded(problems.VanDerPol):
        x2 = gt.variable(start=1.0, fixed=True, min=-0.05)

    class Mirrored(problems.VanDerPol):
        """The state under a name with the other sign."""

        below = gt.variable(max=0.05)

        def equations(self):
            yield from super().equations()
            yield self.below == -self.x2

    @pytest.mark.parametrize("formulation", ["explicit", "inverse"])
    def test_a_bound_under_another_sign(self, formulation):
        a = solve(self.Bounded(), Mesh(20, 3), solver=SolverOptions(formulation=formulation))
        b = solve(self.Mirrored(), Mesh(20, 3), solver=SolverOptions(formulation=formulation))
        assert a.objective == pytest.approx(b.objective, rel=SOLVER)
        assert a.trajectory["x2"].min() == pytest.approx(-0.05, abs=1e-6)
        assert not b.problem.path

    @pytest.mark.parametrize("scheme", ["radau", "gauss"])
    def test_the_end_keeps_the_bounds(self, scheme):
        """With Gauss points the end is no collocation point, but it has its bound."""

        class Emptied(features.Tank):
            x = gt.variable(start=1.0, fixed=True, min=0.5, nominal=2.0)

            def objective(self):
                return self.x.at(self.final_time)

        assert cost(Emptied(), Mesh(5, 2, scheme)) == pytest.approx(0.5, abs=SOLVER)


class TestScaling:
    def test_nominals(self):
        guess = problems.stirred_tank_guess()
        optima = [
            solve(cls(), Mesh(20, 3), guess=guess).objective
            for cls in (problems.StirredTank, problems.StirredTankUnscaled)
        ]
        assert optima[0] == pytest.approx(optima[1], rel=SOLVER)

    @pytest.mark.parametrize("nominals", [(1e3, 1.0, 1.0), (1.0, 1e-3, 1.0), (1e-2, 1e2, 1e2)])
    def test_wrong_nominals_do_no_harm(self, nominals):
        x1, x2, u = ({"nominal": n} for n in nominals)
        # bounds are relaxed by 1e-8 of the nominal: one a hundred times too large loses two more digits
        tolerance = SOLVER * max(1.0, nominals[2])
        assert cost(problems.VanDerPol(x1=x1, x2=x2, u=u)) == pytest.approx(cost(problems.VanDerPol()), rel=tolerance)

    def test_a_nominal_is_read_under_every_name(self):
        """The state is der(x); its nominal and start stand with v, which equals it."""
        model = problems.DoubleIntegrator(x={"nominal": 3.0}, v={"nominal": 50.0, "start": 0.25})
        built = solve(model, Mesh(2, 1), throw=False, solver=SolverOptions(max_iterations=0)).problem
        assert built.state_names == ["x", "der(x)"]
        assert built.x_scale == pytest.approx([3.0, 50.0])
        assert built.start_bounds.low == pytest.approx([1.0, 0.25])


class TestTime:
    class HandScaled(problems.Oscillator, gt.Optimization):
        """Minimum time on [0, 1] with the final time as a factor of all rates."""

        u = gt.input(min=-1.0, max=1.0)
        T = gt.free(guess=2.0, min=0.2)

        def equations(self):
            yield der(self.x1) == self.T * ((1 - self.x2**2) * self.x1 - self.x2 + self.u)
            yield der(self.x2) == self.T * self.x1

        def objective(self):
            return self.T

        def constraints(self):
            yield self.x1.at(1.0) == 0
            yield self.x2.at(1.0) == 0

    class Shifted(problems.StateConstraint):
        start_time = 7.5
        final_time = 8.5

        def constraints(self):
            yield 8 * (self.time - 7.5 - 0.5) ** 2 - 0.5 - self.x2 >= 0

    def test_hand_scaled_time_is_free_time(self):
        assert cost(self.HandScaled()) == pytest.approx(cost(problems.VanDerPolTime()), rel=SOLVER)

    @pytest.mark.parametrize("mesh", [Mesh(20, 3), Mesh(15, 2, "gauss", lengths=tuple(range(1, 16)))])
    def test_shifted_start(self, mesh):
        a = solve(problems.StateConstraint(), mesh)
        b = solve(self.Shifted(), mesh)
        assert b.objective == pytest.approx(a.objective, rel=SOLVER)
        assert b.trajectory.time == pytest.approx(a.trajectory.time + 7.5, abs=1e-12)
        assert b.trajectory["x2"] == pytest.approx(a.trajectory["x2"], abs=FLAT)

    @pytest.mark.parametrize("formulation", ["explicit", "inverse"])
    def test_rates_and_time_at_an_instant(self, formulation):
        """An acceleration asked for at an instant is that of the trajectory; time at an instant is that instant."""

        class Pushed(features.TwoCarts):
            def constraints(self):
                yield from list(super().constraints())[:-2]
                yield der(self.q[0], 2).at(self.final_time) == -1.5
                yield (self.time * der(self.q[1], 2)).at(self.final_time) == 0.5

        run = solve(Pushed(), Mesh(10, 3), solver=SolverOptions(formulation=formulation)).trajectory
        assert run["der(q,2)"][-1, 0] == pytest.approx(-1.5, abs=1e-6)
        assert run["der(q,2)"][-1, 1] * run.time[-1] == pytest.approx(0.5, abs=1e-6)

    @pytest.mark.parametrize("at", [0.4, 1.0, 1.7])
    def test_time_at_an_inner_instant(self, at):
        class Clocked(features.Tank):
            start_time = 0.1

            def constraints(self):
                yield (self.x * self.rate * self.time).at(at) == 0.7 * at

        solution = solve(Clocked(), Mesh(10, 3))
        found = solution.sample(np.array([0.0, (at - 0.1) / 1.9, 1.0]))["x"][1]
        assert found == pytest.approx(0.7, abs=1e-7)

    def test_length_of_a_free_horizon_by_a_constraint_turned_round(self):
        class Turned(problems.DoubleIntegratorBoth):
            def constraints(self):
                yield from problems.DoubleIntegrator.constraints(self)
                yield 2 * self.start_time - 2 * self.final_time <= -0.2

        assert cost(Turned()) == pytest.approx(2.0, rel=1e-6)

    def test_a_parameter_as_final_time(self):
        class Parametric(problems.VanDerPol):
            final_time = gt.parameter(20.0, unit="s")

        assert cost(Parametric()) == pytest.approx(cost(problems.VanDerPol()), rel=SOLVER)
        assert cost(Parametric(final_time=1.0)) < 0.9 * cost(problems.VanDerPol())


class TestFormulation:
    @pytest.mark.parametrize("control", ["polynomial", "constant"])
    def test_explicit_is_inverse(self, control):
        model = features.TwoCarts()
        runs = [
            solve(model, Mesh(12, 3, control=control), solver=SolverOptions(formulation=f))
            for f in ("explicit", "inverse", "auto")
        ]
        assert [r.problem.formulation for r in runs] == ["explicit", "inverse", "inverse"]
        assert runs[1].objective == pytest.approx(runs[0].objective, rel=SOLVER)
        assert runs[2].objective == runs[1].objective
        for name in ("q", "f", "der(q)"):
            assert runs[1].trajectory[name] == pytest.approx(runs[0].trajectory[name], abs=FLAT * 4)

    def test_a_control_that_is_an_acceleration(self):
        """In the inverse form the control is an alias of the state's second derivative."""
        found = [cost(problems.LongWay(), Mesh(30, 3), formulation=f) for f in ("explicit", "inverse")]
        assert found[0] == pytest.approx(found[1], rel=SOLVER)
        assert found[0] == pytest.approx(30.0, rel=1e-6)

    def test_prefer_chooses_the_states(self):
        class Lever(gt.Optimization):
            """The tip is three times as high as the hand; either may be the state."""

            hand = gt.variable()
            tip = gt.variable()
            u = gt.input(min=-1.0, max=1.0)

            def equations(self):
                yield self.tip == 3 * self.hand + 0.1 * self.hand**3
                yield der(self.hand, 2) == self.u

            def objective(self):
                return (self.tip.at(1.0) - 0.7) ** 2 + 0.01 * gt.integral(self.u**2)

            def constraints(self):
                yield self.hand.at(0.0) == 0
                yield der(self.hand).at(0.0) == 0

        assert solve(Lever(), Mesh(4, 2), solver=SolverOptions(prefer=("hand",))).problem.state_names == [
            "hand", "der(hand)"
        ]  # fmt: skip


class TestEliminated:
    """The oscillator with its damping and its force as variables of their own, and with nothing eliminated."""

    class Named(problems.VanDerPolPath):
        damping = gt.variable()
        force = gt.variable()
        room = gt.variable(min=0.0)

        def equations(self):
            yield self.damping == 1 - self.x2**2
            yield self.force == self.damping * self.x1 - self.x2 + self.u
            yield der(self.x1) == self.force
            yield der(self.x2) == self.x1
            yield self.room == 0.1 + self.x1**2 * self.x2**2 - self.u**4

        def constraints(self):
            return iter(())

    @pytest.mark.parametrize("formulation, free", [("explicit", 0), ("dae", 2)])
    def test_optimum(self, formulation, free):
        """The path constraint is the bound of a variable: a row where it is eliminated, a bound where it is kept.

        Equal names are always eliminated: the force is the rate of x1.
        """
        s = solve(self.Named(), Mesh(20, 3), solver=SolverOptions(formulation=formulation))
        assert len(s.problem.z_pairs) == free and len(s.problem.path) == (0 if free else 1)
        assert s.objective == pytest.approx(cost(problems.VanDerPolPath()), rel=SOLVER)


class TestOrderOfDeclaration:
    class Turned(gt.Optimization):
        """Van der Pol with everything declared and written the other way round, under other names."""

        final_time = 20.0
        push = gt.input(max=0.75)
        b = gt.variable(start=1.0, fixed=True)
        a = gt.variable(start=0.0, fixed=True)

        def equations(self):
            yield self.a == der(self.b)
            yield self.push == der(self.a) - (1 - self.b**2) * self.a + self.b

        def objective(self):
            return gt.integral(self.push**2) + gt.integral(self.b**2) + gt.integral(self.a**2)

    class TurnedCarts(features.TwoCarts):
        def equations(self):
            yield from reversed(list(super().equations()))

        def constraints(self):
            yield from reversed(list(super().constraints()))

    def test_van_der_pol(self):
        a = solve(problems.VanDerPol(), Mesh(20, 3))
        b = solve(self.Turned(), Mesh(20, 3))
        assert b.objective == pytest.approx(a.objective, rel=SOLVER)
        assert b.trajectory["push"] == pytest.approx(a.trajectory["u"], abs=FLAT)

    def test_two_carts(self):
        assert cost(self.TurnedCarts()) == pytest.approx(cost(features.TwoCarts()), rel=SOLVER)


def test_guess_by_trajectory_by_solution_and_by_alias_reach_the_same_optimum():
    first = solve(problems.VanDerPolTime(), Mesh(20, 3))
    again = solve(problems.VanDerPolTime(), Mesh(20, 3), guess=first)
    other = solve(problems.VanDerPolTime(), Mesh(20, 3), guess=first.trajectory)
    alias = solve(problems.VanDerPolTime(), Mesh(20, 3), guess=first.trajectory.select(["x1", "u"]))
    assert [r.objective for r in (again, other, alias)] == pytest.approx([first.objective] * 3, rel=SOLVER)
    # a solution is a better start than none
    assert again.iterations < first.iterations and other.iterations < first.iterations


def test_sampling_gives_the_polynomials_back():
    """At the collocation points the sampled trajectory is the solution's own; between them states are smooth."""
    solution = solve(problems.VanDerPol(), Mesh(10, 3))
    s = solution.trajectory.time / 20.0
    again = solution.sample(s)
    for name in ("x1", "x2", "u"):
        assert again[name] == pytest.approx(solution.trajectory[name], abs=1e-12)
    fine = solution.sample(np.linspace(0.0, 1.0, 4001))
    slope = np.gradient(fine["x2"], fine.time)
    # x2' = x1 within elements to the collocation error, at the edges x1 may jump in slope
    assert np.median(np.abs(slope - fine["x1"])) < 1e-3
