"""Export of serial arms to URDF, for pinocchio, ROS and others, and to TOML robot files."""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.rotations import X, Y, Z, rotation_about, rotation_of_rpy, rpy_of_rotation
from ...lang import ModelError
from .arm import DH_NAMES, SerialArm
from .structure import central, moved

BODY = ("m", "mc", "J", "viscous", "coulomb", "rotor_inertia")


def robot_table(arm: SerialArm, urdf: str) -> dict[str, Any]:
    """Return the keys and values of a robot file.

    For an arm with Denavit-Hartenberg parameters the table is complete, with family "serial". For an arm given by xyz
    and rpy it refers to `urdf`, the name of the file that `to_urdf` writes, and has bodies and friction as parameters.

    >>> arm = gt.robots.serial_arm(a=[0.3, 0.2], alpha=[0.0, np.pi / 2], m=[3.0, 2.0])
    >>> table = gt.robots.robot_table(arm, "arm.urdf")
    >>> table["family"], table["a_m"], [round(x) for x in table["alpha_deg"]]
    ('serial', [0.3, 0.2], [0, 90])
    """
    s = arm.structure
    if s.style == "rpy":
        values = {name: np.asarray(getattr(arm, name), float).tolist() for name in BODY}
        return {"robot": urdf, "parameters": values}
    table: dict[str, Any] = {
        "title": s.name, "family": "serial", "convention": s.style, "joints": [j.kind for j in s.joints],
        "names": [j.name for j in s.joints],
    }  # fmt: skip
    for key, name in (("a_m", "a"), ("d_m", "d"), ("base_m", "base_xyz"), ("tool_m", "tool_xyz"), ("m_kg", "m"),
                      ("viscous", "viscous"), ("coulomb", "coulomb"), ("rotor_inertia", "rotor_inertia")):  # fmt: skip
        table[key] = np.asarray(getattr(arm, name), float).tolist()
    for key, name in (("alpha_deg", "alpha"), ("theta_deg", "theta"), ("beta_deg", "beta"),
                      ("base_rpy_deg", "base_rpy"), ("tool_rpy_deg", "tool_rpy")):  # fmt: skip
        table[key] = np.degrees(np.asarray(getattr(arm, name), float)).tolist()
    limits = s.limits()
    if np.all(np.isfinite(limits)):
        table["limits"] = limits.tolist()
    m, mc, J = (np.asarray(x, float) for x in (arm.m, arm.mc, arm.J))
    if np.all(m > 0):
        centres = [central(*body) for body in zip(m, mc, J, strict=True)]
        table |= {"c_m": [c.tolist() for c, _ in centres], "I_kg_m2": [I.tolist() for _, I in centres]}
    return table


Array = np.ndarray
Pose = tuple[Array, Array]


def to_urdf(arm: SerialArm, comment: str = "") -> str:
    """Return the URDF text of an arm: placements, limits, mimics, inertias and friction; the tool is a fixed joint.

    comment: written at the top, for example the source of the numbers. A link "world" is added before the base unless
    base_xyz and base_rpy are 0. URDF has no element for rotor_inertia: `robot_table` keeps it.

    Raises ModelError for a negative mass, and for a body with moments but no mass, which URDF cannot represent.

    >>> arm = gt.robots.serial_arm(a=[0.3, 0.2], alpha=0.0, m=[3.0, 2.0], c=[[-0.15, 0, 0], [-0.1, 0, 0]])
    >>> text = gt.robots.to_urdf(arm)
    >>> again = gt.robots.from_urdf(text)
    >>> q = np.array([0.3, -0.7])
    >>> before, after = (x.causal(known="q", targets="T")(q)[0] for x in (arm, again))
    >>> bool(np.allclose(before, after, atol=1e-15))
    True
    """
    s = arm.structure
    # without an XML declaration, so that users may add comments before the first line
    lines = [f"<!-- {comment.replace('--', '- -')} -->"] if comment else []
    lines.append(f"<robot name={quoteattr(s.name)}>")
    base = (rotation_of_rpy(arm.base_rpy), np.asarray(arm.base_xyz, float))
    names = [s.base, *[j.link for j in s.joints]]
    if not _is_identity(base):
        world = "world" if s.base != "world" else "ground"
        lines += [f'  <link name="{world}"/>', f"  <link name={quoteattr(s.base)}/>"]
        lines += _joint("base_mount", "fixed", world, s.base, base)
    else:
        lines.append(f"  <link name={quoteattr(s.base)}/>")
    places, bodies = _placements(arm)
    for k, joint in enumerate(s.joints):
        lines += _link(joint.link, *bodies[k])
        inside = [f"    <axis {_xyz('xyz', _axis(arm, k))}/>"]
        kind = joint.kind
        if kind == "revolute" and not (np.isfinite(joint.lower) or np.isfinite(joint.upper)):
            kind = "continuous"
        limit = {"velocity": joint.velocity, "effort": joint.effort}
        if kind != "continuous":
            limit |= {"lower": max(joint.lower, -1e9), "upper": min(joint.upper, 1e9)}
        inside.append(f"    <limit {_numbers({k: v if np.isfinite(v) else 1e9 for k, v in limit.items()})}/>")
        viscous, coulomb = float(np.asarray(arm.viscous)[k]), float(np.asarray(arm.coulomb)[k])
        if viscous or coulomb:
            inside.append(f'    <dynamics damping="{viscous:.17g}" friction="{coulomb:.17g}"/>')
        if joint.leader is not None:
            leader = s.joints[joint.leader].name
            inside.append(f'    <mimic joint={quoteattr(leader)} multiplier="{joint.multiplier:.17g}" '
                          f'offset="{joint.offset:.17g}"/>')  # fmt: skip
        lines += _joint(joint.name, kind, names[k], joint.link, places[k], inside)
    lines.append(f"  <link name={quoteattr(_tool(arm))}/>")
    lines += _joint(f"{_tool(arm)}_mount", "fixed", names[-1], _tool(arm), places[-1])
    return "\n".join([*lines, "</robot>", ""])


