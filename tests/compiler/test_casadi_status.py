"""The ca.Function of a causality says with its values whether they are an answer, as its call does."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.compiler.causal import CausalFunction

SAME = 1e-9


def both(f: CausalFunction, rows: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """Codes of the call, codes of the ca.Function, and the largest difference of the values where both are OK."""
    *values, status = f(*rows)
    results = f.casadi.map(len(status))(*[r.reshape(len(status), -1).T for r in rows])
    assert f.casadi.name_out(len(values)) == "status" and f.casadi.name_out(len(values) + 1) == "margins"
    said = np.asarray(results[len(values)]).ravel().astype(int)
    ok = (status == Status.OK) & (said == Status.OK)
    found = np.hstack([np.asarray(r).T for r in results[: len(values)]])[ok]
    expected = np.hstack([v.reshape(len(status), -1) for v in values])[ok]
    return np.asarray(status), said, float(np.max(np.abs(found - expected), initial=0.0))


def spoilt(rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    rows = rows.copy()
    rows[3, 0], rows[7, -1], rows[11, 0] = np.nan, np.inf, -np.inf
    rows[12:20] += rng.standard_normal((8, rows.shape[1]))
    return rows


@pytest.mark.parametrize("known", ["q", "T"])
def test_closed_forms_say_the_same(known: str):
    robot = gt.robots.gantry_tau("l1_tape")
    f = robot.causal(known, "T" if known == "q" else ["q", "der(q)"])
    rng = np.random.default_rng(0)
    rows = [1.5 * rng.standard_normal((200, s.size)) for s in f.inputs]
    rows[0] = spoilt(rows[0], rng)
    called, said, difference = both(f, rows)
    np.testing.assert_array_equal(called, said)
    assert {Status.OK, Status.OUT_OF_RANGE, Status.NOT_FINITE} <= set(called.tolist()) and difference == 0.0
    parametric = f.casadi_parametric
    p = np.tile(f.flat.p0[:, None], 200)
    again = np.asarray(parametric.map(200)(*[r.T for r in rows], p)[len(f.outputs)]).ravel()
    assert np.mean(again == called) > 0.99  # rounding differs at the edge


def test_newton_blocks_never_claim_what_the_call_refuses():
    robot = gt.robots.f1_gantry_tau()
    forward, inverse = robot.causal("q", ["T", "e"]), robot.causal(["T", "e"], "q")
    rng = np.random.default_rng(1)
    home = np.array([0.72, 0.26, 0.21, 0.0, 0.0, 0.0])
    q = home + np.array([0.3, 0.3, 0.3, 0.8, 0.8, 0.8]) * rng.uniform(-1, 1, (40, 6))
    called, said, difference = both(forward, [spoilt(q, rng)])
    assert not np.any((said == Status.OK) & (called != Status.OK)) and difference < SAME
    assert np.sum(said == Status.OK) > 20 and np.sum(said == Status.NOT_FINITE) == 3
    T, e, _ = forward(q)
    T = spoilt(np.where(np.isfinite(T), T, 0.0), rng)
    e = np.where(np.isfinite(e), e, 0.5)
    e[0] *= 1.01
    called, said, difference = both(inverse, [T, e])
    assert not np.any((said == Status.OK) & (called != Status.OK)) and difference < SAME
    assert np.sum(said == Status.OK) > 15 and said[0] != Status.OK and np.any(said == Status.NOT_CONVERGED)


class Screw(gt.Model):
    """An angle that no closed form gives, with solutions a turn apart and no solution beyond a load."""

    a = gt.variable(start=0.2)
    load = gt.variable(start=0.2)

    def equations(self):
        yield gt.sin(self.a) + 0.05 * gt.sin(3 * self.a) == self.load


def test_no_solution_another_turn_away():
    f = Screw().causal("load", "a")
    loads = np.concatenate([np.linspace(-0.9, 0.9, 19), [0.97, 1.3, 5.0, -40.0, np.nan]])
    called, said, difference = both(f, [loads])
    assert np.all(said[:19] == Status.OK) and difference < SAME
    assert np.all(said[20:23] == Status.NOT_CONVERGED) and said[23] == Status.NOT_FINITE
    assert not np.any((said == Status.OK) & (called != Status.OK))
