"""A mass on a belt, held by a spring: it sticks until the spring force exceeds static friction, then slips back."""

import gtmodel as gt


class Belt(gt.Model):
    """Static friction exceeds kinetic friction. `slides` is -1 if the mass is slower than the belt, 0 if it sticks, and
    1 if it is faster."""

    m = gt.parameter(1.0, unit="kg", positive=True)
    k = gt.parameter(100.0, unit="N/m")
    belt = gt.parameter(0.1, unit="m/s", description="speed of the belt")
    static = gt.parameter(5.0, unit="N")
    kinetic = gt.parameter(3.0, unit="N")
    x = gt.variable(unit="m", start=0.0, description="elongation of the spring")
    v = gt.variable(unit="m/s", start=0.1)
    force = gt.variable(unit="N", description="friction force of the belt on the mass")
    slides = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield self.m * gt.der(self.v) == self.force - self.k * self.x
        yield gt.energy(stored=self.m / 2 * self.v**2 + self.k / 2 * self.x**2, supplied=self.force * self.v)
        stuck = (self.slides > -0.5) & (self.slides < 0.5)
        yield gt.If(stuck, gt.der(self.v) == 0.0, self.force == -self.slides * self.kinetic)
        yield gt.when(stuck & (self.force >= self.static), self.slides == -1.0)
        yield gt.when(stuck & (self.force <= -self.static), self.slides == 1.0)
        yield gt.when(self.slides * (self.v - self.belt) <= 0.0, self.slides == 0.0)
