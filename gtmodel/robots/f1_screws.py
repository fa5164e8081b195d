"""The F1 with the ball screws that drive its rotary axes."""

from __future__ import annotations

from .. import lang as gt
from ..mechanics import BallScrew
from .f1 import F1


class F1BallScrews(F1):
    """An F1 whose actuators are all in metres: s (6) [m], the carts q1..q3 and the travels of three ball screws.

    The screws turn q4, q5, q6 (Dressler 2012, section 5.4, which prints neither relation nor dimensions: those of
    BallScrew are an EXAMPLE OF OURS). Motors of the rotary axes stay where F1 has them.

    The F1 of the catalogue on ball screws; 4 mm of the first screw turn q4 [degrees]:

    >>> f1 = gt.robots.f1_gantry_tau()
    >>> needed = ("A0", "v", "L", "A", "B", "u1_2", "u1_3", "u2_3", "r3", "m_p", "I_p", "m_c", "J", "home", "home_e")
    >>> robot = gt.robots.F1BallScrews(**{name: getattr(f1, name) for name in needed})
    >>> q, status = robot.causal(known="s", targets="q")([0.7, 0.26, 0.2, 0.004, 0.0, 0.0])
    >>> np.degrees(q[3:]).round(2) + 0.0
    array([2.49, 0.  , 0.  ])
    """

    s = gt.variable(6, unit="m", description="carts q1..q3, travels of the ball screws of q4..q6")
    screw = gt.parts(3, BallScrew)

    def equations(self):
        yield from super().equations()
        shafts = [self.turning.shaft, *self.tilting.shaft]
        for i, (screw, shaft) in enumerate(zip(self.screw, shafts, strict=True)):
            yield gt.connect(screw.shaft, shaft)
            yield self.s[i] == self.cart[i].flange.s
            yield self.s[3 + i] == screw.flange.s
