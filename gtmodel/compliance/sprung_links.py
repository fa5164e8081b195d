"""A parallel robot with springs: deflection at tool centre points, weights and natural frequencies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from ..geometry.rotations import cross_matrix
from ..kinematics.section import UP, SectionPlane, section_of
from ..kinematics.workspace import BallJointCones
from ..lang import Model, ModelError
from ..results import ArgumentError, Status
from ..view.bodies import COLOURS, lines
from ..view.space import RobotScene, VisiblePart
from .link_structure import LinkGeometry, LinkPoses, LinkSprings, LinkStructure, tube
from .options import ComplianceMap, Load, Springs

Array = np.ndarray
MODE_SIZE = 0.06  # largest motion of a mode in its scene, in sizes of the robot
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class LinkMasses:
    """Masses of a parallel robot as in the models of the catalogue, SI units.

    m_p [kg] of the plate, with its centre of mass c_p (3,) [m] from T and inertia I_p (3, 3) [kg.m2] about it, both in
    plate coordinates; m_c (k,) [kg] of the carts; m_a (m,) [kg] of the links, each at its middle; J [kg.m2] of rotary
    axes.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> springs = gt.compliance.LinkSprings(link=5e-8, drive=1e-7)
    >>> s = gt.compliance.LinkStructure(gt.compliance.LinkGeometry(robot)(robot.home), springs)
    >>> gt.compliance.LinkMasses.of(robot).frequencies(s, 2).shape  # Hz
    (1, 2)
    """

    m_p: float
    m_c: Array
    m_a: Array
    c_p: Array = field(default_factory=lambda: np.zeros(3))
    I_p: Array = field(default_factory=lambda: np.zeros((3, 3)))
    J: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, model: Any) -> LinkMasses:
        """Return the masses of a model. Raises ValueError if its parameters lack them."""
        missing = [name for name in ("m_p", "m_c", "m_a") if not hasattr(model, name)]
        if missing:
            raise ValueError(f"the robot has no {', '.join(missing)}; natural frequencies need m_p, m_c and m_a")
        optional = {
            name: np.asarray(getattr(model, name), float) for name in ("c_p", "I_p", "J") if hasattr(model, name)
        }
        return cls(float(model.m_p), np.asarray(model.m_c, float), np.asarray(model.m_a, float), **optional)

    def matrix(self, s: LinkStructure) -> Array:
        """Return the mass matrix (n, d + s, d + s) in the coordinates of the structure."""
        plate, mid, carts = self._motions(s)
        d = s.degrees_of_freedom
        M = self.m_p * np.swapaxes(plate, 1, 2) @ plate
        M += np.einsum("m,nmis,nmit->nst", self.m_a, mid, mid) + np.einsum("k,nkis,nkit->nst", self.m_c, carts, carts)
        if s.poses.R is not None:
            R = s.poses.R
            M[:, 3:d, 3:d] += R @ self.I_p @ np.swapaxes(R, 1, 2)
        turning = range(M.shape[1] - len(self.J), M.shape[1])
        M[:, turning, turning] += self.J
        return M

    def weight(self, s: LinkStructure, g: Any = GRAVITY) -> Array:
        """Return generalised weights (n, d + s) [N, N.m] of gravity g (3,) [m/s2]: on the plate, then on supports."""
        plate, mid, carts = self._motions(s)
        g = np.asarray(g, float)
        return self.m_p * np.einsum("nis,i->ns", plate, g) + np.einsum("m,nmis,i->ns", self.m_a, mid, g) + np.einsum(
            "k,nkis,i->ns", self.m_c, carts, g)  # fmt: skip

    def sag(self, s: LinkStructure, g: Any = GRAVITY) -> Array:
        """Return the displacement of the plate (n, d) [m, rad] due to all weights."""
        f = self.weight(s, g)
        return s.deflection(f[:, : s.degrees_of_freedom], f[:, s.degrees_of_freedom :])

    def frequencies(self, s: LinkStructure, count: int = 3) -> Array:
        """Return the `count` lowest natural frequencies (n, count) [Hz], with all axes held by their drives' springs.

        K x = w^2 M x for plate, carts and rotary axes; rigid supports do not move. Raises ValueError for rigid links,
        and for a compliant coordinate without mass.
        """
        moving, good, _, whole = self._normal_form(s)
        frequencies = np.full((len(good), min(count, int(moving.sum()))), np.nan)
        if good.any():
            frequencies[good] = _hertz(np.linalg.eigvalsh(whole))[:, : frequencies.shape[1]]
        return frequencies

    def shapes(self, s: LinkStructure, count: int = 3) -> tuple[Array, Array]:
        """Return the lowest natural frequencies (count,) [Hz] of the first pose, and the motions (count, d + s) that
        belong to them, in the coordinates of the structure, of any length. Raises ValueError as `frequencies` does.

        >>> robot = gt.robots.gantry_tau("l1_tape")
        >>> springs = gt.compliance.LinkSprings(link=5e-8, drive=1e-7)
        >>> s = gt.compliance.LinkStructure(gt.compliance.LinkGeometry(robot)(robot.home), springs)
        >>> f, x = gt.compliance.LinkMasses.of(robot).shapes(s, 1)
        >>> K, M = s.stiffness()[0], gt.compliance.LinkMasses.of(robot).matrix(s)[0]
        >>> moves = np.isfinite(np.diag(K))
        >>> K, M, x = K[moves][:, moves], M[moves][:, moves], x[0, moves]
        >>> bool(np.isclose(x @ K @ x / (x @ M @ x), (2 * np.pi * f[0]) ** 2))
        True
        """
        moving, good, L, whole = self._normal_form(s)
        if not (len(good) and good[0]):
            return np.zeros(0), np.zeros((0, len(moving)))
        values, vectors = np.linalg.eigh(whole[0])
        motions = np.zeros((min(count, len(values)), len(moving)))
        motions[:, moving] = np.linalg.solve(L[0].T, vectors)[:, : len(motions)].T
        return _hertz(values)[: len(motions)], motions

    def _normal_form(self, s: LinkStructure) -> tuple[Array, Array, Array, Array]:
        """Which coordinates move, which poses have a result, and of these M = L L' and L^-1 K L^-T."""
        K, M = s.stiffness(), self.matrix(s)
        moving = np.concatenate([np.full(s.degrees_of_freedom, True), s.total[s.degrees_of_freedom :] > 0])
        K, M = K[:, moving][:, :, moving], M[:, moving][:, :, moving]
        good = np.asarray(np.isfinite(K).all(axis=(1, 2)))
        try:
            L = np.linalg.cholesky(M[good])
        except np.linalg.LinAlgError as error:
            raise ValueError("a compliant part has no mass; give masses of plate, carts and rotary axes") from error
        half = np.linalg.solve(L, K[good])
        whole = np.linalg.solve(L, np.swapaxes(half, 1, 2))
        return moving, good, L, (whole + np.swapaxes(whole, 1, 2)) / 2

    def _motions(self, s: LinkStructure) -> tuple[Array, Array, Array]:
        """Motion per coordinate of the plate's centre of mass (n, 3, .), links (n, m, 3, .) and carts (n, k, 3, .)."""
        p, d = s.poses, s.degrees_of_freedom
        n, m, _, supports = s.support.shape
        if self.m_a.shape != (m,) or self.m_c.shape != (p.carts,):
            raise ValueError(
                f"expected masses of {p.carts} carts and {m} links; found {self.m_c.size}, {self.m_a.size}"
            )
        plate = np.zeros((n, 3, d + supports))
        plate[:, range(3), range(3)] = 1.0
        if p.R is not None:
            plate[:, :, 3:d] = -cross_matrix(p.R @ self.c_p)
        mid = np.concatenate([s.plate, s.support], axis=3) / 2
        carts = np.zeros((n, p.carts, 3, d + supports))
        for i in range(p.carts):
            carts[:, i, :, d + 3 * i : d + 3 * i + 3] = np.swapaxes(s.frames[:, i], 1, 2)
        return plate, mid, carts


