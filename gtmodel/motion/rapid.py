"""RAPID modules, as every writer of them needs them. Text only: tested against no controller.

Of the language (ABB, RAPID kernel, technical reference manual): a file is ISO 8859-1, a comment ends with its line,
names are known to all modules of a task unless they are LOCAL, and the quaternion of a robtarget has length 1.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from ..compiler.causal import compile_causal
from ..compiler.flat_cache import flat_of
from ..lang import Model
from ..results import ArgumentError

WIDTH = 110
FARTHEST = 1e6  # mm or degrees: a num is of single precision, and a target so far away is none


def orientation(robot: Model) -> list[str]:
    """The variable of a plate's turn, where the robot has one."""
    return ["e"] if "e" in flat_of(robot).groups else []


def poses(robot: Model, T: np.ndarray) -> np.ndarray:
    """Rows of T (n, 3) [m] with the quaternion of the plate behind them where it turns; T as it is without.

    Raises ArgumentError for rows out of reach.
    """
    turns = orientation(robot)
    if not turns or T.shape[1] == 7:
        return T
    e, status = compile_causal(robot, known="T", targets=turns)(T)
    if np.any(status != 0):
        raise ArgumentError(f"{np.count_nonzero(status)} targets are out of reach", "export.target")
    return np.hstack([T, e])


def comment(text: str) -> list[str]:
    """Lines of comment, in ASCII."""
    plain = " ".join(text.split()).encode("ascii", "backslashreplace").decode("ascii")
    return [f"  ! {line}" for line in textwrap.wrap(plain, WIDTH)]


def module(
    name: str, notes: Sequence[str], declarations: Sequence[str], targets: str, rows: Sequence[str],
    procedure: Sequence[str],
) -> str:  # fmt: skip
    """A module of one procedure and its array `targets` of robtargets, `rows`.

    notes: paragraphs of comment. declarations: of data. procedure: its lines, without PROC's indentation.
    """
    lines = [
        f"MODULE {name}",
        *(line for note in notes for line in comment(note)),
        *(f"  {line}" for line in declarations),
        f"  LOCAL CONST robtarget {targets}{{{len(rows)}}} := [",
        *(f"    {row}{',' if k < len(rows) - 1 else ''}" for k, row in enumerate(rows)),
        "  ];",
        *(f"  {line}" for line in procedure),
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def number(value: float) -> str:
    """A num: of single precision, so nine digits are all that it has."""
    return f"{value:.9g}"


def robtargets(T: np.ndarray, q: np.ndarray) -> list[str]:
    """A robtarget per row of T (n, 3) [m], with a quaternion behind where the plate turns (n, 7); as external axes
    carts q (n, 3) [m] in mm, and rotary ones behind (n, 6) [rad] in degrees.

    Raises ArgumentError for a number that no target has.
    """
    axes = np.hstack([1e3 * q[:, :3], np.degrees(q[:, 3:])])
    wrong = np.flatnonzero(~np.all(np.abs(np.hstack([1e3 * T[:, :3], axes])) < FARTHEST, axis=1))
    length = np.linalg.norm(T[:, 3:], axis=1)
    if T.shape[1] == 7:
        wrong = np.union1d(wrong, np.flatnonzero(~(np.abs(length - 1) < 1e-3)))
    if len(wrong):
        k = wrong[0]
        raise ArgumentError(
            f"target {k} is no pose: {T[k].tolist()} with the actuators {q[k].tolist()}; expected finite numbers and a "
            "quaternion of length 1",
            "targets",
        )
    turned = T[:, 3:] / length[:, None] if T.shape[1] == 7 else []
    lines = []
    for k, (pose, actuators) in enumerate(zip(T, axes, strict=True)):
        x, carts = (_list(v[:3], 4) for v in (1e3 * pose, actuators))
        turn = _list(turned[k], 9) if len(turned) else "1, 0, 0, 0"
        rotary = _list(actuators[3:], 4) or "9E9, 9E9, 9E9"
        lines.append(f"[[{x}], [{turn}], [0, 0, 0, 0], [{carts}, {rotary}]]")
    return lines


def _list(values: np.ndarray, digits: int) -> str:
    return ", ".join(f"{v:.{digits}f}" for v in np.round(values, digits) + 0.0)
