"""What closes when variables are measured: derived from the model's own equations, against formulas by hand."""

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import Choice, Measurements, closure_equations, prepare
from gtmodel.compiler.causal import flat_of
from gtmodel.geometry.quaternions import quaternion_matrix
from problems.models import mechanisms
from tests.calibrate.synthetic import poses, true_robot


class Slider(gt.Model):
    """A user's own mechanism, no robot of the catalogue: a rod from a slide along x to the end of a crank."""

    L = gt.parameter(1.2, unit="m")
    a = gt.parameter(0.4, unit="m", description="crank")
    h = gt.parameter(0.1, unit="m", description="height of the slide")
    phi = gt.variable(unit="rad", start=0.3)
    s = gt.variable(unit="m", start=1.5)
    x = gt.variable(unit="m", start=0.4)
    y = gt.variable(unit="m", start=0.1)

    def equations(self):
        yield self.x == self.a * gt.cos(self.phi)
        yield self.y == self.a * gt.sin(self.phi)
        yield (self.s - self.x) ** 2 + (self.h - self.y) ** 2 == self.L**2


def test_each_link_closes_once_and_nothing_else_does():
    three, six, f1 = (
        closure_equations(flat_of(true_robot(kind)), known)
        for kind, known in (("three_link", "qT"), ("six_link", "qTe"), ("f1", "qTe"))
    )
    assert three.labels == ("arm[0].rod", "arm[1].rod", "arm[2].rod")
    assert six.labels == tuple(f"link[{k}].rod" for k in range(6)) and f1.labels == tuple(
        f"link[{k}]" for k in range(6)
    )
    assert [len(c.touched) for c in (three, six, f1)] == [21, 60, 72]
    assert six.unit == f1.unit == ("e",)


@pytest.mark.parametrize("kind", ["three_link", "six_link"])
def test_lengths_and_squares_are_those_written_by_hand(kind):
    robot, data = true_robot(kind), poses(kind, 20)
    problem = prepare(robot.with_(L=np.array(robot.L) + 0.01), Measurements(data))
    A, v, L = (np.array(getattr(robot, n)) for n in "AvL")
    arm = [0, 1, 2] if kind == "three_link" else [0, 1, 1, 2, 2, 2]
    tips = np.repeat(data["T"][:, None], len(arm), axis=1)
    if kind == "six_link":
        R = np.array([quaternion_matrix(e) for e in data["e"]])
        tips = tips + np.einsum("kij,mj->kmi", R, np.array(robot.B))
    d = tips - A - data["q"][:, arm, None] * v
    length = np.linalg.norm(d, axis=2)
    np.testing.assert_allclose(length, np.broadcast_to(L, length.shape), atol=1e-12)  # the poses are reached
    np.testing.assert_allclose(problem.residuals(), length - L - 0.01, atol=1e-12)
    x, data = problem.unknowns.start, problem.reading.data
    squares = np.hstack([b.evaluate(data, x[b.columns])[0] for b in problem.squared])
    np.testing.assert_allclose(squares, length**2 - (L + 0.01) ** 2, atol=1e-11)


@pytest.mark.parametrize("kind", ["three_link", "six_link", "f1"])
def test_slopes_are_those_of_finite_differences(kind):
    problem = prepare(true_robot(kind), Measurements(poses(kind, 5)))
    x, J = problem.unknowns.start, problem.jacobian()
    rng = np.random.default_rng(0)
    for _ in range(4):  # a wrong entry shows in almost every direction
        way, step = rng.standard_normal(len(x)), 1e-6
        difference = (problem.residuals(x + step * way) - problem.residuals(x - step * way)) / (2 * step)
        np.testing.assert_allclose(J @ way, difference, atol=1e-7)  # rounding over the step


def test_a_users_own_mechanism_closes_by_propagation():
    c = closure_equations(Slider(), ("phi", "s"))
    assert c.labels == ("Slider",) and len(c.touched) == 3
    f = ca.Function("r", [c.symbols["phi"], c.symbols["s"], c.flat.p], [c.residuals])
    expected = (1.5 - 0.4 * np.cos(0.3)) ** 2 + (0.1 - 0.4 * np.sin(0.3)) ** 2 - 1.2**2
    assert float(f(0.3, 1.5, c.flat.p0)) == pytest.approx(expected, abs=1e-15)


def test_what_is_missing_is_named():
    flat = flat_of(true_robot("six_link"))
    with pytest.raises(gt.ModelError, match="with q, T known, not all equations with parameters"):
        closure_equations(flat, ("q", "T"))
    with pytest.raises(gt.ModelError, match="'der\\(q\\)' is a derivative"):
        closure_equations(flat, ("der(q)", "T"))
    with pytest.raises(gt.ModelError, match="has no variable 'Q'"):
        closure_equations(flat, ("Q", "T"))
    with pytest.raises(gt.ModelError, match="a variable is named twice in q, q"):
        closure_equations(flat, ("q", "q"))


def test_the_order_in_which_signals_are_named_changes_nothing():
    data = poses("three_link", 5)
    once = prepare(true_robot("three_link"), Measurements(data), Choice())
    other = prepare(true_robot("three_link"), Measurements(dict(reversed(data.items()))), Choice())
    assert once.unknowns.names == other.unknowns.names
    assert np.array_equal(once.jacobian(), other.jacobian())


def test_a_coordinate_that_a_plane_holds_is_eliminated_by_the_planes_parameters():
    closure = closure_equations(mechanisms.FiveBar(), ["q", "x"])
    assert closure.labels == ("rod[0]", "rod[1]")
