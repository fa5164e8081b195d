"""The configuration state of a Gantry-Tau: which of its inverse and forward solutions is meant."""

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
    # a cart of one link has one root; the signs of the others go together with those of its home pose
    SixLink: (("link[0].ahead", "link[1].ahead", "link[3].ahead"), ""),
    F1: (("below",), ""),
}


def configuration(robot: gt.Model, inverse: Sequence[int] | None = None, forward: int | None = None) -> dict[str, int]:
    """Branches of a configuration, for `robot.causal(..., branches=configuration(robot, (1, -1, 1), 1))`.

    Args:
        inverse: signs +1 or -1, one per arm: the plate joint ahead of the cart along its guideway (three links, six
            links) or below it (F1). All three are independent: 8 inverse solutions of three links. An F1 takes one,
            that of arm 1. None leaves the default, +1.
        forward: the plate ahead of (below) the plane through the three cart joints, +1, or behind it (above), -1; for
            three links and the 5-DOF F1, whose forward kinematics has two solutions. Independent of `inverse`.

    Raises ModelError for a robot without a configuration, a wrong number of signs, or signs other than +1 and -1.

    Carts of the L1 with the second one ahead of its plate joint, where the default has all behind:

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
        raise gt.ModelError(f"{type(robot).__name__} has no configuration; name its branches to causal()")
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
                f"the forward kinematics of {type(robot).__name__} is iterative and continues the home pose; it takes "
                "no sign"
            )
        result[side] = forward
    for name, sign in result.items():
        if sign not in (-1, 1):
            raise gt.ModelError(f"the configuration takes +1 or -1 for {name}; found {sign}")
    return {name: int(sign) for name, sign in result.items()}
