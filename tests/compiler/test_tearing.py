"""Blocks torn at the unknowns that determine the others."""

from __future__ import annotations

import casadi as ca
import numpy as np

from gtmodel.compiler.tearing import determines, torn

Q, A, B = (ca.SX.sym(name) for name in "qab")
EQUATIONS = [2.0 * A - ca.sin(Q), B - Q * A + 1.0, A + B - 3.0]


def test_preferred_unknown_determines_the_others() -> None:
    block = torn(EQUATIONS, [A, B, Q], [-3, -3, 0])
    assert block is not None and [u.name() for u in block.unknowns] == ["q"] and len(block.residuals) == 1
    assert [u.name() for u, _ in block.assignments] == ["a", "b"]
    f = ca.Function("residual", [Q], block.residuals)
    for q in np.linspace(-2.0, 2.0, 5):
        a = np.sin(q) / 2
        assert abs(float(f(q)) - (a + (q * a - 1.0) - 3.0)) < 1e-15  # round-off of numbers of size one


def test_unknowns_without_a_number_as_coefficient_are_not_solved_for() -> None:
    assert torn([Q * A - 1.0, A - ca.cos(Q)], [A, Q], [0, -1]) is None
    assert determines(EQUATIONS[:2], [A, B, Q], [2])
    assert not determines(EQUATIONS, [A, B, Q], [2])  # one equation too many: a loop
    assert not determines([Q * A - 1.0], [A, Q], [1])
