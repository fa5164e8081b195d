"""Control parametrisations, blocks, delays: against closed forms and against programs written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.optimize import Blocks, Mesh, SolverOptions, resimulate, solve
from gtmodel.optimize.formulation.problem import build
from gtmodel.optimize.nlp import make_nlp
from tests.optimize import features, problems
from tests.optimize.test_derivatives import point_near_guess, wrong
from tests.optimize.test_order import Regulator

SOLVER = 1e-6  # two roads to one discrete optimum
TIGHT = SolverOptions(tolerance=1e-11)


class Delayed(gt.Optimization):
    """x' = u(t - 0.5), int x^2 + u^2 over 2 s; before the start u was 0.4."""

    x = gt.variable(start=1.0, fixed=True, nominal=2.0)
    u = gt.input(nominal=0.5)
    late = gt.delayed(u, 0.5, history=lambda t: 0.4)
    final_time = 2.0

    def equations(self):
        yield der(self.x) == self.late

    def objective(self):
        return gt.integral(self.x**2 + self.u**2)


MESHES = {
    "linear": Mesh(4, 3, control="linear"),
    "linear, unequal, Gauss": Mesh(3, 2, "gauss", "linear", (1.0, 2.0, 0.5)),
    "bernstein": Mesh(3, 3, control="bernstein"),
    "blocks": Mesh(5, 2, control="constant", blocks=Blocks(sizes=(2, 3), step_penalty={"u": 0.3})),
    "free lengths": Mesh(3, 2, length_ratio=(0.5, 2.0)),
    "free lengths, linear": Mesh(3, 2, control="linear", length_ratio=(0.5, 2.0)),
    "free lengths, Gauss, constant": Mesh(3, 2, "gauss", "constant", length_ratio=(0.5, 2.0)),
}


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("cls", [features.Mayer, features.FreeTimes, problems.ImplicitBlock])
def test_derivatives(cls, mesh):
    nlp = make_nlp(build(cls()), MESHES[mesh])
    assert wrong(nlp, point_near_guess(nlp, spread=0.02)) == {}


def test_derivatives_with_a_delay():
    for mesh in (Mesh(4, 2), Mesh(4, 3, control="linear"), Mesh(8, 2, control="constant")):
        nlp = make_nlp(build(Delayed()), mesh)
        assert wrong(nlp, point_near_guess(nlp)) == {}


