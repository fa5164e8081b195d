"""Mass matrices and matrices of constraint forces are symmetric and definite: operations grow as the bodies."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from tests.bench.chains import angle_chain, cartesian_chain
from tests.support.compare import relative_error

# round-off of two eliminations of a mass matrix of twelve bodies, condition about 1e3
SOLVED = 1e-9


@pytest.mark.parametrize(
    "model,known,target,prefer",
    [(angle_chain, "torque", "der(phi,2)", "phi"), (cartesian_chain, (), "der(r,2)", ())],
)
def test_operations_of_a_chain_grow_as_its_bodies(model, known, target, prefer):
    few, many = (model(n)().causal(known, target, prefer=prefer).closed.n_instructions() for n in (10, 20))
    assert many < 4 * few


def test_articulated_bodies_give_the_accelerations_of_the_mass_matrix():
    n = 12
    f = angle_chain(n)().causal("torque", "der(phi,2)", prefer="phi")
    assert "state-dependent" in f.explain()
    phi, rate, torque = np.random.default_rng(3).uniform(-2.0, 2.0, (3, 5, n))
    found, status = f(phi, rate, torque)
    assert np.all(status == gt.Status.OK)
    for k in range(
        len(phi)
    ):  # unit masses and lengths: cos(phi_i - phi_j) times the masses outwards of both; `torque` is by the link
        outwards = n - np.maximum.outer(np.arange(n), np.arange(n))
        apart = np.subtract.outer(phi[k], phi[k])
        bias = (outwards * np.sin(apart)) @ rate[k] ** 2 + 9.81 * (n - np.arange(n)) * np.sin(phi[k])
        expected = np.linalg.solve(outwards * np.cos(apart), -torque[k] - bias)
        assert relative_error(found[k], expected) < SOLVED
