"""Serial arms by Denavit-Hartenberg numbers, with Hayati's parameter for nearly parallel axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...lang import ModelError
from .arm import FRICTION, SerialArm, arm_class
from .bodies import moments, with_payload
from .structure import ArmJoint, ArmStructure

Array = np.ndarray
KINDS = {"r": "revolute", "p": "prismatic", "revolute": "revolute", "prismatic": "prismatic"}


def serial_arm(
    a: ArrayLike,
    alpha: ArrayLike,
    d: ArrayLike = 0.0,
    theta: ArrayLike = 0.0,
    beta: ArrayLike = 0.0,
    *,
    convention: Literal["standard", "modified"] = "standard",
    joints: str | Sequence[str] = "r",
    names: Sequence[str] | None = None,
    limits: ArrayLike | None = None,
    c: ArrayLike | None = None,
    I: ArrayLike | None = None,
    title: str = "arm",
    smoothing: str = "tanh",
    payload: float = 0.0,
    **modifiers: Any,
) -> SerialArm:
    """A serial arm of n joints by its Denavit-Hartenberg numbers; one number stands for all joints.

    Args:
        a: link lengths (n,) [m].
        alpha: twists (n,) [rad].
        d: offsets (n,) [m]; of a prismatic joint added to its coordinate.
        theta: angles (n,) [rad]; of a revolute joint added to its coordinate.
        beta: Hayati's angles (n,) [rad] about y, for axes nearly parallel to the next, where d stays as it is.
        convention: "standard", joint and then Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), or "modified" (Craig),
            Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d) and then the joint.
        joints: "r" or "p" of each, as "rrp", or one for all.
        names: of the joints.
        limits: (n, 2) lower and upper [rad, m].
        c, I: centres of mass (n, 3) [m] and inertias about them (n, 3, 3) [kg m2] in the link frames, in place of the
            mc and J of the model.
        title: name of the arm.
        smoothing: of friction, "tanh", "piecewise_linear", "sign" or "stiction".
        payload: point mass at the tool's origin [kg].
        modifiers: any other parameter of `SerialArm`: m, tool_xyz, viscous, ...

    Gauge: `independent_geometry` says which numbers a calibration can determine beside unknown frames.

    Raises ModelError for arrays of other lengths and for words that it does not know.

    The tool of a SCARA, two parallel axes and a slide downwards [m]:

    >>> scara = gt.robots.serial_arm(a=[0.3, 0.25, 0.0], alpha=[0.0, np.pi, 0.0], joints="rrp")
    >>> T, status = scara.causal(known="q", targets="T")([0.0, np.pi / 2, 0.1])
    >>> T.round(6)
    array([ 0.3 ,  0.25, -0.1 ])
    """
    a, alpha, d, theta, beta = (
        _numbers(name, x)
        for name, x in zip(("a", "alpha", "d", "theta", "beta"), (a, alpha, d, theta, beta), strict=True)
    )
    limits = None if limits is None else _numbers("limits", limits)
    c, I = (None if x is None else _numbers(name, x) for name, x in (("c", c), ("I", I)))
    n = max(np.size(x) for x in (a, alpha, d, theta, beta))
    n = max(n, 0 if limits is None else len(np.atleast_2d(limits)), len(joints) if not isinstance(joints, str) else 1)
    n = max(n, len(joints) if isinstance(joints, str) and joints not in KINDS else 1)
    numbers = {"a": a, "alpha": alpha, "d": d, "theta": theta, "beta": beta}
    numbers = {key: _each(key, value, n) for key, value in numbers.items()}
    kinds = [joints] * n if isinstance(joints, str) and joints in KINDS else list(joints)
    wrong = next((k for k in kinds if k not in KINDS), None)
    if wrong is not None or len(kinds) != n:
        raise ModelError(f"joints takes one of r, p for each of the {n} joints, such as 'rrp'; found {joints!r}")
    if convention not in ("standard", "modified"):
        raise ModelError(f"a convention is standard or modified; found {convention!r}")
    if smoothing not in FRICTION:
        raise ModelError(f"friction smoothing is one of {', '.join(FRICTION)}; found {smoothing!r}")
    named = [f"joint_{k + 1}" for k in range(n)] if names is None else [str(x) for x in names]
    if len(named) != n or len(set(named)) != n:
        raise ModelError(f"names takes {n} different names, one for each joint; found {', '.join(named)}")
    ends = np.full((n, 2), [-np.inf, np.inf]) if limits is None else np.asarray(limits, float)
    if ends.shape != (n, 2) or not np.all(ends[:, 0] < ends[:, 1]):
        raise ModelError(f"limits takes a lower and a greater upper one for each of the {n} joints")
    made = tuple(
        ArmJoint(named[k], KINDS[kinds[k]], f"link_{k + 1}", float(ends[k, 0]), float(ends[k, 1]))  # type: ignore[arg-type]
        for k in range(n)
    )
    structure = ArmStructure(title, made, convention, smoothing=smoothing)
    values: dict[str, Any] = {**numbers, **modifiers}
    if c is not None or I is not None:
        if "mc" in modifiers or "J" in modifiers:
            raise ModelError("c and I say the same as mc and J; give one pair of the two")
        values["mc"], values["J"] = moments(values.get("m", np.zeros(n)), c, I)
    return arm_class(structure)(**with_payload(values, payload, n))


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise ModelError(f"'{name}' takes numbers, the same count in each row; found {str(value)[:60]}") from None


def _each(name: str, value: ArrayLike, n: int) -> Array:
    array = np.asarray(value, float)
    if array.shape not in ((), (n,)):
        raise ModelError(f"'{name}' has {array.size} numbers; expected {n}, one for each joint")
    return np.broadcast_to(array, n).copy()
