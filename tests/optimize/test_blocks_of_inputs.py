"""Blocks of each input, and cost and limits of free element lengths, against optima by other roads."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import gtmodel as gt
from gtmodel import Blocks, LengthCost, Mesh, ModelError, Phases, SolverOptions, der, resimulate, solve, solve_phases
from gtmodel.optimize.nlp import mesh_cost, placed

# IPOPT stops at 1e-8 of scaled conditions; the quadratic programmes are exact.
SOLVER = 1e-7
ELEMENTS, HORIZON = 6, 2.0
U, V, W = (1, 2, 3), (2, 2, 2), "linear"


class ThreeInputs(gt.Optimization):
    """x' = u + v + w - 1 from 1: costs of x and of each input."""

    x = gt.variable(start=1.0, fixed=True)
    u = gt.input()
    v = gt.input()
    w = gt.input()
    final_time = HORIZON

    def equations(self):
        yield der(self.x) == self.u + self.v + self.w - 1.0

    def objective(self):
        return gt.integral(self.x**2 + self.u**2 + 2 * self.v**2 + 3 * (self.w - 0.3 * self.time) ** 2)


def by_hand(step_max=np.inf, penalty=0.0):
    """The optimum (cost, values) over u on blocks U, v on blocks V and w linear, by exact quadrature of the parabolas.

    Unknowns: 3 values of u, 3 of v, 7 of w at the edges. x and the inputs are affine in them.
    """
    h, n = HORIZON / ELEMENTS, len(U) + len(V) + ELEMENTS + 1
    s, weight = np.polynomial.legendre.leggauss(5)
    s, weight = (s + 1) / 2, weight / 2 * h

    def paths(z):
        u, v, w = np.repeat(z[:3], U), np.repeat(z[3:6], V), z[6:]
        x, costs = 1.0, []
        for k in range(ELEMENTS):
            slope = w[k + 1] - w[k]
            inside = x + h * ((u[k] + v[k] + w[k] - 1) * s + slope * s**2 / 2)
            target = 0.3 * h * (k + s)
            terms = [inside, np.full(5, u[k]), np.sqrt(2) * v[k] + 0 * s, np.sqrt(3) * (w[k] + slope * s - target)]
            costs.append(np.array(terms) * np.sqrt(weight))
            x += h * (u[k] + v[k] + (w[k] + w[k + 1]) / 2 - 1)
        return np.concatenate([np.ravel(costs), np.sqrt(penalty) * np.diff(z[:3])])

    b = paths(np.zeros(n))
    A = np.column_stack([paths(e) - b for e in np.eye(n)])
    held = [] if not np.isfinite(step_max) else [
        {"type": "ineq", "fun": lambda z: np.concatenate([step_max - np.diff(z[:3]), step_max + np.diff(z[:3])])}
    ]  # fmt: skip
    z = np.linalg.lstsq(A, -b, rcond=None)[0]
    if held:
        cost = lambda z: np.sum((A @ z + b) ** 2)  # noqa: E731
        z = minimize(cost, z, jac=lambda z: 2 * A.T @ (A @ z + b), constraints=held, method="SLSQP",
                     options={"ftol": 1e-15, "maxiter": 500}).x  # fmt: skip
    return float(np.sum((A @ z + b) ** 2)), z


