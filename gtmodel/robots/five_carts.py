"""The Gantry-Tau with two extra carts: five purely parallel degrees of freedom."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt
from ..mechanics.rotation import quaternion_matrix
from .six_link import Cart, SixLink, six_link_gantry_tau

ON = (0, 1, 3, 2, 2, 4)  # the cart on which each link stands: 2b and 3c have their own


class ExtraCarts(SixLink):
    """Six links on five carts: one link of arm 2 and one of arm 3 stand on extra carts of guideways 2 and 3.

    Dressler 2012, Fig. 2.3; of each cluster the last link moves to the extra cart, q[3] for 2b and q[4] for 3c, the
    choice of ours. With q[3] = q[1] and q[4] = q[2] it is the six-link robot. Known q gives the pose by Newton; of the
    pose, T and two elements of e can be prescribed. A reorientation of about 5 degrees is reported.
    """

    m_c = gt.parameter(shape=5, unit="kg", positive=True, description="cart masses, joints included")
    coulomb = gt.parameter(np.zeros(5), unit="N", description="Coulomb friction of each cart")
    viscous = gt.parameter(np.zeros(5), unit="kg/s", description="viscous friction of each cart")
    q = gt.variable(5, unit="m", start=lambda self: _home_q(self), description="cart coordinates along their guideways")
    tau = gt.input(5, unit="N", nominal=100.0, description="motor forces")
    cart = gt.parts(
        5,
        Cart,
        A=lambda self: _means(self.A),
        v=lambda self: _means(self.v),
        m=m_c,
        friction=lambda self: [
            dict(coulomb=self.coulomb[i], viscous=self.viscous[i], velocity_scale=self.velocity_scale) for i in range(5)
        ],
    )

    def equations(self):
        for k, link in enumerate(self.link):
            yield gt.connect(link.cart, self.cart[ON[k]].flange)
            yield gt.connect(link.tip, self.plate.point[k])
        for i, cart in enumerate(self.cart):
            yield self.q[i] == cart.flange.s
            yield self.tau[i] == cart.motor.force
        yield self.plate.frame.r == self.T
        yield self.e == self.plate.attitude.e
        yield self.plate.frame.R == self.R


def _means(rows: Any) -> list[Any]:
    groups = [[rows[k] for k in range(6) if ON[k] == i] for i in range(5)]
    return [sum(group[1:], group[0]) / len(group) for group in groups]


def _home_q(robot: Any) -> Any:
    R = quaternion_matrix(robot.home_e)
    q = []
    for i in range(5):
        k = ON.index(i)
        d, v = robot.home + R @ robot.B[k] - robot.A[k], robot.v[k]
        dv, vv = gt.dot(d, v), gt.dot(v, v)
        root = dv**2 - vv * (gt.dot(d, d) - robot.L[k] ** 2)
        q.append((dv - gt.sqrt(gt.maximum(root, 0.0))) / vv)
    return gt.vector(q)


def extra_carts(name: str = "d1_six_link", **modifiers: Any) -> ExtraCarts:
    """A printed six-link geometry with two extra carts of 10 kg; all masses and frictions are an example of ours.

    Modifiers: any parameter of ExtraCarts. Raises ModelError for an unknown name.
    """
    robot = six_link_gantry_tau(name).__dict__["_modifiers"]
    sizes = {"m_c": 10.0, "coulomb": 100.0, "viscous": 100.0}
    more = {name: [*robot[name], size, size] for name, size in sizes.items()}
    return ExtraCarts(**{**robot, **more, **modifiers})
