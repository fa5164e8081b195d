"""Slides along guideways, straight, rigid or compliant, curved or measured, with friction that grows with the load;
and a plane that a point slides on."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from .. import lang as gt
from .bodies import quaternion_matrix
from .frames import Flange, PointFrame


class Guideway(gt.Model):
    """Point A + q v on a straight line (Dressler 2012, eq. (6.4)).

    |v| is a transmission scale (0.96 to 1.003 on real robots) and is never normalised. The flange's coordinate
    is q. Power passes without loss: the force on the flange plus dot(force on the frame, v) is zero.

    At q = 2 m under a load of 100 N along x. The motor holds it with 98 N towards negative q: 1 m of q is 0.98 m of
    travel, and the force across the guideway does not load it.

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
    """A compliant guideway: frame.r = A + q v + offset, where the force f [N] on the frame is K offset.

    K (3, 3) [N/m], symmetric, world axes: drive, bearings and machine frame in series, along the guideway and across.
    The coordinate q is not affected: compliance of the drive is part of K.

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


class MeasuredGuideway(Guideway):
    """Straight pieces through points measured by a device that stood elsewhere (Dressler 2012, section 5.3, models 2
    and 4): r(q) = t + R(u) p(q), p(q) through (at, points).

    t and u bring the frame of that recording into the robot's; they are what a calibration moves, not A and v, which
    determine branches and start values only. u is a unit quaternion, scalar first: calibrate it as `unit`. Points close
    to a straight line hardly determine the rotation about that line.

    Points recorded by a tracker whose y axis is the robot's x axis, with its origin at (0, 0.5, 1) m:

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
    points = gt.parameter(shape=(None, 3), unit="m", description="the points, frame of their recording")
    t = gt.parameter([0.0, 0.0, 0.0], unit="m", description="origin of that frame")
    u = gt.parameter(
        [1.0, 0.0, 0.0, 0.0], unit="1", kind="unit", description="its orientation, quaternion, scalar first"
    )

    def equations(self):
        q, R = self.flange.s, quaternion_matrix(self.u)
        yield self.frame.r == self.t + R @ gt.interpolate(q, self.at, self.points, "linear")
        slope = gt.interpolate(q, self.at, self.points, "linear", derivative=1)
        yield self.flange.f + gt.dot(self.frame.f, R @ slope) == 0


class SaddleGuideway(Guideway):
    """A straight guideway with friction in proportion to the force across it, beside what a Friction part adds.

    The flange feels saddle N tanh(der(s) / velocity_scale) against positive velocity; N [N] is the size of the force
    that the frame presses across the guideway, links and weight of the cart together, rounded off below `load_scale`.
    Dressler 2012, section 6.2, names such a "saddle" term of the Queensland Gantry-Tau (after Hovland and others, 2007)
    without an equation: this one is OURS. Inverse dynamics stay in closed form; in forward dynamics the friction
    depends on the accelerations, a Newton block. Efforts are linear in `saddle` at given masses, not in both together.

    A cart of 10 kg at 1 m/s on a level guideway: the friction is 0.02 of its weight, which lies across the guideway.

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

    saddle = gt.parameter(0.0, unit="1", min=0.0, description="friction force per force across the guideway")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="velocity of the smoothed sign")
    load_scale = gt.parameter(1.0, unit="N", positive=True, description="force below which N is rounded off")
    across = gt.variable(3, unit="N", description="force of the frame across the guideway")
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
    """The frame's point stays in the plane through p [m] with normal n (3); without friction, the force is along n.

    With it a planar mechanism of rods stands in three dimensions without redundant constraints.

    A point that slides on the floor: the force on it along the normal bears its weight.

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
    n = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="normal, of any length but zero")
    frame = gt.port(PointFrame)
    pressure = gt.variable(unit="N", nominal=100.0, description="force on the point along n, per length of n")

    def equations(self):
        yield gt.dot(self.frame.r - self.p, self.n) == 0
        yield self.frame.f == -self.pressure * self.n
