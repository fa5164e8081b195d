"""The Gantry-Tau with two extra carts: five purely parallel degrees of freedom."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from .. import lang as gt
from .cart import Cart, cart_friction
from .six_link import SixLink, home_q, means, six_link_gantry_tau


class ExtraCarts(SixLink):
    """Six links on five carts: one link of arm 2 and one of arm 3 stand on extra carts of guideways 2 and 3.

    Dressler 2012, Fig. 2.3; of each cluster the last link stands on the extra cart, 2b on that of q[3] and 3c on that
    of q[4], a choice of ours. With q[3] = q[1] and q[4] = q[2] it is the six-link robot. Known q gives the pose by
    Newton; of the pose, T and two elements of e can be prescribed.

    The carts for the home pose, two elements of the quaternion among what is known:

    >>> robot = gt.robots.extra_carts()
    >>> q, status = robot.causal(known=["T", "e[1]", "e[2]"], targets="q")(robot.home, *robot.home_e[1:3])
    >>> print(q.round(3))
    [-0.218 -0.026 -0.217 -0.026 -0.216]
    """

    stands_on: ClassVar[tuple[int, ...]] = (0, 1, 3, 2, 2, 4)  # 2b and 3c have carts of their own
    m_c = gt.parameter(shape=5, unit="kg", positive=True, description="cart masses, joints included")
    coulomb = gt.parameter(np.zeros(5), unit="N", min=0.0, description="Coulomb friction of each cart")
    viscous = gt.parameter(np.zeros(5), unit="kg/s", min=0.0, description="viscous friction of each cart")
    q = gt.variable(5, unit="m", start=lambda self: home_q(self), description="cart coordinates along their guideways")
    tau = gt.input(5, unit="N", nominal=100.0, description="motor forces")
    cart = gt.parts(
        5,
        Cart,
        A=lambda self: means(self.A, self.stands_on),
        v=lambda self: means(self.v, self.stands_on),
        m=m_c,
        friction=cart_friction,
    )


def extra_carts(name: str = "d1_six_link", **modifiers: Any) -> ExtraCarts:
    """A printed six-link geometry with two extra carts of 10 kg; all masses and frictions are an example of ours.

    Modifiers: any parameter of ExtraCarts. Raises ModelError for an unknown name.

    Carts 2 and 4 share guideway 2, carts 3 and 5 share guideway 3. Two of them, 10 mm apart, turn the plate [degrees]:

    >>> robot = gt.robots.extra_carts()
    >>> e, status = robot.causal(known="q", targets="e")([[-0.2, 0.0, -0.2, 0.0, -0.2], [-0.2, 0.0, -0.2, 0.01, -0.2]])
    >>> print(round(np.degrees(2 * np.arccos(abs(e[0] @ e[1]))), 2))
    2.34
    """
    robot = six_link_gantry_tau(name)._modifiers
    sizes = {"m_c": 10.0, "coulomb": 100.0, "viscous": 100.0}
    more = {name: [*robot[name], size, size] for name, size in sizes.items()}
    return ExtraCarts(**{**robot, **more, **modifiers})
