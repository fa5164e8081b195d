"""Slides along guideways that are not straight: measured deviations from the straight line A + q v."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from .. import lang as gt
from .guideway import Guideway


class CurvedGuideway(Guideway):
    """Base: the frame is at r(q) = A + q v + offset(q), q the flange's coordinate.

    The force balance takes the tangent: flange.f + dot(frame.f, r'(q)) = 0, so power in is power out. Subclasses define
    `offset` and its derivative `slope`. With A and v from a fit of eq. (4.10) and its residuals as deviations, r(q)
    goes through the measured points. Inverse kinematics has no closed form; it is a Newton block.

    A guideway that sags like a parabola, 1 mm at q = 1 m:

    >>> class Sagging(gt.mechanics.CurvedGuideway):
    ...     sag = gt.parameter(1e-3, unit="1/m", description="deviation downwards per square of q")
    ...
    ...     def offset(self, q):
    ...         return gt.vector([0.0, 0.0, -self.sag * q**2])
    ...
    ...     def slope(self, q):
    ...         return gt.vector([0.0, 0.0, -2 * self.sag * q])
    ...
    >>> bench = gt.Builder("bench")
    >>> guideway = bench.part("guideway", Sagging(A=np.zeros(3), v=[1.0, 0.0, 0.0]))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> bench.add(gt.connect(motor.flange, guideway.flange), gt.connect(guideway.frame, mass.frame))
    >>> r, status = bench.causal(known="motor.flange.s", targets="mass.frame.r")(1.0)
    >>> r
    array([ 1.   ,  0.   , -0.001])
    """

    def equations(self):
        q = self.flange.s
        yield self.frame.r == self.A + q * self.v + self.offset(q)
        yield self.flange.f + gt.dot(self.frame.f, self.v + self.slope(q)) == 0

    def offset(self, q: Any) -> Any:
        """Deviation (3,) [m] from the straight line at q [m]."""
        raise gt.ModelError("a CurvedGuideway must define offset(q) and slope(q); use PiecewiseLinearGuideway, ...")

    def slope(self, q: Any) -> Any:
        """Derivative (3,) of `offset` by q."""
        raise gt.ModelError("a CurvedGuideway must define offset(q) and slope(q); use PiecewiseLinearGuideway, ...")


class _ThroughPoints(CurvedGuideway):
    METHOD: Literal["linear", "cubic"]
    at = gt.parameter(shape=(None,), unit="m", increasing=True, description="coordinates q of the points")
    deviation = gt.parameter(shape=(None, 3), unit="m", description="deviations from A + q v there, world coordinates")

    def offset(self, q):
        return gt.interpolate(q, self.at, self.deviation, self.METHOD)

    def slope(self, q):
        return gt.interpolate(q, self.at, self.deviation, self.METHOD, derivative=1)


class PiecewiseLinearGuideway(_ThroughPoints):
    """Straight pieces through measured points (Dressler 2012, eq. (5.7)).

    Before the first and after the last point the end pieces are continued; the thesis uses the model within its points
    only. The direction jumps at the points and so does the velocity of a cart at constant der(q): right for kinematics
    and calibration. Where masses count, SplineGuideway has no such jumps.

    Three points, the middle one 0.1 mm above the line; half of that between the points:

    >>> bench = gt.Builder("bench")
    >>> line = dict(A=np.zeros(3), v=[1.0, 0.0, 0.0], at=[0.0, 1.0, 2.0])
    >>> deviation = [[0.0, 0.0, 0.0], [0.0, 0.0, 1e-4], [0.0, 0.0, 0.0]]
    >>> cart = bench.part("cart", gt.mechanics.PiecewiseLinearGuideway(**line, deviation=deviation))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(cart.frame, mass.frame), gt.connect(motor.flange, cart.flange))
    >>> r, status = bench.causal(known="cart.flange.s", targets="cart.frame.r")(0.5)
    >>> r.round(6)
    array([5.e-01, 0.e+00, 5.e-05])
    """

    METHOD = "linear"


class PiecewiseLinearCyclicGuideway(PiecewiseLinearGuideway):
    """Straight pieces plus a sinusoidal error of the transmission, which goes on beyond the points:
    offset + sine sin(2 pi q / period) + cosine cos(2 pi q / period) (Dressler 2012, section 4.2).

    Linear in `sine` and `cosine`; an error along the guideway alone has both parallel to v.

    An error of 0.05 mm along the guideway that repeats with the teeth of a rack, 13 mm apart. At a quarter of a tooth
    it is largest.

    >>> bench = gt.Builder("bench")
    >>> line = dict(A=np.zeros(3), v=[1.0, 0.0, 0.0], at=[0.0, 2.0], deviation=np.zeros((2, 3)))
    >>> rack = dict(period=0.013, sine=[5e-5, 0.0, 0.0])
    >>> cart = bench.part("cart", gt.mechanics.PiecewiseLinearCyclicGuideway(**line, **rack))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(cart.frame, mass.frame), gt.connect(motor.flange, cart.flange))
    >>> r, status = bench.causal(known="cart.flange.s", targets="cart.frame.r")(0.00325)
    >>> r.round(6)
    array([0.0033, 0.    , 0.    ])
    """

    period = gt.parameter(unit="m", positive=True, description="length of one cycle, e.g. between teeth of the rack")
    sine = gt.parameter([0.0, 0.0, 0.0], unit="m", description="amplitude of the sine, world coordinates")
    cosine = gt.parameter([0.0, 0.0, 0.0], unit="m", description="amplitude of the cosine, world coordinates")

    def offset(self, q):
        angle = 2 * np.pi * q / self.period
        return super().offset(q) + gt.sin(angle) * self.sine + gt.cos(angle) * self.cosine

    def slope(self, q):
        angle = 2 * np.pi * q / self.period
        rate = 2 * np.pi / self.period
        return super().slope(q) + rate * (gt.cos(angle) * self.sine - gt.sin(angle) * self.cosine)


class SplineGuideway(_ThroughPoints):
    """A smooth curve through any points: natural cubic spline, twice continuously differentiable in q.

    Before the first and after the last point it continues along its tangent there.

    Three points, the middle one 0.1 mm above the line; between them the curve lies above the straight pieces:

    >>> bench = gt.Builder("bench")
    >>> line = dict(A=np.zeros(3), v=[1.0, 0.0, 0.0], at=[0.0, 1.0, 2.0])
    >>> deviation = [[0.0, 0.0, 0.0], [0.0, 0.0, 1e-4], [0.0, 0.0, 0.0]]
    >>> cart = bench.part("cart", gt.mechanics.SplineGuideway(**line, deviation=deviation))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(cart.frame, mass.frame), gt.connect(motor.flange, cart.flange))
    >>> r, status = bench.causal(known="cart.flange.s", targets="cart.frame.r")(0.5)
    >>> r.round(6)
    array([5.0e-01, 0.0e+00, 6.9e-05])
    """

    METHOD = "cubic"
