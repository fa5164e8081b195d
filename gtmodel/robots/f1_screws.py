"""The F1 with the ball screws that drive its rotary axes."""

from __future__ import annotations

from .. import lang as gt
from ..mechanics import BallScrew
from .f1 import F1


class F1BallScrews(F1):
    """An F1 whose actuators are all in metres: s (6), the carts q1..q3 and the travels of three ball screws.

    The screws turn q4, q5, q6 (Dressler 2012, section 5.4, which prints neither relation nor dimensions: those of
    BallScrew are an EXAMPLE OF OURS). Motors of the rotary axes stay where F1 has them.
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
