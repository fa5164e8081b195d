"""End stops with impact: a coordinate stays between two ends."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange

# of the way between the ends
DEPTH = 1e-6


class EndStop(gt.Model):
    """A hard stop at each end of a flange's way, for simulation: low <= flange.s <= high [m].

    A mass that hits an end leaves it with `restitution` times its velocity (Newton's law of impact). What hits it
    slower than `rest_speed` stays there until it is pulled away, so that a mass comes to rest after finitely many
    impacts. `force` [N] is what the mass exerts on the end that it rests at, `rests` -1 at the low end, 1 at the high
    one and 0 elsewhere. An impact is an impulse of that force: what is coupled rigidly to the flange, as the other
    carts of a parallel robot, changes its velocity too, by the model's masses and constraints.

    A carriage between two ends 0.5 m apart loses half of its speed at each:

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
    restitution = gt.parameter(0.0, unit="1", min=0.0, max=1.0, description="speed after an impact over that before")
    rest_speed = gt.parameter(1e-3, unit="m/s", min=0.0, description="what hits an end slower stays there")
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
            thrown = gt.reinit(v, -self.restitution * v, impulse=self.force)
            yield gt.when((inside <= 0.0) & bounces, thrown)
            stays = [gt.reinit(v, 0.0 * v, impulse=self.force), self.rests == side]
            yield gt.when((inside <= 0.0) & ~bounces, *stays)
            # what was let go and is pressed against it again at once has not left it
            yield gt.when(inside <= -DEPTH * (self.high - self.low), *stays)
        # without a force it stays
        yield gt.when(self.rests * self.force < 0.0, self.rests == 0.0)
