"""What may stand on a cart besides a force and smoothed friction: exact signs, a load-dependent term, a rotor."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import mechanics as m
from tests.mechanics.balance import power_balance
from tests.support.compare import relative_error
from tests.support.strategies import columns, random_states

# some hundred operations in double precision, forces up to 1e3 N
ROUND_OFF = 1e-12
NEWTON = 1e-10  # forward dynamics of the saddle term stop at 1e-13 of the nominals
SADDLE = [0.02, 0.05, 0.03]
J, RADIUS = 2e-3, 0.02  # 5 kg on the flange


@cache
def plain() -> gt.robots.GantryTau:
    return gt.robots.gantry_tau("l1_camera", m_a=[0.5, 1.0, 1.5])


@cache
def with_parts(**parts) -> gt.robots.GantryTau:
    return gt.robots.gantry_tau("l1_camera", m_a=[0.5, 1.0, 1.5], arm=parts)


@cache
def saddled() -> gt.robots.GantryTau:
    arms = [dict(guideway=m.SaddleGuideway(saddle=s, velocity_scale=0.05)) for s in SADDLE]
    return gt.robots.gantry_tau("l1_camera", m_a=[0.5, 1.0, 1.5], arm=arms)


def geared() -> gt.robots.GantryTau:
    return with_parts(motor=m.GearedMotor(J=J, radius=RADIUS))


MOTION = ["q", "der(q)", "der(q,2)", "tau"]


def motion(robot, names=MOTION, seed=1):
    T, Td, Tdd, _ = columns(random_states(plain(), 40, seed=seed))
    *found, status = robot.causal("T", names)(T, Td, Tdd)
    assert not np.any(status)
    return found


def test_the_saddle_term_goes_with_the_force_across():
    # by hand: what link and cart press across the guideway; half a link's inertia and weight count at each end
    q, qd, qdd, tau, *tension = motion(plain(), [*MOTION, *(f"arm[{i}].rod.tension" for i in range(3))])
    _, _, _, loaded = motion(saddled())
    T, _, Tdd, _ = columns(random_states(plain(), 40, seed=1))
    r, g = plain(), np.array([0.0, 0.0, -9.81])
    for i in range(3):
        v = np.asarray(r.v)[i]
        link = T - np.asarray(r.A)[i] - q[:, i, None] * v
        half = r.m_a[i] / 2 * ((Tdd + qdd[:, i, None] * v) / 2 - g)
        force = tension[i][:, None] * link - half - r.m_c[i] * (qdd[:, i, None] * v - g)
        across = force - (force @ v)[:, None] * v / (v @ v)
        load = np.sqrt(np.sum(across**2, axis=1) + 1.0) - 1.0
        expected = SADDLE[i] * load * np.tanh(qd[:, i] / 0.05)
        assert relative_error(loaded[:, i] - tau[:, i], expected, floor=np.max(np.abs(tau))) < ROUND_OFF
        assert np.max(np.abs(expected)) > 3.0  # N; there is something to see


def test_the_saddle_term_forward_and_its_power():
    q, qd, qdd, tau = motion(saddled())
    found, status = saddled().causal("tau", "der(q,2)", prefer="q")(q, qd, tau)
    assert not np.any(status)
    assert relative_error(found, qdd) < NEWTON
    assert power_balance(saddled(), {"q": q[0], "der(q)": qd[0], "der(q,2)": qdd[0]}, "q") < ROUND_OFF


def test_a_rotor_is_mass_without_weight():
    *_, qdd, tau = motion(plain())
    *_, turned = motion(geared())
    size = np.max(np.abs(tau))
    assert np.max(np.abs(turned - tau - J / RADIUS**2 * qdd)) < ROUND_OFF * size
    q, qd, qdd, _ = motion(geared())
    assert power_balance(geared(), {"q": q[0], "der(q)": qd[0], "der(q,2)": qdd[0]}, "q") < ROUND_OFF


def test_exact_signs_are_the_limit_of_smoothed_ones():
    q, qd, qdd, tau = motion(with_parts(friction=m.SignFriction))
    smooth = plain().with_(velocity_scale=1e-6)
    expected, _ = smooth.causal("q", "tau")(q, qd, qdd)
    assert np.min(np.abs(qd)) > 1e-4  # where tanh is 1 to the last digit
    assert relative_error(tau, expected) < ROUND_OFF


def test_signs_by_direction():
    friction = m.DirectionalSignFriction(coulomb_minus=100.0, viscous_minus=50.0)
    q, qd, qdd, tau = motion(with_parts(friction=friction))
    bare = plain().with_(coulomb=[0.0] * 3, viscous=[0.0] * 3).causal("q", "tau")(q, qd, qdd)[0]
    plus = np.asarray(plain().coulomb) + np.asarray(plain().viscous) * qd
    expected = bare + np.where(qd > 0, plus, -100.0 + 50.0 * qd)
    assert relative_error(tau, expected) < ROUND_OFF


def test_simulation_says_where_exact_signs_would_hold_the_carts():
    # at rest without forces the dry friction holds: neither direction of sliding goes on
    with pytest.raises(gt.ModelError, match=r"no side of sign\(\) at .* is consistent with the start.* would stick"):
        with_parts(friction=m.SignFriction).simulate(0.1, inputs={"tau": np.zeros(3)})


def test_work_of_all_forces_is_the_change_of_energy():
    # a motor that pushes to and fro against rotor, friction by direction, links and weight; integrated tightly
    friction = m.DirectionalTanhFriction(coulomb_minus=40.0, viscous_minus=50.0)
    robot = gt.robots.gantry_tau(
        "l1_camera",
        m_a=[0.5, 1.0, 1.5],
        coulomb=[30.0] * 3,
        viscous=[60.0] * 3,
        arm=dict(friction=friction, motor=m.GearedMotor(J=J, radius=RADIUS)),
    )
    hold, _ = robot.causal("T", "tau")(np.asarray(robot.home, float), np.zeros(3), np.zeros(3))
    push = {"tau": lambda t: hold + 60.0 * np.sin(6.0 * t) * np.array([1.0, 0.8, 1.2])}
    run = robot.simulate(1.0, inputs=push, start={"T": robot.home}, prefer="T", tolerance=1e-12)
    turnover = np.max(np.abs(run.trajectory["energy.dissipated"]))
    assert turnover > 1.0  # J
    assert run.energy_error is not None and run.energy_error < 1e-8 * turnover
