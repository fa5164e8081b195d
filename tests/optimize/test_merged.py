"""One unknown where elements meet: derivatives, answers and multipliers as those of the NLP with both."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions
from gtmodel.optimize.formulation.problem import build
from gtmodel.optimize.guess import initial_guess
from gtmodel.optimize.ipopt import run_ipopt
from gtmodel.optimize.nlp import Nlp, make_nlp
from gtmodel.optimize.nlp_forms import Merged, merged
from gtmodel.optimize.watch import Multipliers
from tests.optimize import features
from tests.optimize.problems import VanDerPol

ROUND_OFF = 1e-12  # the same expressions differentiated on one element and on the whole
SOLVER = 1e-6  # relative: both ways end within IPOPT's tolerance of 1e-8 on multipliers of some hundred
MESHES = {
    "1 Radau point": Mesh(4, 1),
    "1 element": Mesh(1, 3),
    "3 Radau, unequal": Mesh(3, 3, lengths=(1.0, 3.0, 0.7)),
    "linear control": Mesh(4, 2, control="linear"),
    "free lengths": Mesh(4, 2, control="constant", length_ratio=(0.5, 2.0)),
}
TWO = Mesh(2, 3)


class AcrossAnEdge(features.Tank):
    """A point constraint that multiplies both unknowns of an edge: the state in an element with the one at its end."""

    def constraints(self):
        yield self.x.at(0.8) * self.x.at(1.0) >= -10.0


def both(cls, mesh) -> tuple[Nlp, Merged]:
    nlp = make_nlp(build(cls()), mesh)
    one = merged(nlp)
    assert one is not None
    return nlp, one


CLASSES = [features.Tank, features.FreeTimes, features.FreeConstants, VanDerPol]


@pytest.mark.parametrize(
    ("cls", "mesh"),
    [
        *(pytest.param(c, m, id=f"{c.__name__}, {name}") for c in CLASSES for name, m in MESHES.items()),
        (AcrossAnEdge, TWO),
    ],
)
def test_derivatives_and_rows(cls, mesh):
    """Against CasADi's own of the merged program, which is the NLP at X = E z without the rows of the edges."""
    nlp, one = both(cls, mesh)
    rng, p = np.random.default_rng(0), one.pairs
    E, guess = p.spread.dm.full(), initial_guess(nlp, None)
    assert np.allclose(p.taken(guess), E.T @ guess)
    z = p.taken(guess) + 0.05 * rng.standard_normal(len(p.weight))
    X = E @ z
    assert len(one.lbx) == len(z) == nlp.size - len(p.gone) and len(one.lbg) == len(nlp.lbg) - len(p.rows)
    assert np.allclose(X[p.kept], X[p.gone], rtol=0, atol=1e-15)
    assert np.allclose(E.T @ E, np.eye(len(z)))
    f, g = (np.asarray(v).reshape(-1) for v in one.nlp(z, []))
    whole_f, whole_g = (np.asarray(v).reshape(-1) for v in nlp.nlp(X, []))
    assert f == pytest.approx(whole_f, rel=1e-12) and g == pytest.approx(whole_g[p.others], rel=1e-12, abs=1e-12)
    assert np.max(np.abs(whole_g[p.rows])) < 1e-12  # what is left out holds by itself
    sigma, lam = 0.7, rng.standard_normal(len(one.lbg))
    names = (["x", "p", "lam:f", "lam:g"], ["grad:f:x", "jac:g:x", "triu:hess:gamma:x:x"])
    theirs = one.nlp.factory("whole", *names, {"gamma": ["f", "g"]})(z, [], sigma, lam)
    own = (one.functions["grad_f"](z, [])[1], one.functions["jac_g"](z, [])[1],
           one.functions["hess_lag"](z, [], sigma, lam))  # fmt: skip
    for a, b in zip(own, theirs, strict=True):
        a, b = np.asarray(ca.densify(a)), np.asarray(ca.densify(b))
        assert np.max(np.abs(a - b), initial=0.0) <= ROUND_OFF * (1 + np.max(np.abs(b), initial=0.0))


