"""The chain of joint axes of an arm's model."""

from __future__ import annotations

from ..geometry.chains import Chain, closed_form
from ..lang import Model, ModelError
from ..results import ArgumentError


def chain_of(robot: Model, *, named: bool = False) -> Chain:
    """Return the joint axes of a serial arm with joint coordinates q, position T and orientation R of its end.

    DH, URDF and hand-written arms alike: the axes are derivatives of the forward kinematics. `named`: the arm must have
    six joints and postures with names, as one with a spherical wrist has. Raises ArgumentError for a model without q, T
    and R, and for one whose end does not move by joints that turn or slide one after the other.

    >>> arm = gt.kinematics.chain_of(gt.robots.kr500())
    >>> postures = gt.kinematics.postures(arm, [1.5, 0.4, 1.2], np.diag([1.0, -1.0, -1.0]))  # flange points down
    >>> postures.names[0], np.degrees(postures.q[0, 0, :3]).round(1)
    ('front, up, no flip', array([-14.9, -72.1, 119.5]))
    """
    try:
        forward = robot.causal(known="q", targets=["T", "R"])
    except (ModelError, AttributeError) as error:
        raise ArgumentError(f"expected a serial arm with q, T and R, such as kr500; {error}", "robot") from error
    chain = Chain.of_function(forward.casadi)
    if chain is None:
        raise ArgumentError(
            "expected a serial arm, such as kr500: each entry of q turns or moves all that follows by its own value",
            "robot",
        )
    if named and (len(chain) != 6 or closed_form(chain) is None):
        raise ArgumentError(
            f"expected a serial arm of six joints with a spherical wrist, such as kr500, or with three parallel axes; "
            f"this one has {len(chain)} joints, and its axes no such structure",
            "robot",
        )
    return chain
