"""The hexapod of the Jugglebot project (Project-DeepBlue-Juggling/Jugglebot, MIT licence): six motor-driven legs.

Nominal dimensions as published with the recordings.
"""

import numpy as np

import gtmodel as gt
from gtmodel.mechanics import Anchor, PointFrame, RigidPlate, Strut

HEIGHT, BASE_RADIUS, PLATFORM_RADIUS = 0.565, 0.410, 0.219075  # m, with all legs retracted
REVOLUTIONS_PER_METRE = np.array([13.21144, 14.0456, 13.8233, 14.124109, 14.16007, 14.03256])


def ring(radius: float, first: float, by_pair: float, by_side: float) -> np.ndarray:
    """Six joints (6, 3) [m] in three pairs on a circle in z = 0: angles first + i by_pair + j by_side [deg]."""
    n = np.arange(6)
    angle = np.radians(first + by_pair * (n // 2) + by_side * ((n + 1) // 2))
    return radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(6)])


BASE = ring(BASE_RADIUS, 200.0, 100.0, 20.0)
PLATFORM = ring(PLATFORM_RADIUS, 154.3012223, 8.6024446, 111.3975554)
RUN_IN = np.linalg.norm(PLATFORM + np.array([0.0, 0.0, HEIGHT]) - BASE, axis=1)


class Leg(gt.Model):
    """A leg from the base joint A to `tip`; after n motor revolutions its length is L0 + c n."""

    A = gt.parameter(shape=3, unit="m", description="base joint")
    L0 = gt.parameter(unit="m", positive=True, description="length at zero revolutions, as homed")
    c = gt.parameter(unit="m", positive=True, description="length per revolution")
    n = gt.variable(unit="1", start=2.0, description="motor revolutions from the homed position")
    tip = gt.port(PointFrame)
    foot = gt.part(Anchor, r=A)
    strut = gt.part(Strut, length=dict(start=0.75))

    def equations(self):
        yield gt.connect(self.foot.point, self.strut.a)
        yield gt.connect(self.strut.b, self.tip)
        yield self.strut.length == self.L0 + self.c * self.n


class Hexapod(gt.Model):
    """A platform on six legs: motor revolutions n, position T [m] and quaternion e of the platform, scalar first.

    |T + R(e) B_k - A_k| = L0_k + c_k n_k, leg by leg: 18 + 18 + 6 + 6 parameters. Nominally, with all legs retracted,
    the platform is parallel to the base, centred above it at a height of 565 mm.
    """

    A = gt.parameter(BASE, unit="m", description="base joints, one row each")
    B = gt.parameter(PLATFORM, unit="m", description="platform joints from T, platform coordinates")
    L0 = gt.parameter(RUN_IN, unit="m", description="lengths at zero revolutions, as homed")
    c = gt.parameter(1 / REVOLUTIONS_PER_METRE, unit="m", description="lengths per revolution")
    m = gt.parameter(1.0, unit="kg", positive=True, description="platform mass, an example value")
    n = gt.variable(6, unit="1", start=2.0, description="motor revolutions")
    T = gt.variable(3, unit="m", start=[0.0, 0.0, 0.73], prefer=1, description="platform centre")
    e = gt.variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-2, description="platform quaternion, scalar first")
    leg = gt.parts(6, Leg, A=A, L0=L0, c=c)
    plate = gt.part(RigidPlate, m=m, I=np.diag([0.01, 0.01, 0.02]), B=B)

    def equations(self):
        for k, leg in enumerate(self.leg):
            yield gt.connect(leg.tip, self.plate.point[k])
            yield self.n[k] == leg.n
        yield self.plate.frame.r == self.T
        yield self.e == self.plate.attitude.e
