"""Functions that become units in the tests, one of every sort."""

from __future__ import annotations

from functools import cache

import gtmodel as gt
from gtmodel.robots.inverse_model import InverseModel

STOP = 0.2


class Integral(gt.SampledBlock):
    kp = gt.parameter(4.0, unit="1/s")
    ki = gt.parameter(2.0, unit="1/s2")
    error = gt.input(unit="m")
    integral = gt.discrete(0.0, unit="m.s")
    speed = gt.output(unit="m/s")

    def step(self, inputs, state):
        integral = state.integral + self.period * inputs.error
        return {"speed": self.kp * inputs.error + self.ki * integral, "integral": integral}


class Loop(gt.Model):
    x = gt.variable(unit="m", start=0.0, fixed=True)
    law = gt.part(Integral, period=0.004)

    def equations(self):
        yield gt.der(self.x) == self.law.speed
        yield self.law.error == 0.1 - self.x


class Pendulum(gt.Model):
    """Nonlinear, smooth, without friction."""

    inertia = gt.parameter(1.0, unit="kg.m2", positive=True)
    weight = gt.parameter(9.0, unit="N.m")
    angle = gt.variable(unit="rad", start=1.0)
    torque = gt.input(unit="N.m")
    energy = gt.variable(unit="J")

    def equations(self):
        yield self.inertia * gt.der(self.angle, 2) == self.torque - self.weight * gt.sin(self.angle)
        yield self.energy == self.inertia * gt.der(self.angle) ** 2 / 2 - self.weight * gt.cos(self.angle)


class Cart(gt.Model):
    x = gt.variable(unit="m")
    v = gt.variable(unit="m/s")
    a = gt.input(unit="m/s2")

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.a


class Driven(gt.Model):
    """The time enters the equations."""

    rate = gt.parameter(2.0, unit="1/s")
    x = gt.variable(unit="m", start=0.5)
    u = gt.input(unit="m/s")

    def equations(self):
        yield gt.der(self.x) == self.u + self.rate * (gt.cos(self.rate * self.time) - 1.0) * self.x


class Spiral(gt.Model):
    """Newton's method beside states: a drive behind a coupling that no closed form solves."""

    stiffness = gt.parameter(2.0, unit="1/s", positive=True, max=8.0, description="of the drive")
    spring = gt.parameter(9.0, unit="1/s2")
    bend = gt.parameter(0.25, min=0.0, max=0.9)
    x = gt.variable(unit="rad", start=0.5)
    v = gt.variable(unit="rad/s", start=0.0)
    y = gt.variable(unit="rad", start=0.4)
    u = gt.input(unit="rad/s2")

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.u - self.spring * self.y - self.stiffness * self.v
        yield self.y + self.bend * gt.sin(3.0 * self.y) == self.x


def cart_filter():
    process = gt.filtering.ProcessModel(Cart(), noise={"a": 0.1}, states=["x", "v"])
    tape = gt.filtering.Sensor("tape", "x", deviation=0.01, delay=0.008, gate=0.999)
    start = gt.filtering.InitialState({}, {"x": 1.0, "v": 1.0})
    return gt.filtering.ControllerFilter(gt.filtering.System(process, [tape]), 0.004, start)


@cache
def l1():
    return gt.robots.gantry_tau("l1_tape", inertia="model_2", velocity_scale=0.1)


@cache
def d1():
    return gt.robots.make("d1_six_link")


@cache
def f1():
    return gt.robots.f1_gantry_tau()


FUNCTIONS = {
    "fk": lambda: l1().causal(known="q", targets="T"),
    "ik": lambda: l1().causal(known="T", targets="q"),
    "inverse": lambda: l1().causal(known="T", targets="tau"),
    "forward": lambda: l1().causal(known="tau", targets=["q", "der(T,2)"], prefer="T"),
    "filtered": lambda: InverseModel(robot=l1()).causal(known="reference", targets=["tau", "robot.q", "robot.T"]),
    "pendulum": lambda: Pendulum().causal(known="torque", targets=["der(angle,2)", "energy"], prefer="angle"),
    "d1_fk": lambda: d1().causal(known="q", targets=["T", "e"]),
    "f1_fk": lambda: f1().causal(known="q", targets=["T", "e"]),
    "f1_ik": lambda: f1().causal(known=["T", "e"], targets="q"),
    "driven": lambda: Driven().causal(known="u", targets="der(x)", prefer="x"),
    "spiral": lambda: Spiral().causal(known="u", targets=["der(v)", "y"], prefer=["x", "v"]),
    "filter": cart_filter,
    "block": lambda: gt.cgen.BlockFunction(Loop(), "law"),
}


@cache
def function(name: str):
    return FUNCTIONS[name]()


def unit(name: str, version: int, **options):
    return gt.fmu.export(function(name), None, version=version, name=f"u_{name}", stop=STOP, **options)


PLAIN = (
    "fk",
    "ik",
    "inverse",
    "forward",
    "filtered",
    "pendulum",
    "d1_fk",
    "f1_fk",
    "f1_ik",
    "block",
    "driven",
    "filter",
    "spiral",
)
MAKERS = {name: (lambda version, name=name: unit(name, version)) for name in PLAIN}
MAKERS["tunable"] = lambda version: unit("pendulum", version, tunable=["torque"])
KEPT = {
    "forward": ["m_p", "coulomb", "viscous"],
    "ik": ["L", "A"],
    "filtered": ["robot.m_p", "robot.coulomb"],
    "spiral": ["stiffness", "bend"],
    "f1_ik": ["L"],
}
for _name, _names in KEPT.items():  # parameters of the model stay parameters of the unit
    MAKERS[f"{_name}_p"] = lambda version, name=_name, names=_names: unit(name, version, parameters=names)
MAKERS["held"] = lambda version: unit("ik", version, on_fault="hold")
