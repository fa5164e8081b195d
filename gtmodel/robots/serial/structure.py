"""The structure of a serial arm: its joints with limits, and the two forms of link inertias."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...lang import ModelError
from ...view.solids import VisibleSolid

JointKind = Literal["revolute", "prismatic"]
Style = Literal["rpy", "standard", "modified"]


@dataclass(frozen=True)
class ArmJoint:
    """A moving joint: its name, kind and the link that it moves; limits in rad or m, rad/s or m/s, N.m or N.

    `leader` is the index of the joint that this one follows (URDF mimic): its coordinate is multiplier times the
    leader's coordinate plus offset.
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
class LinkShape:
    """A capsule of a link: the points within `radius` [m] of the segment from begin to end (3,) [m].

    body: 0 for the base, k + 1 for the body that joint k moves; the points are in the frame of the base, or of that
    body. link: name of the link in the file.
    """

    link: str
    body: int
    begin: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class ArmStructure:
    """The joints of an arm from the base to the tool, and the form of their placements.

    style: xyz and rpy ("rpy"), or standard or modified Denavit-Hartenberg parameters. smoothing: of friction. notes:
    sentences about elements of the source file that were not used. starts: joint coordinates at which inverse
    kinematics starts, the home pose first; empty for zero, or the nearest limit. shapes: capsules around the links.
    visuals: what a view draws, each with the number of its body as in LinkShape, and in the same frame.
    """

    name: str
    joints: tuple[ArmJoint, ...]
    style: Style
    base: str = "base"
    tool: str = "tool"
    smoothing: str = "tanh"
    notes: tuple[str, ...] = ()
    starts: tuple[tuple[float, ...], ...] = ()
    shapes: tuple[LinkShape, ...] = ()
    visuals: tuple[tuple[int, VisibleSolid], ...] = ()

    @property
    def leaders(self) -> list[int]:
        """Indices of the joints without a leader, in the order of q."""
        return [k for k, joint in enumerate(self.joints) if joint.leader is None]

    def coordinate(self, k: int) -> tuple[int, float, float]:
        """Return the index in q from which joint k follows, and multiplier and offset."""
        joint = self.joints[k]
        if joint.leader is None:
            return self.leaders.index(k), 1.0, 0.0
        return self.leaders.index(joint.leader), joint.multiplier, joint.offset

    def geared(self, k: int) -> bool:
        """Return whether joint k is revolute and its leader prismatic, or the reverse, like nut and spindle."""
        leader = self.joints[k].leader
        return leader is not None and self.joints[leader].kind != self.joints[k].kind

    @property
    def kinds(self) -> set[str]:
        """The kinds of joints of the arm."""
        return {joint.kind for joint in self.joints}

    def limits(self) -> np.ndarray:
        """Return lower and upper limits of q (n, 2), including those that mimic joints impose on their leaders."""
        low, high = (np.full(len(self.leaders), v) for v in (-np.inf, np.inf))
        for k, joint in enumerate(self.joints):
            place, multiplier, offset = self.coordinate(k)
            if multiplier == 0.0:
                continue
            ends = sorted([(joint.lower - offset) / multiplier, (joint.upper - offset) / multiplier])
            low[place], high[place] = max(low[place], ends[0]), min(high[place], ends[1])
        return np.column_stack([low, high])

    def speed_limits(self) -> np.ndarray:
        """Return the largest speeds of q (n,), including those that mimic joints impose on their leaders."""
        most = np.full(len(self.leaders), np.inf)
        for k, joint in enumerate(self.joints):
            place, multiplier, _ = self.coordinate(k)
            if multiplier != 0.0:
                most[place] = min(most[place], joint.velocity / abs(multiplier))
        return most

    def effort_limits(self) -> np.ndarray:
        """Return the largest efforts tau (n,): those of the leaders alone, which drive their followers."""
        return np.array([self.joints[k].effort for k in self.leaders])


def wrong(sentence: str, argument: str) -> ModelError:
    """Return the error about an argument of an arm."""
    error = ModelError(sentence)
    error.argument = argument
    return error


