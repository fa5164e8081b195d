"""A serial arm in lines of text: its joints with their limits and masses, and what was left out of its file."""

from __future__ import annotations

import numpy as np

from .arm import SerialArm


def description(arm: SerialArm) -> str:
    """What `gtmodel explain arm.urdf` prints: one line for each joint, in degrees and mm where it turns or slides.

    >>> arm = gt.robots.serial_arm(a=[0.3, 0.2], alpha=0.0, m=[3.0, 2.0], limits=[[-1.0, 1.0], [-2.0, 2.0]])
    >>> print(gt.robots.description(arm).splitlines()[1])
      q[0]  joint_1    revolute    -57.3 to 57.3 deg       moves link_1, 3 kg
    """
    s = arm.structure
    lines = [f"{s.name}: q ({len(s.leaders)}), from {s.base} to {s.tool}"]
    wide = max(len(joint.name) for joint in s.joints) + 3
    for k, joint in enumerate(s.joints):
        at, multiplier, offset = s.coordinate(k)
        factor, unit = (np.degrees(1.0), "deg") if joint.kind == "revolute" else (1e3, "mm")
        ends = [factor * x for x in (joint.lower, joint.upper)]
        limits = f"{ends[0]:.4g} to {ends[1]:.4g} {unit}" if np.any(np.isfinite(ends)) else "no limits"
        if joint.leader is not None:
            limits = f"{multiplier:g} q[{at}] {offset:+g}"
        place = f"q[{at}]" if joint.leader is None else "    "
        mass = float(np.asarray(arm.m)[k])
        lines.append(
            f"  {place}  {joint.name:{wide}s} {joint.kind:10s}  {limits:22s}  moves {joint.link}, {mass:.4g} kg"
        )
    return "\n".join([*lines, *s.notes])
