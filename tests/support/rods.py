"""A point plate on rods between guideways: the three-link robot, and one with a fourth, parallel rod."""

from __future__ import annotations

import gtmodel as gt
from gtmodel.mechanics import ForceMotor, Guideway, MidpointRod, PointFrame, PointMass


class Shift(gt.Model):
    """Point b stands at a fixed offset from point a and passes its force on."""

    offset = gt.parameter(shape=3, unit="m")
    a = gt.port(PointFrame)
    b = gt.port(PointFrame)

    def equations(self):
        yield self.b.r == self.a.r + self.offset
        yield self.a.f + self.b.f == 0


class ThreeRods(gt.Model):
    """Three driven carts and a point plate."""

    A = gt.parameter([[0.0, 0.0, 1.4], [0.2, -1.3, 1.5], [0.0, 0.0, 0.0]], unit="m")
    v = gt.parameter([[1.0, 0.0, 0.0], [0.99, 0.02, 0.0], [1.01, 0.0, -0.01]], unit="1")
    L = gt.parameter([2.0, 1.8, 1.9], unit="m", positive=True)
    m_p = gt.parameter(9.0, unit="kg", positive=True)
    m_c = gt.parameter([13.0, 14.0, 38.0], unit="kg", positive=True)
    m_a = gt.parameter([1.0, 2.0, 3.0], unit="kg", positive=True)
    home = gt.parameter([1.5, -0.5, 0.8], unit="m")
    q = gt.variable(3, unit="m")
    T = gt.variable(3, unit="m", start=home, prefer=1)
    tau = gt.input(3, unit="N")
    guideway = gt.parts(3, Guideway, A=A, v=v)
    cart = gt.parts(3, PointMass, m=m_c)
    rod = gt.parts(3, MidpointRod, L=L, m=m_a)
    motor = gt.parts(3, ForceMotor)
    plate = gt.part(PointMass, m=m_p)

    def equations(self):
        for i in range(3):
            yield gt.connect(self.guideway[i].frame, self.cart[i].frame)
            yield gt.connect(self.guideway[i].frame, self.rod[i].a)
            yield gt.connect(self.guideway[i].flange, self.motor[i].flange)
            yield gt.connect(self.rod[i].b, self.plate.frame)
            yield self.q[i] == self.guideway[i].flange.s
            yield self.tau[i] == self.motor[i].force
            yield gt.branch(f"ahead[{i}]", gt.dot(self.rod[i].b.r - self.rod[i].a.r, self.v[i]))
        yield self.plate.frame.r == self.T


class FourRods(ThreeRods):
    """A fourth rod parallel to the third one and equally long: it repeats the third rod's constraint."""

    b = gt.parameter([0.0, 0.2, 0.1], unit="m", description="from the third rod to the fourth")
    at_cart = gt.part(Shift, offset=b)
    at_plate = gt.part(Shift, offset=b)
    fourth = gt.part(MidpointRod, L=lambda self: self.L[2])

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.guideway[2].frame, self.at_cart.a)
        yield gt.connect(self.plate.frame, self.at_plate.a)
        yield gt.connect(self.at_cart.b, self.fourth.a)
        yield gt.connect(self.at_plate.b, self.fourth.b)
