"""Guideways: straight, compliant, curved, measured, with load-dependent friction; and a plane for a sliding point."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from .. import lang as gt
from .bodies import quaternion_matrix
from .frames import Flange, PointFrame


class Guideway(gt.Model):
    """Point A + q v on a straight line (Dressler 2012, eq. (6.4)).

    |v| is a transmission scale (0.96 to 1.003 on real robots) and is never normalised. q is the flange's coordinate.
    There are no losses: the force on the flange plus dot(force on the frame, v) is zero.

    A cart at q = 2 m under a load with 100 N along x. The motor holds it with 98 N towards negative q, because 1 m of q
    is 0.98 m of travel; the force across the guideway does not load the motor.

    >>> bench = gt.Builder("bench")
    >>> guideway = bench.part("guideway", gt.mechanics.Guideway(A=[0.0, 0.5, 1.0], v=[0.98, 0.0, 0.0]))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(motor.flange, guideway.flange), gt.connect(guideway.frame, load.frame))
    >>> f = bench.causal(known=["motor.flange.s", "load.force"], targets=["load.frame.r", "motor.force"])
    >>> r, force, status = f(2.0, [100.0, 0.0, -500.0])
    >>> print(r, force)
    [1.96 0.5  1.  ] -98.0
    """

    A = gt.parameter(shape=3, unit="m", description="frame position at q = 0")
    v = gt.parameter(shape=3, unit="1", kind="direction", description="guideway direction times transmission scale")
    flange = gt.port(Flange)
    frame = gt.port(PointFrame)

    def equations(self):
        yield self.frame.r == self.A + self.flange.s * self.v
        yield self.flange.f + gt.dot(self.frame.f, self.v) == 0


class CompliantGuideway(Guideway):
    """A compliant guideway: frame.r = A + q v + offset, with the force K offset [N] on the frame.

    K (3, 3) [N/m], symmetric, world axes, is the stiffness of drive, bearings and machine frame in series, along the
    guideway and across. The coordinate q is not affected: compliance of the drive is part of K.

    A load of 100 N across a guideway of 1e7 N/m displaces the frame by 10 micrometres:

    >>> bench = gt.Builder("bench")
    >>> K = 1e7 * np.eye(3)
    >>> guideway = bench.part("guideway", gt.mechanics.CompliantGuideway(A=np.zeros(3), v=[1.0, 0.0, 0.0], K=K))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(motor.flange, guideway.flange), gt.connect(guideway.frame, load.frame))
    >>> f = bench.causal(known=["motor.flange.s", "load.force"], targets="load.frame.r")
    >>> r, status = f(2.0, [0.0, 100.0, 0.0])
    >>> r.round(7)
    array([2.e+00, 1.e-05, 0.e+00])
    """

    K = gt.parameter(
        shape=(3, 3), unit="N/m", kind="semidefinite", description="stiffness of drive, bearings and frame, world axes"
    )
    offset = gt.variable(3, unit="m", nominal=1e-4, description="displacement of the frame under its force")

    def equations(self):
        force = self.frame.f
        yield self.frame.r == self.A + self.flange.s * self.v + self.offset
        yield force == self.K @ self.offset
        yield self.flange.f + gt.dot(force, self.v) == 0
        yield gt.energy(stored=gt.dot(self.offset, force) / 2)


class CurvedGuideway(Guideway):
    """Base class of curved guideways: the frame is at r(q) = A + q v + offset(q), with q the flange's coordinate.

    The force balance uses the tangent, flange.f + dot(frame.f, r'(q)) = 0, so there are no losses. Subclasses define
    `offset` and its derivative `slope`. With A and v from a fit of eq. (4.10) and its residuals as deviations, r(q)
    passes through the measured points. Inverse kinematics has no closed form; it is a Newton block.

    A guideway that sags as a parabola, by 1 mm at q = 1 m:

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
        """Return the deviation (3,) [m] from the straight line at q [m]."""
        raise gt.ModelError("a CurvedGuideway must define offset(q) and slope(q); use PiecewiseLinearGuideway, ...")

    def slope(self, q: Any) -> Any:
        """Return the derivative (3,) of `offset` with respect to q."""
        raise gt.ModelError("a CurvedGuideway must define offset(q) and slope(q); use PiecewiseLinearGuideway, ...")


class _ThroughPoints(CurvedGuideway):
    METHOD: Literal["linear", "cubic"]
    at = gt.parameter(shape=(None,), unit="m", increasing=True, description="coordinates q of the points")
    deviation = gt.parameter(
        shape=(None, 3), unit="m", description="deviations from the line A + q v at these points, world axes"
    )

    def offset(self, q):
        return gt.interpolate(q, self.at, self.deviation, self.METHOD)

    def slope(self, q):
        return gt.interpolate(q, self.at, self.deviation, self.METHOD, derivative=1)


class PiecewiseLinearGuideway(_ThroughPoints):
    """Straight pieces through measured points (Dressler 2012, eq. (5.7)).

    The end pieces are extrapolated beyond the first and last point; the thesis uses the model only between its points.
    The direction, and the velocity of a cart at constant der(q), is discontinuous at the points. This is suitable for
    kinematics and calibration; for dynamics, use SplineGuideway, which is smooth.

    Three points, the middle one 0.1 mm above the line; halfway between the points it is half of that:

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
    """Straight pieces plus a sinusoidal transmission error, which continues beyond the points:
    offset + sine sin(2 pi q / period) + cosine cos(2 pi q / period) (Dressler 2012, section 4.2).

    Linear in `sine` and `cosine`; for an error only along the guideway both are parallel to v.

    An error of 0.05 mm along the guideway with the period of a rack's teeth, 13 mm. It is largest at a quarter of it:

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

    Beyond the first and last point it continues along its tangent.

    Three points, the middle one 0.1 mm above the line; between them the curve is above the straight pieces:

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


class MeasuredGuideway(Guideway):
    """Straight pieces through points measured in another frame (Dressler 2012, section 5.3, models 2 and 4):
    r(q) = t + R(u) p(q), with p(q) through (at, points).

    t and u transform the frame of the recording to the robot's frame. A calibration adjusts them instead of A and v,
    which only determine branches and start values. u is a unit quaternion, scalar first: calibrate it as `unit`. Points
    close to a straight line hardly determine the rotation about that line.

    Points recorded by a tracker at (0, 0.5, 1) m whose y axis is the robot's x axis:

    >>> bench = gt.Builder("bench")
    >>> u = [np.cos(np.pi / 4), 0.0, 0.0, -np.sin(np.pi / 4)]  # minus 90 degrees about z
    >>> guideway = gt.mechanics.MeasuredGuideway(
    ...     A=[0.0, 0.5, 1.0],
    ...     v=[1.0, 0.0, 0.0],
    ...     at=[0.0, 1.0, 2.0],
    ...     points=[[0.0, 0.0, 0.0], [0.0, 0.999, 1e-4], [0.0, 1.998, 0.0]],
    ...     t=[0.0, 0.5, 1.0],
    ...     u=u,
    ... )
    >>> cart = bench.part("cart", guideway)
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(cart.frame, mass.frame), gt.connect(motor.flange, cart.flange))
    >>> r, status = bench.causal(known="cart.flange.s", targets="cart.frame.r")(1.5)
    >>> r.round(6)
    array([1.4985 , 0.5    , 1.00005])
    """

    at = gt.parameter(shape=(None,), unit="m", increasing=True, description="coordinates q of the points")
    points = gt.parameter(shape=(None, 3), unit="m", description="the points, recording frame")
    t = gt.parameter([0.0, 0.0, 0.0], unit="m", description="origin of the recording frame")
    u = gt.parameter(
        [1.0, 0.0, 0.0, 0.0], unit="1", kind="unit", description="orientation of the recording frame, scalar first"
    )

    def equations(self):
        q, R = self.flange.s, quaternion_matrix(self.u)
        yield self.frame.r == self.t + R @ gt.interpolate(q, self.at, self.points, "linear")
        slope = gt.interpolate(q, self.at, self.points, "linear", derivative=1)
        yield self.flange.f + gt.dot(self.frame.f, R @ slope) == 0


class SaddleGuideway(Guideway):
    """A straight guideway with friction proportional to the transverse force, in addition to any Friction part.

    The friction force is saddle N tanh(der(s) / velocity_scale) and opposes the motion. N [N] is the magnitude of the
    transverse force of links and cart weight on the guideway, smoothed below `load_scale`. Dressler 2012, section 6.2,
    mentions such a "saddle" term of the Queensland Gantry-Tau (after Hovland and others, 2007) without an equation:
    this one is OURS. Inverse dynamics is in closed form. In forward dynamics the friction depends on the accelerations,
    which gives a Newton block. Efforts are linear in `saddle` for known masses, but not in both together.

    A cart of 10 kg at 1 m/s on a level guideway: the friction is 0.02 of its weight.

    >>> bench = gt.Builder("bench")
    >>> line = dict(A=np.zeros(3), v=[1.0, 0.0, 0.0])
    >>> guideway = bench.part("guideway", gt.mechanics.SaddleGuideway(**line, saddle=0.02, load_scale=0.01))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(guideway.frame, mass.frame), gt.connect(motor.flange, guideway.flange))
    >>> inverse = bench.causal(known="guideway.flange.s", targets="motor.force")
    >>> force, status = inverse(0.0, 1.0, 0.0)  # position, velocity, acceleration
    >>> print(round(force, 2))
    1.96
    """

    saddle = gt.parameter(0.0, unit="1", min=0.0, description="friction force per transverse force")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="velocity of the smoothed sign")
    load_scale = gt.parameter(1.0, unit="N", positive=True, description="force below which N is smoothed")
    across = gt.variable(3, unit="N", description="transverse force of the frame on the guideway")
    saddle_force = gt.variable(unit="N", description="load-dependent friction force against the motion")

    def equations(self):
        v, f = self.v, self.frame.f
        yield self.frame.r == self.A + self.flange.s * v
        yield self.across == f - gt.dot(f, v) / gt.dot(v, v) * v
        load = gt.sqrt(gt.dot(self.across, self.across) + self.load_scale**2) - self.load_scale
        rate = gt.der(self.flange.s)
        yield self.saddle_force == self.saddle * load * gt.tanh(rate / self.velocity_scale)
        yield self.flange.f + gt.dot(f, v) == self.saddle_force
        yield gt.energy(dissipated=self.saddle_force * rate)


class Plane(gt.Model):
    """Keeps a point in the plane through p [m] with normal n (3), without friction: the force is along n.

    It models a planar mechanism of rods in three dimensions without redundant constraints.

    A mass that slides on the floor; the normal force bears its weight:

    >>> bench = gt.Builder("bench")
    >>> floor = bench.part("floor", gt.mechanics.Plane(p=[0.0, 0.0, 0.1], n=[0.0, 0.0, 1.0]))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> bench.add(gt.connect(floor.frame, mass.frame))
    >>> f = bench.causal(targets=["floor.pressure", "mass.frame.r[2]"], prefer=["mass.frame.r[0]", "mass.frame.r[1]"])
    >>> pressure, height, status = f(0.0, 0.0)
    >>> print(round(pressure, 6), height)
    29.43 0.1
    """

    p = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a point of the plane")
    n = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="normal, of any nonzero length")
    frame = gt.port(PointFrame)
    pressure = gt.variable(unit="N", nominal=100.0, description="force on the point along n, per length of n")

    def equations(self):
        yield gt.dot(self.frame.r - self.p, self.n) == 0
        yield self.frame.f == -self.pressure * self.n
