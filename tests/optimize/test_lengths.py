"""Element lengths that the optimisation chooses, and meshes refined by their error."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.optimize import Mesh, refine, resimulate, solve
from gtmodel.optimize.judgement.refine import element_errors
from gtmodel.optimize.nlp import placed
from tests.optimize import features, problems

# IPOPT stops at 1e-8 of scaled conditions and relaxes bounds by as much: here the optimum is exact.
EXACT = 1e-7


class TestFreeLengths:
    @pytest.mark.parametrize("control", ["constant"])
    @pytest.mark.parametrize(
        "cls, time, guess, switches",
        [
            (problems.LongWay, 30.0, None, [20.0]),
            (problems.DoubleIntegratorBack, 4.0, problems.back_guess, [3.0]),
        ],
    )
    def test_the_switch_lies_on_an_edge(self, cls, time, guess, switches, control):
        mesh = Mesh(4, 3, control=control, length_ratio=(0.2, 2.5))
        s = solve(cls(), mesh, guess=guess() if guess else None)
        assert s.final_time == pytest.approx(time, rel=EXACT)
        found = placed(s.nlp, s.x)
        assert found.h.sum() == pytest.approx(1.0, abs=1e-12)
        assert np.all(found.h * 4 >= 0.2 - 1e-7) and np.all(found.h * 4 <= 2.5 + 1e-7)
        for at in switches:
            assert np.min(np.abs(found.edges * time - at)) < 1e-4
        # the pattern: one extreme value before, the other after, and nothing between
        t, u = s.trajectory.time[1:], s.trajectory["u"][1:]
        bounds = next(v for v in s.problem.flat.variables if v.name == "u")
        first, last = (bounds.max, bounds.min) if cls is problems.LongWay else (bounds.min, bounds.max)
        inside = np.abs(t - switches[0]) > 1e-3
        assert u[inside] == pytest.approx(np.where(t < switches[0], first, last)[inside], abs=1e-4)
        run = resimulate(s)
        assert run.defect < 1e-6 and run.violation < 1e-5

    def test_a_polynomial_bounded_at_its_points_profits_from_its_overshoot(self):
        """So choose another control: lengths that are free let it overshoot where that pays."""
        s = solve(problems.LongWay(), Mesh(4, 3, length_ratio=(0.2, 2.5)))
        assert s.final_time < 29.9 and resimulate(s).violation > 0.1

    def test_an_equal_mesh_misses_it(self):
        s = solve(problems.LongWay(), Mesh(4, 3, control="constant"))
        assert s.final_time > 30.0 * (1 + 1e-3)

    def test_a_value_within_the_horizon_is_refused(self):
        with pytest.raises(ModelError, match=r"uses a value at 0\.\d+ of the horizon, but with free element lengths"):
            solve(features.InteriorPoints(), Mesh(4, 2, length_ratio=(0.5, 2.0)))

    def test_warm_start_with_given_lengths(self):
        s = solve(problems.LongWay(), Mesh(4, 3, control="constant", length_ratio=(0.2, 2.5)))
        again = solve(problems.LongWay(), Mesh(4, 3, control="constant", lengths=placed(s.nlp, s.x).lengths), guess=s)
        assert again.final_time == pytest.approx(30.0, rel=1e-6)


class Layer(gt.Optimization):
    """x' = -(x - cos t) / 0.02: a layer of 0.02 s, then smooth; the solution is known."""

    rate = gt.parameter(1.0, unit="1/s")
    x = gt.variable(start=3.0, fixed=True)
    final_time = 2.0

    def equations(self):
        yield der(self.x) == -(self.x - gt.cos(self.rate * self.time)) / 0.02

    def objective(self):
        return gt.integral(self.x)


def exact(t):
    e = 0.02
    smooth = lambda t: (np.cos(t) + e * np.sin(t)) / (1 + e**2)  # noqa: E731
    return smooth(t) + (3.0 - smooth(0.0)) * np.exp(-t / e)


