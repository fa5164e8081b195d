"""A slide through points that were measured in another frame than the robot's, as models 2 and 4 of D1."""

from __future__ import annotations

from .. import lang as gt
from .guideway import Guideway
from .rotation import quaternion_matrix


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
