"""What is not solved ends with the line that it is about: where it is written, the same in the message."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus, der

HERE = "optimize/test_places.py"
MESH = gt.Mesh(4)


class Cart(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u

    def objective(self):
        return gt.integral(self.u**2)


class OutOfReach(Cart):
    def constraints(self):
        yield self.x.at(self.final_time) ** 2 <= 0.01  # 0.5 m is as near as it gets


class Endless(Cart):
    u = gt.input()

    def objective(self):
        return self.x.at(self.final_time)


class Saddle(Cart):
    """From its middle, where the slope is zero: a maximum in u."""

    u = gt.input(min=-1.0, max=1.0)

    def objective(self):
        return gt.integral(-(self.u**2))


class Steep(Cart):
    def objective(self):
        return gt.integral(gt.sqrt(self.u) + self.x)


class Wiggle(Cart):
    rate = gt.parameter(1.0, unit="1/s")
    w = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield from super().equations()
        yield der(self.w) == gt.sin(40 * self.rate * self.time) - 20 * self.w


class Coarse(Cart):
    rate = gt.parameter(1.0, unit="1/s")

    def objective(self):
        return gt.integral(self.u**2 + gt.sin(25 * self.rate * self.time) ** 2 * self.x)


class Indifferent(Cart):
    def objective(self):
        return 0.0 * self.x.at(self.final_time) + 1.0


class Adrift(Cart):
    cost = gt.variable(start=0.0)

    def equations(self):
        yield from super().equations()
        yield der(self.cost) == self.u**2

    def objective(self):
        return self.cost.at(self.final_time)


class Crossed(Cart):
    def constraints(self):
        yield self.x >= 2.0


def line(of: Any, text: str) -> int:
    """The line of this file on which a text stands first inside a class."""
    lines, first = inspect.getsourcelines(of)
    return first + next(n for n, written in enumerate(lines) if text in written)


def solution(cls: type[gt.Optimization], **options: Any) -> gt.Solution:
    return gt.solve(cls(), MESH, solver=gt.SolverOptions(**options), throw=False)


CASES: list[tuple[type[gt.Optimization], type, str, SolveStatus, dict[str, Any]]] = [
    (OutOfReach, OutOfReach, "yield self.x.at", SolveStatus.INFEASIBLE, {}),
    (Steep, Steep, "def objective", SolveStatus.NOT_FINITE, {}),
    (Cart, Cart, "class Cart", SolveStatus.ITERATION_LIMIT, {"max_iterations": 1}),
    (Cart, Cart, "class Cart", SolveStatus.INTERRUPTED, {"max_seconds": 0.0}),
    (Wiggle, Wiggle, "w = gt.variable", SolveStatus.CHECK_FAILED, {}),
    (Coarse, Coarse, "def objective", SolveStatus.CHECK_FAILED, {}),
]


@pytest.mark.parametrize(("cls", "of", "text", "status", "options"), CASES, ids=lambda c: getattr(c, "__name__", ""))
def test_the_line_it_is_about(
    cls: type[gt.Optimization], of: type, text: str, status: SolveStatus, options: dict[str, Any]
) -> None:
    ended = solution(cls, **options)
    assert ended.status is status, ended.message
    assert ended.where is not None and (ended.where.file, ended.where.line) == (HERE, line(of, text)), ended.message
    assert f"({ended.where})" in ended.message


def test_what_grows_without_a_bound_is_named_by_its_declaration() -> None:
    ended = solution(Endless, max_iterations=60)
    assert not ended.status.ok and "has grown" in ended.message and ended.where is not None
    declared = {line(Cart, "x = gt.variable"), line(Cart, "v = gt.variable"), line(Endless, "u = gt.input")}
    assert f"({ended.where})" in ended.message and ended.where.line in declared | {line(Endless, "class Endless")}


def test_a_doubt_about_a_minimum_is_the_objectives() -> None:
    ended = solution(Saddle)
    assert ended.reservation and ended.where is not None
    assert ended.where.line == line(Saddle, "def objective") and f"({ended.where})" in ended.message


def test_a_constant_objective_is_no_doubt_about_a_minimum() -> None:
    ended = solution(Indifferent)
    assert ended.status is SolveStatus.SOLVED and ended.objective == 1.0
    assert "constant" in ended.reservation and "minimum" not in ended.reservation


def test_what_is_solved_is_about_no_line() -> None:
    ended = solution(Cart)
    assert ended.status is SolveStatus.SOLVED and ended.where is None and "(" not in ended.message


@pytest.mark.parametrize(
    ("cls", "text", "word"), [(Adrift, "cost = gt.variable", "'cost'"), (Crossed, "x = gt.variable", "'x'")]
)
def test_refused_before_anything_is_solved(cls: type[gt.Optimization], text: str, word: str) -> None:
    with pytest.raises(gt.ModelError) as caught:
        gt.solve(cls(), MESH)
    where = caught.value.where
    owner = cls if cls is Adrift else Cart
    assert where is not None and where.line == line(owner, text) and word in str(caught.value)


def test_a_start_that_a_constraint_holds_is_not_adrift() -> None:
    class Held(Adrift):
        def constraints(self):
            yield self.cost.at(self.start_time) == 0.0
            yield self.x.at(self.final_time) == 0.9

    class Fixed(Held):
        cost = gt.variable(start=0.0, fixed=True)

        def constraints(self):
            yield self.x.at(self.final_time) == 0.9

    held, fixed = gt.solve(Held(), MESH), gt.solve(Fixed(), MESH)
    assert held.objective == pytest.approx(fixed.objective, rel=1e-6)  # IPOPT's 1e-8 on both


def test_the_study_carries_the_place_as_data() -> None:
    study = gt.optimize.optimization_study(OutOfReach(), MESH)
    assert study.values["where"] == f"{HERE}:{line(OutOfReach, 'yield self.x.at')}"
    assert gt.optimize.optimization_study(Cart(), MESH).values["where"] is None


def test_a_phase_says_its_line() -> None:
    phases = gt.Phases({"first": Cart(), "second": OutOfReach()})
    ended = gt.solve_phases(phases, MESH, solver=gt.SolverOptions(max_iterations=200), throw=False)
    assert not ended.status.ok and ended.where is not None and f"({ended.where})" in ended.message
    assert all(s.where == ended.where for s in ended.phases.values())


def test_a_second_guess_is_taken_where_the_first_fails() -> None:
    class Root(gt.Optimization):
        """x stays on its branch; from a guess at the other end of the horizon's range there is no way."""

        x = gt.variable(start=1.0, fixed=True)
        y = gt.variable(start=1.0)
        u = gt.input(min=-1.0, max=1.0)

        def equations(self):
            yield der(self.x) == self.u
            yield self.y == gt.log(self.x)

        def objective(self):
            return gt.integral(self.u**2)

        def constraints(self):
            yield self.y.at(self.final_time) == 0.5

    bad = gt.Trajectory([0.0, 1.0], {"x": [-1.0, -1.0], "u": [0.0, 0.0]})
    good = gt.Trajectory([0.0, 1.0], {"x": [1.0, 1.5], "u": [0.5, 0.5]})
    alone = gt.optimize.optimization_study(Root(), MESH, guess=bad)
    study = gt.optimize.optimization_study(Root(), MESH, guess=bad, second_guess=lambda: good)
    assert not alone.status.ok and study.status.ok and len(study.notes) == 1
    assert study.objective == pytest.approx((np.exp(0.5) - 1.0) ** 2, rel=1e-6)  # at a constant rate