def shown(kind: JointKind, value: float) -> str:
    """Return a joint coordinate in degrees or metres, with its unit."""
    return f"{np.degrees(value):.4g} deg" if kind == "revolute" else f"{value:.4g} m"


def started(structure: ArmStructure, start: ArrayLike | None) -> ArmStructure:
    """Return the structure with starts from one row of joint coordinates or several; unchanged for None. Raises
    ModelError for other shapes, and for starts outside the limits."""
    if start is None:
        return structure
    rows = np.atleast_2d(np.asarray(start, float))
    n, limits = len(structure.leaders), structure.limits()
    if rows.ndim != 2 or rows.shape[1] != n or not len(rows) or not np.all(np.isfinite(rows)):
        raise wrong(f"start takes {n} joint coordinates, or rows of them; found the shape {np.shape(start)}", "start")
    outside = np.argwhere((rows < limits[:, 0]) | (rows > limits[:, 1]))
    if len(outside):
        k, j = outside[0].tolist()
        joint = structure.joints[structure.leaders[j]]
        value, low, high = (shown(joint.kind, float(x)) for x in (rows[k, j], limits[j, 0], limits[j, 1]))
        raise wrong(f"the start of joint '{joint.name}' is {value}; its limits are {low} and {high}", "start")
    return replace(structure, starts=tuple(tuple(float(x) for x in row) for row in rows))


Array = np.ndarray
# entries xx, xy, xz, yy, yz, zz of a symmetric tensor
ROWS, COLUMNS = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])


def tensor(six: ArrayLike) -> Array:
    """Return tensors (..., 3, 3) from their entries xx, xy, xz, yy, yz, zz (..., 6)."""
    six = np.asarray(six, float)
    full = np.zeros((*six.shape[:-1], 3, 3))
    full[..., ROWS, COLUMNS] = six
    full[..., COLUMNS, ROWS] = six
    return full


def six_of(full: ArrayLike) -> Array:
    """Return the entries xx, xy, xz, yy, yz, zz (..., 6) of tensors (..., 3, 3)."""
    return np.asarray(full, float)[..., ROWS, COLUMNS]


def about_point(m: ArrayLike, r: ArrayLike) -> Array:
    """Return the inertia (..., 3, 3) about the origin of point masses m (...,) [kg] at r (..., 3) [m]."""
    r = np.asarray(r, float)
    square = np.sum(r**2, axis=-1)[..., None, None] * np.eye(3)
    return np.asarray(m, float)[..., None, None] * (square - r[..., :, None] * r[..., None, :])


def moments(m: ArrayLike, c: ArrayLike | None, I: ArrayLike | None) -> tuple[Array, Array]:
    """Return mc (n, 3) and J (n, 6) about the frames' origins from masses (n,), centres c (n, 3) and I (n, 3, 3)."""
    m = np.asarray(m, float)
    c = np.zeros((len(m), 3)) if c is None else np.asarray(c, float)
    I = np.zeros((len(m), 3, 3)) if I is None else np.asarray(I, float)
    if c.shape != (len(m), 3) or I.shape != (len(m), 3, 3):
        raise ModelError(f"c takes ({len(m)}, 3) and I ({len(m)}, 3, 3); found {c.shape} and {I.shape}")
    return m[:, None] * c, six_of(I + about_point(m, c))


def central(m: float, mc: ArrayLike, J: ArrayLike) -> tuple[Array, Array]:
    """Return the centre of mass (3,) [m] and the inertia about it (3, 3); m must not be 0."""
    c = np.asarray(mc, float) / m
    return c, tensor(J) - about_point(m, c)


def moved(R: Array, r: Array, m: float, mc: Array, J: Array) -> tuple[Array, Array]:
    """Return mc and J of a body in another frame, in which the body's frame has the origin r (3,) and rotation R."""
    h = R @ mc
    cross = np.outer(r, h)
    shift = about_point(m, r) + 2 * (r @ h) * np.eye(3) - cross - cross.T
    return h + m * r, six_of(R @ tensor(J) @ R.T + shift)


def with_payload(values: dict[str, Any], payload: float, n: int) -> dict[str, Any]:
    """Add a point mass at the tool's origin to the modifiers of an arm. Raises ModelError for a payload below 0."""
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