def _hertz(eigenvalues: Array) -> Array:
    return np.sqrt(np.maximum(eigenvalues, 0.0)) / (2 * np.pi)


VERTICAL = 0.9  # beyond this vertical component of a guideway, sections are drawn with y upwards
MARGIN_M = 0.05
BEYOND = "beyond the cones of the ball joints"
SINGULAR = Status.SINGULAR.message


@dataclass(frozen=True, eq=False)
class ComplianceAtPoses:
    """Results at n poses with d degrees of freedom of the plate.

    C (n, d, d): compliance. moved (n, d) [m, rad]: displacement under the load. reason: why a pose has no result, or
    "". frequencies (n, k) [Hz]: natural frequencies; sag (n, d) [m, rad]: displacement by weights; both None without
    masses. shares: of the load's work by group of springs, None without a load.
    """

    C: Array
    moved: Array
    reason: list[str]
    frequencies: Array | None = None
    sag: Array | None = None
    shares: dict[str, Array] | None = None


class Sprung(Protocol):
    """A robot with springs.

    home (3,) [m]; section: the mapped plane; marks: intersections of guideways with it; window: its lower and upper
    (u, v) [m]; assumptions: sentences; scenes: views in space by name, of a title. Called with tool centre points
    (n, 3) [m] it returns `ComplianceAtPoses`.
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
    def scenes(self, title: str) -> dict[str, Callable[[], RobotScene]]: ...
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
            raise ArgumentError(f"{error}; for a serial arm use joint springs", "robot") from error
        home = getattr(model, "home", None) if pose is None else pose
        if home is None:
            raise ArgumentError("is missing, and the robot declares no home; give a tool centre point", "pose")
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
        distance = p.lengths[0] + np.linalg.norm(p.arms[0], axis=1)
        reach = np.array([distance[[k for k, i in enumerate(p.stands_on) if i == c]].max() for c in range(p.carts)])
        return (self.marks - reach[:, None]).max(axis=0) - MARGIN_M, (self.marks + reach[:, None]).min(
            axis=0
        ) + MARGIN_M

    @property
    def assumptions(self) -> list[str]:
        sentences = ["axes hold their position; the compliance of their servo loops is part of the drives' springs"]
        if self.at_home.R is None:
            sentences.append("the plate keeps its orientation and is a point mass: it carries no moments")
        elif self.at_home.q.shape[1] > self.at_home.carts:
            sentences.append("the plate keeps the orientation of its home")
        return [*sentences, *([self.cones.assumes] if self.cones else [])]

    def structure(self, poses: LinkPoses) -> LinkStructure:
        try:
            return LinkStructure(poses, self.springs)
        except ValueError as error:
            raise ArgumentError(str(error), "robot") from error

    def scenes(self, title: str) -> dict[str, Callable[[], RobotScene]]:
        """The lowest modes at home as scenes by name; none without masses."""
        if self.masses is None:
            return {}
        s = self.structure(self.at_home)
        frequencies, motions = self.masses.shapes(s, self.count)
        return {
            f"mode_{k + 1}": partial(_mode_in_space, s, x, f"{title}: mode {k + 1}, {f:.4g} Hz")
            for k, (f, x) in enumerate(zip(frequencies.tolist(), motions, strict=True))
        }

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


def _mode_in_space(s: LinkStructure, motion: Array, title: str) -> RobotScene:
    """A mode, slowed down to one vibration in two seconds and enlarged, over the robot at rest."""
    p, d = s.poses, s.degrees_of_freedom
    rest = {"tool centre point": p.T[0]}
    moved = {"tool centre point": motion[:3]}
    for k in range(p.a.shape[1]):
        rest |= {f"cart joint {k + 1}": p.a[0, k], f"plate joint {k + 1}": p.b[0, k]}
        moved |= {
            f"cart joint {k + 1}": s.support[0, k] @ motion[d:],
            f"plate joint {k + 1}": s.plate[0, k] @ motion[:d],
        }
    size = float(np.linalg.norm(np.ptp(np.array([*rest.values()]), axis=0)))
    scale = MODE_SIZE * size / max(np.linalg.norm(x) for x in moved.values())
    time = np.linspace(0.0, 2.0, 41)
    swing = scale * np.sin(np.pi * time)
    points = {name: rest[name] + np.outer(swing, moved[name]) for name in rest}
    links = range(1, p.a.shape[1] + 1)
    parts = [VisiblePart("bar", (f"cart joint {k}", f"plate joint {k}"), f"link {k}",
                         COLOURS[p.stands_on[k - 1] % len(COLOURS)]) for k in links]  # fmt: skip
    if p.R is not None:
        parts += [VisiblePart("bar", ("tool centre point", f"plate joint {k}"), "plate") for k in links]
    parts += [VisiblePart("joint", (name,), name) for name in points]
    note = (
        f"Enlarged and slowed down: the largest motion is drawn as {1e3 * MODE_SIZE * size:.0f} mm, a vibration takes "
        "2 s; grey: at rest. The size of a mode is arbitrary."
    )
    still = lines(p.a[0], p.b[0], name="at rest")
    return RobotScene(points, parts, time, title=title, note=note, bodies=[still])


def _springs(springs_of: Springs, load: Load, home: LinkPoses) -> LinkSprings:
    links, carts, frame = springs_of.links, springs_of.carts, springs_of.frame
    of_tube = links.modulus is not None or links.outer_diameter is not None or links.inner_diameter != 0
    whole = links.modulus is not None and links.outer_diameter is not None
    if of_tube == (links.stiffness is not None) or (of_tube and not whole):
        raise ArgumentError("expected either a stiffness, or modulus with outer diameter", "springs.links")
    if np.any(load.moment) and home.R is None:
        raise ArgumentError("the plate of this robot is a point and carries no moment; leave it out", "load.moment")
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
