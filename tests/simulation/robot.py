"""The L1 prototype in motion, and the same motion by hand: eqs. (6.3)-(6.8) transcribed, integrated by SciPy."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

import gtmodel as gt
from tests.oracle.hand_written import ThreeLink

T0 = np.array([0.5, -0.9, 0.3])
AHEAD = np.ones(3)


@cache
def l1(velocity_scale: float = 0.1, smoothing: str = "tanh", friction: float = 1.0) -> gt.Model:
    """The prototype of Dressler 2012 with link masses of our own, so that no term of (6.7) is left out."""
    robot = gt.robots.gantry_tau("l1_tape", velocity_scale=velocity_scale, smoothing=smoothing)
    return robot.with_(
        m_a=[1.5, 2.0, 2.5], coulomb=friction * np.array(robot.coulomb), viscous=friction * np.array(robot.viscous)
    )


def oracle(robot: gt.Model) -> ThreeLink:
    names = ("A", "L", "m_p", "m_c", "m_a", "coulomb", "viscous")
    return ThreeLink(*(np.array(getattr(robot, k), float) for k in names), float(robot.velocity_scale))


def by_hand(robot: gt.Model, times, force=lambda t: np.zeros(3), start=T0, velocity=(0.0, 0.0, 0.0), method="DOP853"):
    """(T, der(T), q) at the times."""
    hand = oracle(robot)

    def rates(t, y):
        q = hand.inverse_kinematics(y[:3], AHEAD)
        return np.concatenate([y[3:], hand.forward_dynamics(y[:3], q, y[3:], force(t))[0]])

    run = solve_ivp(
        rates, (times[0], times[-1]), np.concatenate([start, velocity]), method, times, rtol=1e-11, atol=1e-12
    )
    assert run.success
    T, Td = run.y[:3].T, run.y[3:].T
    return T, Td, np.array([hand.inverse_kinematics(x, AHEAD) for x in T])
