"""The configuration state of a Gantry-Tau: the choice among its inverse and forward solutions."""

from __future__ import annotations

from collections.abc import Sequence

from .. import lang as gt
from .f1 import F1
from .f1_geometry import F1FiveDof
from .six_link import SixLink
from .three_link import GantryTau

_SIGNS: dict[type[gt.Model], tuple[tuple[str, ...], str]] = {
    GantryTau: (("arm[0].ahead", "arm[1].ahead", "arm[2].ahead"), "plate_ahead"),
    F1FiveDof: (("arm_below[0]", "arm_below[1]", "arm_below[2]"), "plate_below"),
    # one sign per cart, that of its first link; the other links of the cart are on the side of the home pose
    SixLink: (("link[0].ahead", "link[1].ahead", "link[3].ahead"), ""),
    F1: (("below",), ""),
}


def configuration(robot: gt.Model, inverse: Sequence[int] | None = None, forward: int | None = None) -> dict[str, int]:
    """Return the branches of a configuration, for `robot.causal(..., branches=configuration(robot, (1, -1, 1), 1))`.

    Args:
        inverse: one sign per arm, +1 if the plate joint is ahead of the cart along its guideway (three links, six
            links) or below it (F1), else -1. The three signs are independent: a three-link robot has 8 inverse
            solutions. An F1 takes one sign, that of arm 1. None keeps the default, +1.
        forward: +1 if the plate is ahead of (F1: below) the plane through the three cart joints, -1 if it is behind
            (above); for three links and the 5-DOF F1, whose forward kinematics has two solutions. Independent of
            `inverse`.

    Raises ModelError for a robot without a configuration, a wrong number of signs, or signs other than +1 and -1.

    Carts of the L1, by default all behind their plate joints, and with the second cart ahead:

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> branches = gt.robots.configuration(robot, inverse=(1, -1, 1))
    >>> print(branches)
    {'arm[0].ahead': 1, 'arm[1].ahead': -1, 'arm[2].ahead': 1}
    >>> q, status = robot.causal(known="T", targets="q")(robot.home)
    >>> other, status = robot.causal(known="T", targets="q", branches=branches)(robot.home)
    >>> print(q.round(3), other.round(3))
    [-0.564 -0.347 -0.045] [-0.564  2.691 -0.045]
    """
    signs_of_class = next((signs for cls, signs in _SIGNS.items() if isinstance(robot, cls)), None)
    if signs_of_class is None:
        raise gt.ModelError(f"{type(robot).__name__} has no configuration; pass its branches to causal()")
    arms, side = signs_of_class
    result: dict[str, int] = {}
    if inverse is not None:
        if len(inverse) != len(arms):
            raise gt.ModelError(
                f"the inverse kinematics of {type(robot).__name__} takes {len(arms)} signs; found {len(inverse)}"
            )
        result = dict(zip(arms, inverse, strict=True))
    if forward is not None:
        if not side:
            raise gt.ModelError(
                f"the forward kinematics of {type(robot).__name__} is iterative and continues from the home pose; it "
                "takes no sign"
            )
        result[side] = forward
    for name, sign in result.items():
        if sign not in (-1, 1):
            raise gt.ModelError(f"the configuration takes +1 or -1 for {name}; found {sign}")
    return {name: int(sign) for name, sign in result.items()}
