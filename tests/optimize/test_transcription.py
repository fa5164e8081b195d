"""Solving a transcribed problem again: parameters, sensitivities, warm starts, continuation, many starts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.optimize import Mesh, NotSolved, SolverOptions, multi_start, solve, transcribe
from gtmodel.results import ArgumentError
from tests.optimize import features, problems

SOLVER = 1e-6  # two roads to one discrete optimum


class Weighted(features.Tank):
    """Parameters in the rate, in the cost, in a bound along the path, in a point constraint and as a vector."""

    limit = gt.parameter(0.8)
    weight = gt.parameter(0.1, positive=True)
    end = gt.parameter(0.1)
    w = gt.parameter([1.0, 0.5])

    def equations(self):
        yield der(self.x) == -self.rate * self.x**3 + gt.cos(self.x) * self.u

    def objective(self):
        return gt.integral(self.w[0] * self.x**2 + self.w[1] * self.weight * self.u**2)

    def constraints(self):
        yield self.u <= self.limit
        yield self.x.at(self.final_time) == self.end


CHANGES = [
    {"rate": 1.3},
    {"limit": 0.3},
    {"weight": 0.3, "end": 0.4},
    {"w": [0.7, 2.0]},
]


@pytest.fixture(scope="module")
def tank():
    return transcribe(Weighted(), Mesh(10, 3))


@pytest.mark.parametrize("change", CHANGES)
def test_other_parameters_are_another_model(tank, change):
    again = tank.solve(change)
    fresh = solve(Weighted(**change), Mesh(10, 3))
    assert again.objective == pytest.approx(fresh.objective, rel=SOLVER)
    assert again.trajectory["x"] == pytest.approx(fresh.trajectory["x"], abs=1e-6)
    # nothing stays behind
    assert tank.solve().objective == pytest.approx(solve(Weighted(), Mesh(10, 3)).objective, rel=SOLVER)
    for name, value in change.items():
        shown = [again.parameters[n] for n in again.parameters if n.partition("[")[0] == name]
        assert shown == pytest.approx(np.atleast_1d(value))


def test_sensitivities_are_differences(tank):
    tight = SolverOptions(tolerance=1e-11)
    base = tank.solve(solver=tight)
    for name, size in (("rate", 1.0), ("limit", 0.8), ("weight", 0.1), ("end", 0.1)):
        e = 1e-4 * size
        high, low = (tank.solve({name: size + d}, solver=tight).objective for d in (e, -e))
        assert base.sensitivity[name] == pytest.approx((high - low) / (2 * e), rel=1e-4, abs=1e-7)


def test_warm_start_needs_fewer_iterations():
    cold_counts, warm_counts = [], []
    brachistochrone = transcribe(problems.Brachistochrone(), Mesh(20, 3))
    first = brachistochrone.solve(guess=problems.brachistochrone_guess())
    tank = transcribe(problems.StirredTank(), Mesh(20, 3), parameters=["U"])
    second = tank.solve(guess=problems.stirred_tank_guess())
    for t, start, change, guess in (
        (brachistochrone, first, {"g": 9.9}, problems.brachistochrone_guess()),
        (tank, second, {"U": 920.0}, problems.stirred_tank_guess()),
    ):
        cold, warm = t.solve(change, guess=guess), t.solve(change, start=start)
        assert warm.objective == pytest.approx(cold.objective, rel=SOLVER)
        cold_counts.append(cold.iterations)
        warm_counts.append(warm.iterations)
    assert sum(warm_counts) < 0.6 * sum(cold_counts)
    # the same problem again
    assert brachistochrone.solve(start=first).iterations <= 4


def test_start_from_another_mesh_takes_its_trajectory(tank):
    other = solve(Weighted(), Mesh(5, 2))
    assert tank.solve(start=other).objective == pytest.approx(tank.solve().objective, rel=SOLVER)


class TestRefused:
    def test_an_attribute_that_follows_a_parameter(self):
        class Rim(features.Tank):
            top = gt.parameter(1.5)
            inner = gt.part(Brim, y={"max": top})

            def equations(self):
                yield from super().equations()
                yield self.inner.y == self.x

        t = transcribe(Rim(), Mesh(4, 2))
        with pytest.raises(ModelError, match=r"max of 'inner.y' depends on top, but transcribe"):
            t.solve({"top": 1.7})

    def test_names_and_values(self, tank):
        with pytest.raises(ModelError, match="transcribed with parameters rate, limit, weight, end, w; found 'mass'"):
            tank.solve({"mass": 1.0})
        with pytest.raises(ModelError, match="'weight' is declared positive; found -1"):
            tank.solve({"weight": -1.0})
        with pytest.raises(ModelError, match="declares no parameter 'mass'; it declares rate, limit"):
            transcribe(Weighted(), parameters=["mass"])
        with pytest.raises(ModelError, match="transcribed with parameters rate; found 'limit'"):
            transcribe(Weighted(), Mesh(2, 2), parameters=["rate"]).solve({"limit": 1.0})
        with pytest.raises(ValueError, match="a guess or a start, not both"):
            s = tank.solve()
            tank.solve(guess=s, start=s)


class Brim(gt.Model):
    y = gt.variable(max=0.5)


class TestContinuation:
    def test_steps_and_table(self, tank):
        c = tank.continuation([{"rate": 0.5}, {"rate": 1.0, "limit": 0.5}, {"rate": 2.0}])
        assert [v["rate"] for v, _ in c.steps] == [0.5, 1.0, 2.0]
        fresh = solve(Weighted(rate=2.0, limit=0.5), Mesh(10, 3))  # what is not named again stays
        assert c.solution.objective == pytest.approx(fresh.objective, rel=SOLVER)
        assert str(c).count("\n") == 3 and "rate = 0.5" in str(c)
        assert c.iterations == sum(s.iterations for _, s in c.steps)

    def test_steps_are_halved(self):
        """Far from its start IPOPT needs more iterations than it is given; half of the way it does not."""
        t = transcribe(problems.Brachistochrone(), Mesh(10, 3))
        first = t.solve(guess=problems.brachistochrone_guess())
        few = SolverOptions(max_iterations=9)
        assert not t.solve({"g": 200.0}, start=first, solver=few, throw=False).status.ok
        c = t.continuation([{"g": 9.80665}, {"g": 200.0}], start=first, solver=few)
        assert len(c.steps) > 2 and c.steps[-1][0] == {"g": 200.0}
        assert c.solution.objective == pytest.approx(first.objective * np.sqrt(9.80665 / 200.0), rel=1e-5)

    def test_it_ends_where_nothing_helps(self, tank):
        with pytest.raises(NotSolved, match=r"the continuation stopped before end = \S+: .*"):
            tank.continuation([{"end": 0.1}, {"end": 50.0}])  # out of reach
        c = tank.continuation([{"end": 0.1}, {"end": 50.0}], throw=False)
        assert c.message and not c.solution.status.ok and c.steps[0][1].status.ok


class Wells(gt.Optimization):
    """x' = u to the bottom of one of two wells at -1 and 1; that at -1 is deeper."""

    x = gt.variable(start=0.05, fixed=True)
    u = gt.input()
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        end = self.x.at(self.final_time)
        return 10 * (end**2 - 1) ** 2 + end + 0.01 * gt.integral(self.u**2)


