"""A serial arm as the tables of a TOML robot file, in the units of its keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arm import SerialArm
from .bodies import central

BODY = ("m", "mc", "J", "viscous", "coulomb")


def robot_table(arm: SerialArm, urdf: str) -> dict[str, Any]:
    """Keys and values of a robot file: of an arm by Denavit-Hartenberg numbers all that it is, family "serial".

    An arm placed by xyz and rpy stays in `urdf`, the name of the file that `to_urdf` writes; its bodies and friction
    stand beside it as parameters.

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
                      ("viscous", "viscous"), ("coulomb", "coulomb")):  # fmt: skip
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
