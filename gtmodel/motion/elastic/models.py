"""Optimal point-to-point motions of a three-link robot with its tool rigid, and on a spring."""

from __future__ import annotations

import numpy as np

from ... import lang as gt
from ...mechanics import PointMass, PointSpringDamper
from ...robots import GantryTau


class RigidMotion(GantryTau, gt.Optimization):
    """The optimal motion from rest to rest between two points: time plus energy, motor forces within +-F_max."""

    final_time = gt.free(guess=1.2, min=0.2, unit="s")
    F_max = gt.parameter(unit="N", positive=True, description="largest force of a motor")
    weight = gt.parameter(0.0, unit="1", description="of the energy in the cost")
    F_unit = gt.parameter(unit="N", positive=True, description="force that counts 1 in the energy")
    start = gt.parameter(shape=3, unit="m", description="tool centre point at first")
    goal = gt.parameter(shape=3, unit="m", description="tool centre point in the end")

    def objective(self):
        return self.final_time + self.weight * gt.integral(gt.dot(self.tau, self.tau) / self.F_unit**2)

    def constraints(self):
        yield gt.between(-self.F_max, self.tau, self.F_max)
        for instant, place in ((0, self.start), (self.final_time, self.goal)):
            yield self.T.at(instant) == place
            yield gt.der(self.T).at(instant) == np.zeros(3)


class ElasticMotion(RigidMotion):
    """The motion of `RigidMotion` with a mass on a spring at the plate; the mass hangs at rest at the start and at the
    end.
    """

    mass = gt.parameter(unit="kg", positive=True, description="mass on the spring")
    K = gt.parameter(shape=(3, 3), unit="N/m", kind="semidefinite", description="its stiffness, world axes")
    D = gt.parameter(np.zeros((3, 3)), unit="N.s/m", kind="semidefinite", description="its damping, world axes")
    spring = gt.part(PointSpringDamper, K=K, D=D)
    tool = gt.part(PointMass, m=mass)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.spring.a, self.plate.frame)
        yield gt.connect(self.spring.b, self.tool.frame)

    def constraints(self):
        yield from super().constraints()
        weight = self.mass * self.tool.world.g
        for instant in (0, self.final_time):
            yield (self.K @ self.spring.offset).at(instant) == weight
            yield gt.der(self.spring.offset).at(instant) == np.zeros(3)
