"""The scattered derivatives of the NLP against CasADi's own of the whole NLP, and against finite differences."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.motion import Cost, End, Limits, MotionProblem
from gtmodel.motion.task import line_guess, motion
from gtmodel.optimize import Mesh
from gtmodel.optimize.formulation.problem import build
from gtmodel.optimize.guess import initial_guess
from gtmodel.optimize.nlp import Nlp, make_nlp
from tests.optimize import features
from tests.optimize.problems import LinearAlgebraic, VanDerPol

# The same expressions differentiated on one element and on the whole: some hundred operations of 2.2e-16, in units
# of the matrix's largest entry.
ROUND_OFF = 1e-12
# Central differences with step 1e-6 of values of order one: 1e-16 / 1e-6 of cancellation and third derivatives times
# 1e-12; random directions, so entries add up.
DIFFERENCES = 1e-6
STEP = 1e-6

MESHES = {
    "1 Radau point": Mesh(4, 1),
    "2 Gauss, constant control, unequal": Mesh(3, 2, "gauss", "constant", (1.0, 0.5, 2.0)),
    "3 Radau, constant control": Mesh(3, 3, "radau", "constant"),
    "3 Radau, unequal": Mesh(3, 3, lengths=(1.0, 3.0, 0.7)),
    "4 Gauss": Mesh(2, 4, "gauss"),
}
PROBLEMS = (*features.FEATURES, VanDerPol, LinearAlgebraic)
FORMULATIONS = {"Lagrange": ("explicit", "inverse"), "TwoCarts": ("explicit", "inverse")}
CASES = [
    pytest.param(cls, form, id=f"{cls.__name__}-{form}")
    for cls in PROBLEMS
    for form in FORMULATIONS.get(cls.__name__, ("auto",))
]


@cache
def configured(cls):
    return cls()


def point_near_guess(nlp: Nlp, guess=None, seed=0, spread=0.1) -> np.ndarray:
    return initial_guess(nlp, guess) + spread * np.random.default_rng(seed).standard_normal(nlp.size)


def compare(nlp: Nlp, x: np.ndarray) -> dict[str, float]:
    """How far apart, in tolerances, all three functions are at one point with random multipliers."""
    rng = np.random.default_rng(1)
    sigma, lam = 0.7, rng.standard_normal(len(nlp.lbg))
    names = (["x", "p", "lam:f", "lam:g"], ["f", "g", "grad:f:x", "jac:g:x", "triu:hess:gamma:x:x"])
    whole = nlp.nlp.factory("whole", *names, {"gamma": ["f", "g"]})
    f, g, grad, jac, hess = whole(x, [], sigma, lam)
    own_g, own_jac = nlp.functions["jac_g"](x, [])
    own_f, own_grad = nlp.functions["grad_f"](x, [])
    own_hess = nlp.functions["hess_lag"](x, [], sigma, lam)
    found = {"below the diagonal": 0.0 if own_hess.sparsity().is_triu() else np.inf}
    for name, own, theirs in (
        ("f", own_f, f), ("g", own_g, g), ("grad_f", own_grad, grad), ("jac_g", own_jac, jac), ("hess", own_hess, hess)
    ):  # fmt: skip
        a, b = np.asarray(ca.densify(own)), np.asarray(ca.densify(theirs))
        assert a.shape == b.shape
        found[name] = np.max(np.abs(a - b), initial=0.0) / (ROUND_OFF * (1 + np.max(np.abs(b), initial=0.0)))
    return found | _by_differences(nlp, x, sigma, lam, np.asarray(ca.densify(own_jac)), own_grad, own_hess)


def _by_differences(nlp, x, sigma, lam, jac, grad, hess) -> dict[str, float]:
    d = np.random.default_rng(2).standard_normal(nlp.size)
    d /= np.linalg.norm(d)
    (f1, g1), (f0, g0) = ([np.asarray(v).reshape(-1) for v in nlp.nlp(x + e * d, [])] for e in (STEP, -STEP))
    scale = 1 + np.linalg.norm(jac, axis=1)
    rows = np.max(np.abs((g1 - g0) / (2 * STEP) - jac @ d) / scale, initial=0.0)
    slope = float(np.asarray(grad).reshape(-1) @ d)
    cost = abs((f1 - f0)[0] / (2 * STEP) - slope) / (1 + float(ca.norm_2(grad)))

    def lagrangian_slope(e: float) -> np.ndarray:
        jacobian = np.asarray(ca.densify(nlp.functions["jac_g"](x + e * d, [])[1]))
        return sigma * np.asarray(nlp.functions["grad_f"](x + e * d, [])[1]).reshape(-1) + lam @ jacobian

    upper = np.asarray(ca.densify(hess))
    full = upper + np.triu(upper, 1).T
    difference = (lagrangian_slope(STEP) - lagrangian_slope(-STEP)) / (2 * STEP)
    curvature = np.max(np.abs(difference - full @ d)) / (1 + np.max(np.abs(full)))
    found = {"jac_g by differences": rows, "grad_f by differences": cost, "hess by differences": curvature}
    return {name: miss / DIFFERENCES for name, miss in found.items()}


def wrong(nlp: Nlp, x: np.ndarray) -> dict[str, float]:
    """What `compare` finds out of tolerance, or not finite."""
    return {name: miss for name, miss in compare(nlp, x).items() if not miss <= 1}


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("cls, formulation", CASES)
def test_scattered_derivatives(cls, formulation, mesh):
    nlp = make_nlp(build(configured(cls), formulation), MESHES[mesh])
    assert wrong(nlp, point_near_guess(nlp)) == {}


@cache
def robot_motion():
    """The motion of problems/l1_min_time.toml with energy and a goal at zero acceleration, and its guess."""
    robot = gt.robots.gantry_tau("l1_tape")
    start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.9, -0.9, 0.45])
    problem = MotionProblem(
        robot=robot, start=End(start.tolist()), goal=End(goal.tolist(), ["velocity", "acceleration"]),
        limits=Limits(700.0), cost=Cost(energy=0.01, force_unit=112.9),
    )  # fmt: skip
    model = motion(problem)
    return model, line_guess(robot.causal(known="T", targets="tau"), start, goal, 700.0)


@pytest.mark.parametrize("mesh", [Mesh(3, 3), Mesh(2, 3, control="constant")], ids=["polynomial", "constant"])
@pytest.mark.parametrize("formulation", ["inverse", "explicit"])
def test_robot_motion(mesh, formulation):
    model, guess = robot_motion()
    problem = build(model, formulation)
    assert problem.formulation == formulation
    nlp = make_nlp(problem, mesh)
    # small steps: the pose must stay within reach of all links
    assert wrong(nlp, point_near_guess(nlp, guess, spread=0.01)) == {}


def test_what_the_features_are():
    """Each feature takes the road that it is here for."""
    built = {cls.__name__: build(configured(cls)) for cls in features.FEATURES}
    assert built["BoundedEnergy"].state_names == ["x", "integral 0"]
    assert built["FunctionOfIntegral"].state_names == ["x", "integral 0", "integral 1"]
    assert len(built["FunctionOfIntegral"].integrals) == 1
    assert len(built["InteriorPoints"].points) == 3 and {i.s for i in built["InteriorPoints"].instants} >= {0.35, 0.5}
    assert built["FreeTimes"].free_names == ["start_time", "final_time"]
    assert built["FreeConstants"].free_names == ["k", "w[0]", "w[1]"] and len(built["FreeConstants"].points) == 1
    assert built["NoControl"].control_names == []
    assert len(built["PathConstraints"].path) == 4 and built["PathConstraints"].formulation == "explicit"
    # cos(x) u: solved for u it would divide by what may vanish
    assert built["TwoCarts"].formulation == "inverse" and built["Lagrange"].formulation == "explicit"


def test_rows_vanish_on_a_polynomial_that_solves_the_equations():
    """Collocation is exact for x = 1 + s^3 / 3, x' = s^2 = u: no row but the bounds is left over."""

    class Cubic(gt.Optimization):
        x = gt.variable(start=1.0, fixed=True, nominal=3.0)
        u = gt.input(nominal=7.0)
        final_time = 2.0

        def equations(self):
            yield gt.der(self.x) == self.u

        def objective(self):
            return gt.integral(self.x)

    for scheme in ("radau", "gauss"):
        mesh = Mesh(4, 3, scheme, lengths=(1.0, 2.0, 0.5, 1.0))
        nlp = make_nlp(build(Cubic(), "explicit"), mesh)
        layout, x = nlp.element.layout, np.zeros(nlp.size)
        for k in range(mesh.elements):
            block = np.zeros(layout.size)
            left = 2.0 * mesh.edges[k]
            t = left + 2.0 * mesh.h[k] * mesh.table.points
            block[layout.left], block[layout.x[:, 0]], block[layout.u[:, 0]] = 1 + left**3 / 3, 1 + t**3 / 3, t**2
            x[k * layout.size : (k + 1) * layout.size] = block / layout.scale
        x[-1] = (1 + 8 / 3) / 3.0
        f, g = nlp.nlp(x, [])
        assert np.max(np.abs(np.asarray(g))) < ROUND_OFF
        assert float(f) == pytest.approx(2 + 16 / 12, rel=ROUND_OFF)  # int 1 + t^3 / 3 over 2 s
