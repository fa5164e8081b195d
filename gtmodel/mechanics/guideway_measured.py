"""A slide through points that were measured in another frame than the robot's, as models 2 and 4 of D1."""

from __future__ import annotations

from .. import lang as gt
from .guideway import Guideway
from .rotation import quaternion_matrix


class MeasuredGuideway(Guideway):
    """Straight pieces through points measured by a device that stood elsewhere (Dressler 2012, section 5.3, models 2
    and 4): r(q) = t + R(u) p(q), p(q) through (at, points).

    t and u bring the frame of that recording into the robot's; they are what a calibration moves, not A and v, which
    only tell branches and start values. u is a unit quaternion, scalar first: calibrate it as `unit`. Points close to a
    straight line hardly tell the turn about it.
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