class TestLinear:
    def test_it_is_continuous_and_keeps_its_bounds(self):
        s = solve(problems.LongWay(), Mesh(30, 3, control="linear"))
        run = resimulate(s)
        assert run.violation == 0.0
        u, t = run.trajectory["u"][:: 8 // 2], run.trajectory.time
        # halves of an element: the middle is the mean of its ends
        assert u[1::2] == pytest.approx((u[:-1:2] + u[2::2]) / 2, abs=1e-9)
        assert t[-1] > 30.0 and s.final_time == pytest.approx(30.0, rel=1e-2)

    def test_order(self):
        """The best continuous polygon misses tanh(2), the optimum, by O(h^4): the cost is flat there."""
        miss = [solve(Regulator(), Mesh(n, 3, control="linear"), solver=TIGHT).objective - np.tanh(2.0) for n in (4, 8)]
        assert miss[1] > 0 and np.log2(miss[0] / miss[1]) == pytest.approx(4.0, abs=0.3)


class TestBernstein:
    def test_the_same_polynomials(self):
        for cls, mesh in ((Regulator, {}), (problems.VanDerPolPath, {})):
            a, b = (solve(cls(), Mesh(20, 3, control=c, **mesh)) for c in ("polynomial", "bernstein"))
            assert a.objective == pytest.approx(b.objective, rel=SOLVER)

    def test_bounds_hold_at_every_instant(self):
        for points in (2, 3, 4):
            a, b = (solve(problems.VanDerPol(), Mesh(12, points, control=c)) for c in ("polynomial", "bernstein"))
            assert resimulate(a).control_range["u"][1] > 0.751
            assert resimulate(b).control_range["u"][1] <= 0.75 + 1e-9
            assert b.objective > a.objective  # fewer polynomials


class TestBlocks:
    SIZES = (1, 2, 3)

    def by_hand(self, step_max=np.inf, weight=0.0):
        """x' = u constant on blocks of [0, 2]: x is a polygon, whose square is integrated exactly."""
        h = 2.0 * np.array(self.SIZES) / 6

        def cost(u):
            x = 1 + np.concatenate([[0.0], np.cumsum(h * u)])
            square = np.sum(h * (x[:-1] ** 2 + x[:-1] * x[1:] + x[1:] ** 2) / 3)
            return square + np.sum(h * u**2) + weight * np.sum(np.diff(u) ** 2)

        steps = {"type": "ineq", "fun": lambda u: np.concatenate([step_max - np.diff(u), step_max + np.diff(u)])}
        held = [steps] if np.isfinite(step_max) else []
        return minimize(cost, -0.5 * np.ones(3), constraints=held, method="SLSQP", options={"ftol": 1e-14})

    @pytest.mark.parametrize("step_max, weight", [(None, 0.0), (0.1, 0.0), (None, 0.4), (0.2, 0.1)])
    def test_by_hand(self, step_max, weight):
        blocks = Blocks(
            sizes=self.SIZES,
            step_max={} if step_max is None else {"u": step_max},
            step_penalty={"u": weight} if weight else {},
        )
        s = solve(Regulator(), Mesh(6, 3, control="constant", blocks=blocks))
        hand = self.by_hand(np.inf if step_max is None else step_max, weight)
        assert s.objective == pytest.approx(hand.fun, rel=SOLVER)
        u = s.trajectory["u"][1:].reshape(6, 3)
        for values, expected in zip(np.split(u, np.cumsum(self.SIZES)[:-1]), hand.x, strict=True):
            assert values == pytest.approx(np.full_like(values, expected), abs=1e-4)
        assert resimulate(s).cost_error == pytest.approx(0.0, abs=SOLVER)

    def test_arguments_cannot_be_swapped(self):
        with pytest.raises(TypeError, match="positional"):
            Blocks((1, 2), {"u": 1.0}, {"u": 0.1})  # type: ignore[misc]

    @pytest.mark.parametrize(
        "arguments, sentence",
        [
            (dict(sizes=(1, 0)), r"each block size must be a positive integer; found \(1, 0\)"),
            (dict(sizes=(1.5, 0.5)), "each block size must be a positive integer"),
            (dict(sizes=(1,), step_max={"u": 0.0}), "step_max of 'u' must be positive; found 0"),
            (dict(sizes=(1,), step_penalty={"u": -1.0}), "step_penalty of 'u' must not be negative; found -1"),
        ],
    )
    def test_wrong_blocks(self, arguments, sentence):
        with pytest.raises(ValueError, match=sentence):
            Blocks(**arguments)

    def test_unknown_control(self):
        mesh = Mesh(2, 2, control="constant", blocks=Blocks(sizes=(1, 1), step_max={"v": 1.0}))
        with pytest.raises(ModelError, match="unknown control 'v' in step_max; controls of Regulator are u"):
            solve(Regulator(), mesh)


class TestDelay:
    @pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
    def test_closed_form(self, control):
        """x = 1 + 0.4 t for 0.5 s; from x(0.5) = 1.2 on it is the regulator with 1.5 s to go, half a second early."""
        s = solve(Delayed(), Mesh(40, 3, control=control))
        before = ((1.2**3 - 1) / 3) / 0.4
        slack = {"polynomial": 1e-6, "linear": 1e-5, "constant": 1e-3}[control]
        assert s.objective == pytest.approx(before + 1.2**2 * np.tanh(1.5), rel=slack)
        t, u, late = s.trajectory.time, s.trajectory["u"], s.trajectory["late"]
        assert late[1:31] == pytest.approx(np.full(30, 0.4), abs=1e-8)
        assert late[31:] == pytest.approx(u[1:-30], abs=1e-7)
        if control == "polynomial":
            early = 1.2 * -np.sinh(1.5 - t[1:91]) / np.cosh(1.5)
            assert u[1:91] == pytest.approx(early, abs=1e-4)
            assert resimulate(s).defect < 1e-6

    def test_wrong_delays(self):
        cases = {
            r"the delay of 0.5 s is not a whole number of elements": (Delayed(), Mesh(5, 2)),
            "needs a fixed horizon and fixed element lengths": (Delayed(), Mesh(4, 2, length_ratio=(0.5, 2.0))),
            "fixed horizon": (type("F", (Delayed,), {"final_time": gt.free(2.0, min=1.0)})(), Mesh(4, 2)),
        }
        for sentence, (model, mesh) in cases.items():
            with pytest.raises(ModelError, match=sentence):
                solve(model, mesh)
        for source, tau in ((gt.variable(), 0.1), (gt.input(2), 0.1), (3.0, 0.1), (gt.input(), 0.0)):
            with pytest.raises(ModelError, match=r"gt.delayed takes a scalar gt.input|a delay must be positive"):
                gt.delayed(source, tau, history=0.0)


class Late(gt.Model):
    u = gt.input(min=-1, max=1)
    late = gt.delayed(u, 1.0, history=0.5)
    x = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.der(self.x) == self.late


class WithPart(gt.Optimization):
    p = gt.part(Late)
    final_time = 2.0

    def objective(self):
        return (self.p.x.at(2.0) - 5) ** 2


class TestDelayInPlace:
    def test_of_a_part(self):
        """Half a second's worth of history, then the bound of the part's own input."""
        s = solve(WithPart(), Mesh(4))
        assert s.problem.control_names == ["p.u"]
        assert s.trajectory["p.x"][-1] == pytest.approx(1.5, abs=1e-6)

    @pytest.mark.parametrize("control", ["polynomial", "linear", "bernstein", "constant"])
    def test_an_element_that_reads_two(self, control):
        class Two(gt.Optimization):
            u = gt.input()
            late = gt.delayed(u, 2.0, history=0.0)
            x = gt.variable(start=0.0, fixed=True)
            final_time = 4.0

            def equations(self):
                yield gt.der(self.x) == self.late

            def objective(self):
                return gt.integral((self.u - self.time) ** 2)

        with pytest.raises(ModelError, match="element 3 takes the delayed input from two elements, which meet at 1 s"):
            solve(Two(), Mesh(3, 3, control=control, lengths=(1, 1, 2)))
        if control != "constant":
            s = solve(Two(), Mesh(4, 3, control=control))
            assert s.trajectory["x"][-1] == pytest.approx(2.0, abs=1e-8)

    @pytest.mark.parametrize("history", ["abc", lambda t: float("nan"), None])
    def test_a_history_that_is_no_number(self, history):
        class Wrong(gt.Optimization):
            u = gt.input()
            late = gt.delayed(u, 0.5, history=history)
            x = gt.variable(start=0.0, fixed=True)

            def equations(self):
                yield gt.der(self.x) == self.late

            def objective(self):
                return gt.integral(self.u**2)

        with pytest.raises(ModelError, match="the history of 'late' must be a finite number at -0"):
            solve(Wrong(), Mesh(4))
