"""Refinement keeps limits on states between the collocation points, also where the equations hold exactly."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, refine, resimulate, solve

LIMIT, RANGE = 0.15, 1e-4  # m; and what may be missed, as a part of what x runs through


class Turn(gt.Optimization):
    """Back to 0 with opposite speed after 1 s, x within a limit: least int u^2 is 8 / (9 LIMIT) (Bryson, Ho)."""

    x = gt.variable(start=0.0, fixed=True, max=LIMIT)
    v = gt.variable(start=1.0, fixed=True)
    u = gt.input()

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u

    def objective(self):
        return gt.integral(self.u**2)

    def constraints(self):
        yield self.x.at(1.0) == 0
        yield self.v.at(1.0) == -1


class Row(Turn):
    """The same limit as a row."""

    x = gt.variable(start=0.0, fixed=True)

    def constraints(self):
        yield from super().constraints()
        yield 2 * self.x + 0 * self.v**2 <= 2 * LIMIT


@pytest.mark.parametrize("model", [Turn, Row])
@pytest.mark.parametrize("control", ["polynomial", "linear"])
def test_limits_between_the_points(model, control):
    mesh = Mesh(4, control=control)
    assert resimulate(solve(model(), mesh)).violation > RANGE * LIMIT  # why there is something to refine
    found = refine(model(), mesh, tolerance=1e-2)
    assert found.reached and found.excess.max() <= RANGE
    assert found.solution.sample(np.linspace(0.0, 1.0, 2001))["x"].max() <= LIMIT * (1 + RANGE)
    assert resimulate(found.solution).violation <= 2 * RANGE * LIMIT
    assert found.solution.objective == pytest.approx(8 / (9 * LIMIT), rel=2e-2)


def test_not_reached_is_said():
    assert not refine(Turn(), Mesh(4, control="linear"), tolerance=1e-2, passes=1).reached
