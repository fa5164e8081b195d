"""Where a chain of frames closes on itself: constraints between two frames that other joints lead to."""

from __future__ import annotations

from typing import Any, ClassVar

from .. import lang as gt
from .frames import Frame


class LoopClosure(gt.Model):
    """Two frames, each of which other joints lead to, coincide: six constraints, with a force and a torque.

    A chain of joints from the ground back to the ground is a loop of orientations, which a Frame cannot have: one
    connection of it becomes a LoopClosure. It counts on a loop in space, of seven joint coordinates or more: in a
    planar loop three of its constraints are redundant, see PlanarLoopClosure.

    A body of 2 kg with six coordinates of its own, held where it is by six constraints, and what they bear:

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
        "where all axes of the loop are parallel, close it by gt.mechanics.PlanarLoopClosure in place of "
        "gt.mechanics.LoopClosure; else take the constraints that the joints keep already out of the closure, or make "
        "a part compliant"
    )

    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        turned: list[list[Any]] = [[gt.dot(a.R[:, i], b.R[:, j]) for j in range(3)] for i in range(3)]
        yield b.r == a.r
        # the axis of the rotation from a to b times tan(angle/2): zero where they are parallel, and nowhere else
        trace = turned[0][0] + turned[1][1] + turned[2][2]
        for i, j in ((1, 2), (2, 0), (0, 1)):
            yield (turned[j][i] - turned[i][j]) / (1.0 + trace) == 0
        yield a.f + b.f == 0
        yield a.t + b.t == 0


class PlanarLoopClosure(gt.Model):
    """A revolute joint that closes a planar loop: the origins of two frames meet in the plane.

    `first` and `second` (3), coordinates of a, span the plane; the axis is across both. The other joints of the loop
    are parallel to it; they alone keep b in the plane and bear what acts along the axis, so that no torque passes
    here and no force along the axis.

    A four-bar linkage whose bars make a parallelogram, a crank of 0.3 m and a coupler of 0.5 m: the coupler stays
    level, and the rocker turns with the crank.

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
        "gt.mechanics.PlanarLoopClosure closes a loop of parallel axes, and `first` and `second` lie across them; a "
        "loop in space is closed by gt.mechanics.LoopClosure"
    )

    first = gt.parameter([1.0, 0.0, 0.0], unit="1", kind="direction", description="direction in the plane, of a")
    second = gt.parameter([0.0, 1.0, 0.0], unit="1", kind="direction", description="another, not along the first")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        gap = b.r - a.r
        yield gt.dot(a.R @ self.first, gap) == 0
        yield gt.dot(a.R @ self.second, gap) == 0
        yield a.f + b.f == 0
        yield gt.dot(a.R @ gt.cross(self.first, self.second), b.f) == 0
        yield a.t == 0
        yield b.t == 0