class TestBlocksOfEachInput:
    @pytest.mark.parametrize("step_max, penalty", [(np.inf, 0.0), (0.05, 0.0), (np.inf, 0.4), (0.05, 0.1)])
    def test_two_blocked_and_one_linear(self, step_max, penalty):
        limits = {} if step_max == np.inf else {"u": step_max}
        blocks = Blocks(sizes={"u": U, "v": 2}, step_max=limits, step_penalty={"u": penalty} if penalty else {})
        s = solve(ThreeInputs(), Mesh(ELEMENTS, 3, control="linear", blocks=blocks))
        cost, z = by_hand(step_max, penalty)
        assert s.objective == pytest.approx(cost, rel=SOLVER)
        u, v, w = (s.trajectory[n][1:].reshape(ELEMENTS, 3) for n in "uvw")
        assert u == pytest.approx(np.tile(np.repeat(z[:3], U)[:, None], 3), abs=1e-4)
        assert v == pytest.approx(np.tile(np.repeat(z[3:6], V)[:, None], 3), abs=1e-4)
        assert w[:, -1] == pytest.approx(z[7:], abs=1e-4)
        assert mesh_cost(s.nlp, s.x) == pytest.approx(penalty * np.sum(np.diff(z[:3]) ** 2), abs=1e-6)
        run = resimulate(s)
        assert run.defect < 1e-7 and run.cost_error == pytest.approx(0.0, abs=SOLVER)

    @pytest.mark.parametrize("control", ["polynomial", pytest.param("bernstein", marks=pytest.mark.proof), "constant"])
    def test_blocks_are_constant_beside_any_control(self, control):
        mesh = Mesh(ELEMENTS, 3, control=control, blocks={"u": U, "v": list(V)})
        s = solve(ThreeInputs(), mesh)
        u = s.trajectory["u"][1:].reshape(ELEMENTS, 3)
        assert np.ptp(u, axis=1) == pytest.approx(0.0, abs=1e-12)
        assert len(np.unique(np.round(u, 9))) == len(U)
        assert resimulate(s).defect < 1e-6
        shot = solve(ThreeInputs(), mesh, method="shooting")
        assert shot.objective == pytest.approx(s.objective, rel=1e-6)
        assert s.bound_multiplier("u").shape == (ELEMENTS, 1)

    def test_sizes_for_all_and_by_name_agree(self):
        every = solve(ThreeInputs(), Mesh(ELEMENTS, control="constant", blocks=Blocks(sizes=U)))
        named = solve(ThreeInputs(), Mesh(ELEMENTS, control="constant", blocks={"u": U, "v": U, "w": U}))
        assert np.array_equal(every.x, named.x)

    def test_name_of_a_vector_and_a_rest(self):
        class Vector(gt.Optimization):
            x = gt.variable(2, start=[1.0, -1.0], fixed=True)
            u = gt.input(2)
            final_time = 1.0

            def equations(self):
                yield der(self.x) == self.u

            def objective(self):
                return gt.integral(gt.dot(self.x, self.x) + gt.dot(self.u, self.u))

        s = solve(Vector(), Mesh(5, 2, control="linear", blocks={"u": 2}))
        u = s.trajectory["u"][1:].reshape(5, 2, 2)
        assert np.ptp(u[:2], axis=(0, 1)) == pytest.approx(0.0, abs=1e-8)
        assert u[4, 0] != pytest.approx(u[3, 0], abs=1e-4)  # the rest is a block of its own

    @pytest.mark.parametrize(
        "blocks, sentence",
        [
            ({"q": 2}, "unknown control 'q'; controls of ThreeInputs are u, v, w"),
            (Blocks(sizes={"u": 2}, step_max={"w": 1.0}), "steps of 'w', which has no blocks"),
            (Blocks(sizes={"u": 2}, step_penalty={"q": 1.0}), "unknown control 'q' in step_penalty"),
        ],
    )
    def test_wrong_names(self, blocks, sentence):
        with pytest.raises(ModelError, match=sentence):
            solve(ThreeInputs(), Mesh(ELEMENTS, control="linear", blocks=blocks))

    @pytest.mark.parametrize(
        "arguments, sentence",
        [
            (dict(blocks={"u": (1, 2)}), "block sizes of 'u' sum to 3, but the mesh has 6 elements"),
            (dict(blocks={"u": (6, 0)}), r"each block size of 'u' must be a positive integer; found \(6, 0\)"),
            (dict(blocks={}), "blocks need the sizes of at least one control"),
            (dict(blocks=2), "blocks need control 'constant'; found 'polynomial'"),
            (dict(length_limits=(0.1, 1.0)), "length_limits needs free element lengths; give length_ratio"),
            (dict(length_ratio=(0.5, 2.0), length_limits=(1.0, 0.1)), "length_limits must be .*found"),
            (dict(length_cost=LengthCost(uneven=1.0)), "length_cost needs free element lengths"),
        ],
    )
    def test_wrong_meshes(self, arguments, sentence):
        with pytest.raises(ValueError, match=sentence):
            Mesh(ELEMENTS, **arguments)


PHASES = 20


class Decay(gt.Optimization):
    """x' = -3 x + u from 1 in 2 s."""

    rate = gt.parameter(3.0, unit="1/s")
    x = gt.variable(start=1.0, fixed=True)
    u = gt.input(min=-0.2, max=0.2)
    final_time = 2.0

    def equations(self):
        yield der(self.x) == -self.rate * self.x + self.u

    def objective(self):
        return gt.integral((self.x - 0.2) ** 2 + 0.1 * self.u**2)


