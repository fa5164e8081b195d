"""What closes a loop of frames: the constraints of joints, and closures that replace a connection."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

from .. import lang as gt
from .bodies import rotation_about
from .frames import Frame


def normals(n: Any) -> tuple[Any, Any]:
    """Return two unit vectors that form a right-handed basis with the unit vector n (3), for any n.

    Duff et al., Building an Orthonormal Basis, Revisited, JCGT 6(1), 2017. For a coordinate axis they are coordinate
    axes.
    """
    x, y, z = (n[k] for k in range(3))
    side = gt.sign(gt.sign(z) + 0.5)  # 1 also for z = 0
    scale = -1.0 / (side + z)
    mixed = x * y * scale
    return (
        gt.vector([1.0 + side * x * x * scale, side * mixed, -side * x]),
        gt.vector([mixed, side + y * y * scale, -y]),
    )


def turned(a: Any, b: Any, n: Any, phi: Any) -> tuple[Any, Any]:
    """Return the equation that frame b is frame a turned by phi about the unit vector n, solved for b and for a."""
    return a.R @ rotation_about(n, phi) == b.R, b.R @ rotation_about(n, -phi) == a.R


def held_position(a: Any, b: Any, directions: Iterable[Any]) -> Iterator[Any]:
    """Yield constraints: the origin of frame b does not leave that of frame a along directions in a's coordinates."""
    for direction in directions:
        along = a.R @ direction
        yield gt.constraint(a, b, gt.dot(along, b.r - a.r) == 0, gt.dot(along, b.f), "position along")


def held_tilt(a: Any, b: Any, n: Any, across: Iterable[Any]) -> Iterator[Any]:
    """Yield constraints: the axis n, equal in both frames' coordinates, does not tilt about the normals `across`.

    Twice the tangent of half the angle, not the sine: zero only for equal directions, not for opposite ones.
    """
    n_a, n_b = a.R @ n, b.R @ n
    tilt = 2.0 * gt.cross(n_a, n_b) / (1.0 + gt.dot(n_a, n_b))
    for direction in across:
        about = a.R @ direction
        yield gt.constraint(a, b, gt.dot(about, tilt) == 0, gt.dot(about, b.t), "rotation about")


def held_rotation(a: Any, b: Any) -> Iterator[Any]:
    """Yield three constraints: the frames are parallel. The rotation vector from a to b, with length 2 tan(angle/2)."""
    turned: list[list[Any]] = [[gt.dot(a.R[:, i], b.R[:, j]) for j in range(3)] for i in range(3)]
    trace = turned[0][0] + turned[1][1] + turned[2][2]
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        turn = 2.0 * (turned[j][i] - turned[i][j]) / (1.0 + trace)
        yield gt.constraint(a, b, turn == 0, gt.dot(a.R[:, k], b.t), "rotation about")


def angle_between_frames(a: Any, b: Any, across: tuple[Any, Any], phi: Any) -> Any:
    """Return the equation that phi is the angle from frame a to frame b about the normal of the vectors `across`.

    Its residual is the difference of the angles, which keeps full turns.
    """
    first, second = (a.R @ direction for direction in across)
    turned = b.R @ across[0]
    x, y = gt.dot(first, turned), gt.dot(second, turned)
    c, s = gt.cos(phi), gt.sin(phi)
    return gt.atan2(c * y - s * x, c * x + s * y) == 0


class LoopClosure(gt.Model):
    """Closes a loop: two frames coincide, with six constraints, a force and a torque.

    A chain of joints from the ground back to the ground is a loop of orientations, which connected Frames cannot have:
    replace one connection by a LoopClosure. The loop must be spatial, with seven joint coordinates or more. In a planar
    loop three of the constraints are redundant; see PlanarLoopClosure.

    Force and torque of the six constraints that hold a free body of 2 kg:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, c=[0.1, 0.0, 0.0], I=0.01 * np.eye(3)))
    >>> closure = bench.part("closure", gt.mechanics.LoopClosure())
    >>> bench.add(gt.connect([ground.frame, closure.b], [closure.a, body.frame]))
    >>> force, torque, status = bench.causal(targets=["closure.a.f", "closure.a.t"])()
    >>> print(force.round(6) + 0.0, torque.round(6) + 0.0)
    [ 0.    0.   19.62] [ 0.    -1.962  0.   ]
    """

    if_redundant: ClassVar[str] = (
        "if all axes of the loop are parallel, close it with gt.mechanics.PlanarLoopClosure instead of "
        "gt.mechanics.LoopClosure; otherwise remove from the closure the constraints that the joints already impose, "
        "or make a part compliant"
    )

    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        for k in range(3):
            yield gt.constraint(a, b, b.r[k] == a.r[k], b.f[k], "position along")
        yield from held_rotation(a, b)
        yield a.f + b.f == 0
        yield a.t + b.t == 0


class PlanarLoopClosure(gt.Model):
    """A revolute joint that closes a planar loop: the origins of two frames coincide in the plane.

    `first` and `second` (3), coordinates of a, span the plane; the axis is normal to it. The other joints of the loop
    are parallel to the axis. They alone keep b in the plane and bear loads out of it, so this joint transmits no torque
    and no force along the axis.

    A parallelogram linkage with a crank of 0.3 m and a coupler of 0.5 m: the coupler stays level, and the rocker turns
    with the crank.

    >>> bench = gt.Builder("parallelogram")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> crank, coupler, rocker = (bench.part(n, gt.mechanics.Revolute()) for n in ("crank", "coupler", "rocker"))
    >>> lengths = {"bar": [0.3, 0.0, 0.0], "top": [0.5, 0.0, 0.0], "base": [0.5, 0.0, 0.0], "arm": [0.3, 0.0, 0.0]}
    >>> bar, top, base, arm = (bench.part(n, gt.mechanics.FixedTranslation(d=d)) for n, d in lengths.items())
    >>> closure = bench.part("closure", gt.mechanics.PlanarLoopClosure())
    >>> bench.add(gt.connect([ground.frame, crank.b, bar.b, coupler.b], [crank.a, bar.a, coupler.a, top.a]))
    >>> bench.add(gt.connect([ground.frame, base.b, rocker.b], [base.a, rocker.a, arm.a]))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([top.b, arm.b, motor.shaft], [closure.a, closure.b, crank.shaft]))
    >>> follow = bench.causal(known="crank.shaft.phi", targets=["rocker.shaft.phi", "coupler.shaft.phi"])
    >>> rocker_angle, coupler_angle, status = follow(0.8)
    >>> print(round(rocker_angle, 6), round(np.sin(coupler_angle), 6))  # the sine of -0.8
    0.8 -0.717356
    """

    if_redundant: ClassVar[str] = (
        "gt.mechanics.PlanarLoopClosure closes a loop with parallel axes, with `first` and `second` normal to them; "
        "close a spatial loop with gt.mechanics.LoopClosure"
    )

    first = gt.parameter([1.0, 0.0, 0.0], unit="1", kind="direction", description="direction in the plane, of a")
    second = gt.parameter([0.0, 1.0, 0.0], unit="1", kind="direction", description="second direction in the plane")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        yield from held_position(a, b, (self.first, self.second))
        yield a.f + b.f == 0
        yield gt.dot(a.R @ gt.cross(self.first, self.second), b.f) == 0
        yield a.t == 0
        yield b.t == 0
