"""Rods between spherical joints: rigid ones of length L, and one compliant along itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .. import lang as gt
from .frames import PointFrame, World


class Rod(gt.Model):
    """Massless-inertia base of all rods: two joints at distance L [m], total mass m [kg].

    `tension` [N/m] times the vector from a to b is the internal force that pulls the ends together.
    Subclasses say how the mass is spread.
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
        yield gt.energy(stored=self.kinetic_energy() - self.m * weight)

    def closure(self, d: Any) -> Iterator[Any]:
        """Equations of the distance of the joints, d from a to b [m]."""
        yield gt.dot(d, d) == self.L**2

    def inertial_forces(self) -> tuple[Any, Any]:
        """Mass times acceleration minus weight, as shared by the two ends [N]."""
        raise gt.ModelError("a Rod must say how its mass is spread; use MidpointRod or UniformRod")

    def kinetic_energy(self) -> Any:
        """Kinetic energy [J] of the mass so spread."""
        raise gt.ModelError("a Rod must say how its mass is spread; use MidpointRod or UniformRod")


class MidpointRod(Rod):
    """Mass as a point at mid-length (Dressler 2012, eq. (6.7): m/4 and m/4)."""

    def inertial_forces(self):
        half = self.m / 2 * (gt.der((self.a.r + self.b.r) / 2, 2) - self.world.g)
        return half, half

    def kinetic_energy(self):
        v = gt.der((self.a.r + self.b.r) / 2)
        return self.m / 2 * gt.dot(v, v)


class ElasticRod(MidpointRod):
    """A MidpointRod compliant along itself: length = L + n/k under the pull n = tension * length [N].

    k [N/m]: of the rod and the joints at its ends in series, 1/k = L/(E A) + 1/k_a + 1/k_b. It bends no more than a
    rigid one: its joints pass no moment.
    """

    k = gt.parameter(unit="N/m", positive=True, description="stiffness along the rod, joints included")
    stretch = gt.variable(unit="m", nominal=1e-4, description="distance of the joints less L")

    def closure(self, d):
        length = self.L + self.stretch
        yield gt.dot(d, d) == length**2
        yield self.tension * length == self.k * self.stretch
        yield gt.energy(stored=self.k / 2 * self.stretch**2)


class UniformRod(Rod):
    """Mass spread evenly along a thin rod: consistent masses m/3 and m/6."""

    def inertial_forces(self):
        acc_a, acc_b = gt.der(self.a.r, 2), gt.der(self.b.r, 2)
        weight = self.m / 2 * self.world.g
        return self.m / 3 * acc_a + self.m / 6 * acc_b - weight, self.m / 6 * acc_a + self.m / 3 * acc_b - weight

    def kinetic_energy(self):
        v_a, v_b = gt.der(self.a.r), gt.der(self.b.r)
        return self.m / 6 * (gt.dot(v_a, v_a) + gt.dot(v_a, v_b) + gt.dot(v_b, v_b))
