"""Regressors: efforts at other parameters by another road, and parameters in which nothing is linear."""

from __future__ import annotations

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, der
from gtmodel.identify import Regressor
from gtmodel.inference import identifiability
from tests.support.strategies import columns, random_states

# sums of some hundred products of masses up to 40 kg and accelerations up to 10 m/s2
ROUND_OFF = 1e-12
THIRTEEN = ["m_p", "m_c", "m_a", "coulomb", "viscous"]
OTHER: dict[str, Any] = dict(
    m_p=11.0, m_c=[9.0, 21.0, 30.0], m_a=[0.7, 0.2, 2.5], coulomb=[90.0, 260.0, 150.0], viscous=[40.0, 10.0, 400.0]
)


@cache
def robot(rod=None) -> gt.robots.GantryTau:
    return gt.robots.gantry_tau("l1_camera", m_a=[0.5, 1.0, 1.5], rod=rod)


def flat_values(values: dict) -> np.ndarray:
    return np.concatenate([np.atleast_1d(v) for v in values.values()])


@pytest.mark.parametrize("rod", [gt.mechanics.MidpointRod, gt.mechanics.UniformRod])
@pytest.mark.parametrize("known", ["q", "T"])
def test_another_plant_by_its_own_inverse_dynamics(known, rod):
    T, Td, Tdd, _ = columns(random_states(robot(), 50, seed=1))
    other = gt.robots.gantry_tau("l1_camera", rod=rod, **OTHER)
    q, qd, qdd, tau, _ = other.causal("T", ["q", "der(q)", "der(q,2)", "tau"])(T, Td, Tdd)
    rows = (q, qd, qdd) if known == "q" else (T, Td, Tdd)
    regressor = Regressor(robot(rod), THIRTEEN, known=known)
    found = regressor(*rows)
    assert regressor.names[:5] == ("m_p", "m_c[0]", "m_c[1]", "m_c[2]", "m_a[0]")
    assert not found.status.any()
    Y, y0 = found.stacked()
    size = np.max(np.abs(tau))
    assert np.max(np.abs(Y @ flat_values(OTHER) + y0 - tau.reshape(-1))) < ROUND_OFF * size
    assert np.max(np.abs(regressor.effort(flat_values(OTHER), *rows) - tau)) < ROUND_OFF * size


def test_what_is_not_asked_for_stays_at_its_number():
    regressor = Regressor(robot(), ["m_p", "m_c[1]"])
    s = random_states(robot(), 1, seed=2)[0]
    q, qd, qdd, tau, _ = robot().causal("T", ["q", "der(q)", "der(q,2)", "tau"])(s.T, s.Td, s.Tdd)
    found = regressor(q[None], qd[None], qdd[None])
    assert np.max(np.abs(found.y0)) > 100.0  # N; friction and the other carts
    assert found.Y[0] @ [9.13, 13.64] + found.y0[0] == pytest.approx(tau, rel=ROUND_OFF)


def test_cut_loose_and_pickled_it_stays_the_same():
    regressor = Regressor(robot(), THIRTEEN)
    rows = [np.array(x) for x in ([[0.1, 0.0, -0.1]], [[0.5, 0.4, 0.3]], [[1.0, -2.0, 3.0]])]
    copy = pickle.loads(pickle.dumps(regressor))
    assert np.array_equal(copy(*rows).Y, regressor(*rows).Y) and copy.names == regressor.names


def test_symbols_for_an_optimisation():
    regressor = Regressor(robot(), THIRTEEN)
    rows = [np.array(x) for x in ([[0.1, 0.0, -0.1]], [[0.5, 0.4, 0.3]], [[1.0, -2.0, 3.0]])]
    Y, y0, status = regressor.casadi(*[r[0] for r in rows])
    assert float(status) == 0
    found = regressor(*rows)
    assert np.array_equal(Y.full(), found.Y[0])
    assert np.array_equal(y0.full().ravel(), found.y0[0])


def test_a_row_out_of_reach_is_nan_with_its_status():
    q, rest = np.array([[0.0, 0.0, 0.0], [0.0, 50.0, 0.0]]), np.zeros((2, 3))
    found = Regressor(robot(), ["m_p"])(q, rest, rest)
    assert found.status.tolist() == [gt.Status.OK, gt.Status.OUT_OF_RANGE]
    assert np.isfinite(found.Y[0]).all() and np.isnan(found.Y[1]).all()


class Pendulum(gt.Model):
    """Not a robot of ours: a link on a motor, with its moment of inertia and its static moment."""

    J = gt.parameter(0.2, unit="kg.m2", positive=True)
    s = gt.parameter(0.5, unit="kg.m")
    d = gt.parameter(0.3, unit="rad")
    g = gt.parameter(9.81, unit="m/s2")
    phi = gt.variable(unit="rad")
    torque = gt.variable(unit="N.m")

    def equations(self):
        yield self.J * der(self.phi, 2) + self.g * self.s * gt.sin(self.phi + self.d) == self.torque


def test_any_model_of_the_language():
    rng = np.random.default_rng(3)
    phi, rate = rng.uniform(-1, 1, (2, 20))
    regressor = Regressor(Pendulum(), ["J", "s"], known="phi", targets="torque")
    names = [s.name for s in regressor.inputs]
    rows = {"phi": phi, "der(phi)": np.zeros(20), "der(phi,2)": rate}
    found = regressor(*[rows[n] for n in names])
    expected = np.stack([rate, 9.81 * np.sin(phi + 0.3)], axis=1)
    assert np.max(np.abs(found.Y[:, 0, :] - expected)) < ROUND_OFF
    assert regressor.units == ("kg.m2", "kg.m")


