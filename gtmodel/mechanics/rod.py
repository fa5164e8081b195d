"""Rods between spherical joints: rigid rods of length L, and a rod that is compliant along its axis."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .. import lang as gt
from .frames import PointFrame, World


class Rod(gt.Model):
    """Base class of rods between two spherical joints at distance L [m], with the total mass m [kg].

    `tension` [N/m] times the vector from a to b is the internal force [N] that pulls the ends together:
    positive in tension, negative in compression. Subclasses define the distribution of the mass.

    A custom rod with its mass at the end b. Released from level with a fixed, b falls like a point mass:

    >>> class EndRod(gt.mechanics.Rod):
    ...     def inertial_forces(self):
    ...         at_b = self.m * (gt.der(self.b.r, 2) - self.world.g)
    ...         return 0.0 * at_b, at_b
    ...
    ...     def kinetic_energy(self):
    ...         v = gt.der(self.b.r)
    ...         return self.m / 2 * gt.dot(v, v)
    ...
    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> rod = bench.part("rod", EndRod(L=1.0, m=2.0))
    >>> bench.add(gt.connect(anchor.point, rod.a), gt.branch("along_x", rod.b.r[0]))
    >>> swing = bench.causal(targets="der(rod.b.r,2)", prefer=["rod.b.r[1]", "rod.b.r[2]"])
    >>> acceleration, status = swing(0.0, 0.0, 0.0, 0.0)  # positions y and z, velocities
    >>> acceleration.round(6) + 0.0
    array([ 0.  ,  0.  , -9.81])
    """

    L = gt.parameter(unit="m", positive=True, description="length between joint centres")
    m = gt.parameter(0.0, unit="kg", min=0.0, description="mass of the rod or link cluster")
    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    tension = gt.variable(unit="N/m", nominal=100.0, description="internal force per length, pull positive")
    world = gt.outer(World)

    def equations(self):
        d = self.b.r - self.a.r
        yield from self.closure(d)
        inertial_a, inertial_b = self.inertial_forces()
        yield self.a.f == inertial_a - self.tension * d
        yield self.b.f == inertial_b + self.tension * d
        weight = gt.dot(self.world.g, (self.a.r + self.b.r) / 2)
        yield gt.energy(stored=self.kinetic_energy())
        yield gt.energy(stored=-self.m * weight)

    def closure(self, d: Any) -> Iterator[Any]:
        """Yield the closure equations; d is the vector from a to b [m]."""
        yield gt.dot(d, d) == self.L**2

    def inertial_forces(self) -> tuple[Any, Any]:
        """Return mass times acceleration minus weight [N], divided between the two ends."""
        raise gt.ModelError("a Rod must define inertial_forces(); use MidpointRod or UniformRod")

    def kinetic_energy(self) -> Any:
        """Return the kinetic energy [J] of the distributed mass."""
        raise gt.ModelError("a Rod must define kinetic_energy(); use MidpointRod or UniformRod")


class MidpointRod(Rod):
    """A rod with a point mass at mid-length (Dressler 2012, eq. (6.7): m/4 and m/4).

    A pendulum at rest: `tension` times the length is the weight of the mass and of half the rod.

    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor(r=[0.0, 0.0, 2.0]))
    >>> rod = bench.part("rod", gt.mechanics.MidpointRod(L=0.5, m=1.0))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> bench.add(gt.connect(anchor.point, rod.a), gt.connect(rod.b, mass.frame))
    >>> bench.add(gt.branch("below", rod.a.r[2] - rod.b.r[2]))
    >>> swing = bench.causal(targets="rod.tension", prefer=["rod.b.r[0]", "rod.b.r[1]"])
    >>> tension, status = swing(0.0, 0.0, 0.0, 0.0)  # positions x and y, velocities
    >>> print(round(tension * 0.5, 6), round(3.5 * 9.81, 6))
    34.335 34.335
    """

    def inertial_forces(self):
        half = self.m / 2 * (gt.der((self.a.r + self.b.r) / 2, 2) - self.world.g)
        return half, half

    def kinetic_energy(self):
        v = gt.der((self.a.r + self.b.r) / 2)
        return self.m / 2 * gt.dot(v, v)


class ElasticRod(MidpointRod):
    """A MidpointRod that is compliant along its axis: length = L + n/k under the pull n = tension * length [N].

    k [N/m] is the stiffness of the rod and its end joints in series, 1/k = L/(E A) + 1/k_a + 1/k_b. It does not bend,
    because its joints transmit no moment.

    A load of 1000 N along a rod of 1e7 N/m stretches it by 0.1 mm:

    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> rod = bench.part("rod", gt.mechanics.ElasticRod(L=1.5, k=1e7))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, rod.a), gt.connect(rod.b, load.frame))
    >>> pull = bench.causal(known="rod.b.r", targets=["rod.stretch", "load.force"])
    >>> stretch, force, status = pull([1.5001, 0.0, 0.0], np.zeros(3), np.zeros(3))
    >>> print(round(stretch, 9), force.round(3))
    0.0001 [1000.    0.    0.]
    """

    k = gt.parameter(unit="N/m", positive=True, description="stiffness along the rod, joints included")
    stretch = gt.variable(unit="m", nominal=1e-4, description="distance between the joints minus L")

    def closure(self, d):
        length = self.L + self.stretch
        yield gt.dot(d, d) == length**2
        yield self.tension * length == self.k * self.stretch
        yield gt.energy(stored=self.k / 2 * self.stretch**2)


class UniformRod(Rod):
    """A thin uniform rod: consistent masses m/3 and m/6.

    Released from level with a fixed, its end b falls with 3/2 g; a MidpointRod falls with 2 g:

    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> rod = bench.part("rod", gt.mechanics.UniformRod(L=1.0, m=2.0))
    >>> bench.add(gt.connect(anchor.point, rod.a), gt.branch("along_x", rod.b.r[0]))
    >>> swing = bench.causal(targets="der(rod.b.r,2)", prefer=["rod.b.r[1]", "rod.b.r[2]"])
    >>> acceleration, status = swing(0.0, 0.0, 0.0, 0.0)  # positions y and z, velocities
    >>> acceleration.round(6) + 0.0
    array([  0.   ,   0.   , -14.715])
    """

    def inertial_forces(self):
        acc_a, acc_b = gt.der(self.a.r, 2), gt.der(self.b.r, 2)
        weight = self.m / 2 * self.world.g
        return self.m / 3 * acc_a + self.m / 6 * acc_b - weight, self.m / 6 * acc_a + self.m / 3 * acc_b - weight

    def kinetic_energy(self):
        v_a, v_b = gt.der(self.a.r), gt.der(self.b.r)
        return self.m / 6 * (gt.dot(v_a, v_a) + gt.dot(v_a, v_b) + gt.dot(v_b, v_b))
