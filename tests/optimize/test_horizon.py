"""The ends of a horizon, instants on it, and wrong arguments: each said in one sentence."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, solve, transcribe

MESH = Mesh(4)
FOUR: Any = 4
REAL: Any = 4.0
TABLE: Any = {"x": 1}


class Run(gt.Optimization):
    k = gt.parameter(1.0)
    x = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        return -self.x.at(self.final_time)

    def constraints(self) -> Iterable[Any]:
        return ()


class ByParameter(Run):
    T = gt.parameter(2.0)
    final_time = T


class Fastest(Run):
    T = gt.free(2.0, min=0.1, max=10.0)
    final_time = T

    def objective(self):
        return self.T

    def constraints(self):
        yield self.x.at(self.final_time) == 1


class Twice(Fastest):
    final_time = property(lambda self: 2 * self.T + 0.5)


class TestOneQuantity:
    def test_a_parameter_under_two_names(self):
        assert solve(ByParameter(T=5.0), MESH).objective == pytest.approx(-5.0, abs=1e-6)
        t = transcribe(ByParameter(), MESH)
        assert t.parameters == ("k", "T")
        s = t.solve({"T": 3.0})
        assert s.objective == pytest.approx(-3.0, abs=1e-6)
        assert s.sensitivity["T"] == pytest.approx(-1.0, abs=1e-6)

    def test_a_free_constant_under_two_names(self):
        s = solve(Fastest(), MESH)
        assert s.free == {"T": pytest.approx(1.0, abs=1e-6)} and s.final_time == pytest.approx(1.0, abs=1e-6)

    def test_declared_anew_by_a_subclass(self):
        class Other(ByParameter):
            T = gt.parameter(4.0)

        assert solve(Other(), MESH).objective == pytest.approx(-4.0, abs=1e-6)

    def test_an_expression_of_free_constants(self):
        s = solve(Twice(), MESH)
        assert s.free["T"] == pytest.approx(0.25, abs=1e-6) and s.final_time == pytest.approx(1.0, abs=1e-6)

    @pytest.mark.parametrize(
        ("end", "sentence"),
        [
            (lambda self: self.T**2, "an end of the horizon must be affine in the free constants"),
            (lambda self: self.T - 3.0, "the free horizon is -1 s long at its guess"),
            (lambda self: self.x, "final_time may depend on .* free constants only; found x"),
        ],
    )
    def test_an_expression_that_is_none(self, end, sentence):
        with pytest.raises(gt.ModelError, match=sentence):
            solve(type("Wrong", (Fastest,), {"final_time": property(end), "constraints": lambda self: ()})(), MESH)

    def test_a_parameter_that_turns_the_horizon_round(self):
        same = "the horizon ends at -1 s, but starts at 0 s"
        with pytest.raises(gt.ModelError, match=same):
            solve(ByParameter(T=-1.0), MESH)
        with pytest.raises(gt.ModelError, match=same):
            transcribe(ByParameter(), MESH).solve({"T": -1.0})


class TestInstants:
    @pytest.mark.parametrize("tenths", range(1, 10))
    def test_an_input_at_an_edge_is_that_of_the_element_on_its_right(self, tenths):
        class At(Run):
            def objective(self):
                return gt.integral(self.u**2)

            def constraints(self):
                yield self.u.at(tenths * 0.1) == 1

        s = solve(At(), Mesh(10, 2, control="constant"))
        u = s.trajectory["u"][1:].reshape(10, 2)[:, 0]
        assert np.flatnonzero(u > 0.5).tolist() == [tenths]

    @pytest.mark.parametrize(
        ("value", "sentence"),
        [
            (lambda s: s.x.at(0.5).at(0.7), "holds a value at an instant or an integral"),
            (lambda s: gt.integral(s.x).at(0.7), "holds a value at an instant or an integral"),
            (lambda s: s.x.at(s.x), "constant time: .* depends on x"),
            (lambda s: s.x.at(s.time), "constant time: .* depends on time"),
            (lambda s: s.x.at(s.x.at(0.5)), "constant time: .* depends on at"),
        ],
    )
    def test_no_constant_time(self, value, sentence):
        class At(Run):
            def constraints(self):
                yield value(self) <= 1

        with pytest.raises(gt.ModelError, match=rf"{sentence}.*test_horizon\.py:\d+\)"):
            solve(At(), MESH)

    def test_at_a_parameter(self):
        class At(Run):
            def constraints(self):
                yield self.x.at(self.k * 0.5) <= 0.1

        assert solve(At(), MESH).objective == pytest.approx(-0.6, abs=1e-6)
        with pytest.raises(gt.ModelError, match=r"leave k out of transcribe\(parameters=...\)"):
            transcribe(At(), MESH)
        assert transcribe(At(), MESH, parameters=()).solve().objective == pytest.approx(-0.6, abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda: Mesh(REAL), "elements of a mesh must be an integer; found 4.0"),
        (lambda: Mesh(4, True), "points of a mesh must be an integer; found True"),
        (lambda: Mesh(2, lengths=(1.0, np.nan)), "positive, finite lengths; found"),
        (lambda: Mesh(2, lengths=(1.0, np.inf)), "positive, finite lengths; found"),
        (lambda: solve(Run(), FOUR), r"the mesh must be a gt.Mesh\(elements, points\); found 4"),
        (lambda: transcribe(Run(), FOUR), r"the mesh must be a gt.Mesh\(elements, points\); found 4"),
        (
            lambda: solve(Run(), MESH, guess=TABLE),
            r"the guess must be a gt.Trajectory or an earlier solution; found \{",
        ),
    ],
)
def test_wrong_arguments(wrong, sentence):
    with pytest.raises(gt.ModelError, match=sentence):
        wrong()