def test_newton_blocks_read_geometry_alone():
    d1 = gt.robots.six_link_gantry_tau()
    regressor = Regressor(d1, ["m_p", "m_c", "m_a", "viscous"], known="T")
    rng = np.random.default_rng(4)
    T = np.asarray(d1.home, dtype=float) + rng.uniform(-0.05, 0.05, (8, 3))
    Td, Tdd = rng.uniform(-1, 1, (2, 8, 3))
    tau, _ = d1.causal("T", "tau")(T, Td, Tdd)
    p = np.array([d1.m_p, *d1.m_c, *d1.m_a, *d1.viscous], dtype=float)
    assert np.max(np.abs(regressor.effort(p, T, Td, Tdd) - tau)) < 1e-9 * np.max(np.abs(tau))  # Newton's tolerance
    Y, y0, status = regressor.casadi(T[0], Td[0], Tdd[0])
    assert float(status) == 0
    assert (Y.full() @ p + y0.full().ravel()) == pytest.approx(tau[0], rel=1e-9)


def test_a_wrist_on_the_plate_and_what_its_motion_cannot_tell():
    robot = gt.robots.gantry_tau_wrist("l1_tape", m_a=[0.5, 1.0, 1.5])
    names = ["m_p", "m_c", "wrist.m", "wrist.link[0].motor.J", "viscous"]
    known = ["q", "wrist.q"]
    regressor = Regressor(robot, names, known=known, targets=["tau", "wrist.tau"])
    assert regressor.columns == ("tau[0]", "tau[1]", "tau[2]", "wrist.tau[0]", "wrist.tau[1]")
    rng = np.random.default_rng(5)
    T, Td, Tdd, _ = columns(random_states(robot, 20, seed=5))
    q, qd, qdd, _ = robot.causal("T", ["q", "der(q)", "der(q,2)"])(T, Td, Tdd)
    turning = [rng.uniform(-1, 1, (20, 2)) for _ in range(3)]
    rows = (q, qd, qdd, *turning)
    tau, wrist_tau, status = robot.causal(known, ["tau", "wrist.tau"])(*rows)
    assert not np.any(status)
    found = regressor.effort(regressor.nominal, *rows)
    assert np.max(np.abs(found - np.hstack([tau, wrist_tau]))) < ROUND_OFF * np.max(np.abs(tau))
    # with the wrist held still its first body is so much more plate: together they are told, alone they are not
    still = [np.full((20, 2), 0.3), np.zeros((20, 2)), np.zeros((20, 2))]
    masses = [k for k, unit in enumerate(regressor.units) if unit == "kg"]
    Y = regressor(q, qd, qdd, *still).Y[:, :3, masses].reshape(60, -1)  # the forces of the carts
    chosen = [regressor.names[k] for k in masses]
    told = identifiability(Y, chosen, scale=regressor.nominal[masses], known_noise=False, keep=["m_p"])
    assert told.redundant == 2
    assert told.dependencies.base("m_p") == pytest.approx({"m_p": 1.0, "wrist.m[0]": 1.0, "wrist.m[1]": 1.0})


@pytest.mark.parametrize(
    "names, sentence",
    [
        (["A"], r"not linear in parameter 'A\[0,0\]'"),
        (["velocity_scale"], "not linear in parameter 'velocity_scale'"),
        (["m_p", "world.g"], r"linear in parameter 'm_p' and in 'world.g\[0\]', but not in both"),
        (["home"], r"'home\[0\]' of GantryTau has no effect on tau"),
        (["m_q"], "no parameter 'm_q'; did you mean 'm_p'"),
        (["arm[0].rod.m"], r"depends on m_a\[0\]"),
        (["m_c", "m_c[1]"], r"'m_c\[1\]' is named twice"),
        ([], "no parameter is named"),
    ],
)
def test_wrong_parameters_are_named(names, sentence):
    with pytest.raises(gt.ModelError, match=sentence):
        Regressor(robot(), names)


def test_wrong_rows():
    regressor = Regressor(robot(), ["m_p"])
    with pytest.raises(TypeError, match=r"takes 3 arrays of rows \(q, der\(q\), der\(q,2\)\); found 1"):
        regressor(np.zeros((4, 3)))
    with pytest.raises(TypeError, match=r"'der\(q\)' takes shape \(n, 3\)"):
        regressor(np.zeros((4, 3)), np.zeros((5, 3)), np.zeros((4, 3)))


def test_the_casadi_function_says_its_status_too():
    class Pushed(gt.Model):
        m = gt.parameter(2.0)
        x = gt.variable(start=0.4)
        y = gt.variable(start=0.7)
        F = gt.variable()

        def equations(self):
            yield self.x**2 + self.y**2 == 0.65
            yield self.m * gt.der(self.y, 2) == self.F
            yield gt.branch("up", self.y)

    regressor = Regressor(Pushed(), ["m"], known="x", targets="F")
    assert regressor.casadi.name_out() == ["Y", "y0", "status"]
    for x, code in ((0.4, Status.OK), (0.9, Status.OUT_OF_RANGE), (np.nan, Status.NOT_FINITE)):
        assert int(regressor.casadi(x, 0.1, 0.2)[2]) == code
        assert int(regressor([x], [0.1], [0.2]).status[0]) == code
