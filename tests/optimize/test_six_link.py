"""The six-link robot, whose forward kinematics has no closed form: optimised torn and whole."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, resimulate, solve

HOME = np.array([-0.5, -0.4, -0.5])


class Shift(gt.Optimization):
    """All carts 0.1 m on within 1 s, from rest to rest, at least effort."""

    robot = gt.part(gt.robots.six_link_gantry_tau())
    final_time = 1.0

    def objective(self):
        return 1e-4 * gt.integral(gt.dot(self.robot.tau, self.robot.tau))

    def constraints(self):
        yield self.robot.q.at(0.0) == HOME
        yield der(self.robot.q).at(0.0) == 0
        yield self.robot.q.at(1.0) == HOME + 0.1
        yield der(self.robot.q).at(1.0) == 0


@pytest.mark.proof  # planning 260 unknowns takes half a minute
def test_six_links_torn_and_whole():
    model, prefer = Shift(), ("robot.q",)
    torn = solve(model, Mesh(4, 2), solver=SolverOptions(prefer=prefer))
    assert torn.problem.formulation == "torn" and len(torn.problem.point_names) == 7
    forward = gt.robots.six_link_gantry_tau().causal(known="q", targets="T")
    q, T = torn.trajectory["robot.q"], torn.trajectory["robot.T"]
    expected, status = forward(q)
    assert np.all(status == gt.Status.OK) and expected[1:] == pytest.approx(T[1:], abs=1e-6)
    # the same discrete problem: a solution of one is one of the other, without an iteration
    whole = solve(model, Mesh(4, 2), guess=torn, solver=SolverOptions(prefer=prefer, formulation="dae"))
    assert whole.iterations <= 2 and whole.objective == pytest.approx(torn.objective, rel=1e-7)
    assert resimulate(torn).status.ok
