"""Small models whose motion is known, for the tests of the simulation."""

from __future__ import annotations

import numpy as np

import gtmodel as gt
from gtmodel import der
from gtmodel.mechanics import (
    FixedFlange,
    FlangeSpringDamper,
    ForceMotor,
    Gear,
    Inertia,
    Mass,
    ShaftSpringDamper,
    TorqueMotor,
)
from tests.support.models import Pendulum


class SwingingPendulum(Pendulum):
    """The Cartesian pendulum, with its energy."""

    def equations(self):
        yield from super().equations()
        square = der(self.x) ** 2 + der(self.y) ** 2
        yield gt.energy(stored=self.m * square / 2 + self.m * self.g * self.y)


class FourBarInAngles(gt.Model):
    """Four-bar with inertias at crank and rocker, no gravity, written in angles: its closure needs Newton's method."""

    a = gt.parameter(0.3, unit="m", positive=True, description="crank")
    b = gt.parameter(0.7, unit="m", positive=True, description="coupler, massless")
    c = gt.parameter(0.6, unit="m", positive=True, description="rocker")
    d = gt.parameter(0.8, unit="m", positive=True, description="frame")
    J = gt.parameter(0.2, unit="kg.m2", positive=True, description="inertia of the crank")
    K = gt.parameter(0.5, unit="kg.m2", positive=True, description="inertia of the rocker")
    phi = gt.variable(unit="rad", start=0.5, prefer=1, description="crank")
    beta = gt.variable(unit="rad", start=0.7, description="coupler")
    psi = gt.variable(unit="rad", start=1.5, description="rocker")
    pull = gt.variable(unit="N", description="force in the coupler")
    torque = gt.input(unit="N.m")

    def equations(self):
        along = gt.vector([gt.cos(self.beta), gt.sin(self.beta)])
        crank = gt.vector([gt.cos(self.phi), gt.sin(self.phi)])
        rocker = gt.vector([gt.cos(self.psi), gt.sin(self.psi)])
        yield self.a * crank + self.b * along == gt.vector([self.d + self.c * rocker[0], self.c * rocker[1]])
        moment = self.a * self.pull * (crank[0] * along[1] - crank[1] * along[0])
        yield self.J * der(self.phi, 2) == self.torque + moment
        yield self.K * der(self.psi, 2) == -self.c * self.pull * (rocker[0] * along[1] - rocker[1] * along[0])
        kinetic = self.J / 2 * der(self.phi) ** 2 + self.K / 2 * der(self.psi) ** 2
        yield gt.energy(stored=kinetic, supplied=self.torque * der(self.phi))


class TwoMasses(gt.Model):
    """Wall, spring, mass, spring with damper, mass; a force on the first mass."""

    k = gt.parameter([300.0, 200.0], unit="N/m")
    d = gt.parameter([0.0, 0.0], unit="N.s/m")
    m = gt.parameter([2.0, 1.5], unit="kg")
    s = gt.variable(2, unit="m", prefer=1)
    F = gt.input(unit="N")
    wall = gt.part(FixedFlange)
    spring = gt.parts(2, FlangeSpringDamper, k=k, d=d)
    mass = gt.parts(2, Mass, m=m)
    motor = gt.part(ForceMotor)

    def equations(self):
        yield gt.connect(self.wall.flange, self.spring[0].a)
        yield gt.connect(self.spring[0].b, self.mass[0].flange)
        yield gt.connect(self.mass[0].flange, self.spring[1].a)
        yield gt.connect(self.spring[1].b, self.mass[1].flange)
        yield gt.connect(self.motor.flange, self.mass[0].flange)
        yield self.F == self.motor.force
        for i in range(2):
            yield self.s[i] == self.mass[i].flange.s

    def matrices(self):
        """Mass, damping and stiffness matrices by hand."""
        k, d = (np.array(x, dtype=float) for x in (self.k, self.d))

        def chain(x):
            return np.array([[x[0] + x[1], -x[1]], [-x[1], x[1]]])

        return np.diag(np.array(self.m, dtype=float)), chain(d), chain(k)


class DriveTrain(gt.Model):
    """Motor with rotor inertia, gear, elastic shaft, load."""

    J_motor = gt.parameter(1e-3, unit="kg.m2")
    ratio = gt.parameter(50.0, unit="1", nonzero=True)
    k = gt.parameter(4e3, unit="N.m/rad")
    J_load = gt.parameter(5.0, unit="kg.m2")
    phi = gt.variable(unit="rad", prefer=1, description="angle of the load")
    torque = gt.input(unit="N.m", description="of the motor")
    motor = gt.part(TorqueMotor, J=J_motor)
    gear = gt.part(Gear, ratio=ratio)
    shaft = gt.part(ShaftSpringDamper, k=k)
    load = gt.part(Inertia, J=J_load)

    def equations(self):
        yield gt.connect(self.motor.shaft, self.gear.a)
        yield gt.connect(self.gear.b, self.shaft.a)
        yield gt.connect(self.shaft.b, self.load.shaft)
        yield self.phi == self.load.shaft.phi
        yield self.torque == self.motor.torque
