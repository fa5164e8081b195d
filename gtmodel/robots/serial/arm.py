"""A serial arm as a model built from joints, placements, bodies and friction, and its description as text."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ... import lang as gt
from ..._pickling import made_by_call
from ...mechanics import (
    FixedDH,
    FixedModifiedDH,
    FixedRpy,
    ForceMotor,
    Frame,
    Ground,
    LinkBody,
    PiecewiseLinearFriction,
    Prismatic,
    Revolute,
    RotationalPiecewiseLinearFriction,
    RotationalSignFriction,
    RotationalStictionFriction,
    RotationalTanhFriction,
    SignFriction,
    StictionFriction,
    TanhFriction,
    TorqueMotor,
)
from ...view.solids import VisibleSolid
from .structure import ArmStructure, JointKind, Style

Z = np.array([0.0, 0.0, 1.0])
# friction models of revolute and of prismatic joints
FRICTION: dict[str, tuple[type[gt.Model], type[gt.Model]]] = {
    "tanh": (RotationalTanhFriction, TanhFriction),
    "piecewise_linear": (RotationalPiecewiseLinearFriction, PiecewiseLinearFriction),
    "sign": (RotationalSignFriction, SignFriction),
    "stiction": (RotationalStictionFriction, StictionFriction),
}
VELOCITY_SCALE = 0.1  # friction smoothing [rad/s or m/s]
DH_NAMES = ("theta", "d", "a", "alpha", "beta")


class SerialArm(gt.Model):
    """Base class of serial arms, built by `serial_arm`, `from_urdf` or a robot file with family = "serial".

    q (n) [rad, m] are the joint coordinates, `tau` (n) [N.m, N] the motor efforts on them, T [m] and R the position and
    orientation of the tool frame, v [m/s] and w [rad/s] its linear and angular velocity, world coordinates. The port
    `end` is the tool frame; no load acts there unless one is connected. base_xyz and base_rpy place the base in the
    world; gravity points along -z of the world.

    Parameters: base_xyz, base_rpy, tool_xyz, tool_rpy; per joint xyz, rpy, axis (URDF) or theta, d, a, alpha, beta
    (Denavit-Hartenberg), depending on the style; per link m [kg], mc [kg m] and J [kg m2] as in `mechanics.LinkBody`,
    in the link frame; per joint viscous and coulomb friction, by default 0, with velocity_scale; per joint
    rotor_inertia [kg.m2, kg], by default 0: inertia of the rotor times the gear ratio squared, which tau accelerates
    with the joint. Gyroscopic torques of the rotors are neglected.

    Motor torques that hold an arm level with 1 kg at 0.5 m from joint 2:

    >>> arm = gt.robots.serial_arm(a=[0.0, 0.5], alpha=[np.pi / 2, 0.0], m=[0.0, 1.0])
    >>> tau, status = arm.causal(known="q", targets="tau")(np.zeros(2), np.zeros(2), np.zeros(2))
    >>> tau.round(6) + 0.0
    array([0.   , 4.905])
    """

    structure: ClassVar[ArmStructure]
    base_xyz = gt.parameter([0.0, 0.0, 0.0], unit="m", description="position of the base in the world")
    base_rpy = gt.parameter([0.0, 0.0, 0.0], unit="rad", description="base orientation: Rz(yaw) Ry(pitch) Rx(roll)")
    tool_xyz = gt.parameter([0.0, 0.0, 0.0], unit="m", description="tool position in the last link's frame")
    tool_rpy = gt.parameter([0.0, 0.0, 0.0], unit="rad", description="tool orientation in the last link's frame")
    T = gt.variable(3, unit="m", description="origin of the tool frame")
    R = gt.variable((3, 3), unit="1", prefer=-4, kind="rotation", description="rotation from tool to world coordinates")
    v = gt.variable(3, unit="m/s", description="velocity of T")
    w = gt.variable(3, unit="rad/s", prefer=-1, description="angular velocity of the tool, world coordinates")
    end = gt.port(Frame)
    ground = gt.part(Ground)
    base = gt.part(FixedRpy, xyz=base_xyz, rpy=base_rpy)
    tool = gt.part(FixedRpy, xyz=tool_xyz, rpy=tool_rpy)

    @property
    def joint_limits(self) -> np.ndarray | None:
        """Lower and upper limits of q (n, 2) [rad, m], infinite for joints without one; None if no joint has any."""
        limits = self.structure.limits()
        return limits if np.any(np.isfinite(limits)) else None

    @property
    def speed_limits(self) -> np.ndarray:
        """Largest speeds of q (n,) [rad/s, m/s], infinite for joints without a limit. No kind or solver applies them:
        write them as constraints of an Optimization."""
        return self.structure.speed_limits()

    @property
    def effort_limits(self) -> np.ndarray:
        """Largest efforts tau (n,) [N.m, N], infinite for joints without a limit. No kind or solver applies them:
        write them as constraints of an Optimization."""
        return self.structure.effort_limits()

    @property
    def visual(self) -> dict[str, list[VisibleSolid]]:
        """What the links look like in a view, by the frame of the base or of the link; empty if no file says it."""
        solids: dict[str, list[VisibleSolid]] = {}
        for body, solid in self.structure.visuals:
            solids.setdefault(f"link_{body}.after" if body else "base.b", []).append(solid)
        return solids

    def joint_unit(self, entry: str) -> str:
        """Return the unit of an entry such as "q[2]", "tau[2]" or "viscous[2]", "" for other names. The array itself
        has no unit if revolute and prismatic joints share it."""
        name, _, index = entry.removesuffix("]").partition("[")
        if name not in JOINT_UNITS["revolute"] or not index.isdecimal():
            return ""
        k = self.structure.leaders[int(index)] if name in ("q", "tau") else int(index)
        return JOINT_UNITS[self.structure.joints[k].kind][name]

    @property
    def links(self) -> list[Any]:
        """The part of each link, with joint, body and friction; for use inside equations()."""
        return [getattr(self, f"link_{k + 1}") for k in range(len(self.structure.joints))]

    def equations(self):
        yield gt.connect(self.ground.frame, self.base.a)
        before, efforts = self.base.b, [[] for _ in self.structure.leaders]
        for k, link in enumerate(self.links):
            place, multiplier, offset = self.structure.coordinate(k)
            yield gt.connect(before, link.before)
            if (multiplier, offset) == (1.0, 0.0):
                yield self.q[place] == link.coordinate()
            else:
                yield link.coordinate() == multiplier * self.q[place] + offset
            effort = link.effort() + self.rotor_inertia[k] * gt.der(gt.der(link.coordinate()))
            if self.structure.geared(k):  # the leader's effort has the other unit: force for torque, or the reverse
                driven, effort = effort, getattr(self, f"effort_{k + 1}")
                yield effort == driven
            efforts[place].append(multiplier * effort)
            before = link.after
        for place, parts in enumerate(efforts):
            yield self.tau[place] == sum(parts[1:], parts[0])
        yield gt.connect(before, self.tool.a)
        yield gt.connect(self.tool.b, self.end)
        yield self.T == self.end.r
        yield self.R == self.end.R
        yield self.v == gt.der(self.end.r)
        yield self.w == self.end.w

    def __repr__(self) -> str:
        s = self.structure
        return f"SerialArm('{s.name}', {len(s.leaders)} joints from {s.base} to {s.tool})"


class _Link(gt.Model):
    """A joint with its placement, motor, friction and the link body that it moves."""

    m = gt.parameter(0.0, unit="kg", description="mass")
    mc = gt.parameter(np.zeros(3), unit="kg.m", description="mass times centre of mass")
    J = gt.parameter(np.zeros(6), unit="kg.m2", description="inertia about the link frame's origin")
    before = gt.port(Frame)
    after = gt.port(Frame)
    body = gt.part(LinkBody, m=m, mc=mc, J=J)

    def equations(self):
        first, second = self.order()
        yield gt.connect(self.before, first.a)
        yield gt.connect(first.b, second.a)
        yield gt.connect(second.b, self.after)
        yield gt.connect(second.b, self.body.frame)
        joint, motor, friction = self.ports()
        yield gt.connect(joint, motor)
        yield gt.connect(joint, friction)

    def order(self) -> tuple[Any, Any]:
        """Return placement and joint in their order along the chain."""
        return self.placement, self.joint


def drive(kind: JointKind, smoothing: str, motor: bool = True, friction: bool = True) -> dict[str, Any]:
    """Return the declarations of a joint's motor and friction, and functions for its coordinate, its effort and the
    ports to connect, first that of `joint`."""
    turning, units = kind == "revolute", JOINT_UNITS[kind]
    port, coordinate, effort = ("shaft", "phi", "torque") if turning else ("flange", "s", "force")
    names = ["joint", *["motor"] * motor, *["friction"] * friction]
    body: dict[str, Any] = {
        "coordinate": lambda self: getattr(getattr(self.joint, port), coordinate),
        "ports": lambda self: [getattr(getattr(self, name), port) for name in names],
    }
    if motor:
        body["motor"] = gt.part(TorqueMotor if turning else ForceMotor)
        body["effort"] = lambda self: getattr(self.motor, effort)
    if friction:
        values = {n: gt.parameter(0.0, unit=units[n]) for n in ("coulomb", "viscous")}
        values["velocity_scale"] = gt.parameter(VELOCITY_SCALE, unit=units["velocity_scale"])
        body |= {**values, "friction": gt.part(FRICTION[smoothing][0 if turning else 1], **values)}
    return body


@made_by_call
def _link_class(style: Style, kind: JointKind, smoothing: str) -> type[_Link]:
    body = drive(kind, smoothing)
    joint, direction = (Revolute, "axis") if kind == "revolute" else (Prismatic, "v")
    if style == "rpy":
        xyz, rpy = gt.parameter(np.zeros(3), unit="m"), gt.parameter(np.zeros(3), unit="rad")
        axis = gt.parameter(Z, unit="1", kind="direction")
        geometry = {"xyz": xyz, "rpy": rpy, "axis": axis, "placement": gt.part(FixedRpy, xyz=xyz, rpy=rpy)}
        return type("UrdfLink", (_Link,), {**body, **geometry, "joint": gt.part(joint, **{direction: axis})})
    numbers = {n: gt.parameter(0.0, unit="m" if n in ("d", "a") else "rad") for n in DH_NAMES}
    values = {"a_x" if n == "a" else n: p for n, p in numbers.items()}
    placement = gt.part(FixedDH if style == "standard" else FixedModifiedDH, **values)
    order = {"order": lambda self: (self.joint, self.placement)} if style == "standard" else {}
    geometry = {**numbers, **order, "placement": placement, "joint": gt.part(joint, **{direction: Z})}
    return type("DHLink", (_Link,), {**body, **geometry})


# units of the quantities of a joint
JOINT_UNITS: dict[str, dict[str, str]] = {
    "revolute": {"q": "rad", "tau": "N.m", "coulomb": "N.m", "viscous": "N.m.s/rad", "velocity_scale": "rad/s",
                 "rotor_inertia": "kg.m2"},
    "prismatic": {"q": "m", "tau": "N", "coulomb": "N", "viscous": "kg/s", "velocity_scale": "m/s",
                  "rotor_inertia": "kg"},
}  # fmt: skip


def _units(structure: ArmStructure) -> dict[str, str | None]:
    """Return the units of the joint arrays; None if revolute and prismatic joints share an array."""
    kinds = structure.kinds
    return dict(JOINT_UNITS[kinds.pop()]) if len(kinds) == 1 else dict.fromkeys(JOINT_UNITS["revolute"])


def _row(name: str, k: int) -> Any:
    return lambda arm: getattr(arm, name)[k]


@made_by_call
def arm_class(structure: ArmStructure) -> type[SerialArm]:
    """Return the class of all arms of a structure; cached."""
    joints, units = structure.joints, _units(structure)
    n, moving = len(joints), len(structure.leaders)
    limits = structure.limits()
    low, high = (x if np.any(np.isfinite(x)) else None for x in limits.T)
    start = np.array(structure.starts[0]) if structure.starts else np.clip(np.zeros(moving), *limits.T)
    body: dict[str, Any] = {
        "structure": structure,
        "further_starts": {"q": structure.starts[1:]},
        "q": gt.variable(
            moving, unit=units["q"], start=start, prefer=1, min=low, max=high, description="joint coordinates"
        ),
        "tau": gt.input(moving, unit=units["tau"], nominal=100.0, description="motor efforts on the joints"),
        "m": gt.parameter(np.zeros(n), unit="kg", description="masses of the links"),
        "mc": gt.parameter(np.zeros((n, 3)), unit="kg.m", description="mass times centre of mass, link frames"),
        "J": gt.parameter(
            np.zeros((n, 6)), unit="kg.m2", description="xx, xy, xz, yy, yz, zz of the inertias about the link frames"
        ),
        "coulomb": gt.parameter(np.zeros(n), unit=units["coulomb"], min=0.0, description="Coulomb friction"),
        "viscous": gt.parameter(np.zeros(n), unit=units["viscous"], min=0.0, description="viscous friction"),
        "rotor_inertia": gt.parameter(
            np.zeros(n), unit=units["rotor_inertia"], min=0.0, description="rotor inertias, times gear ratio squared"
        ),
        "velocity_scale": gt.parameter(
            VELOCITY_SCALE, unit=units["velocity_scale"], positive=True, description="friction smoothing"
        ),
    }
    if structure.style == "rpy":
        geometry = ["xyz", "rpy", "axis"]
        body["xyz"] = gt.parameter(np.zeros((n, 3)), unit="m", description="joint origins, previous frame")
        body["rpy"] = gt.parameter(
            np.zeros((n, 3)), unit="rad", description="joint orientations: Rz(yaw) Ry(pitch) Rx(roll)"
        )
        body["axis"] = gt.parameter(np.tile(Z, (n, 1)), unit="1", kind="direction", description="axes, joint frames")
    else:
        geometry = list(DH_NAMES)
        for name in geometry:
            unit = "m" if name in ("d", "a") else "rad"
            what = "Hayati's beta" if name == "beta" else f"Denavit-Hartenberg {name}"
            body[name] = gt.parameter(np.zeros(n), unit=unit, description=f"{what} of each joint")
    rows = [*geometry, "m", "mc", "J", "coulomb", "viscous"]
    for k, joint in enumerate(joints):
        values = {name: _row(name, k) for name in rows} | {"velocity_scale": lambda arm: arm.velocity_scale}
        if structure.geared(k):
            body[f"effort_{k + 1}"] = gt.variable(description=f"effort that {joint.name} needs from its leader")
        body[f"link_{k + 1}"] = gt.part(_link_class(structure.style, joint.kind, structure.smoothing), **values)
    return type("SerialArm", (SerialArm,), body)


def description(arm: SerialArm) -> str:
    """Return the text of `gtmodel explain arm.urdf`: one line for each joint, in degrees or mm, with its limits of
    speed and effort if any joint has one.

    >>> arm = gt.robots.serial_arm(a=[0.3, 0.2], alpha=0.0, m=[3.0, 2.0], limits=[[-1.0, 1.0], [-2.0, 2.0]])
    >>> print(gt.robots.description(arm).splitlines()[1])
      q[0]  joint_1    revolute    -57.3 to 57.3 deg       moves link_1, 3 kg
    """
    s = arm.structure
    lines = [f"{s.name}: q ({len(s.leaders)}), from {s.base} to {s.tool}"]
    wide = max(len(joint.name) for joint in s.joints) + 3
    limited = any(np.isfinite(x) for joint in s.joints for x in (joint.velocity, joint.effort))
    for k, joint in enumerate(s.joints):
        place, multiplier, offset = s.coordinate(k)
        factor, unit = (np.degrees(1.0), "deg") if joint.kind == "revolute" else (1e3, "mm")
        ends = [factor * x for x in (joint.lower, joint.upper)]
        limits = f"{ends[0]:.4g} to {ends[1]:.4g} {unit}" if np.any(np.isfinite(ends)) else "no limits"
        if joint.leader is not None:
            limits = f"{multiplier:g} q[{place}] {offset:+g}"
        entry = f"q[{place}]" if joint.leader is None else "    "
        if limited:
            most = [(factor * joint.velocity, f"{unit}/s"), (joint.effort, JOINT_UNITS[joint.kind]["tau"])]
            limits = f"{limits:22s}"
            for value, its in most:
                limits += f"  {f'{value:.4g} {its}' if np.isfinite(value) else '-':12s}"
        mass = float(np.asarray(arm.m)[k])
        lines.append(
            f"  {entry}  {joint.name:{wide}s} {joint.kind:10s}  {limits:22s}  moves {joint.link}, {mass:.4g} kg"
        )
    return "\n".join([*lines, *s.notes])
