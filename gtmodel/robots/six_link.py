"""The Gantry-Tau with six links and a rigid plate; also with two extra carts, and with the triangular arm of the
Queensland machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from .. import lang as gt
from ..geometry import quaternions
from ..geometry.quaternions import zyz_quaternion
from ..mechanics import Flange, Guideway, MidpointRod, PointFrame, RigidPlate
from ..mechanics.bodies import quaternion_matrix
from .cart import Cart, behind_and_ahead, cart_friction
from .entries import printed

LINKS = ("1", "2a", "2b", "3a", "3b", "3c")
ARM = (0, 1, 1, 2, 2, 2)  # the cart of each link


class Link(gt.Model):
    """One link from a cart to the plate; its cart joint is A + q v (Dressler 2012, section 4.4: A and v of each link).

    Branch `ahead`: the plate joint is ahead of the cart joint along the guideway, dot(d, v) > 0.
    """

    A = gt.parameter(shape=3, unit="m", description="cart joint at q = 0")
    v = gt.parameter(shape=3, unit="1", kind="direction", description="motion of that joint per q, not normalised")
    cart = gt.port(Flange)
    tip = gt.port(PointFrame)
    guideway = gt.part(Guideway, A=A, v=v)
    rod = gt.part(MidpointRod)

    def equations(self):
        yield gt.connect(self.cart, self.guideway.flange)
        yield gt.connect(self.guideway.frame, self.rod.a)
        yield gt.connect(self.rod.b, self.tip)
        yield gt.branch("ahead", gt.dot(self.rod.b.r - self.rod.a.r, self.v))


class SixLink(gt.Model):
    """Gantry-Tau with links 1, 2a, 2b, 3a, 3b, 3c and a rigid plate: carts q [m], pose T [m] and R, forces tau [N].

    The closure equation of link (i, j) is |T + R B_ij - A_ij - q_i v_ij| = L_ij (Dressler 2012, section 4.4). The rows
    of A, v, L, B and m_a are the links in the order of LINKS. The reference point of a cart, which carries its mass,
    moves with the mean of its links' v. A positive force of tau pushes its cart along +v. R = R(e), e a unit
    quaternion, scalar first; e and -e are the same pose. A wrist may be connected to plate.frame. The Newton iteration
    finds the assembly mode that continues from the home pose, with the carts behind the plate unless `branches` select
    another one.

    Attributes:
        stands_on: the cart of each link.

    Rotation of the plate [degrees] when it moves half a metre along the guideways; it follows from the position:

    >>> robot = gt.robots.six_link_gantry_tau()
    >>> R, status = robot.causal(known="T", targets="R")([robot.home, robot.home + [0.5, 0.0, 0.0]])
    >>> angle = np.arccos((np.trace(R[0].T @ R[1]) - 1) / 2)
    >>> print(round(np.degrees(angle), 3))
    0.027
    """

    stands_on: ClassVar[tuple[int, ...]] = ARM
    A = gt.parameter(shape=(6, 3), unit="m", description="cart joints at q = 0")
    v = gt.parameter(shape=(6, 3), unit="1", kind="direction", description="joint motion per q, not normalised")
    L = gt.parameter(shape=6, unit="m", positive=True, description="link lengths")
    B = gt.parameter(shape=(6, 3), unit="m", description="plate joints from T, plate coordinates")
    m_p = gt.parameter(unit="kg", positive=True, description="plate mass, joints and payload included")
    c_p = gt.parameter([0.0, 0.0, 0.0], unit="m", description="plate's centre of mass from T, plate coordinates")
    I_p = gt.parameter(
        shape=(3, 3),
        unit="kg.m2",
        kind="semidefinite",
        description="plate's inertia about its centre of mass, plate axes",
    )
    m_c = gt.parameter(shape=3, unit="kg", positive=True, description="cart masses, joints included")
    m_a = gt.parameter(np.zeros(6), unit="kg", min=0.0, description="link masses")
    coulomb = gt.parameter([0.0, 0.0, 0.0], unit="N", min=0.0, description="Coulomb friction of each cart")
    viscous = gt.parameter([0.0, 0.0, 0.0], unit="kg/s", min=0.0, description="viscous friction of each cart")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="friction smoothing")
    home = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a reachable T")
    home_e = gt.parameter([1.0, 0.0, 0.0, 0.0], unit="1", kind="unit", description="plate quaternion at home")
    q = gt.variable(3, unit="m", start=lambda self: home_q(self), description="cart coordinates along their guideways")
    T = gt.variable(3, unit="m", start=home, prefer=1, description="tool centre point, origin of the plate frame")
    e = gt.variable(4, unit="1", start=home_e, prefer=-2, description="plate quaternion, scalar first")
    R = gt.variable((3, 3), unit="1", prefer=-4, description="rotation from plate to world coordinates")
    tau = gt.input(3, unit="N", nominal=100.0, description="motor forces")
    cart = gt.parts(
        3,
        Cart,
        A=lambda self: means(self.A, self.stands_on),
        v=lambda self: means(self.v, self.stands_on),
        m=m_c,
        friction=cart_friction,
    )
    link = gt.parts(6, Link, A=A, v=v, rod=lambda self: [dict(L=self.L[k], m=self.m_a[k]) for k in range(6)])
    plate = gt.part(RigidPlate, m=m_p, c=c_p, I=I_p, B=B)

    def equations(self):
        for k, link in enumerate(self.link):
            yield gt.connect(link.cart, self.cart[self.stands_on[k]].flange)
            yield gt.connect(link.tip, self.plate.point[k])
        for i, cart in enumerate(self.cart):
            yield self.q[i] == cart.flange.s
            yield self.tau[i] == cart.motor.force
        yield self.plate.frame.r == self.T
        yield self.e == self.plate.attitude.e
        yield self.plate.frame.R == self.R


def on_guideways(guideways: Sequence[Any]) -> dict[str, list[dict[str, Any]]]:
    """Return modifiers of SixLink that put arms 1 to 3 on the given guideway parts: a cart and its links deviate alike.

    `SixLink(..., **on_guideways([PiecewiseLinearGuideway(at=..., deviation=...), Guideway, SplineGuideway(...)]))`.
    Each link keeps its A and v (Dressler 2012, section 5.3: models 4 and 5). For GantryTau use
    `arm=[dict(guideway=g) for g in guideways]`.

    Raises ModelError unless there are three guideways.

    Arm 2 of the six-link D1 on a curve that rises by 0.1 mm in its middle, the others straight:

    >>> straight = gt.mechanics.Guideway
    >>> bent = gt.mechanics.SplineGuideway(at=[-1.0, 0.0, 1.0], deviation=[[0, 0, 0], [0, 0, 1e-4], [0, 0, 0]])
    >>> modifiers = gt.robots.on_guideways([straight, bent, straight])
    >>> robot = gt.robots.six_link_gantry_tau(**modifiers)
    >>> print({part: len(each) for part, each in modifiers.items()})
    {'cart': 3, 'link': 6}
    >>> gt.robots.on_guideways([straight, bent])
    Traceback (most recent call last):
        ...
    gtmodel.lang.source.ModelError: on_guideways takes one guideway per arm, three; found 2
    """
    if len(guideways) != 3:
        raise gt.ModelError(f"on_guideways takes one guideway per arm, three; found {len(guideways)}")
    return dict(cart=[dict(guideway=g) for g in guideways], link=[dict(guideway=guideways[i]) for i in ARM])


def means(rows: Any, stands_on: Sequence[int]) -> list[Any]:
    """Mean over the links of each cart."""
    groups = [[rows[k] for k, cart in enumerate(stands_on) if cart == i] for i in range(max(stands_on) + 1)]
    return [sum(group[1:], group[0]) / len(group) for group in groups]


def home_q(robot: Any) -> Any:
    """Return carts behind the plate at the home pose, from the first link of each: start values on the usual side."""
    R = quaternion_matrix(robot.home_e)
    first = [robot.stands_on.index(i) for i in range(max(robot.stands_on) + 1)]
    return gt.vector(
        [behind_and_ahead(robot.home + R @ robot.B[k] - robot.A[k], robot.v[k], robot.L[k])[0] for k in first]
    )


# No masses of D1 are printed. These are an EXAMPLE OF OURS, similar to the identified L1 (Dressler 2012, Table 6.3).
EXAMPLE = dict(
    m_p=12.0,
    I_p=np.diag([0.25, 0.25, 0.3]),
    m_c=np.array([15.0, 20.0, 40.0]),
    m_a=np.full(6, 2.0),
    coulomb=np.array([130.0, 150.0, 200.0]),
    viscous=np.array([100.0, 200.0, 300.0]),
)
D1_ZYZ_DEG = (85.0, 100.9, -88.6)  # the plate's orientation: see the note of d1_six_link in data/gantry_tau.toml


def six_link_gantry_tau(name: str = "d1_six_link", **modifiers: Any) -> SixLink:
    """Return the six-link D1 (Dressler 2012, Table 5.9 model 3); masses and friction are an example of ours.

    Repaired: A and v of link 2b are missing in the printed text. Here A_2b = A_2a plus the difference of the offsets of
    model 4, and v_2b = v_2a, which agrees with Table 5.8 to 1.1 mm.

    The plate is ahead of the carts, side c = -1, where the tool centre points of the six-link and the three-link model
    agree; e is near ZYZ = (85.0, 100.9, -88.6) deg. Modifiers: any parameter of SixLink. Raises ModelError for an
    unknown name.

    A heavier plate [kg] with the printed link lengths [m]:

    >>> robot = gt.robots.six_link_gantry_tau(m_p=20.0)
    >>> print(robot.m_p, robot.L)
    20.0 [2.04422 2.04291 2.04294 2.04351 2.04352 2.04352]
    """
    if name != "d1_six_link":
        raise gt.ModelError(f"there is no six-link robot '{name}'; there is d1_six_link")
    A, v, L, B = (np.array(printed("gantry_tau.toml")[name][k], dtype=float) for k in ("A_m", "v", "L_m", "B_m"))
    home = A.mean(axis=0) + 0.85 * L.mean() * v.mean(axis=0)
    values = dict(A=A, v=v, L=L, B=B, home=home, home_e=zyz_quaternion(*np.radians(D1_ZYZ_DEG)), **EXAMPLE)
    return SixLink(**{**values, **modifiers})


class ExtraCarts(SixLink):
    """Six links on five carts: one link of arm 2 and one of arm 3 are on extra carts of guideways 2 and 3.

    Dressler 2012, Fig. 2.3. The last link of each cluster is on the extra cart, 2b on that of q[3] and 3c on that of
    q[4]; this is a choice of ours. With q[3] = q[1] and q[4] = q[2] it is the six-link robot. A Newton iteration gives
    the pose for known q. T and two elements of e can be prescribed.

    The carts for the home pose, from T and two elements of the quaternion:

    >>> robot = gt.robots.extra_carts()
    >>> q, status = robot.causal(known=["T", "e[1]", "e[2]"], targets="q")(robot.home, *robot.home_e[1:3])
    >>> print(q.round(3))
    [-0.218 -0.026 -0.217 -0.026 -0.216]
    """

    stands_on: ClassVar[tuple[int, ...]] = (0, 1, 3, 2, 2, 4)  # 2b and 3c are on the extra carts
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
    """Return a printed six-link geometry with two extra carts of 10 kg; all masses and friction: an example of ours.

    Modifiers: any parameter of ExtraCarts. Raises ModelError for an unknown name.

    Carts 2 and 4 share guideway 2, carts 3 and 5 share guideway 3. Rotation of the plate [degrees] if carts 2 and 4 are
    10 mm apart:

    >>> robot = gt.robots.extra_carts()
    >>> e, status = robot.causal(known="q", targets="e")([[-0.2, 0.0, -0.2, 0.0, -0.2], [-0.2, 0.0, -0.2, 0.01, -0.2]])
    >>> print(round(np.degrees(2 * np.arccos(abs(e[0] @ e[1]))), 2))
    2.34
    """
    robot = six_link_gantry_tau(name)._modifiers
    sizes = {"m_c": 10.0, "coulomb": 100.0, "viscous": 100.0}
    more = {name: [*robot[name], size, size] for name, size in sizes.items()}
    return ExtraCarts(**{**robot, **more, **modifiers})


def triangular(robot: SixLink) -> dict[str, np.ndarray]:
    """Return A (6, 3) and L (6) [m] for a triangular arm 3: links 3b and 3c meet in one joint midway on the cart.

    With their two plate joints they form a triangle, so that the plate turns with the arm, as on the Queensland
    Gantry-Tau (Dressler 2012, section 2.2): the orientation changes with the position, and the cart needs less room. No
    dimensions are printed: the choice of links and of their common joint is OURS. The lengths close the loops at the
    robot's home pose, with the cart at the coordinate of its first link.
    """
    A, v, B, L = (np.array(getattr(robot, name), dtype=float) for name in "AvBL")
    home, R = np.array(robot.home), quaternions.quaternion_matrix(np.array(robot.home_e))
    joint, along = home + R @ B[3] - A[3], v[3]
    dv, vv = joint @ along, along @ along
    q = (dv - np.sqrt(dv**2 - vv * (joint @ joint - L[3] ** 2))) / vv
    A[4:] = A[4:].mean(axis=0)
    L[4:] = np.linalg.norm(home + B[4:] @ R.T - A[4:] - q * v[4:], axis=1)
    return {"A": A, "L": L}


def queensland_gantry_tau(name: str = "d1_six_link", **modifiers: Any) -> SixLink:
    """Return the six-link D1 with a triangular arm 3: an EXAMPLE OF OURS for the structure of the Queensland machine.

    modifiers: any parameter of SixLink. Raises ModelError for an unknown name.

    Rotation of the plate [degrees] over 0.3 m; the plate of the six-link D1 turns by 0.09 degrees:

    >>> robot = gt.robots.queensland_gantry_tau()
    >>> R, status = robot.causal(known="T", targets="R")([robot.home, robot.home + [0.0, 0.0, 0.3]])
    >>> print(round(np.degrees(np.arccos((np.trace(R[0].T @ R[1]) - 1) / 2)), 2))
    6.1
    """
    robot = six_link_gantry_tau(name)
    return robot.with_(**{**triangular(robot), **modifiers})
