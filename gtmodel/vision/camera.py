"""A camera as a component: its frame and the point it sees are ports, the pixel is two variables."""

from __future__ import annotations

from .. import lang as gt
from ..geometry.pinhole import distorted, straightness
from ..mechanics.frames import Frame, PointFrame


class PinholeCamera(gt.Model):
    """A pinhole camera with Brown's distortion that sees one point.

    Port `frame` is the camera: origin in the centre of projection, z forward, x right and y down in the picture. Port
    `point` is the mark. Fixed cameras that look at a tool and a camera on the tool that looks at a fixed board are the
    same equations, connected otherwise. Pixels are OpenCV's: the middle of the first one is (0, 0).

    `front` and `straight` are roots of what must be positive: the cosine of the angle from the axis to the mark, and
    the straightness of the lens up to it (see project()). A mark behind the camera, or beyond the radius where the lens
    folds the picture over, so has Status.OUT_OF_RANGE.

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

    fx = gt.parameter(unit="1", positive=True, description="focal length across [pixel]")
    fy = gt.parameter(unit="1", positive=True, description="focal length down [pixel]")
    cx = gt.parameter(unit="1", description="principal point across [pixel]")
    cy = gt.parameter(unit="1", description="principal point down [pixel]")
    k1 = gt.parameter(0.0, unit="1", description="radial distortion, of r^2")
    k2 = gt.parameter(0.0, unit="1", description="radial distortion, of r^4")
    p1 = gt.parameter(0.0, unit="1", description="tangential distortion, of r^2 + 2 y^2 down")
    p2 = gt.parameter(0.0, unit="1", description="tangential distortion, of r^2 + 2 x^2 across")
    k3 = gt.parameter(0.0, unit="1", description="radial distortion, of r^6")
    frame = gt.port(Frame)
    point = gt.port(PointFrame)
    u = gt.variable(unit="1", nominal=1000.0, description="place in the picture, to the right [pixel]")
    v = gt.variable(unit="1", nominal=1000.0, description="place in the picture, downwards [pixel]")
    front = gt.variable(unit="1", start=1.0, description="root of the cosine of the angle to the axis")
    straight = gt.variable(unit="1", start=1.0, description="root of the straightness of the lens up to the mark")

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
        one = self.straight**2 / least  # so that a pixel beyond the fold has no value
        yield self.u == self.fx * xd * one + self.cx
        yield self.v == self.fy * yd * one + self.cy
        yield self.frame.f == 0
        yield self.frame.t == 0
        yield self.point.f == 0
