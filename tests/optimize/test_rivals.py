"""What the benchmarks compare with is the same problem: equations by hand, and the same optimum on the same mesh."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.compiler.causal import compile_causal
from tests.bench.bench_path import solve_squares, symbolic
from tests.bench.rivals.l1_by_hand import Motion, data, forward_dynamics, inverse_dynamics
from tests.bench.rivals.line_in_sx import solve_line
from tests.bench.rivals.plain_casadi import solve_mx, solve_sx
from tests.bench.rivals.with_gtmodel import declared, solve_blocks

ELEMENTS = 8
SAME = 1e-6  # one discrete optimum by two NLPs, IPOPT's tolerance 1e-8
CLOSE = 2e-3  # of the final time on the line: two discretisations, coarse


@pytest.fixture(scope="module")
def motion():
    return Motion(1.0)  # much energy: one optimum, which every method finds


def test_equations_by_hand(motion):
    d = data(motion.robot)
    T, v, a = np.random.default_rng(3).uniform([0.2, -1.0, 0.1], [0.8, -0.7, 0.4], (3, 3))
    tau = compile_causal(motion.robot, known="T", targets="tau")(T, v, a)[0]
    assert np.array(inverse_dynamics(d)(T, v, a)).ravel() == pytest.approx(tau, rel=1e-11)
    assert np.array(forward_dynamics(d)(T, v, tau)).ravel() == pytest.approx(a, rel=1e-11)


def test_the_same_optimum(motion):
    ours = solve_blocks(motion, declared(motion), ELEMENTS, "polynomial", False)
    for method in (solve_sx, solve_mx):
        found = method(motion, ELEMENTS)
        assert found.converged and ours.converged
        assert found.objective == pytest.approx(ours.objective, rel=SAME)


def test_the_line_by_two_methods(motion):
    squares, radau = solve_squares(symbolic(motion.robot), 100), solve_line(motion, 30)
    assert squares.converged and radau.converged
    assert squares.objective == pytest.approx(radau.objective, rel=CLOSE)
