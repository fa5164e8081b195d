"""The response by the Schur form against a linear system solved at each frequency, in which nothing is triangular."""

from __future__ import annotations

import doctest

import control
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.linear import response, roots, state_space
from gtmodel.linear.response import Transfer

D = gt.control.delayed
ROUNDING = 1e-12  # relative, of a response away from its poles


@pytest.mark.parametrize("states", [1, 2, 5, 12])
def test_a_transfer_function_is_that_of_linear_systems_solved_one_by_one(states: int) -> None:
    rng = np.random.default_rng(states)
    scale = 10 ** rng.uniform(-4, 4, states)  # states in units far apart
    A = rng.uniform(-0.9, 0.9, (states, states)) / states * scale[:, None] / scale
    entries, leaves = rng.standard_normal((states, 2)) * scale[:, None], rng.standard_normal(states) / scale
    z = np.exp(1j * np.linspace(0, np.pi, 7))
    solved = [leaves @ np.linalg.solve(x * np.eye(states) - A, entries @ [2.0, 1 / x]) for x in z]
    transfer = Transfer(A, entries, leaves)
    assert np.abs(transfer.at(z, [2.0, 1 / z]) / solved - 1).max() < ROUNDING
    assert np.abs(np.array([transfer.at(x, [2.0, 1 / x]) for x in z.tolist()]) / solved - 1).max() < ROUNDING


def test_one_frequency_is_one_of_many_and_a_pole_is_infinite() -> None:
    law = control.StateSpace([[0.5]], [[1.0]], [[0.2]], [[1.0]], 0.004)
    loop = D.DelayedLoop(D.equivalent_plant(3.0, 57.7, 34200.0, 0.004), 0.004, 0.0533, law)
    w = np.linspace(1.0, 700.0, 9)
    alone = np.array([loop.response_at(x) for x in w.tolist()])
    assert np.abs(alone / loop.response(w) - 1).max() < ROUNDING
    rigid = D.DelayedLoop(D.rigid_plant(0.004), 0.004, 0.052)
    assert rigid.response_at(0.0) == complex(np.inf) == rigid.response(np.zeros(1))[0]


@pytest.mark.parametrize("module", [response, roots, state_space], ids=lambda m: m.__name__)
def test_examples_run(module) -> None:
    done = doctest.testmod(module)
    assert done.attempted and not done.failed