class Piece(gt.Optimization):
    """One element of `Decay` as a phase of its own; its cost of length is written out by hand."""

    rate = gt.parameter(3.0, unit="1/s")
    uneven, rates, power = gt.parameter(0.0), gt.parameter(0.0), gt.parameter(1.0)
    horizon = gt.parameter(2.0, unit="s")
    shortest, longest = gt.parameter(0.0, unit="s"), gt.parameter(1.0, unit="s")
    x = gt.variable()
    squares = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-0.2, max=0.2)
    start_time = gt.free(0.0, unit="s")
    final_time = gt.free(1.0, unit="s")

    def equations(self):
        yield der(self.x) == -self.rate * self.x + self.u
        yield der(self.squares) == (-self.rate * self.x + self.u) ** 2

    def objective(self):
        h = (self.final_time - self.start_time) / self.horizon
        lengths = self.uneven * (h * PHASES - 1) ** 2
        lengths += self.rates * h * gt.exp(self.power * gt.log(h)) * self.squares.at(self.final_time)
        return gt.integral((self.x - 0.2) ** 2 + 0.1 * self.u**2) + lengths

    def constraints(self):
        yield gt.between(self.shortest, self.final_time - self.start_time, self.longest)


class First(Piece):
    x = gt.variable(start=1.0, fixed=True)
    start_time = 0.0


class Last(Piece):
    final_time = 2.0


def linked(**parameters):
    """The same problem as 20 linked phases of one element each."""
    names = [f"p{k}" for k in range(PHASES)]
    kinds = [First, *[Piece] * (PHASES - 2), Last]
    phases = Phases(
        {n: kind(**parameters) for n, kind in zip(names, kinds, strict=True)},
        free={n: ["squares"] for n in names[1:]},
    )
    edges = np.linspace(0, 2, PHASES + 1)
    guess = {
        n: gt.Trajectory(edges[k : k + 2], {"x": np.exp(-edges[k : k + 2]), "squares": np.zeros(2), "u": np.zeros(2)})
        for k, n in enumerate(names)
    }
    found = solve_phases(phases, Mesh(1, 3, control="constant"), guess=guess, solver=EXACTLY)
    lengths = np.array([found[n].trajectory.duration for n in names])
    return found.objective, lengths, np.array([found[n].trajectory["u"][-1] for n in names])


EXACTLY = SolverOptions(tolerance=1e-10, error_bound=None)


