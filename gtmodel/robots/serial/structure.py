"""What a serial arm is made of: joints in their order with limits, and inertias of links in their two forms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...lang import ModelError

JointKind = Literal["revolute", "prismatic"]
Style = Literal["rpy", "standard", "modified"]


@dataclass(frozen=True)
class ArmJoint:
    """A moving joint: its name, kind and the link that it moves; limits in rad or m, rad/s or m/s, N.m or N.

    A joint with a `leader`, the place of another one among the joints of the arm, follows it (mimic of URDF): its
    coordinate is multiplier times the leader's plus offset.
    """

    name: str
    kind: JointKind
    link: str
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf
    leader: int | None = None
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ArmStructure:
    """The joints of an arm from the base to the tool, and how they are placed.

    style: by xyz and rpy ("rpy"), or by standard or modified Denavit-Hartenberg numbers. smoothing: of friction. notes:
    what was left out of the file it came from, in sentences.
    """

    name: str
    joints: tuple[ArmJoint, ...]
    style: Style
    base: str = "base"
    tool: str = "tool"
    smoothing: str = "tanh"
    notes: tuple[str, ...] = ()

    @property
    def leaders(self) -> list[int]:
        """Places of the joints that follow no other, in the order of q."""
        return [k for k, joint in enumerate(self.joints) if joint.leader is None]

    def coordinate(self, k: int) -> tuple[int, float, float]:
        """Of joint k: the place in q, and multiplier and offset of what stands there."""
        joint = self.joints[k]
        if joint.leader is None:
            return self.leaders.index(k), 1.0, 0.0
        return self.leaders.index(joint.leader), joint.multiplier, joint.offset

    def geared(self, k: int) -> bool:
        """Whether joint k turns and follows one that slides, or the reverse: as nut and spindle."""
        leader = self.joints[k].leader
        return leader is not None and self.joints[leader].kind != self.joints[k].kind

    @property
    def kinds(self) -> set[str]:
        """Kinds of joints that there are."""
        return {joint.kind for joint in self.joints}

    def limits(self) -> np.ndarray:
        """Of q (n, 2), lower and upper; those of followers too, as far as they bind."""
        low, high = (np.full(len(self.leaders), v) for v in (-np.inf, np.inf))
        for k, joint in enumerate(self.joints):
            at, multiplier, offset = self.coordinate(k)
            if multiplier == 0.0:
                continue
            ends = sorted([(joint.lower - offset) / multiplier, (joint.upper - offset) / multiplier])
            low[at], high[at] = max(low[at], ends[0]), min(high[at], ends[1])
        return np.column_stack([low, high])


Array = np.ndarray
# of a symmetric tensor: xx, xy, xz, yy, yz, zz
ROWS, COLUMNS = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])


def tensor(six: ArrayLike) -> Array:
    """Tensors (..., 3, 3) of xx, xy, xz, yy, yz, zz (..., 6)."""
    six = np.asarray(six, float)
    full = np.zeros((*six.shape[:-1], 3, 3))
    full[..., ROWS, COLUMNS] = six
    full[..., COLUMNS, ROWS] = six
    return full


def six_of(full: ArrayLike) -> Array:
    """xx, xy, xz, yy, yz, zz (..., 6) of tensors (..., 3, 3)."""
    return np.asarray(full, float)[..., ROWS, COLUMNS]


def about_point(m: ArrayLike, r: ArrayLike) -> Array:
    """Inertia (..., 3, 3) of point masses m (...,) [kg] at r (..., 3) [m] about the origin."""
    r = np.asarray(r, float)
    square = np.sum(r**2, axis=-1)[..., None, None] * np.eye(3)
    return np.asarray(m, float)[..., None, None] * (square - r[..., :, None] * r[..., None, :])


def moments(m: ArrayLike, c: ArrayLike | None, I: ArrayLike | None) -> tuple[Array, Array]:
    """mc (n, 3) and J (n, 6) about the frames' origins of masses (n,), centres c (n, 3) and inertias I (n, 3, 3)."""
    m = np.asarray(m, float)
    c = np.zeros((len(m), 3)) if c is None else np.asarray(c, float)
    I = np.zeros((len(m), 3, 3)) if I is None else np.asarray(I, float)
    if c.shape != (len(m), 3) or I.shape != (len(m), 3, 3):
        raise ModelError(f"c takes ({len(m)}, 3) and I ({len(m)}, 3, 3); found {c.shape} and {I.shape}")
    return m[:, None] * c, six_of(I + about_point(m, c))


def central(m: float, mc: ArrayLike, J: ArrayLike) -> tuple[Array, Array]:
    """Centre of mass (3,) [m] and inertia about it (3, 3) of a body with mass; m must not be 0."""
    c = np.asarray(mc, float) / m
    return c, tensor(J) - about_point(m, c)


def moved(R: Array, r: Array, m: float, mc: Array, J: Array) -> tuple[Array, Array]:
    """mc and J of a body in a frame where its own stands at r (3,) turned by R (3, 3)."""
    h = R @ mc
    cross = np.outer(r, h)
    shift = about_point(m, r) + 2 * (r @ h) * np.eye(3) - cross - cross.T
    return h + m * r, six_of(R @ tensor(J) @ R.T + shift)


def with_payload(values: dict[str, Any], payload: float, n: int) -> dict[str, Any]:
    """Modifiers of an arm with a point mass at the tool's origin. Raises ModelError for a payload below 0."""
    if payload < 0:
        raise ModelError(f"a payload is a mass of 0 kg or more; found {payload:g} kg")
    if not payload:
        return values
    point = np.asarray(values.get("tool_xyz", np.zeros(3)), float)
    m, mc, J = (
        np.array(values.get(name, np.zeros(shape)), float) for name, shape in (("m", n), ("mc", (n, 3)), ("J", (n, 6)))
    )
    m[-1] += payload
    mc[-1] += payload * point
    J[-1] += six_of(about_point(payload, point))
    return {**values, "m": m, "mc": mc, "J": J}
