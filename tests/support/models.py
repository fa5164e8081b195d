"""Small models with known answers, written in the language; none of them needs gtmodel.robots."""

from __future__ import annotations

import gtmodel as gt
from gtmodel import der


class Pendulum(gt.Model):
    """Point mass on a massless rod in Cartesian coordinates, y upwards; index 3."""

    L = gt.parameter(1.0, unit="m", positive=True)
    m = gt.parameter(1.0, unit="kg", positive=True)
    g = gt.parameter(9.81, unit="m/s2")
    x = gt.variable(unit="m", start=0.6)
    y = gt.variable(unit="m", start=-0.8)
    tension = gt.variable(unit="N/m")

    def equations(self):
        yield self.m * der(self.x, 2) == -self.tension * self.x
        yield self.m * der(self.y, 2) == -self.tension * self.y - self.m * self.g
        yield self.x**2 + self.y**2 == self.L**2


class SliderCrank(gt.Model):
    """Crank pin P on a circle, rod of length l, slider at (s, 0); masses at pin and slider, no gravity.

    Branches: `up`: the pin is above the slider's line; `right`: the slider is right of the pin.
    """

    r = gt.parameter(0.3, unit="m", positive=True)
    l = gt.parameter(0.8, unit="m", positive=True)
    m_P = gt.parameter(1.5, unit="kg", positive=True)
    m_s = gt.parameter(2.5, unit="kg", positive=True)
    P = gt.variable(2, unit="m", start=[0.2, 0.22])
    s = gt.variable(unit="m", start=0.97)
    radial = gt.variable(unit="N/m", description="pull of the crank per length")
    tension = gt.variable(unit="N/m", description="pull of the rod per length")
    torque = gt.input(unit="N.m")
    force = gt.input(unit="N")

    def equations(self):
        rod = gt.vector([self.s - self.P[0], -self.P[1]])
        turned = gt.vector([-self.P[1], self.P[0]])
        yield gt.dot(self.P, self.P) == self.r**2
        yield gt.dot(rod, rod) == self.l**2
        drive = self.torque / self.r**2 * turned
        yield self.m_P * der(self.P, 2) == drive - self.radial * self.P + self.tension * rod
        yield self.m_s * der(self.s, 2) == self.force - self.tension * rod[0]
        yield gt.branch("up", self.P[1])
        yield gt.branch("right", rod[0])


class FourBar(gt.Model):
    """Planar four-bar A B C D in Cartesian coordinates; branch `open`: C is on the left of the line B to D."""

    a = gt.parameter(0.3, unit="m", positive=True, description="crank A to B")
    b = gt.parameter(0.7, unit="m", positive=True, description="coupler B to C")
    c = gt.parameter(0.6, unit="m", positive=True, description="rocker D to C")
    d = gt.parameter(0.8, unit="m", positive=True, description="frame A to D")
    theta = gt.variable(unit="1", description="crank angle in rad")
    B = gt.variable(2, unit="m")
    C = gt.variable(2, unit="m", start=[0.5, 0.5])

    def equations(self):
        yield gt.vector([self.a * gt.cos(self.theta), self.a * gt.sin(self.theta)]) == self.B
        coupler = self.C - self.B
        rocker = gt.vector([self.C[0] - self.d, self.C[1]])
        yield gt.dot(coupler, coupler) == self.b**2
        yield gt.dot(rocker, rocker) == self.c**2
        diagonal = gt.vector([self.d - self.B[0], -self.B[1]])
        yield gt.branch("open", diagonal[0] * coupler[1] - diagonal[1] * coupler[0])


class Pin(gt.Connector):
    """Electrical pin: potential v, current i into the component."""

    v = gt.potential(unit="V")
    i = gt.flow(unit="A")


class TwoPins(gt.Model):
    """Base of two-pin components: voltage v from p to n, current i from p to n."""

    p = gt.port(Pin)
    n = gt.port(Pin)
    v = gt.variable(unit="V")
    i = gt.variable(unit="A")

    def equations(self):
        yield self.v == self.p.v - self.n.v
        yield self.p.i == self.i
        yield self.p.i + self.n.i == 0
        yield self.law()

    def law(self):
        raise NotImplementedError


class Resistor(TwoPins):
    R = gt.parameter(unit="Ohm", positive=True)

    def law(self):
        return self.v == self.R * self.i


class Capacitor(TwoPins):
    C = gt.parameter(unit="F", positive=True)

    def law(self):
        return self.C * der(self.v) == self.i


class Inductor(TwoPins):
    L = gt.parameter(unit="H", positive=True)

    def law(self):
        return self.L * der(self.i) == self.v


class Source(TwoPins):
    """Voltage source: its voltage is given from outside."""

    def law(self):
        return []


class Ground(gt.Model):
    p = gt.port(Pin)

    def equations(self):
        yield self.p.v == 0


class SeriesRLC(gt.Model):
    """Source, resistor, inductor and capacitor in one loop."""

    R = gt.parameter(2.0, unit="Ohm", positive=True)
    L = gt.parameter(0.5, unit="H", positive=True)
    C = gt.parameter(0.1, unit="F", positive=True)
    u = gt.input(unit="V")
    source = gt.part(Source)
    resistor = gt.part(Resistor, R=R)
    inductor = gt.part(Inductor, L=L)
    capacitor = gt.part(Capacitor, C=C)
    ground = gt.part(Ground)

    def equations(self):
        yield self.source.v == self.u
        yield gt.connect(self.source.p, self.resistor.p)
        yield gt.connect(self.resistor.n, self.inductor.p)
        yield gt.connect(self.inductor.n, self.capacitor.p)
        yield gt.connect(self.capacitor.n, self.source.n)
        yield gt.connect(self.source.n, self.ground.p)


class Bridge(gt.Model):
    """Wheatstone bridge: five resistors between a source and ground; R[4] is the detector."""

    R = gt.parameter([1.0, 2.0, 3.0, 5.0, 7.0], unit="Ohm", positive=True)
    u = gt.input(unit="V")
    source = gt.part(Source)
    resistor = gt.parts(5, Resistor, R=R)
    ground = gt.part(Ground)

    def equations(self):
        top_left, bottom_left, top_right, bottom_right, detector = self.resistor
        yield self.source.v == self.u
        yield gt.connect(self.source.n, self.ground.p)
        yield gt.connect(self.source.p, top_left.p)
        yield gt.connect(self.source.p, top_right.p)
        yield gt.connect(top_left.n, bottom_left.p)
        yield gt.connect(top_left.n, detector.p)
        yield gt.connect(top_right.n, bottom_right.p)
        yield gt.connect(top_right.n, detector.n)
        yield gt.connect(bottom_left.n, self.ground.p)
        yield gt.connect(bottom_right.n, self.ground.p)
