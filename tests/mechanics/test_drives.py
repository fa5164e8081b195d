"""Drive trains, springs and loads against formulas by hand."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, mechanics as m
from tests.mechanics.balance import power_balance
from tests.support.compare import relative_error
from tests.support.residuals import original_residuals

# Some ten operations on numbers of order 1 to 1e3.
ROUND_OFF = 1e-13
RESIDUAL = 1e-10


class BeltDrive(gt.Model):
    """Motor with rotor, gear, pulley inertia, belt, carriage with friction: what drives a gantry."""

    s = gt.variable(unit="m", prefer=1)
    torque = gt.input(unit="N.m")
    motor = gt.part(m.TorqueMotor, J=2e-3, ratio=-3.0)
    gear = gt.part(m.Gear, ratio=4.0)
    pulley = gt.part(m.Inertia, J=0.01)
    belt = gt.part(m.RackAndPinion, radius=0.05)
    carriage = gt.part(m.Mass, m=12.0)
    friction = gt.part(m.TanhFriction, coulomb=30.0, viscous=20.0)

    def equations(self):
        yield gt.connect(self.motor.shaft, self.gear.a)
        yield gt.connect(self.gear.b, self.pulley.shaft)
        yield gt.connect(self.gear.b, self.belt.shaft)
        yield gt.connect(self.belt.flange, self.carriage.flange)
        yield gt.connect(self.belt.flange, self.friction.flange)
        yield self.s == self.belt.flange.s
        yield self.torque == self.motor.torque


def test_belt_drive_is_one_reduced_mass():
    per_metre = -3.0 * 4.0 / 0.05  # motor angle per travel
    mass = 12.0 + 0.01 / 0.05**2 + 2e-3 * per_metre**2
    model = BeltDrive()
    inverse, forward = model.causal("s", "torque"), model.causal("torque", "der(s,2)")
    v, a = 0.3, 1.7
    force = mass * a + 30 * np.tanh(v / 0.1) + 20 * v
    given = {"s": 0.0, "der(s)": v, "der(s,2)": a}
    torque, status = inverse(*[given[x.name] for x in inverse.inputs])
    assert status == Status.OK
    assert relative_error(torque, force / per_metre) < ROUND_OFF
    given = {"s": 0.0, "der(s)": v, "torque": torque}
    back, status = forward(*[given[x.name] for x in forward.inputs])
    assert status == Status.OK
    assert relative_error(back, a) < 100 * ROUND_OFF  # forces of 1e2 N cancel down to the acceleration
    assert power_balance(model, given, "torque") < ROUND_OFF
    assert np.max(np.abs(original_residuals(model, given, "torque"))) < RESIDUAL


class TwoInertias(gt.Model):
    """Two rotors on a torsional spring, the second one also on a spring to the wall."""

    phi = gt.variable(2, unit="rad", prefer=1)
    rotor = gt.parts(2, m.Inertia, J=[0.2, 0.3])
    spring = gt.part(m.ShaftSpringDamper, k=40.0, d=0.5, rest=0.1)
    wall = gt.part(m.FixedShaft, phi=0.2)
    to_wall = gt.part(m.ShaftSpringDamper, k=25.0)

    def equations(self):
        yield gt.connect(self.rotor[0].shaft, self.spring.a)
        yield gt.connect(self.spring.b, self.rotor[1].shaft)
        yield gt.connect(self.to_wall.a, self.rotor[1].shaft)
        yield gt.connect(self.to_wall.b, self.wall.shaft)
        for i in range(2):
            yield self.phi[i] == self.rotor[i].shaft.phi


class TwoMasses(gt.Model):
    """The same along a line."""

    x = gt.variable(2, unit="m", prefer=1)
    mass = gt.parts(2, m.Mass, m=[0.2, 0.3])
    spring = gt.part(m.FlangeSpringDamper, k=40.0, d=0.5, rest=0.1)
    wall = gt.part(m.FixedFlange, s=0.2)
    to_wall = gt.part(m.FlangeSpringDamper, k=25.0)

    def equations(self):
        yield gt.connect(self.mass[0].flange, self.spring.a)
        yield gt.connect(self.spring.b, self.mass[1].flange)
        yield gt.connect(self.to_wall.a, self.mass[1].flange)
        yield gt.connect(self.to_wall.b, self.wall.flange)
        for i in range(2):
            yield self.x[i] == self.mass[i].flange.s


def test_springs_on_shafts_and_flanges():
    y, dy = np.array([0.3, -0.4]), np.array([1.0, 2.0])
    pull = 40 * (y[1] - y[0] - 0.1) + 0.5 * (dy[1] - dy[0])
    expected = np.array([pull / 0.2, (-pull + 25 * (0.2 - y[1])) / 0.3])
    for model, name in ((TwoInertias(), "phi"), (TwoMasses(), "x")):
        f = model.causal((), f"der({name},2)")
        found, status = f(y, dy)
        assert status == Status.OK
        assert relative_error(found, expected) < ROUND_OFF
        assert power_balance(model, {name: y, f"der({name})": dy}) < ROUND_OFF


class HungMass(gt.Model):
    """A point mass on a spring from a fixed point, pushed by a force."""

    r = gt.variable(3, unit="m", start=[0.3, 0.2, -1.0], prefer=1)
    force = gt.input(3, unit="N")
    anchor = gt.part(m.Anchor, r=[0.1, 0.2, 0.5])
    spring = gt.part(m.SpringDamper, k=80.0, d=3.0, length0=1.2)
    mass = gt.part(m.PointMass, m=0.7)
    load = gt.part(m.PointLoad)

    def equations(self):
        yield gt.connect(self.anchor.point, self.spring.a)
        yield gt.connect(self.spring.b, self.mass.frame)
        yield gt.connect(self.load.frame, self.mass.frame)
        yield self.mass.frame.r == self.r
        yield self.force == self.load.force


def test_spring_between_points():
    r, v, force = np.array([0.4, -0.1, -1.1]), np.array([0.3, 1.0, -0.5]), np.array([2.0, 3.0, -1.0])
    away = r - [0.1, 0.2, 0.5]
    length = np.linalg.norm(away)
    pull = 80 * (length - 1.2) + 3 * (away @ v) / length
    expected = (force - pull * away / length) / 0.7 + [0, 0, -9.81]
    model = HungMass()
    f = model.causal("force", ["der(r,2)", "spring.pull", "spring.length"])
    found, tension, distance, status = f(r, v, force)
    assert status == Status.OK
    assert relative_error(found, expected) < ROUND_OFF
    assert relative_error([tension, distance], [pull, length]) < ROUND_OFF
    values = {"r": r, "der(r)": v, "force": force}
    assert power_balance(model, values, "force") < ROUND_OFF
    assert np.max(np.abs(original_residuals(model, values, "force"))) < RESIDUAL


def test_a_spring_without_damping_between_massless_flanges_names_what_to_give():
    bench = gt.Builder("bench")
    spring = bench.part("spring", gt.mechanics.FlangeSpringDamper(k=1000.0))
    left, right = bench.part("left", gt.mechanics.FixedFlange()), bench.part("right", gt.mechanics.ForceMotor())
    bench.add(gt.connect(left.flange, spring.a), gt.connect(spring.b, right.flange))
    sentence = r"der\(spring.b.s\) drops out because spring.d is 0; set spring.d to another value$"
    with pytest.raises(gt.ModelError, match=sentence):
        bench.causal(known="right.force", targets=["spring.b.s"])
