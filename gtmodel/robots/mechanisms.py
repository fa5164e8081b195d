"""A mechanism as a model: links and joints by their names, with branches and closed loops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from .. import lang as gt
from .._pickling import made_by_call
from ..lang.source import SourceLocation
from ..mechanics import (
    FixedRpy,
    Frame,
    Ground,
    LinkBody,
    LoopClosure,
    Prismatic,
    Revolute,
    Screw,
    Spherical,
    UnitQuaternion,
    Universal,
    World,
)
from ..view.solids import VisibleSolid
from .serial.arm import JOINT_UNITS, VELOCITY_SCALE, Z, drive

# joints without a motor: the component, and the joint's directions among its parameters
OTHERS: dict[str, tuple[type[gt.Model], tuple[str, ...]]] = {
    "universal": (Universal, ("axis_1", "axis_2")), "screw": (Screw, ("axis",)), "ball": (Spherical, ()),
    "weld": (LoopClosure, ()),
}  # fmt: skip


@dataclass(frozen=True)
class MechanismLink:
    """A link: the name of its part, "" for a frame between two joints, and whether it has an attitude of its own."""

    part: str
    line: int
    free: bool


@dataclass(frozen=True)
class MechanismJoint:
    """A joint between two links of the file: the name of its part, the parts that it has, and the joint it follows."""

    part: str
    kind: str
    line: int
    parent: str
    child: str
    motor: bool
    friction: bool
    leader: str | None = None


@dataclass(frozen=True)
class MechanismGraph:
    """Links and joints by their names in the file. q: the driven joints, in the order of q and tau."""

    name: str
    file: str
    root: str
    links: tuple[tuple[str, MechanismLink], ...]
    joints: tuple[tuple[str, MechanismJoint], ...]
    q: tuple[str, ...]
    cut: tuple[str, ...]
    drop: bool
    smoothing: str
    notes: tuple[str, ...]
    visuals: tuple[tuple[str, VisibleSolid], ...] = ()  # by frame


class JointedMechanism(gt.Model):
    """Base class of mechanisms that `mechanism` reads from files.

    Each link is a part with a `frame` and with the parameters of `mechanics.LinkBody`, each joint a part with xyz, rpy
    and axis as in `SerialArm`, a component `joint` of `gt.mechanics`, and its coordinate: `phi` [rad] of a revolute
    joint, `s` [m] of a prismatic one, with the limits of the file. The names are those of the file, with "_" for
    characters that Python does not allow. The root link is fixed in the world.

    q (n) [rad, m] are the coordinates of the driven joints and `tau` (n) [N.m, N] their motor efforts; a mechanism
    without driven joints has neither. `world` holds the gravity g, that of the file if it states one.

    >>> text = '''<mujoco model="pendulum"><worldbody><body name="bob">
    ...   <joint name="pivot" axis="0 1 0"/><inertial pos="0 0 -0.5" mass="2" diaginertia="0 0 0"/>
    ... </body></worldbody></mujoco>'''
    >>> pendulum = gt.robots.mechanism(text)
    >>> torque, status = pendulum.causal("q", "tau")([np.pi / 6], [0.0], [0.0])
    >>> torque.round(6)  # 2 kg, 9.81 m/s2, 0.5 m, sine of 30 degrees
    array([4.905])
    """

    graph: ClassVar[MechanismGraph]
    world = gt.part(World)
    ground = gt.part(Ground)

    def equations(self):
        graph = self.graph
        frames: dict[str, Any] = {graph.root: self.ground.frame}
        frames |= {name: getattr(self, link.part).frame for name, link in graph.links if link.part}
        for _, j in graph.joints:
            part = getattr(self, j.part)
            for link, port in ((j.parent, part.a), (j.child, part.b)):
                if link in frames:
                    yield gt.connect(frames[link], port)
                frames.setdefault(link, port)
        yield from self._efforts()
        if graph.cut or graph.drop:
            joints = dict(graph.joints)
            yield gt.loops([getattr(self, joints[name].part) for name in graph.cut], "drop" if graph.drop else "error")

    @property
    def visual(self) -> dict[str, list[VisibleSolid]]:
        """What the links look like in a view, by frame; empty if the file says nothing."""
        return {f: [s for name, s in self.graph.visuals if name == f] for f, _ in self.graph.visuals}

    def _efforts(self) -> Iterator[Any]:
        graph, joints = self.graph, dict(self.graph.joints)
        motors = {name: getattr(self, j.part) for name, j in graph.joints if j.motor}
        efforts = {
            name: m.effort()
            + m.rotor_inertia * gt.der(gt.der(m.coordinate()))
            + m.stiffness * (m.coordinate() - m.rest)
            for name, m in motors.items()
        }
        followers = {name: getattr(self, coupling_of(joints[name].part)) for name in motors if joints[name].leader}
        for name, coupling in followers.items():
            leader = str(joints[name].leader)
            yield coupling.follower == motors[name].coordinate()
            yield coupling.leader == motors[leader].coordinate()
            efforts[leader] = efforts[leader] + coupling.reaction
        for name, effort in efforts.items():
            if name in followers:
                yield followers[name].effort == effort
            elif name in graph.q:
                k = graph.q.index(name)
                yield self.q[k] == motors[name].coordinate()
                yield self.tau[k] == effort
            else:
                yield effort == 0

    def description(self) -> str:
        """Return one line for each joint that moves: its part, kind, links, and its entry of q if it is driven.

        >>> text = '''<mujoco model="pendulum"><worldbody><body name="bob">
        ...   <joint name="pivot" axis="0 1 0"/><inertial pos="0 0 -0.5" mass="2" diaginertia="0 0 0"/>
        ... </body></worldbody></mujoco>'''
        >>> print(gt.robots.mechanism(text).description())
        pendulum: q (1), 1 joint
          pivot  revolute   world - bob  q[0]
        """
        graph = self.graph
        ends = {name: link.part for name, link in graph.links if link.part}
        for _, j in graph.joints:  # a frame between two joints is shown as the link to which it is fixed
            if j.kind == "fixed":
                ends.setdefault(j.parent, ends.get(j.child, j.child))
                ends.setdefault(j.child, ends.get(j.parent, j.parent))
        moving = [(name, j) for name, j in graph.joints if j.kind != "fixed"]
        wide = max([len(j.part) for _, j in moving], default=0)
        lines = [f"{graph.name}: q ({len(graph.q)}), {len(moving)} joint{'s' if len(moving) != 1 else ''}"]
        for name, j in moving:
            role = f"q[{graph.q.index(name)}]" if name in graph.q else f"follows {j.leader}" if j.leader else "passive"
            between = f"{ends.get(j.parent, j.parent)} - {ends.get(j.child, j.child)}"
            lines.append(f"  {j.part:{wide}s}  {j.kind:9s}  {between}  {role}")
        return "\n".join([*lines, *graph.notes])

    def __repr__(self) -> str:
        joints = sum(j.kind != "fixed" for _, j in self.graph.joints)
        return f"Mechanism('{self.graph.name}', {joints} joints, {len(self.graph.q)} driven)"


class FreeLink(LinkBody):
    """A link whose orientation no joint determines: a floating body, or one between ball joints."""

    r = gt.variable(3, unit="m", prefer=-3, description="origin of the frame")
    attitude = gt.part(UnitQuaternion)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.r == self.frame.r
        yield self.attitude.rotation() == self.frame.R
        yield self.attitude.angular_velocity() == self.frame.w
        yield from super().equations()


class Coupling(gt.Model):
    """follower = c[0] + c[1] leader + c[2] leader^2 + ... for two joint coordinates, and the follower's effort on the
    leader. Without units: one may be an angle and the other a travel."""

    c = gt.parameter(np.zeros(5), description="coefficients")
    leader = gt.variable()
    follower = gt.variable()
    effort = gt.variable(description="effort that the follower needs")
    reaction = gt.variable(description="the same effort, on the leader's coordinate")

    def equations(self):
        powers = [self.leader**k for k in range(1, 5)]
        slopes = [1.0, *((k + 1) * powers[k - 1] for k in range(1, 4))]
        yield self.follower == sum((self.c[k + 1] * power for k, power in enumerate(powers)), self.c[0])
        yield self.reaction == self.effort * sum(self.c[k + 1] * slope for k, slope in enumerate(slopes))


class _PlacedJoint(gt.Model):
    """A joint at `xyz` and `rpy` of its parent link, as in URDF."""

    xyz = gt.parameter(np.zeros(3), unit="m", description="joint origin, parent's frame")
    rpy = gt.parameter(np.zeros(3), unit="rad", description="joint orientation: Rz(yaw) Ry(pitch) Rx(roll)")
    a = gt.port(Frame)
    b = gt.port(Frame)
    placement = gt.part(FixedRpy, xyz=xyz, rpy=rpy)

    def equations(self):
        yield gt.connect([self.a, self.placement.b, self.joint.b], [self.placement.a, self.joint.a, self.b])
        yield from self.moving()

    def moving(self) -> Iterator[Any]:
        """Yield the equations of coordinate, motor and friction."""
        return iter(())


def _driven(self: Any) -> Iterator[Any]:
    joint, *others = self.ports()
    yield from (gt.connect(joint, other) for other in others)
    yield getattr(self, self.symbol) == self.coordinate()


@made_by_call
def _joint_class(kind: str, motor: bool, friction: bool, smoothing: str) -> type[gt.Model]:
    if kind in OTHERS:
        component, directions = OTHERS[kind]
        body: dict[str, Any] = {n: gt.parameter(Z, unit="1", kind="direction") for n in directions}
        if kind == "screw":
            body["lead"] = gt.parameter(unit="m")
        return type("PlacedJoint", (_PlacedJoint,), {**body, "joint": gt.part(component, **body)})
    turning = kind != "prismatic"
    axis, symbol = gt.parameter(Z, unit="1", kind="direction"), "phi" if turning else "s"
    unit = JOINT_UNITS["revolute" if turning else "prismatic"]
    body = {
        **drive("revolute" if turning else "prismatic", smoothing, motor, friction), "axis": axis, "symbol": symbol,
        "joint": gt.part(Revolute, axis=axis) if turning else gt.part(Prismatic, v=axis), "moving": _driven,
        symbol: gt.variable(unit=unit["q"], description="coordinate"),
    }  # fmt: skip
    if motor:
        body["rotor_inertia"] = gt.parameter(0.0, unit=unit["rotor_inertia"], min=0.0)
        body["stiffness"] = gt.parameter(0.0, unit=f"{unit['tau']}/{unit['q']}", description="of a spring in the joint")
        body["rest"] = gt.parameter(0.0, unit=unit["q"], description="coordinate at which the spring is at rest")
    return type("PlacedJoint", (_PlacedJoint,), body)


def coupling_of(part: str) -> str:
    """Return the name of the part that couples a joint to the one it follows."""
    return f"{part}_coupling"


@made_by_call
def mechanism_class(graph: MechanismGraph) -> type[JointedMechanism]:
    """Return the class of all mechanisms of a graph; cached."""

    def part(cls: type[gt.Model], line: int, **modifiers: Any) -> Any:
        item = gt.part(cls, **modifiers)
        item.where = SourceLocation(graph.file, line)  # messages quote the file
        return item

    body: dict[str, Any] = {"graph": graph}
    joints = dict(graph.joints)
    if graph.q:
        kinds = {"prismatic" if joints[name].kind == "prismatic" else "revolute" for name in graph.q}
        unit = JOINT_UNITS[kinds.pop()] if len(kinds) == 1 else {"q": None, "tau": None}
        body["q"] = gt.variable(len(graph.q), unit=unit["q"], prefer=1, description="coordinates of the driven joints")
        body["tau"] = gt.input(
            len(graph.q), unit=unit["tau"], nominal=100.0, description="efforts on the driven joints"
        )
    if any(j.friction for _, j in graph.joints):
        body["velocity_scale"] = gt.parameter(
            VELOCITY_SCALE, positive=True, description="friction smoothing, rad/s or m/s"
        )
    for _, link in graph.links:
        if link.part:
            body[link.part] = part(FreeLink if link.free else LinkBody, link.line)
    for _, j in graph.joints:
        cls = FixedRpy if j.kind == "fixed" else _joint_class(j.kind, j.motor, j.friction, graph.smoothing)
        scale = {"velocity_scale": lambda m: m.velocity_scale} if j.friction else {}
        body[j.part] = part(cls, j.line, **scale)
        if j.leader is not None:
            body[coupling_of(j.part)] = part(Coupling, j.line)
    return type("Mechanism", (JointedMechanism,), body)
