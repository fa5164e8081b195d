"""Models whose equations have no closed form: Newton unknowns ride along in IDAS."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import gtmodel as gt
from gtmodel import der
from gtmodel.simulation import simulate
from tests.simulation.models import FourBarInAngles

TOLERANCE = 1e-11
# IDAS holds the tolerance per step; over some hundred steps of a 3 s run that adds up to 1e-9.
INTEGRATOR = 1e-8

A, B, C, D, J, K = 0.3, 0.7, 0.6, 0.8, 0.2, 0.5


def rocker(phi):
    """Angle of the rocker and its slope over the crank angle: law of cosines in the triangle pin, joint, foot."""
    pin = A * np.exp(1j * phi)
    diagonal = D - pin
    e = abs(diagonal)
    at_pin = np.arccos((e**2 + B**2 - C**2) / (2 * e * B))
    joint = pin + B * diagonal / e * np.exp(1j * at_pin)
    lever, coupler = joint - D, joint - pin
    # the joint turns about the foot, and along the coupler it moves as the pin does
    slope = np.real(np.conj(coupler) * 1j * pin) / np.real(np.conj(coupler) * 1j * lever)
    return np.angle(lever), slope


def inertia(phi):
    return J + K * rocker(phi)[1] ** 2


@pytest.fixture(scope="module")
def run():
    start = {"phi": 0.5, "der(phi)": 4.0}
    return simulate(
        FourBarInAngles(), 3.0, inputs={"torque": 0.0}, start=start, tolerance=TOLERANCE, outputs="der(psi)"
    )


def test_it_is_solved_by_newton_and_keeps_its_equations(run):
    f = FourBarInAngles().causal("torque", "der(phi,2)", prefer="phi")
    assert "Newton" in f.explain()
    assert run.states == ("phi", "der(phi)") and run.residual < 1e-12


def test_positions_and_velocities_by_geometry(run):
    t = run.trajectory
    psi, slope = np.array([rocker(phi) for phi in t["phi"]]).T
    assert np.exp(1j * t["psi"]) == pytest.approx(np.exp(1j * psi), abs=1e-12)
    assert t["der(psi)"] == pytest.approx(slope * t["der(phi)"], abs=1e-10)
    assert t["phi"][-1] > 2 * np.pi  # all the way round


def test_speed_and_time_by_energy(run):
    t = run.trajectory
    speed = 4.0 * np.sqrt(inertia(0.5) / np.array([inertia(phi) for phi in t["phi"]]))
    assert t["der(phi)"] == pytest.approx(speed, abs=INTEGRATOR)
    assert np.ptp(speed) > 1.0

    def rate(phi):
        return np.sqrt(inertia(phi) / inertia(0.5)) / 4.0

    for k in (100, 500):
        needed = quad(rate, 0.5, t["phi"][k], epsabs=1e-12, epsrel=1e-12, limit=200)[0]
        assert needed == pytest.approx(t.time[k], abs=INTEGRATOR)


def test_a_torque_does_its_work(run):
    run = simulate(
        FourBarInAngles(), 2.0, inputs={"torque": lambda t: 3 * np.sin(2 * t)}, start={"phi": 0.5}, tolerance=1e-10
    )
    turnover = np.max(np.abs(run.trajectory["energy.supplied"]))
    assert turnover > 1.0 and run.energy_error is not None and run.energy_error < 1e-6 * turnover


def test_prescribed_motion_needs_newton_too():
    run = simulate(FourBarInAngles(), 1.0, step=0.1, inputs={"phi": lambda t: 0.5 + 2 * t}, outputs=["der(psi)"])
    t = run.trajectory
    assert run.states == () and run.residual < 1e-12
    for k, phi in enumerate(t["phi"]):
        psi, slope = rocker(phi)
        assert [t["psi"][k], t["der(psi)"][k]] == pytest.approx([psi, 2 * slope], abs=1e-11)


def test_an_implicit_equation_with_a_discontinuity_of_its_input():
    class Implicit(gt.Model):
        x = gt.variable(unit="1", start=0.0, fixed=True)
        y = gt.variable(unit="1", start=0.3)
        u = gt.input(unit="1")
        tau = gt.parameter(1.0, unit="s")

        def equations(self):
            yield self.tau * der(self.x) == self.y - self.x
            yield self.y + gt.sin(self.y) / 2 == self.u

    table = (np.array([0.0, 0.4]), np.array([0.5, 2.0]))
    run = simulate(Implicit(), 1.0, inputs={"u": (table, "previous")}, tolerance=TOLERANCE)
    low, high = (brentq(lambda y, u=u: y + np.sin(y) / 2 - u, 0.0, 3.0, xtol=1e-14) for u in (0.5, 2.0))
    assert run.trajectory["y"][[0, -1]] == pytest.approx([low, high], abs=1e-11)
    expected = high + (low * (1 - np.exp(-0.4)) - high) * np.exp(-0.6)
    assert run.trajectory["x"][-1] == pytest.approx(expected, abs=INTEGRATOR)
