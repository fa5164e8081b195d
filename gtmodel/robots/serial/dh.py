"""Serial arms from Denavit-Hartenberg parameters, with Hayati's beta for nearly parallel axes; conversion of arms given
by xyz and rpy; and the parameters that measured poses determine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.rotations import rotation_of_rpy, rpy_of_rotation
from ...inference import dependencies
from ...lang import ModelError
from .arm import DH_NAMES, FRICTION, SerialArm, arm_class
from .described import Pose, composed, relative
from .structure import ArmJoint, ArmStructure, JointKind, moments, moved, shown, started, with_payload, wrong
from .to_urdf import dh_step

Array = np.ndarray
KINDS: dict[str, JointKind] = {"r": "revolute", "p": "prismatic", "revolute": "revolute", "prismatic": "prismatic"}


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
    start: ArrayLike | None = None,
    c: ArrayLike | None = None,
    I: ArrayLike | None = None,
    title: str = "arm",
    smoothing: str = "tanh",
    payload: float = 0.0,
    **modifiers: Any,
) -> SerialArm:
    """Return a serial arm of n joints from its Denavit-Hartenberg parameters; a single number applies to all joints.

    Args:
        a: link lengths (n,) [m].
        alpha: twists (n,) [rad].
        d: offsets (n,) [m]; added to the coordinate of a prismatic joint.
        theta: angles (n,) [rad]; added to the coordinate of a revolute joint.
        beta: Hayati's angles (n,) [rad] about y, calibrated instead of d if an axis is nearly parallel to the next.
        convention: "standard", joint and then Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), or "modified" (Craig),
            Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d) and then the joint.
        joints: "r" or "p" for each joint, such as "rrp", or one letter for all.
        names: of the joints.
        limits: lower and upper (n, 2) [rad, m].
        start: joint coordinates (n,) [rad, m] of the home pose, by default 0, or the nearest limit. Inverse kinematics
            starts there and takes the branches of this pose. Rows (k, n) are further starts, which are tried in order
            where Newton's method finds nothing from the first.
        c, I: centres of mass (n, 3) [m] and inertias about them (n, 3, 3) [kg m2] in the link frames, instead of mc and
            J.
        title: name of the arm.
        smoothing: of friction, "tanh", "piecewise_linear", "sign" or "stiction".
        payload: point mass at the tool's origin [kg].
        modifiers: any other parameter of `SerialArm`: m, tool_xyz, viscous, ...

    Gauge: `independent_geometry` lists the parameters that a calibration with unknown frames can determine.

    Raises ModelError for arrays of wrong length and for unknown options.

    The tool of a SCARA with two parallel axes and a vertical slide [m]:

    >>> scara = gt.robots.serial_arm(a=[0.3, 0.25, 0.0], alpha=[0.0, np.pi, 0.0], joints="rrp")
    >>> T, status = scara.causal(known="q", targets="T")([0.0, np.pi / 2, 0.1])
    >>> T.round(6)
    array([ 0.3 ,  0.25, -0.1 ])
    """
    given = {"a": a, "alpha": alpha, "d": d, "theta": theta, "beta": beta}
    c, I = (None if x is None else _numbers(name, x) for name, x in (("c", c), ("I", I)))
    numbers, structure = checked_joints(
        given, joints=joints, names=names, limits=limits, start=start, m=modifiers.get("m"), convention=convention,
        smoothing=smoothing, title=title,
    )  # fmt: skip
    n, values = len(structure.joints), {**numbers, **modifiers}
    if c is not None or I is not None:
        if "mc" in modifiers or "J" in modifiers:
            raise ModelError("c and I describe the same as mc and J; give one of the two pairs")
        values["mc"], values["J"] = moments(values.get("m", np.zeros(n)), c, I)
    return arm_class(structure)(**with_payload(values, payload, n))


def checked_joints(
    numbers: Mapping[str, ArrayLike], *, joints: str | Sequence[str] = "r", names: Sequence[str] | None = None,
    limits: ArrayLike | None = None, start: ArrayLike | None = None, m: Any = None, convention: str = "standard",
    smoothing: str = "tanh", title: str = "arm",
) -> tuple[dict[str, Array], ArmStructure]:  # fmt: skip
    """Return the Denavit-Hartenberg parameters, one of each per joint, and the structure of an arm.

    Arguments as for `serial_arm`. Raises ModelError, whose `argument` is the wrong one.
    """
    numbers = {name: _numbers(name, x) for name, x in numbers.items()}
    limits = None if limits is None else _numbers("limits", limits)
    letters = isinstance(joints, str) and joints in KINDS
    n = max([*(np.size(x) for x in numbers.values()), 1 if letters else len(joints)])
    n = max(n, 0 if limits is None else len(np.atleast_2d(limits)))
    kinds = [joints] * n if isinstance(joints, str) and letters else list(joints)
    if not set(kinds) <= set(KINDS) or len(kinds) != n:
        raise wrong(f"joints takes one of r, p for each of the {n} joints, such as 'rrp'; found {joints!r}", "joints")
    each = {key: _each(key, value, n) for key, value in numbers.items()}
    if convention not in ("standard", "modified"):
        raise wrong(f"a convention is standard or modified; found {convention!r}", "convention")
    if smoothing not in FRICTION:
        raise wrong(f"friction smoothing is one of {', '.join(FRICTION)}; found {smoothing!r}", "smoothing")
    labels = [f"joint_{k + 1}" for k in range(n)] if names is None else [str(x) for x in names]
    if len(labels) != n or len(set(labels)) != n:
        raise wrong(f"names takes {n} different names, one for each joint; found {', '.join(labels)}", "names")
    ends = np.full((n, 2), [-np.inf, np.inf]) if limits is None else np.asarray(limits, float)
    if ends.shape != (n, 2):
        raise wrong(f"limits takes a lower and an upper limit for each of the {n} joints; found the shape {ends.shape}",
                    "limits")  # fmt: skip
    for label, kind, (low, high) in zip(labels, kinds, ends.tolist(), strict=True):
        if not low < high:
            low, high = (shown(KINDS[kind], x) for x in (low, high))
            raise wrong(f"the limits of joint '{label}' are {low} and {high}; the first must be lower", "limits")
    masses = np.atleast_1d(np.asarray(m, float)) if isinstance(m, (int, float, list, tuple, np.ndarray)) else []
    for label, mass in zip(labels, masses, strict=False):
        if mass < 0:
            raise wrong(f"the mass of the link that joint '{label}' moves is {mass:g} kg; it cannot be negative", "m")
    arm_joints = tuple(
        ArmJoint(labels[k], KINDS[kinds[k]], f"link_{k + 1}", float(ends[k, 0]), float(ends[k, 1])) for k in range(n)
    )
    return each, started(ArmStructure(title, arm_joints, convention, smoothing=smoothing), start)


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise wrong(f"'{name}' takes numbers, the same count in each row; found {str(value)[:60]}", name) from None


def _each(name: str, value: ArrayLike, n: int) -> Array:
    array = np.asarray(value, float)
    if array.shape not in ((), (n,)):
        raise wrong(f"'{name}' has {array.size} numbers; expected {n}, one for each joint", name)
    return np.broadcast_to(array, n).copy()


NEARLY_PARALLEL = np.radians(5.0)  # below this angle the common normal is less well determined than a tilt
POINTS, SEED, STEP = 60, 1, 1e-6  # configurations, seed, and step of central differences [m, rad]
RANK = 1e-6  # rank tolerance relative to the longest column; central differences are good to 1e-9
WIDE = 1.5  # range [rad or m] of a joint with wider limits or none
FRAME = [*(f"the frame's shift along {x}" for x in "xyz"), *(f"the frame's turn about {x}" for x in "xyz")]
TOOL = [f"tool_xyz[{k}]" for k in range(3)]
TURN = [f"tool_rpy[{k}]" for k in range(3)]


def independent_geometry(
    arm: SerialArm, base: bool = True, tool: bool = True, *, turns: bool = False, tool_turn: bool = True
) -> tuple[list[str], list[str]]:
    """Return the Denavit-Hartenberg parameters that measured poses can determine, and sentences about the others.

    base: the measurement frame is unknown. tool: the position tool_xyz of the target on the last link is unknown.
    turns: orientations are measured in addition to positions. tool_turn: if they are, the orientation tool_rpy of the
    target is unknown; positions alone do not depend on it.

    The names are for `free` of a calibration. If an axis is within 5 degrees of parallel to the next, d stays fixed and
    Hayati's beta is free; otherwise beta stays fixed. A QR decomposition of the poses' derivatives at random
    configurations finds dependent parameters. Among these, the unknown frames are kept free first, then a, alpha, theta
    and d. Raises ModelError for an arm given by xyz and rpy, which has two parameters too many per joint: convert it
    with `as_dh`.

    >>> arm = gt.robots.serial_arm(a=[0.1, 0.5, 0.0], alpha=[np.pi / 2, 0.0, np.pi / 2], d=[0.4, 0.0, 0.0],
    ...                            tool_xyz=[0.1, 0.0, 0.2])
    >>> names, notes = gt.robots.independent_geometry(arm)
    >>> print(", ".join(names))
    a[0], alpha[0], theta[1], a[1], alpha[1], beta[1], tool_xyz[0], tool_xyz[1], tool_xyz[2]
    >>> print(notes[0])
    d[1] stays fixed: axes 2 and 3 are nearly parallel, so d[1] and d[2] have the same effect; beta[1] is free instead
    """
    s, n = arm.structure, len(arm.structure.joints)
    if s.style == "rpy":
        raise ModelError("an arm given by xyz and rpy has six parameters per joint, two more than can be determined; "
                         "calibrate as_dh(arm) instead")  # fmt: skip
    place = _places(arm, turns)
    names = [f"{name}[{k}]" for k in range(n) for name in DH_NAMES] + TOOL + TURN + FRAME
    J = np.array([(place(h) - place(-h)) / (2 * STEP) for h in STEP * np.eye(len(names))]).T
    parallel = {}  # d of a joint -> beta between its axis and the next
    twist = np.abs(np.sin(np.asarray(arm.alpha, float)))
    for i in range(n - 1):
        link = i if s.style == "standard" else i + 1
        if twist[link] < np.sin(NEARLY_PARALLEL):
            parallel[f"d[{i}]"] = f"beta[{link}]"
    beta = set(parallel.values())
    frames = [*(FRAME if base else []), *(TOOL if tool else []), *(TURN if turns and tool_turn else [])]
    groups = [[f"{name}[{k}]" for k in range(n)] for name in ("a", "alpha", "theta", "d")]
    order = [*frames, *groups[0], *groups[1], *groups[2], *sorted(beta), *(x for x in groups[3] if x not in parallel)]
    columns = [names.index(name) for name in order]
    result = dependencies(J[:, columns], order, keep=order, tolerance=RANK)
    notes = [
        f"{d} stays fixed: axes {int(d[2:-1]) + 1} and {int(d[2:-1]) + 2} are nearly parallel, so {d} and "
        f"d[{int(d[2:-1]) + 1}] have the same effect; {b} is free instead"
        for d, b in parallel.items()
        if b in result.independent
    ]
    for name, terms in result.coefficients.items():
        related = [x for x, c in terms.items() if abs(c) > 0.01 * max(map(abs, terms.values()))]
        reason = f"its effect is a combination of {', '.join(related)}" if related else "it has no effect on the poses"
        notes.append(f"{name} stays fixed: {reason}")
    free = [name for name in names if name in result.independent and name not in FRAME]
    return free, notes


def _places(arm: SerialArm, turns: bool) -> Callable[[Array], Array]:
    """Return a function of changes of the parameters, tool and frame: positions (m,) of the tool at random
    configurations. With `turns` it includes points at 1 m along the tool's axes, which depend on its orientation."""
    s, n = arm.structure, len(arm.structure.joints)
    limits = s.limits()
    low, high = np.clip(limits, -WIDE, WIDE).T
    free = np.random.default_rng(SEED).uniform(low, np.maximum(high, low + 0.1), (POINTS, len(s.leaders)))
    coordinates = [s.coordinate(k) for k in range(n)]
    q = np.column_stack([multiplier * free[:, column] + offset for column, multiplier, offset in coordinates])
    numbers = np.array([np.asarray(getattr(arm, name), float) for name in DH_NAMES]).T
    point, rpy = np.asarray(arm.tool_xyz, float), np.asarray(arm.tool_rpy, float)
    points = np.vstack([np.zeros(3), *([np.eye(3)] if turns else [])])  # tool coordinates
    q = np.tile(q, (len(points), 1))
    steps = [dh_step(s.style, *row) for row in numbers]

    def place(change: Array) -> Array:
        changed = numbers + change[: 5 * n].reshape(n, 5)
        shift, turn, frame = np.split(change[5 * n :], [3, 6])
        p = np.repeat(point + shift + points @ rotation_of_rpy(rpy + turn).T, POINTS, axis=0)
        for k in reversed(range(n)):
            R, r = dh_step(s.style, *changed[k]) if (changed[k] != numbers[k]).any() else steps[k]
            if s.style == "standard":
                p = _joint(s.joints[k].kind, q[:, k], p @ R.T + r)
            else:
                p = _joint(s.joints[k].kind, q[:, k], p) @ R.T + r
        return (p @ rotation_of_rpy(frame[3:]).T + frame[:3]).ravel()

    return place