class TestElementLengths:
    @pytest.mark.parametrize(
        "cost, limits",
        [
            pytest.param(LengthCost(uneven=1e-4), None, marks=pytest.mark.proof),
            pytest.param(LengthCost(uneven=1e-4, rates={"x": 0.3}, power=1.0), None, marks=pytest.mark.proof),
            (LengthCost(uneven=1e-4, rates={"x": 0.1}, power=0.5), (0.06, 0.115)),
        ],
        ids=["uneven", "rates", "limits"],
    )
    def test_twenty_linked_phases_give_the_same(self, cost, limits):
        ratio = (0.3, 3.0)
        mesh = Mesh(PHASES, 3, control="constant", length_ratio=ratio, length_cost=cost, length_limits=limits)
        s = solve(Decay(), mesh, solver=EXACTLY)
        low, high = (0.3 * 2 / PHASES, 3 * 2 / PHASES) if limits is None else limits
        weights = {"uneven": cost.uneven, "rates": cost.rates.get("x", 0.0), "power": cost.power}
        objective, lengths, u = linked(**weights, shortest=low, longest=high)
        found = placed(s.nlp, s.x).h * 2.0
        assert s.objective == pytest.approx(objective, rel=SOLVER)
        assert found == pytest.approx(lengths, abs=1e-5)
        assert s.trajectory["u"][3::3] == pytest.approx(u, abs=1e-4)
        assert np.ptp(found) > 0.01  # the lengths differ
        if limits is not None:
            assert found.min() >= 0.06 - 1e-8 and found.max() <= 0.115 + 1e-8
            assert found.min() == pytest.approx(0.06, abs=1e-6) and found.max() == pytest.approx(0.115, abs=1e-6)
            assert s.multiplier("element duration").shape == (PHASES,)
        assert mesh_cost(s.nlp, s.x) > 0
        assert resimulate(s).cost_error == pytest.approx(0.0, abs=1e-6)

    def test_a_limit_in_seconds_under_a_free_horizon(self):
        """The fastest move of 1 m with |a| <= 1: 2 s with the switch at 1 s, in four elements of at least 0.3 s."""

        class Fastest(gt.Optimization):
            final_time = gt.free(3.0, min=0.1, unit="s")
            x = gt.variable(unit="m", start=0.0, fixed=True)
            v = gt.variable(unit="m/s", start=0.0, fixed=True)
            a = gt.input(unit="m/s2", min=-1.0, max=1.0)

            def equations(self):
                yield der(self.x) == self.v
                yield der(self.v) == self.a

            def objective(self):
                return self.final_time

            def constraints(self):
                yield self.x.at(self.final_time) == 1.0
                yield self.v.at(self.final_time) == 0.0

        mesh = Mesh(3, 3, control="constant", length_ratio=(0.1, 3.0))
        assert solve(Fastest(), mesh).final_time == pytest.approx(2.0, rel=1e-6)
        # the longest element of 0.8 s: rest, then 0.8 s up, a middle of at most 0.8 s, and down
        limited = Mesh(3, 3, control="constant", length_ratio=(0.1, 3.0), length_limits=(0.0, 0.8))
        s = solve(Fastest(), limited)
        found = placed(s.nlp, s.x).h * s.final_time
        # by hand: 0.8 s at 1, t at a, 0.8 s at -1 with v = 0 at the end needs a = 0: 0.8 (0.8 + t) = 1
        assert s.final_time == pytest.approx(2 * 0.8 + 1 / 0.8 - 0.8, rel=1e-6)
        assert found == pytest.approx([0.8, 1 / 0.8 - 0.8, 0.8], abs=1e-5)

    @pytest.mark.parametrize("scheme, points", [("radau", 1), ("gauss", 2)])
    def test_derivatives(self, scheme, points):
        """Gradient and Hessian of the programme against finite differences."""
        cost = LengthCost(uneven=0.2, rates={"x": 0.3}, power=0.5)
        mesh = Mesh(3, points, scheme, "linear", length_ratio=(0.5, 2.0), length_cost=cost, length_limits=(0.1, 1.5))
        s = solve(Decay(), mesh, solver=EXACTLY)
        nlp, rng = s.nlp, np.random.default_rng(3)
        x, step = s.x + 0.01 * rng.standard_normal(len(s.x)), 1e-6
        lam = rng.standard_normal(len(nlp.lbg))

        def slope(x):
            f = np.asarray(nlp.functions["grad_f"](x, [])[1]).ravel()
            return f, f + np.asarray(nlp.functions["jac_g"](x, [])[1]).T @ lam

        direct = [(nlp.nlp(x + step * e, []), nlp.nlp(x - step * e, [])) for e in np.eye(len(x))]
        assert slope(x)[0] == pytest.approx([float(a[0] - b[0]) / (2 * step) for a, b in direct], abs=1e-7)
        jacobian = np.column_stack([np.asarray(a[1] - b[1]).ravel() / (2 * step) for a, b in direct])
        assert np.asarray(nlp.functions["jac_g"](x, [])[1]) == pytest.approx(jacobian, abs=1e-7)
        upper = np.asarray(nlp.functions["hess_lag"](x, [], 1.0, lam))
        hessian = upper + np.triu(upper, 1).T
        by_steps = [(slope(x + step * e)[1] - slope(x - step * e)[1]) / (2 * step) for e in np.eye(len(x))]
        assert hessian == pytest.approx(np.array(by_steps), abs=1e-5)

    @pytest.mark.parametrize(
        "arguments, sentence",
        [
            ({}, "a length cost needs a positive weight"),
            ({"uneven": -1.0}, "uneven of a length cost must be finite and not negative; found -1"),
            ({"rates": {"x": np.inf}}, "rates of 'x' of a length cost must be finite"),
        ],
    )
    def test_wrong_costs(self, arguments, sentence):
        with pytest.raises(ValueError, match=sentence):
            LengthCost(**arguments)

    def test_unknown_state(self):
        mesh = Mesh(3, length_ratio=(0.5, 2.0), length_cost=LengthCost(rates={"y": 1.0}))
        with pytest.raises(ModelError, match="length_cost names 'y', which is not a state; states are x"):
            solve(Decay(), mesh)
