"""What kind "compliance" asks of a robot, parallel or serial: how it gives way at rows of tool centre points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gtmodel.compliance import LinkGeometry, LinkMasses, LinkPoses, LinkSprings, LinkStructure, tube
from gtmodel.kinematics.section import Section, across_guideways
from gtmodel.kinematics.workspace import BallJointCones, Poses
from gtmodel.lang import Model, ModelError
from gtmodel.results import Status

from .base import InputError
from .compliance_keys import Schema

Array = np.ndarray
VERTICAL = 0.9  # a guideway this near to the vertical: sections are drawn with y upwards
MARGIN_M = 0.05
BEYOND = "beyond the cones of the ball joints"
SINGULAR = Status.SINGULAR.sentence


@dataclass(frozen=True, eq=False)
class Found:
    """Of n poses: C (n, d, d), displacement under the load (n, d) [m, rad], the reason why there is none ("" where
    there is one); natural frequencies (n, k) [Hz], displacement by weights (n, d) and shares of the load's work, None
    where they are not asked for or the robot has no masses."""

    C: Array
    moved: Array
    reason: list[str]
    frequencies: Array | None = None
    sag: Array | None = None
    shares: dict[str, Array] | None = None


class Study(Protocol):
    """A robot with its springs."""

    @property
    def home(self) -> Array: ...
    @property
    def marks(self) -> Array: ...
    @property
    def assumptions(self) -> list[str]: ...
    @property
    def section(self) -> Section: ...
    @property
    def window(self) -> tuple[Array, Array]: ...
    def __call__(self, T: Array) -> Found: ...


class LinkStudy:
    """A parallel robot. Raises InputError."""

    def __init__(self, problem: Schema, model: Model) -> None:
        self.problem = problem
        try:
            self.geometry = LinkGeometry(model)
        except ModelError as error:
            raise InputError(f"{error}; a serial arm takes [arm]", "robot") from error
        home = getattr(model, "home", None) if problem.pose_m is None else problem.pose_m
        if home is None:
            raise InputError("is missing, and the robot declares no home; name a tool centre point", "pose_m")
        self.home = np.asarray(home, float)
        self.at_home = self.geometry(self.home)
        if self.at_home.status[0] != Status.OK:
            raise InputError(f"cannot be reached: {Status(int(self.at_home.status[0])).sentence}", "pose_m")
        self.springs = _springs(problem, self.at_home)
        self.structure(self.at_home)
        self.masses = LinkMasses.of(model) if hasattr(model, "m_p") else None
        cone = problem.section.cone_deg
        self.cones = None if cone is None else BallJointCones.about_home(_poses(self.at_home), np.radians(cone))
        axes = self.at_home.cart_motion[0]
        first = [self.at_home.stands_on.index(i) for i in range(len(axes))]
        anchors = self.at_home.a[0, first]
        vertical = abs(axes[0, 2]) > VERTICAL * np.linalg.norm(axes[0])
        try:
            plane = across_guideways(
                anchors, axes, self.home.tolist(), (0.0, 1.0, 0.0) if vertical else (0.0, 0.0, 1.0)
            )
        except ValueError as error:
            raise InputError(str(error), "robot") from error
        along = problem.section.along_m
        self.section = plane if along is None else Section(
            along * plane.normal, plane.across, plane.up, plane.normal)  # fmt: skip
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
        said = ["axes hold still; what their servo loops give way by is part of the drives' springs"]
        if self.at_home.R is None:
            said.append("the plate keeps its orientation and is a point for forces: moments are not carried")
        elif self.at_home.q.shape[1] > self.at_home.carts:
            said.append("the plate keeps the orientation of its home")
        return [*said, *([self.cones.assumes] if self.cones else [])]

    def structure(self, poses: LinkPoses) -> LinkStructure:
        try:
            return LinkStructure(poses, self.springs)
        except ValueError as error:
            raise InputError(str(error), "robot") from error

    def __call__(self, T: Array) -> Found:
        poses = self.geometry(T)
        s = self.structure(poses)
        d = s.freedoms
        load = np.array([*self.problem.load.force_N, *self.problem.load.moment_Nm])[:d]
        frequencies = sag = None
        if self.masses is not None:
            try:
                frequencies, sag = self.masses.frequencies(s, self.problem.frequencies), self.masses.sag(s)
            except ValueError as error:
                raise InputError(str(error), "robot") from error
        reason = ["" if code == Status.OK else Status(int(code)).sentence for code in poses.status]
        singular = np.asarray(~np.isfinite(s.U).all(axis=(1, 2)))
        margins = np.zeros(len(T)) if self.cones is None else self.cones.margins(_poses(poses)).min(axis=1)
        reason = [
            r or (SINGULAR if lost else BEYOND if not margin >= 0 else "")
            for r, lost, margin in zip(reason, singular, margins.tolist(), strict=True)
        ]
        shares = s.shares(load) if np.any(load) else None
        return Found(s.compliance(), s.deflection(load), reason, frequencies, sag, shares)


def _poses(p: LinkPoses) -> Poses:
    return Poses(p.T, p.q, p.a, p.b, p.status)


def _springs(problem: Schema, home: LinkPoses) -> LinkSprings:
    keys = problem.links
    assert keys is not None
    of_tube = {"modulus_Pa", "outer_diameter_m", "inner_diameter_m"} & keys.model_fields_set
    if bool(of_tube) == (keys.stiffness_N_m is not None) or (
        of_tube and not (keys.modulus_Pa and keys.outer_diameter_m)
    ):
        raise InputError("expected either stiffness_N_m, or modulus_Pa with outer_diameter_m", "links")
    if np.any(problem.load.moment_Nm) and home.R is None:
        raise InputError("the plate of this robot is a point, which takes no moment; leave it out", "load.moment_Nm")
    if problem.carts.axis_Nm_rad is not None and home.q.shape[1] == home.carts:
        raise InputError("this robot has no rotary axes on its carts; leave it out", "carts.axis_Nm_rad")
    try:
        if keys.stiffness_N_m is not None:
            link = 1 / np.asarray(keys.stiffness_N_m, float)
        else:
            link = tube(keys.modulus_Pa or 0.0, keys.outer_diameter_m or 0.0, keys.inner_diameter_m, home.lengths[0])
        three = home.R is None and home.a.shape[1] == 3
        springs = LinkSprings(
            link=link,
            joint=_compliance(keys.joint_N_m),
            parallel=keys.parallel or ((1, 2, 3) if three else 1),
            drive=_compliance(problem.carts.drive_N_m),
            axis=_compliance(problem.carts.axis_Nm_rad),
            cart=_compliance(problem.carts.across_N_m),
            frame_along=_compliance(problem.frame.along_N_m),
            frame_across=_compliance(problem.frame.across_N_m),
        )
        springs.by_group(home.a.shape[1], home.carts, home.q.shape[1] - home.carts)
    except ValueError as error:
        raise InputError(str(error), "links") from error
    return springs


def _compliance(stiffness: float | list[float] | None) -> Array:
    return np.zeros(()) if stiffness is None else 1 / np.asarray(stiffness, float)