def _joint(kind: str, q: Array, p: Array) -> Array:
    """Return points (m, 3) after a rotation about z or a translation along it."""
    if kind == "prismatic":
        return p + np.outer(q, [0.0, 0.0, 1.0])
    c, si = np.cos(q), np.sin(q)
    return np.column_stack([c * p[:, 0] - si * p[:, 1], si * p[:, 0] + c * p[:, 1], p[:, 2]])


MEETING = 1e-9  # axes closer than this intersect [m]


def as_dh(arm: SerialArm) -> SerialArm:
    """Convert an arm to standard Denavit-Hartenberg parameters, with its limits, mimics, inertias and friction.

    Frames follow the common normals of the axes. If an axis is within 5 degrees of parallel to the next, d is 0 and
    Hayati's beta is the tilt. base_xyz and base_rpy place the first frame, tool_xyz and tool_rpy the tool in the last
    one. An arm with Denavit-Hartenberg parameters is returned unchanged.

    >>> text = '''<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
    ...   <joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
    ...   <joint name="lift" type="continuous"><parent link="b"/><child link="c"/>
    ...     <origin xyz="0.1 0 0.4"/><axis xyz="0 1 0"/></joint></robot>'''
    >>> arm = gt.robots.as_dh(gt.robots.from_urdf(text))
    >>> print(arm.a.round(3), arm.d.round(3), np.degrees(arm.alpha).round())
    [0.1 0. ] [0.4 0. ] [-90.   0.]
    """
    s = arm.structure
    if s.style != "rpy":
        return arm
    here, links = _links(arm)
    axes = [(R @ _unit(axis), r) for (R, r), axis in zip(links, np.asarray(arm.axis, float), strict=True)]
    n = len(links)
    numbers = np.zeros((n, 5))  # theta, d, a, alpha, beta
    frames = [_first(here, *axes[0])]
    for k in range(n - 1):
        if s.joints[k].kind == "prismatic":  # the axis may pass through any point
            axes[k] = (axes[k][0], frames[k][1])
        through = frames[k][1] if s.joints[k + 1].kind == "prismatic" else axes[k + 1][1]
        numbers[k], following = _step(frames[k], axes[k + 1][0], through)
        frames.append(following)
    ends = [*frames[1:], frames[-1]]  # the link frames
    tool = composed(links[-1], (rotation_of_rpy(arm.tool_rpy), np.asarray(arm.tool_xyz, float)))
    m, mc, J = (np.asarray(x, float) for x in (arm.m, arm.mc, arm.J))
    bodies = [moved(*relative(ends[k], links[k]), m[k], mc[k], J[k]) for k in range(n)]
    last = relative(ends[-1], tool)
    values: dict[str, Any] = dict(zip(("theta", "d", "a", "alpha", "beta"), numbers.T, strict=True))
    values |= {"m": m, "mc": np.array([x for x, _ in bodies]), "J": np.array([x for _, x in bodies])}
    values |= {"base_xyz": frames[0][1], "base_rpy": rpy_of_rotation(frames[0][0])}
    values |= {"tool_xyz": last[1], "tool_rpy": rpy_of_rotation(last[0])}
    values |= {name: getattr(arm, name) for name in ("viscous", "coulomb", "rotor_inertia", "velocity_scale")}
    return arm_class(replace(s, style="standard"))(**values)


