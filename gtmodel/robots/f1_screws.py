"""The F1 with the ball screws that drive its rotary axes."""

from __future__ import annotations

from typing import Any

from .. import lang as gt
from ..mechanics import BallScrew
from .f1 import F1, f1_gantry_tau


class F1BallScrews(F1):
    """An F1 whose actuators are all in metres: s (6) [m], the carts q1..q3 and the travels of three ball screws.

    The screws turn q4, q5, q6 (Dressler 2012, section 5.4, which prints neither relation nor dimensions: those of
    BallScrew are an EXAMPLE OF OURS). Motors of the rotary axes stay where F1 has them.

    `f1_ball_screws` makes that of the catalogue. 4 mm of the first screw turn q4 [degrees]; another lever:

    >>> known = ([0.7, 0.26, 0.2, 0.004, 0.0, 0.0],)
    >>> for robot in gt.robots.f1_ball_screws(), gt.robots.f1_ball_screws(screw=dict(b=0.2)):
    ...     q, status = robot.causal(known="s", targets="q")(*known)
    ...     print(np.degrees(q[3:]).round(2) + 0.0)
    [2.49 0.   0.  ]
    [1.48 0.   0.  ]
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


def f1_ball_screws(name: str = "f1", parallel: bool = False, **modifiers: Any) -> F1BallScrews:
    """The F1 on ball screws; arguments as for `f1_gantry_tau`, modifiers of F1BallScrews.

    Dimensions of the screws are an example of ours (see BallScrew). Raises ModelError for another name.

    Carts and travels of the screws [m] for the home pose:

    >>> robot = gt.robots.f1_ball_screws()
    >>> s, status = robot.causal(known=["T", "e"], targets="s")(robot.home, robot.home_e)
    >>> print(s.round(3))
    [ 0.719  0.262  0.208  0.    -0.005 -0.001]
    """
    robot = f1_gantry_tau(name, parallel)._modifiers
    return F1BallScrews(**{**robot, **modifiers})
