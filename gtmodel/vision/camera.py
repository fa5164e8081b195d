"""A camera as a component: its frame and the observed point are ports, the pixel coordinates are variables."""

from __future__ import annotations

from .. import lang as gt
from ..geometry.pinhole import distorted, straightness
from ..mechanics.frames import Frame, PointFrame


class PinholeCamera(gt.Model):
    """A pinhole camera with Brown's distortion that observes one point.

    Port `frame` is the camera frame: origin at the centre of projection, z forward, x right and y down in the picture.
    Port `point` is the mark. The same equations describe a fixed camera that observes a tool and a camera on the tool
    that observes a fixed board; only the connections differ. Pixel coordinates are those of OpenCV: the centre of the
    first pixel is (0, 0).

    `front` and `straight` are square roots of quantities that must be positive: the cosine of the angle from the axis
    to the mark, and the straightness of the lens up to it (see project()). Therefore a mark behind the camera, or
    beyond the radius at which the lens folds the picture over, has Status.OUT_OF_RANGE.

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> mount = bench.part("mount", gt.mechanics.FixedTranslation(d=[0.0, 0.0, -1.0]))
    >>> camera = bench.part("camera", gt.vision.PinholeCamera(fx=500.0, fy=500.0, cx=320.0, cy=240.0, k1=-0.2))
    >>> mark = bench.part("mark", gt.mechanics.PointLoad())  # held somewhere
    >>> bench.add(gt.connect([ground.frame, mount.b, mark.frame], [mount.a, camera.frame, camera.point]))
    >>> f = bench.causal(known="camera.point.r", targets=["camera.u", "camera.v"])
    >>> u, v, status = f([0.1, 0.0, 0.0])
    >>> print(round(u, 6), v, status.ok)
    369.9 240.0 True
    >>> f([0.1, 0.0, -2.0])[2].ok  # behind
    False
    """

    fx = gt.parameter(unit="1", positive=True, description="horizontal focal length [pixel]")
    fy = gt.parameter(unit="1", positive=True, description="vertical focal length [pixel]")
    cx = gt.parameter(unit="1", description="principal point, horizontal [pixel]")
    cy = gt.parameter(unit="1", description="principal point, vertical [pixel]")
    k1 = gt.parameter(0.0, unit="1", description="radial distortion, coefficient of r^2")
    k2 = gt.parameter(0.0, unit="1", description="radial distortion, coefficient of r^4")
    p1 = gt.parameter(0.0, unit="1", description="tangential distortion, coefficient of r^2 + 2 y^2 in v")
    p2 = gt.parameter(0.0, unit="1", description="tangential distortion, coefficient of r^2 + 2 x^2 in u")
    k3 = gt.parameter(0.0, unit="1", description="radial distortion, coefficient of r^6")
    frame = gt.port(Frame)
    point = gt.port(PointFrame)
    u = gt.variable(unit="1", nominal=1000.0, description="pixel coordinate, to the right [pixel]")
    v = gt.variable(unit="1", nominal=1000.0, description="pixel coordinate, downwards [pixel]")
    front = gt.variable(unit="1", start=1.0, description="square root of the cosine of the angle to the axis")
    straight = gt.variable(unit="1", start=1.0, description="square root of the lens straightness up to the mark")

    def equations(self):
        d = self.point.r - self.frame.r
        P = [gt.dot(self.frame.R[:, k], d) for k in range(3)]
        yield self.front**2 == P[2] / gt.norm(d)
        depth = self.front**2 * gt.norm(d)
        x, y = P[0] / depth, P[1] / depth
        k = [self.k1, self.k2, self.p1, self.p2, self.k3]
        xd, yd = distorted(x, y, k)
        least = straightness(x * x + y * y, k, gt.minimum, gt.maximum, gt.sqrt)
        yield self.straight**2 == least
        one = self.straight**2 / least  # undefined beyond the fold, so that the pixel is too
        yield self.u == self.fx * xd * one + self.cx
        yield self.v == self.fy * yd * one + self.cy
        yield self.frame.f == 0
        yield self.frame.t == 0
        yield self.point.f == 0