class TestManyStarts:
    def test_both_wells(self):
        m = multi_start(transcribe(Wells(), Mesh(5, 2)), 12, seed=3, spread=1.0)
        assert len(m.optima) == 2 and m.starts == 12 and not m.failures
        ends = [o.solution.trajectory["x"][-1] for o in m.optima]
        # roots of 40 x (x^2 - 1) + 1 + 0.02 (x - 0.05)
        roots = np.roots([40.0, 0.0, -40.0 + 0.02, 1.0 - 0.001])
        assert ends == pytest.approx([roots.min(), roots.max()], abs=1e-5)
        assert m.optima[0].objective < m.optima[1].objective and m.best is m.optima[0].solution
        assert m.optima[0].distance == 0.0 < m.optima[1].distance
        assert min(o.count for o in m.optima) >= 2
        assert "0 of 12 starts failed; seed 3" in str(m)
        assert [o.solution.message for o in m.optima] == [
            f"solved; local optimum; {o.count} of 12 starts ended here" for o in m.optima
        ]

    def test_the_seed_decides(self):
        t = transcribe(Wells(), Mesh(3, 2))
        tables = [str(multi_start(t, 4, seed=s, spread=1.0)) for s in (1, 1)]
        assert tables[0] == tables[1]
        xs = [multi_start(t, 2, seed=s, spread=1.0).best.x for s in (1, 1)]
        assert np.array_equal(xs[0], xs[1])

    def test_wrong_calls(self, tank):
        wrong: list[tuple[str, dict[str, Any]]] = [
            ("count", {"count": 0}), ("count", {"count": 2.5}), ("count", {"count": True}),
            ("seed", {"count": 2, "seed": "a"}), ("seed", {"count": 2, "seed": -1}),
            ("spread", {"count": 2, "spread": 0.0}), ("spread", {"count": 2, "spread": "1"}),
        ]  # fmt: skip
        for argument, given in wrong:
            with pytest.raises(ArgumentError) as caught:
                multi_start(tank, **given)
            assert caught.value.argument == argument
        with pytest.raises(NotSolved):
            multi_start(tank, 2, parameters={"end": 50.0})
