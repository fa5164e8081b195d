"""Forces: springs with parallel dampers, external loads, and end stops with impact."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, Frame, PointFrame, Shaft


class SpringDamper(gt.Model):
    """Massless spring and damper between two points, along the line that joins them.

    `pull` [N] = k (length - length0) + d der(length), positive if it pulls the points together. The points must not
    coincide.

    Pull of a spring from the origin to (3, 4, 0) m, and the load that holds b there:

    >>> bench = gt.Builder("bench")
    >>> spring = bench.part("spring", gt.mechanics.SpringDamper(k=100.0, length0=4.0))
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, spring.a), gt.connect(spring.b, load.frame))
    >>> hold = bench.causal(known="load.frame.r", targets=["spring.pull", "load.force"])
    >>> pull, force, status = hold([3.0, 4.0, 0.0], np.zeros(3))
    >>> print(round(pull, 6), force.round(6))
    100.0 [60. 80.  0.]
    """

    k = gt.parameter(unit="N/m", min=0.0, description="stiffness")
    d = gt.parameter(0.0, unit="N.s/m", min=0.0, description="damping")
    length0 = gt.parameter(0.0, unit="m", description="length of the unloaded spring")
    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    length = gt.variable(unit="m", description="distance between the points")
    pull = gt.variable(unit="N", nominal=100.0, description="force that pulls the points together")

    def equations(self):
        ab = self.b.r - self.a.r
        yield self.length == gt.norm(ab)
        yield self.pull == self.k * (self.length - self.length0) + self.d * gt.der(self.length)
        yield self.a.f == -self.pull / self.length * ab
        yield self.b.f == self.pull / self.length * ab
        yield _energy(self.k, self.d, self.length - self.length0)


class PointSpringDamper(gt.Model):
    """Spring and damper between two points in all three directions, without force where the points coincide.

    K and D (3, 3) are symmetric, in world axes: the force of a on b is -K (b.r - a.r) - D der(b.r - a.r). With a mass
    it models a compliant mount, such as an elastic end-effector.

    Load that displaces b by 1 mm along x and z, on a mount ten times as stiff along z:

    >>> bench = gt.Builder("bench")
    >>> mount = bench.part("mount", gt.mechanics.PointSpringDamper(K=np.diag([1e5, 1e5, 1e6])))
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, mount.a), gt.connect(mount.b, load.frame))
    >>> hold = bench.causal(known="load.frame.r", targets="load.force")
    >>> force, status = hold([1e-3, 0.0, 1e-3], np.zeros(3))
    >>> force.round(6)
    array([ 100.,    0., 1000.])
    """

    K = gt.parameter(shape=(3, 3), unit="N/m", kind="semidefinite", description="stiffness, world axes")
    D = gt.parameter(np.zeros((3, 3)), unit="N.s/m", kind="semidefinite", description="damping, world axes")
    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    offset = gt.variable(3, unit="m", nominal=1e-3, description="displacement from a to b")

    def equations(self):
        rate = gt.der(self.offset)
        pull = self.K @ self.offset + self.D @ rate
        yield self.b.r == self.a.r + self.offset
        yield self.b.f == pull
        yield self.a.f == -pull
        stored = gt.dot(self.offset, self.K @ self.offset) / 2
        yield gt.energy(stored=stored, dissipated=gt.dot(rate, self.D @ rate))


class FlangeSpringDamper(gt.Model):
    """Spring and damper between two flanges; pull = k (b.s - a.s - rest) + d der(b.s - a.s).

    A spring stretched by 0.02 m and extending at 0.1 m/s. The flows are the forces on the spring, which pull its ends
    apart; their reactions pull the flanges together.

    >>> bench = gt.Builder("bench")
    >>> spring = bench.part("spring", gt.mechanics.FlangeSpringDamper(k=1000.0, d=50.0))
    >>> left = bench.part("left", gt.mechanics.FixedFlange())
    >>> right = bench.part("right", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(left.flange, spring.a), gt.connect(spring.b, right.flange))
    >>> stretch = bench.causal(known="spring.b.s", targets=["spring.pull", "spring.a.f", "spring.b.f"])
    >>> *forces, status = stretch(0.02, 0.1)
    >>> print(np.round(forces, 6))
    [ 25. -25.  25.]
    """

    k = gt.parameter(unit="N/m", min=0.0, description="stiffness")
    d = gt.parameter(0.0, unit="N.s/m", min=0.0, description="damping")
    rest = gt.parameter(0.0, unit="m", description="b.s - a.s of the unloaded spring")
    a = gt.port(Flange)
    b = gt.port(Flange)
    pull = gt.variable(unit="N", nominal=100.0, description="force that pulls the flanges together")

    def equations(self):
        stretch = self.b.s - self.a.s
        yield self.pull == self.k * (stretch - self.rest) + self.d * gt.der(stretch)
        yield self.a.f == -self.pull
        yield self.b.f == self.pull
        yield _energy(self.k, self.d, stretch - self.rest)


class ShaftSpringDamper(gt.Model):
    """Torsional spring and damper between two shafts; pull = k (b.phi - a.phi - rest) + d der(b.phi - a.phi).

    A spring twisted by 0.3 rad, 0.2 rad more than its rest angle, with a twist rate of 0.5 rad/s:

    >>> bench = gt.Builder("bench")
    >>> spring = bench.part("spring", gt.mechanics.ShaftSpringDamper(k=50.0, d=2.0, rest=0.1))
    >>> left = bench.part("left", gt.mechanics.FixedShaft())
    >>> right = bench.part("right", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect(left.shaft, spring.a), gt.connect(spring.b, right.shaft))
    >>> twist = bench.causal(known="spring.b.phi", targets="spring.pull")
    >>> pull, status = twist(0.3, 0.5)  # 50 (0.3 - 0.1) + 2 * 0.5
    >>> print(round(pull, 6))
    11.0
    """

    k = gt.parameter(unit="N.m/rad", min=0.0, description="torsional stiffness")
    d = gt.parameter(0.0, unit="N.m.s/rad", min=0.0, description="torsional damping")
    rest = gt.parameter(0.0, unit="rad", description="b.phi - a.phi of the unloaded spring")
    a = gt.port(Shaft)
    b = gt.port(Shaft)
    pull = gt.variable(unit="N.m", nominal=10.0, description="torque that reduces the twist")

    def equations(self):
        twist = self.b.phi - self.a.phi
        yield self.pull == self.k * (twist - self.rest) + self.d * gt.der(twist)
        yield self.a.t == -self.pull
        yield self.b.t == self.pull
        yield _energy(self.k, self.d, twist - self.rest)


def _energy(k, d, stretch):
    return gt.energy(stored=k / 2 * stretch**2, dissipated=d * gt.der(stretch) ** 2)


class PointLoad(gt.Model):
    """External `force` (3) [N] on a point, world coordinates: process forces, payload tests.

    The force acts on the connected components; the flow f of the load's frame is the reaction.

    >>> bench = gt.Builder("bench")
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=2.0))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(mass.frame, load.frame))
    >>> forward = bench.causal(known="load.force", targets=["der(mass.frame.r,2)", "load.frame.f"])
    >>> acceleration, reaction, status = forward([4.0, 1.0, 21.62])
    >>> print(acceleration.round(6), reaction)
    [2.  0.5 1. ] [ -4.    -1.   -21.62]
    """

    frame = gt.port(PointFrame)
    force = gt.input(3, unit="N", nominal=100.0, description="force on the connected point, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)))


class FrameLoad(gt.Model):
    """External `force` (3) [N] at the origin of a frame and `torque` (3) [N.m], world coordinates.

    Accelerations of a body under a force at its centre of mass and a torque, without gravity:

    >>> bench = gt.Builder("bench")
    >>> world = bench.part("world", gt.mechanics.World(g=np.zeros(3)))
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, I=np.diag([0.1, 0.2, 0.25])))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(body.frame, load.frame))
    >>> f = bench.causal(
    ...     known=["load.force", "load.torque"],
    ...     targets=["der(body.frame.r,2)", "der(body.frame.w)"],
    ...     prefer=["body.frame.r", "body.frame.w"],
    ... )
    >>> rest, force, torque = np.zeros(3), [4.0, 0.0, 0.0], [0.0, 0.1, 0.0]
    >>> a, turn, status = f(rest, *rest, force, torque)  # w, three of e, the load
    >>> print(a + 0.0, turn.round(6) + 0.0)
    [2. 0. 0.] [0.  0.5 0. ]
    """

    frame = gt.port(Frame)
    force = gt.input(3, unit="N", nominal=100.0, description="force on the connected frame, world coordinates")
    torque = gt.input(3, unit="N.m", nominal=10.0, description="torque on the connected frame, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield self.frame.t == -self.torque
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)) + gt.dot(self.torque, self.frame.w))


class AppliedLoad(gt.Model):
    """Like FrameLoad, but equations of the enclosing model determine force [N] and torque [N.m]: a spring to a target,
    a signal, a thruster that turns with the body.

    Acceleration of a body of 2 kg at 0.5 m along x, pulled towards the origin with 8 N/m, without gravity:

    >>> bench = gt.Builder("bench")
    >>> world = bench.part("world", gt.mechanics.World(g=np.zeros(3)))
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, I=np.eye(3)))
    >>> load = bench.part("load", gt.mechanics.AppliedLoad())
    >>> k = bench.parameter("k", 8.0, unit="N/m")
    >>> bench.add(gt.connect(body.frame, load.frame), load.force == -k * body.frame.r, load.torque == np.zeros(3))
    >>> pull = bench.causal(targets="der(body.frame.r,2)", prefer=["body.frame.r", "body.frame.w"])
    >>> acceleration, status = pull([0.5, 0.0, 0.0], np.zeros(3), 0.0, 0.0, 0.0)  # r, w, three of e
    >>> print(acceleration + 0.0)
    [-2.  0.  0.]
    """

    frame = gt.port(Frame)
    force = gt.variable(3, unit="N", nominal=100.0, description="force on the connected frame, world coordinates")
    torque = gt.variable(3, unit="N.m", nominal=10.0, description="torque on the connected frame, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield self.frame.t == -self.torque
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)) + gt.dot(self.torque, self.frame.w))


DEPTH = 1e-6  # penetration at which a mass rests, as a share of the distance between the ends


class EndStop(gt.Model):
    """Hard stops at both ends of a flange's travel, for simulation: low <= flange.s <= high [m].

    A mass that hits an end leaves it with `restitution` times its velocity (Newton's law of impact). A mass slower than
    `rest_speed` stays at the end until a force pulls it away, so that it comes to rest after finitely many impacts.
    `force` [N] is the force of the resting mass on the end; `rests` is -1 at the low end, 1 at the high end and 0
    elsewhere. An impact is an impulse of that force: bodies that are rigidly coupled to the flange, such as the other
    carts of a parallel robot, also change their velocities, according to the model's masses and constraints.

    A carriage between two ends 0.5 m apart loses half of its speed at each impact:

    >>> bench = gt.Builder("bench")
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=2.0))
    >>> ends = bench.part("ends", gt.mechanics.EndStop(low=0.0, high=0.5, restitution=0.5))
    >>> bench.add(gt.connect(carriage.flange, ends.flange))
    >>> run = bench.simulate(2.0, start={"carriage.flange.s": 0.0, "der(carriage.flange.s)": 1.0})
    >>> [round(e.time, 9) for e in run.events], [round(e.energy, 9) for e in run.events]
    ([0.5, 1.5], [-0.75, -0.1875])
    """

    low = gt.parameter(unit="m", description="coordinate of the low end")
    high = gt.parameter(unit="m", min=low, description="coordinate of the high end")
    restitution = gt.parameter(0.0, unit="1", min=0.0, max=1.0, description="speed ratio, after to before an impact")
    rest_speed = gt.parameter(1e-3, unit="m/s", min=0.0, description="speed below which a mass rests at an end")
    flange = gt.port(Flange)
    force = gt.variable(unit="N", nominal=100.0, description="force against an end")
    rests = gt.discrete(0.0, description="-1 at the low end, 1 at the high end, 0 elsewhere")

    def equations(self):
        s, v = self.flange.s, gt.der(self.flange.s)
        free = (self.rests > -0.5) & (self.rests < 0.5)
        yield self.flange.f == self.force
        yield gt.If(free, self.force == 0.0, gt.der(s, 2) == 0.0)
        for side, inside in ((-1.0, s - self.low), (1.0, self.high - s)):
            bounces = side * v >= self.rest_speed
            rebound = gt.reinit(v, -self.restitution * v, impulse=self.force)
            yield gt.when((inside <= 0.0) & bounces, rebound)
            stays = [gt.reinit(v, 0.0 * v, impulse=self.force), self.rests == side]
            yield gt.when((inside <= 0.0) & ~bounces, *stays)
            # a mass that is released and immediately pressed back has not left the end
            yield gt.when(inside <= -DEPTH * (self.high - self.low), *stays)
        # at zero force it stays
        yield gt.when(self.rests * self.force < 0.0, self.rests == 0.0)
