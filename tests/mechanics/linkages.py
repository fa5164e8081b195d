"""Slider-crank and four-bar from parts: cranks are joints, couplers are rods between points."""

from __future__ import annotations

import gtmodel as gt
from gtmodel.mechanics import (
    Anchor,
    FixedTranslation,
    ForceMotor,
    Ground,
    Guideway,
    Plane,
    PointFrame,
    PointMass,
    PointOnFrame,
    Revolute,
    RigidBody,
    TorqueMotor,
    UniformRod,
)


class Crank(gt.Model):
    """A driven crank about z of the world, with inertia J [kg m2] about its axis; its pin is at the radius r [m]."""

    r = gt.parameter(unit="m", positive=True)
    J = gt.parameter(0.0, unit="kg.m2")
    phi = gt.variable(unit="rad", start=0.7, prefer=1)
    ground = gt.part(Ground)
    joint = gt.part(Revolute)
    wheel = gt.part(RigidBody, m=0.0, I=lambda self: [[0, 0, 0], [0, 0, 0], [0, 0, self.J]])
    arm = gt.part(FixedTranslation, d=lambda self: [self.r, 0.0, 0.0])
    eye = gt.part(PointOnFrame)
    pin = gt.port(PointFrame)
    motor = gt.part(TorqueMotor)

    def equations(self):
        yield gt.connect(self.ground.frame, self.joint.a)
        yield gt.connect(self.joint.b, self.wheel.frame)
        yield gt.connect(self.joint.b, self.arm.a)
        yield gt.connect(self.arm.b, self.eye.frame)
        yield gt.connect(self.eye.point, self.pin)
        yield gt.connect(self.motor.shaft, self.joint.shaft)
        yield self.phi == self.joint.shaft.phi


class SliderCrank(gt.Model):
    """Crank, rod and a mass on a slide along x; branch `ahead`: the slider is ahead of the pin."""

    r = gt.parameter(0.3, unit="m", positive=True)
    l = gt.parameter(0.8, unit="m", positive=True)
    J = gt.parameter(0.05, unit="kg.m2")
    m_rod = gt.parameter(1.2, unit="kg")
    m = gt.parameter(2.5, unit="kg", positive=True)
    phi = gt.variable(unit="rad", start=0.7, prefer=1)
    s = gt.variable(unit="m", start=1.0)
    torque = gt.input(unit="N.m")
    force = gt.input(unit="N")
    crank = gt.part(Crank, r=r, J=J)
    rod = gt.part(UniformRod, L=l, m=m_rod)
    slide = gt.part(Guideway, A=[0.0, 0.0, 0.0], v=[1.0, 0.0, 0.0])
    slider = gt.part(PointMass, m=m)
    pusher = gt.part(ForceMotor)

    def equations(self):
        yield gt.connect(self.crank.pin, self.rod.a)
        yield gt.connect(self.rod.b, self.slide.frame)
        yield gt.connect(self.slide.frame, self.slider.frame)
        yield gt.connect(self.pusher.flange, self.slide.flange)
        yield self.phi == self.crank.phi
        yield self.torque == self.crank.motor.torque
        yield self.s == self.slide.flange.s
        yield self.force == self.pusher.force
        yield gt.branch("ahead", self.rod.b.r[0] - self.rod.a.r[0])


class FourBar(gt.Model):
    """Crank a, coupler b, rocker c, frame d in the plane z = 0; C is the joint of coupler and rocker, with a mass.

    Branch `open`: C is on the left of the line from the crank's pin to the rocker's foot.
    """

    a = gt.parameter(0.3, unit="m", positive=True)
    b = gt.parameter(0.7, unit="m", positive=True)
    c = gt.parameter(0.6, unit="m", positive=True)
    d = gt.parameter(0.8, unit="m", positive=True)
    m = gt.parameter(1.5, unit="kg", positive=True)
    phi = gt.variable(unit="rad", start=0.7, prefer=1)
    C = gt.variable(3, unit="m", start=[0.6, 0.5, 0.0])
    psi = gt.variable(unit="rad", description="angle of the rocker")
    torque = gt.input(unit="N.m")
    crank = gt.part(Crank, r=a)
    coupler = gt.part(UniformRod, L=b, m=0.9)
    rocker = gt.part(UniformRod, L=c, m=1.1)
    foot = gt.part(Anchor, r=lambda self: [self.d, 0.0, 0.0])
    mass = gt.part(PointMass, m=m)
    plane = gt.part(Plane)

    def equations(self):
        yield gt.connect(self.crank.pin, self.coupler.a)
        yield gt.connect(self.coupler.b, self.mass.frame)
        yield gt.connect(self.foot.point, self.rocker.a)
        yield gt.connect(self.rocker.b, self.mass.frame)
        yield gt.connect(self.plane.frame, self.mass.frame)
        yield self.phi == self.crank.phi
        yield self.torque == self.crank.motor.torque
        yield self.mass.frame.r == self.C
        yield self.psi == gt.atan2(self.C[1], self.C[0] - self.d)
        pin, diagonal = self.coupler.a.r, self.rocker.a.r - self.coupler.a.r
        yield gt.branch("open", diagonal[0] * (self.C[1] - pin[1]) - diagonal[1] * (self.C[0] - pin[0]))
