"""Which Denavit-Hartenberg numbers measured poses determine: the choice of a gauge, made and said."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...geometry.rotations import rotation_of_rpy
from ...inference import dependencies
from ...lang import ModelError
from .arm import DH_NAMES, SerialArm
from .to_urdf import dh_step

Array = np.ndarray
NEARLY_PARALLEL = np.radians(5.0)  # below, the place of the common normal is worse known than a tilt
POINTS, SEED, STEP = 60, 1, 1e-6  # configurations, and the step of central differences [m, rad]
RANK = 1e-6  # of the longest column; central differences are good to 1e-9
WIDE = 1.5  # rad or m, of a joint with wider limits or none
FRAME = [*(f"the frame's shift along {x}" for x in "xyz"), *(f"the frame's turn about {x}" for x in "xyz")]
TOOL = [f"tool_xyz[{k}]" for k in range(3)]
TURN = [f"tool_rpy[{k}]" for k in range(3)]


def independent_geometry(
    arm: SerialArm, base: bool = True, tool: bool = True, *, turns: bool = False, tool_turn: bool = True
) -> tuple[list[str], list[str]]:
    """Which Denavit-Hartenberg numbers a calibration by positions can determine, and why not the others.

    base: whether the frame in which the tool is measured is unknown too. tool: whether the place of the target on the
    last link is, as tool_xyz. Of the tool's turn positions see nothing. turns: whether orientations are measured, too.
    tool_turn: whether the turn of the target on the last link is then unknown, as tool_rpy.

    The names are for `free` of a calibration, the reasons are sentences. Where an axis is within 5 degrees of parallel
    to the next, d stays as it is and Hayati's beta is free; elsewhere beta stays. Of what moves together, by a QR of
    the poses' derivatives at random configurations, the unknown frames come first, then a, alpha, theta and d.
    Raises ModelError for an arm placed by xyz and rpy, which has two numbers a joint too many: take `as_dh` of it.

    >>> arm = gt.robots.serial_arm(a=[0.1, 0.5, 0.0], alpha=[np.pi / 2, 0.0, np.pi / 2], d=[0.4, 0.0, 0.0],
    ...                            tool_xyz=[0.1, 0.0, 0.2])
    >>> names, notes = gt.robots.independent_geometry(arm)
    >>> print(", ".join(names))
    a[0], alpha[0], theta[1], a[1], alpha[1], beta[1], tool_xyz[0], tool_xyz[1], tool_xyz[2]
    >>> print(notes[0])
    d[1] stays: axes 2 and 3 are nearly parallel, so that d[1] and d[2] move together; beta[1] is free in its place
    """
    s, n = arm.structure, len(arm.structure.joints)
    if s.style == "rpy":
        raise ModelError("an arm placed by xyz and rpy has six numbers a joint, two more than can be determined; "
                         "take as_dh(arm) to calibrate it")  # fmt: skip
    place = _places(arm, turns)
    names = [f"{name}[{k}]" for k in range(n) for name in DH_NAMES] + TOOL + TURN + FRAME
    J = np.array([(place(h) - place(-h)) / (2 * STEP) for h in STEP * np.eye(len(names))]).T
    # theta and d of a joint, and a, alpha and beta that lead from its axis to the next: of one link, or of two
    parallel = {}
    twist = np.abs(np.sin(np.asarray(arm.alpha, float)))
    for i in range(n - 1):
        link = i if s.style == "standard" else i + 1
        if twist[link] < np.sin(NEARLY_PARALLEL):
            parallel[f"d[{i}]"] = f"beta[{link}]"
    beta = set(parallel.values())
    frames = [*(FRAME if base else []), *(TOOL if tool else []), *(TURN if turns and tool_turn else [])]
    groups = [[f"{name}[{k}]" for k in range(n)] for name in ("a", "alpha", "theta", "d")]
    wanted = [*frames, *groups[0], *groups[1], *groups[2], *sorted(beta), *(x for x in groups[3] if x not in parallel)]
    at = [names.index(name) for name in wanted]
    chosen = dependencies(J[:, at], wanted, keep=wanted, tolerance=RANK)
    notes = [
        f"{d} stays: axes {int(d[2:-1]) + 1} and {int(d[2:-1]) + 2} are nearly parallel, so that {d} and "
        f"d[{int(d[2:-1]) + 1}] move together; {b} is free in its place"
        for d, b in parallel.items()
        if b in chosen.independent
    ]
    for name, terms in chosen.coefficients.items():
        with_ = [other for other, c in terms.items() if abs(c) > 0.01 * max(map(abs, terms.values()))]
        notes.append(f"{name} stays: it moves with {', '.join(with_)}" if with_ else f"{name} moves nothing")
    free = [name for name in names if name in chosen.independent and name not in FRAME]
    return free, notes


def _places(arm: SerialArm, turns: bool) -> Callable[[Array], Array]:
    """Positions (m,) of the tool at random configurations as a function of changes of the numbers, tool and frame; with
    `turns` also of points a metre along its axes, which its orientation moves."""
    s, n = arm.structure, len(arm.structure.joints)
    limits = s.limits()
    low, high = np.clip(limits, -WIDE, WIDE).T
    free = np.random.default_rng(SEED).uniform(low, np.maximum(high, low + 0.1), (POINTS, len(s.leaders)))
    places = [s.coordinate(k) for k in range(n)]
    q = np.column_stack([multiplier * free[:, at] + offset for at, multiplier, offset in places])
    numbers = np.array([np.asarray(getattr(arm, name), float) for name in DH_NAMES]).T
    point, rpy = np.asarray(arm.tool_xyz, float), np.asarray(arm.tool_rpy, float)
    points = np.vstack([np.zeros(3), *([np.eye(3)] if turns else [])])  # in the frame of the tool
    q = np.tile(q, (len(points), 1))

    def place(change: Array) -> Array:
        now = numbers + change[: 5 * n].reshape(n, 5)
        shift, turn, frame = np.split(change[5 * n :], [3, 6])
        p = np.repeat(point + shift + points @ rotation_of_rpy(rpy + turn).T, POINTS, axis=0)
        for k in reversed(range(n)):
            R, r = dh_step(s.style, *now[k])
            if s.style == "standard":
                p = _joint(s.joints[k].kind, q[:, k], p @ R.T + r)
            else:
                p = _joint(s.joints[k].kind, q[:, k], p) @ R.T + r
        return (p @ rotation_of_rpy(frame[3:]).T + frame[:3]).ravel()

    return place


def _joint(kind: str, q: Array, p: Array) -> Array:
    """Points (m, 3) moved by a joint about or along z."""
    if kind == "prismatic":
        return p + np.outer(q, [0.0, 0.0, 1.0])
    c, si = np.cos(q), np.sin(q)
    return np.column_stack([c * p[:, 0] - si * p[:, 1], si * p[:, 0] + c * p[:, 1], p[:, 2]])