def _tool(arm: SerialArm) -> str:
    """Return a name for the tool's link that no moving link has."""
    s = arm.structure
    return s.tool if s.tool not in {j.link for j in s.joints} else f"{s.tool}_tool"


def _placements(arm: SerialArm) -> tuple[list[Pose], list[tuple[float, Array, Array]]]:
    """Return the pose of each joint in the previous link and of the tool in the last, and the bodies in URDF frames."""
    s, n = arm.structure, len(arm.structure.joints)
    m, mc, J = (np.asarray(x, float) for x in (arm.m, arm.mc, arm.J))
    tool = (rotation_of_rpy(arm.tool_rpy), np.asarray(arm.tool_xyz, float))
    if s.style == "rpy":
        poses = [(rotation_of_rpy(arm.rpy[k]), np.asarray(arm.xyz[k], float)) for k in range(n)]
        return [*poses, tool], [(m[k], mc[k], J[k]) for k in range(n)]
    numbers = [np.asarray(getattr(arm, name), float) for name in DH_NAMES]
    steps = [dh_step(s.style, *[x[k] for x in numbers]) for k in range(n)]
    if s.style == "modified":
        return [*steps, tool], [(m[k], mc[k], J[k]) for k in range(n)]
    start = (np.eye(3), np.zeros(3))
    bodies = [(m[k], *moved(*steps[k], m[k], mc[k], J[k])) for k in range(n)]
    R, r = steps[-1]
    return [start, *steps[:-1], (R @ tool[0], R @ tool[1] + r)], bodies


def dh_step(style: str, theta: float, d: float, a: float, alpha: float, beta: float) -> Pose:
    """Return rotation (3, 3) and origin (3,) [m] of the next frame from Denavit-Hartenberg parameters [rad, m]."""
    x, y, z = rotation_about(X, alpha), rotation_about(Y, beta), rotation_about(Z, theta)
    if style == "standard":
        return z @ x @ y, np.array([a * np.cos(theta), a * np.sin(theta), d])
    return x @ y @ z, np.array([a, 0.0, 0.0]) + d * (x @ y)[:, 2]


def _axis(arm: SerialArm, k: int) -> Array:
    axis = np.asarray(arm.axis, float)[k] if arm.structure.style == "rpy" else np.array([0.0, 0.0, 1.0])
    return axis / np.linalg.norm(axis)


def _is_identity(pose: Pose) -> bool:
    return not np.any(pose[0] - np.eye(3)) and not np.any(pose[1])


def _link(name: str, m: float, mc: Array, J: Array) -> list[str]:
    if m < 0 or (m == 0 and (np.any(mc) or np.any(J))):
        what = f"a mass of {m:.4g} kg" if m else "moments but no mass"
        raise ModelError(f"link '{name}' has {what}, which URDF cannot represent; give physically consistent inertias")
    if m == 0:
        return [f"  <link name={quoteattr(name)}/>"]
    c, I = central(m, mc, J)
    entries = {"ixx": I[0, 0], "ixy": I[0, 1], "ixz": I[0, 2], "iyy": I[1, 1], "iyz": I[1, 2], "izz": I[2, 2]}
    return [
        f"  <link name={quoteattr(name)}>",
        "    <inertial>",
        f'      <origin {_xyz("xyz", c)} rpy="0 0 0"/>',
        f'      <mass value="{m:.17g}"/>',
        f"      <inertia {_numbers(entries)}/>",
        "    </inertial>",
        "  </link>",
    ]


def _joint(name: str, kind: str, parent: str, child: str, pose: Pose, inside: Any = ()) -> list[str]:
    return [
        f"  <joint name={quoteattr(name)} type={quoteattr(kind)}>",
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
        f"    <origin {_xyz('xyz', pose[1])} {_xyz('rpy', rpy_of_rotation(pose[0]))}/>",
        *inside,
        "  </joint>",
    ]


def _numbers(values: dict[str, float]) -> str:
    return " ".join(f'{name}="{value:.17g}"' for name, value in values.items())


def _xyz(name: str, values: ArrayLike) -> str:
    numbers = " ".join(f"{x:.17g}" for x in np.asarray(values, float))
    return f'{name}="{numbers}"'