def _links(arm: SerialArm) -> tuple[Pose, list[Pose]]:
    """Return the base and the link frames in the world, with all joints at 0."""
    base = (rotation_of_rpy(arm.base_rpy), np.asarray(arm.base_xyz, float))
    poses, pose = [], base
    for xyz, rpy in zip(np.asarray(arm.xyz, float), np.asarray(arm.rpy, float), strict=True):
        pose = composed(pose, (rotation_of_rpy(rpy), xyz))
        poses.append(pose)
    return base, poses


def _first(base: Pose, z: Array, point: Array) -> Pose:
    """Return the frame on the first axis nearest to the base: origin at the perpendicular's foot, x along its x."""
    R, r = base
    x = R[:, 0] - (R[:, 0] @ z) * z
    if np.linalg.norm(x) < 1e-6:
        x = R[:, 1] - (R[:, 1] @ z) * z
    x = _unit(x)
    return np.column_stack([x, np.cross(z, x), z]), point + ((r - point) @ z) * z


def _step(frame: Pose, z: Array, point: Array) -> tuple[Array, Pose]:
    """Return theta, d, a, alpha, beta from a frame to the next axis, along z through a point, and the next frame."""
    R, r = frame
    axis, p = R.T @ z, R.T @ (point - r)  # frame coordinates
    across = float(np.hypot(axis[0], axis[1]))
    if across < np.sin(NEARLY_PARALLEL):
        foot = p - axis * (p[2] / axis[2])  # intersection of the next axis with the plane z = 0
        a = float(np.hypot(foot[0], foot[1]))
        theta, d = float(np.arctan2(foot[1], foot[0])) if a > MEETING else 0.0, 0.0
        tilted = _about_z(-theta) @ axis
        beta, alpha = float(np.arcsin(np.clip(tilted[0], -1.0, 1.0))), float(np.arctan2(-tilted[1], tilted[2]))
    else:
        normal = np.array([-axis[1], axis[0], 0.0]) / across  # z x axis
        a = float(normal @ p)
        if a < -MEETING:
            normal, a = -normal, -a
        a = a if abs(a) > MEETING else 0.0
        theta, beta = float(np.arctan2(normal[1], normal[0])), 0.0
        # foot of the common normal: p + s axis has no component along side
        side = np.array([-normal[1], normal[0], 0.0])
        d = float(p[2] - axis[2] * (side @ p) / (side @ axis))
        alpha = float(np.arctan2(-(side @ axis), axis[2]))
    x, y, turn = (rotation_of_rpy(v) for v in ([alpha, 0, 0], [0, beta, 0], [0, 0, theta]))
    step = (turn @ x @ y, np.array([a * np.cos(theta), a * np.sin(theta), d]))
    return np.array([theta, d, a, alpha, beta]), composed(frame, step)


def _about_z(angle: float) -> Array:
    return rotation_of_rpy([0.0, 0.0, angle])


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)
