"""A guideway whose friction grows with its load."""

from __future__ import annotations

from .. import lang as gt
from .guideway import Guideway


class SaddleGuideway(Guideway):
    """A straight guideway with friction in proportion to the force across it, beside what a Friction part adds.

    The flange feels saddle N tanh(der(s) / velocity_scale) against positive velocity; N [N] is the size of the force
    that the frame presses across the guideway, links and weight of the cart together, rounded off below `load_scale`.
    Dressler 2012, section 6.2, names such a "saddle" term of the Queensland Gantry-Tau (after Hovland and others, 2007)
    without an equation: this one is OURS. Inverse dynamics stay in closed form; in forward dynamics the friction
    depends on the accelerations, a Newton block. Efforts are linear in `saddle` at given masses, not in both together.

    A cart of 10 kg at 1 m/s on a level guideway: the friction is 0.02 of its weight, which lies across the guideway.

    >>> bench = gt.Builder("bench")
    >>> line = dict(A=np.zeros(3), v=[1.0, 0.0, 0.0])
    >>> guideway = bench.part("guideway", gt.mechanics.SaddleGuideway(**line, saddle=0.02, load_scale=0.01))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=10.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(guideway.frame, mass.frame), gt.connect(motor.flange, guideway.flange))
    >>> inverse = bench.causal(known="guideway.flange.s", targets="motor.force")
    >>> force, status = inverse(0.0, 1.0, 0.0)  # position, velocity, acceleration
    >>> print(round(force, 2))
    1.96
    """

    saddle = gt.parameter(0.0, unit="1", min=0.0, description="friction force per force across the guideway")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="velocity of the smoothed sign")
    load_scale = gt.parameter(1.0, unit="N", positive=True, description="force below which N is rounded off")
    across = gt.variable(3, unit="N", description="force of the frame across the guideway")
    saddle_force = gt.variable(unit="N", description="load-dependent friction force against the motion")

    def equations(self):
        v, f = self.v, self.frame.f
        yield self.frame.r == self.A + self.flange.s * v
        yield self.across == f - gt.dot(f, v) / gt.dot(v, v) * v
        load = gt.sqrt(gt.dot(self.across, self.across) + self.load_scale**2) - self.load_scale
        rate = gt.der(self.flange.s)
        yield self.saddle_force == self.saddle * load * gt.tanh(rate / self.velocity_scale)
        yield self.flange.f + gt.dot(f, v) == self.saddle_force
        yield gt.energy(dissipated=self.saddle_force * rate)