class TestRefine:
    @pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
    def test_until_below_the_tolerance(self, tolerance):
        r = refine(Layer(), Mesh(6, 3), tolerance=tolerance)
        assert r.reached and r.errors.max() <= tolerance
        error = np.max(np.abs(r.solution.trajectory["x"] - exact(r.solution.trajectory.time)))
        assert error < 3 * tolerance  # the layer forgets: no errors add up
        h = placed(r.solution.nlp, r.solution.x).h
        assert h[0] < 0.2 * h.max()  # fine where the layer is
        assert r.passes[0].elements == 6 and str(r).count("\n") == len(r.passes)

    def test_far_fewer_elements_than_equal_ones(self):
        r = refine(Layer(), Mesh(6, 3), tolerance=1e-5)
        equal = solve(Layer(), Mesh(r.passes[-1].elements, 3))
        assert element_errors(equal).max() > 100 * r.errors.max()

    def test_merges(self):
        r = refine(Layer(), Mesh(60, 3), tolerance=1e-3)
        assert sum(p.merged for p in r.passes) > 10 and r.passes[-1].elements < 60

    @pytest.mark.parametrize("points", [1, 2, 3])
    def test_order_of_the_estimate(self, points):
        """h^(points + 1) in each element of a smooth problem."""

        class Wave(Layer):
            x = gt.variable(start=0.7, fixed=True)

            def equations(self):
                yield der(self.x) == gt.cos(self.rate * self.time) - gt.sin(2 * self.x)

        a, b = (element_errors(solve(Wave(), Mesh(n, points))).max() for n in (16, 32))
        assert np.log2(a / b) == pytest.approx(points + 1, abs=0.35)

    def test_estimate_in_all_forms(self):
        model, errors = problems.ImplicitBlock(), []
        for form in ("torn", "dae"):
            s = solve(model, Mesh(10, 3), solver=gt.SolverOptions(formulation=form))
            errors.append(element_errors(s))
        assert errors[0] == pytest.approx(errors[1], rel=1e-3) and np.all(errors[0] > 0)

    def test_a_dae_that_leaves_its_range_between_the_points(self):
        """On four elements y5 is negative somewhere; there it is split, until its root is real."""
        r = refine(problems.ImplicitBlock(), Mesh(2, 2), tolerance=1e-3, solver=gt.SolverOptions(formulation="dae"))
        assert r.reached and np.all(np.isfinite(r.errors))

    def test_limits_and_wrong_calls(self):
        r = refine(Layer(), Mesh(3, 2), tolerance=1e-9, passes=2)
        assert not r.reached and len(r.passes) == 2 and r.passes[0].split > 0 and r.passes[1].split == 0
        assert not refine(Layer(), Mesh(3, 2), tolerance=1e-9, most_elements=10).reached
        with pytest.raises(ValueError, match=r"tolerance of refine\(\) must be positive; found 0"):
            refine(Layer(), tolerance=0.0)
        with pytest.raises(ValueError, match="remove blocks"):
            blocks = gt.Blocks(sizes=(1, 1))
            refine(problems.VanDerPol(), Mesh(2, 2, control="constant", blocks=blocks), tolerance=1.0)


@pytest.mark.parametrize("control", ["polynomial", "linear"])
def test_after_refinement_constraints_hold_between_the_nodes(control):
    r = refine(problems.StateConstraint(), Mesh(10, 3, control=control), tolerance=1e-6)
    run = resimulate(r.solution)
    t, x2 = run.trajectory.time, run.trajectory["x2"]
    reach = np.ptp(8 * (t - 0.5) ** 2 - 0.5 - x2)
    assert "constraint 1" in run.violated
    assert run.violation <= 1e-4 * reach
    if control == "linear":
        low, high = run.control_range["u"]
        assert -20 - 1e-9 <= low <= high <= 20 + 1e-9
