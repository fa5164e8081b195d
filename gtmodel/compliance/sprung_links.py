"""A parallel robot on its springs: its deflection at rows of tool centre points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..kinematics.section import UP, SectionPlane, section_of
from ..kinematics.workspace import BallJointCones
from ..lang import Model, ModelError
from ..results import ArgumentError, Status
from .link_masses import LinkMasses
from .link_poses import LinkGeometry, LinkPoses
from .link_springs import LinkSprings, tube
from .link_structure import LinkStructure
from .options import ComplianceMap, Load, Springs

Array = np.ndarray
VERTICAL = 0.9  # a guideway this near to the vertical: sections are drawn with y upwards
MARGIN_M = 0.05
BEYOND = "beyond the cones of the ball joints"
SINGULAR = Status.SINGULAR.message


@dataclass(frozen=True, eq=False)
class ComplianceAtPoses:
    """What was computed for n poses with d degrees of freedom of the plate.

    C (n, d, d): compliance. moved (n, d) [m, rad]: displacement under the load. reason: why a pose has no result, ""
    where it has one. frequencies (n, k) [Hz]: natural frequencies; sag (n, d) [m, rad]: displacement by weights; None
    for robots without masses. shares: parts of the load's work by group of springs, None without a load.
    """

    C: Array
    moved: Array
    reason: list[str]
    frequencies: Array | None = None
    sag: Array | None = None
    shares: dict[str, Array] | None = None


class Sprung(Protocol):
    """A robot on its springs.

    home (3,) [m]; section: the plane that is mapped; marks: where guideways pierce it; window: its least and greatest
    (u, v) [m]; assumptions: sentences. Called with tool centre points (n, 3) [m] it returns `ComplianceAtPoses`.
    """

    @property
    def home(self) -> Array: ...
    @property
    def marks(self) -> Array: ...
    @property
    def assumptions(self) -> list[str]: ...
    @property
    def section(self) -> SectionPlane: ...
    @property
    def window(self) -> tuple[Array, Array]: ...
    def __call__(self, T: Array) -> ComplianceAtPoses: ...


class SprungLinks:
    """A parallel robot with springs in its links, joints, drives and frame. Raises ArgumentError."""

    def __init__(
        self,
        model: Model,
        springs: Springs,
        load: Load,
        pose: Sequence[float] | None,
        chosen: ComplianceMap,
        frequencies: int,
    ) -> None:
        self.load, self.count = load, frequencies
        try:
            self.geometry = LinkGeometry(model)
        except ModelError as error:
            raise ArgumentError(f"{error}; a serial arm takes joint springs", "robot") from error
        home = getattr(model, "home", None) if pose is None else pose
        if home is None:
            raise ArgumentError("is missing, and the robot declares no home; name a tool centre point", "pose")
        self.home = np.asarray(home, float)
        self.at_home = self.geometry(self.home)
        if self.at_home.status[0] != Status.OK:
            raise ArgumentError(f"cannot be reached: {Status(int(self.at_home.status[0])).message}", "pose")
        self.springs = _springs(springs, load, self.at_home)
        self.structure(self.at_home)
        self.masses = LinkMasses.of(model) if hasattr(model, "m_p") else None
        cone = chosen.cone
        self.cones = None if cone is None else BallJointCones.about_home(self.at_home, cone)
        axes = self.at_home.cart_motion[0]
        first = [self.at_home.stands_on.index(i) for i in range(len(axes))]
        anchors = self.at_home.a[0, first]
        vertical = abs(axes[0, 2]) > VERTICAL * np.linalg.norm(axes[0])
        up = (0.0, 1.0, 0.0) if vertical else UP
        self.section = section_of(anchors, axes, self.home, chosen.along, up)
        self.marks = self.section.pierced(anchors, axes)

    @property
    def window(self) -> tuple[Array, Array]:
        p = self.at_home
        far = p.lengths[0] + np.linalg.norm(p.arms[0], axis=1)
        reach = np.array([far[[k for k, i in enumerate(p.stands_on) if i == c]].max() for c in range(p.carts)])
        return (self.marks - reach[:, None]).max(axis=0) - MARGIN_M, (self.marks + reach[:, None]).min(
            axis=0
        ) + MARGIN_M

    @property
    def assumptions(self) -> list[str]:
        said = ["axes hold still; what their servo loops yield is part of the drives' springs"]
        if self.at_home.R is None:
            said.append("the plate keeps its orientation and is a point for forces: moments are not carried")
        elif self.at_home.q.shape[1] > self.at_home.carts:
            said.append("the plate keeps the orientation of its home")
        return [*said, *([self.cones.assumes] if self.cones else [])]

    def structure(self, poses: LinkPoses) -> LinkStructure:
        try:
            return LinkStructure(poses, self.springs)
        except ValueError as error:
            raise ArgumentError(str(error), "robot") from error

    def __call__(self, T: Array) -> ComplianceAtPoses:
        poses = self.geometry(T)
        s = self.structure(poses)
        d = s.degrees_of_freedom
        load = np.array([*self.load.force, *self.load.moment])[:d]
        frequencies = sag = None
        if self.masses is not None:
            try:
                frequencies, sag = self.masses.frequencies(s, self.count), self.masses.sag(s)
            except ValueError as error:
                raise ArgumentError(str(error), "robot") from error
        reason = ["" if code == Status.OK else Status(int(code)).message for code in poses.status]
        singular = np.asarray(~np.isfinite(s.U).all(axis=(1, 2)))
        margins = np.zeros(len(T)) if self.cones is None else self.cones.margins(poses).min(axis=1)
        reason = [
            r or (SINGULAR if lost else BEYOND if not margin >= 0 else "")
            for r, lost, margin in zip(reason, singular, margins.tolist(), strict=True)
        ]
        shares = s.shares(load) if np.any(load) else None
        return ComplianceAtPoses(s.compliance(), s.deflection(load), reason, frequencies, sag, shares)


def _springs(given: Springs, load: Load, home: LinkPoses) -> LinkSprings:
    links, carts, frame = given.links, given.carts, given.frame
    of_tube = links.modulus is not None or links.outer_diameter is not None or links.inner_diameter != 0
    whole = links.modulus is not None and links.outer_diameter is not None
    if of_tube == (links.stiffness is not None) or (of_tube and not whole):
        raise ArgumentError("expected either a stiffness, or modulus with outer diameter", "springs.links")
    if np.any(load.moment) and home.R is None:
        raise ArgumentError("the plate of this robot is a point, which takes no moment; leave it out", "load.moment")
    if carts.axis is not None and home.q.shape[1] == home.carts:
        raise ArgumentError("this robot has no rotary axes on its carts; leave it out", "springs.carts.axis")
    try:
        if links.stiffness is not None:
            link = 1 / np.asarray(links.stiffness, float)
        else:
            link = tube(links.modulus or 0.0, links.outer_diameter or 0.0, links.inner_diameter, home.lengths[0])
        three = home.R is None and home.a.shape[1] == 3
        springs = LinkSprings(
            link=link,
            joint=_compliance(links.joint),
            parallel=links.parallel or ((1, 2, 3) if three else 1),
            drive=_compliance(carts.drive),
            axis=_compliance(carts.axis),
            cart=_compliance(carts.across),
            frame_along=_compliance(frame.along),
            frame_across=_compliance(frame.across),
        )
        springs.by_group(home.a.shape[1], home.carts, home.q.shape[1] - home.carts)
    except ValueError as error:
        raise ArgumentError(str(error), "springs.links") from error
    return springs


def _compliance(stiffness: float | list[float] | None) -> Array:
    return np.zeros(()) if stiffness is None else 1 / np.asarray(stiffness, float)