def test_entries_of_both_unknowns_of_an_edge_are_there_to_be_summed():
    nlp, one = both(AcrossAnEdge, TWO)
    i, j = (np.array(a) for a in nlp.functions["hess_lag"].sparsity_out(0).get_triplet())
    place = one.pairs.place
    assert np.any((i != j) & (place[i] == place[j]))


class Bounded(gt.Optimization):
    """Bounds on a state that hold at edges and in between, a state given at both ends, a free constant."""

    final_time = gt.free(2.0, min=0.1)
    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True, max=0.7)
    u = gt.input(min=-1.0, max=1.0)

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u - 0.1 * self.v**2

    def objective(self):
        return self.final_time + gt.integral(0.1 * self.u**2)

    def constraints(self):
        yield self.x.at(self.final_time) == 1.0
        yield self.v.at(self.final_time) == 0.0


@pytest.mark.parametrize("mesh", [Mesh(8, 3), Mesh(8, 2, control="linear"), Mesh(12, 3)])
def test_answer_and_multipliers_are_those_of_the_whole(mesh):
    nlp, one = both(Bounded, mesh)
    options, x0 = SolverOptions(tolerance=1e-10), initial_guess(nlp, None)
    whole = run_ipopt(nlp, x0, options)
    lifted = one.turned(run_ipopt(one, one.start(x0, None)[0], options))
    assert whole.status.ok and lifted.status.ok
    assert lifted.objective == pytest.approx(whole.objective, rel=SOLVER)
    assert lifted.x == pytest.approx(whole.x, abs=1e-5) and lifted.g == pytest.approx(whole.g, abs=1e-7)
    # where a bound of both unknowns acts, how much each of the two holds is the solver's choice
    p = one.pairs
    compared = np.append(p.others, p.rows[np.abs(whole.multipliers.bounds[p.gone]) < 1e-6])
    assert lifted.multipliers.rows[compared] == pytest.approx(whole.multipliers.rows[compared], abs=1e-5)
    assert np.all(lifted.x >= nlp.lbx) and np.all(lifted.x <= nlp.ubx)
    # stationary in the unknowns of the NLP, those that are given too
    gradient = np.asarray(nlp.functions["grad_f"](lifted.x, [])[1]).reshape(-1)
    jacobian = nlp.functions["jac_g"](lifted.x, [])[1]
    rows = np.asarray((jacobian.T @ ca.DM(lifted.multipliers.rows)).full()).reshape(-1)
    free = nlp.lbx < nlp.ubx
    assert np.max(np.abs(gradient + rows + lifted.multipliers.bounds)[free]) < 1e-7


def test_a_warm_start_ends_at_once():
    nlp, one = both(Bounded, Mesh(8, 3))
    options, x0 = SolverOptions(), initial_guess(nlp, None)
    cold = one.turned(run_ipopt(one, one.start(x0, None)[0], options))
    z, multipliers = one.start(cold.x, cold.multipliers)
    assert isinstance(multipliers, Multipliers)
    warm = run_ipopt(one, z, options, warm=multipliers)
    assert warm.status.ok and warm.iterations < cold.iterations / 2


def test_what_is_merged():
    def count(mesh):
        one = merged(make_nlp(build(Bounded()), mesh))
        return 0 if one is None else len(one.pairs.rows)

    assert count(Mesh(5, 3, "gauss")) == 0  # an element's end is no unknown
    assert count(Mesh(5, 3)) == 10 and count(Mesh(5, 3, control="linear")) == 15
    blocks = gt.Blocks(sizes=(2, 3))
    assert count(Mesh(5, 3, control="constant", blocks=blocks)) == 10  # the control may step


def test_functions_are_made_once_and_bounds_each_time():
    class Told(Bounded):
        far = gt.parameter(1.0)

        def constraints(self):
            yield self.x.at(self.final_time) == self.far
            yield self.v.at(self.final_time) == 0.0

    t = gt.transcribe(Told(), Mesh(6, 3))
    times = [t.solve({"far": far}).final_time for far in (1.0, 2.0, 1.0)]
    assert times[0] == pytest.approx(times[2], rel=1e-9) and times[1] > times[0] + 1.0
    first, second = merged(t.nlp), merged(t.nlp)
    assert first is not None and second is not None and first.functions is second.functions
