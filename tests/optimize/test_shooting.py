"""Multiple shooting as a second road: what collocation finds on a fine mesh."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError
from gtmodel.optimize import Mesh, SolverOptions, resimulate, solve
from tests.optimize import features, problems

LIMITED = SolverOptions(tolerance=1e-7, max_iterations=300)  # L-BFGS on an integrator's derivatives
# CVODES at 1e-10 per step; with and without its sensitivities it takes other steps
ROADS = 1e-6

# controls that do not depend on the collocation points
ROWS = {
    "int x^2 + u^2": (features.Tank, Mesh(8, 3, control="constant"), None),
    "van der Pol": (problems.VanDerPol, Mesh(20, 3, control="linear"), None),
    "end costs": (features.Mayer, Mesh(6, 2, control="constant"), None),
    "free final time": (problems.DoubleIntegrator, Mesh(10, 2, control="constant"), None),
    "free ends": (features.FreeTimes, Mesh(8, 3, control="linear"), None),
    "cycloid": (problems.Brachistochrone, Mesh(10, 3, control="linear"), problems.brachistochrone_guess),
    "an integral bounded": (features.BoundedEnergy, Mesh(6, 3, control="constant"), None),
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.proof] * (n == "van der Pol")) for n in ROWS])
def test_both_roads(name):
    """Collocation with seven points per element has no error left to speak of."""
    cls, mesh, guess = ROWS[name]
    start = guess() if guess else None
    shot = solve(cls(), mesh, guess=start, method="shooting", solver=LIMITED)
    fine = Mesh(mesh.elements, 7, control=mesh.control)
    collocated = solve(cls(), fine, guess=start, solver=SolverOptions(formulation="explicit"))
    assert shot.objective == pytest.approx(collocated.objective, rel=ROADS)
    # van der Pol's origin is unstable: what CVODES loses grows ten thousandfold in 20 s
    assert resimulate(shot).defect < (1e-3 if cls is problems.VanDerPol else 1e-6)


def test_conformance_by_integration():
    """Double integrator, 1 to 0 at rest in least time: exactly 2, and bang-bang."""
    s = solve(problems.DoubleIntegrator(), Mesh(10, 2, control="constant"), method="shooting", solver=LIMITED)
    assert s.final_time == pytest.approx(2.0, rel=1e-5)
    assert s.trajectory["u"][1:10] == pytest.approx(-np.ones(9), abs=1e-3)


def test_state_bounds_between_the_edges():
    class Slow(problems.DoubleIntegrator):
        v = gt.variable(start=0.0, fixed=True, min=-0.6)

    s = solve(Slow(), Mesh(10, 2, control="constant"), method="shooting", solver=LIMITED)
    # up to 0.6 in 0.6 s and down again: 1 = 0.6 (T - 0.6)
    assert s.final_time == pytest.approx(0.6 + 1 / 0.6, rel=1e-2)
    assert s.trajectory["v"].min() > -0.6 - 1e-6


@pytest.mark.parametrize(
    "model, mesh, options, sentence",
    [
        (problems.VanDerPol, Mesh(4, 2, "gauss"), {}, "VanDerPol: shooting needs scheme 'radau'"),
        (problems.ImplicitBlock, Mesh(4, 2), {}, "no closed form, which formulation 'explicit' needs"),
        (problems.VanDerPol, Mesh(4, 2), {"formulation": "dae"}, "needs an explicit formulation .* found 'dae'"),
    ],
)
def test_refused(model, mesh, options, sentence):
    with pytest.raises(ModelError, match=sentence):
        solve(model(), mesh, method="shooting", solver=SolverOptions(**options))


def test_unknown_method():
    with pytest.raises(ValueError, match="method must be one of collocation, shooting; found 'single'"):
        solve(problems.VanDerPol(), method="single")  # type: ignore[arg-type]


def test_a_failure_keeps_the_best_iterate_and_says_so():
    options = SolverOptions(max_iterations=2)
    s = solve(problems.StirredTank(), Mesh(8), method="shooting", solver=options, throw=False)
    assert "returned iterate 1, which has the smallest violation; worst rows: continuity of" in s.message
    kept = solve(
        problems.StirredTank(), Mesh(8), method="shooting", solver=SolverOptions(max_iterations=1), throw=False
    )
    assert s.checks["constraint_violation"].value == pytest.approx(kept.checks["constraint_violation"].value)
    assert s.trajectory["T"] == pytest.approx(kept.trajectory["T"], rel=1e-9)
