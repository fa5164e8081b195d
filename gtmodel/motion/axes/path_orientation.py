"""The way of a plate along a path: where its tool centre point is and how its tool points, as equations in s."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ... import lang as gt
from ...compiler.causal import CausalFunction, compile_causal
from ...results import ArgumentError
from ..constraints import MotionConstraints
from ..paths import Path

Array = np.ndarray
WIDEST_DEG = 100.0  # between declared directions that follow one another: their chord must stay off zero


@dataclass(frozen=True, eq=False)
class PathOrientation:
    """A path and how the plate is held on it.

    turning: s -> tool direction (3,) in the robot's frame, for five degrees of freedom, or the plate's quaternion (4,),
    for six; of any length but zero.
    tool: the tool's direction in plate coordinates (3,); None with six degrees of freedom.
    """

    path: Path
    turning: scipy.interpolate.PPoly
    tool: Array | None

    def equations(self, robot: Any, s: Any, metre: Any) -> Iterator[Any]:
        """What restricts an F1 to its path coordinate s: six equations for its six axes."""
        yield robot.T == self.path.expression(s, metre)
        wanted = gt.piecewise(s, self.turning.x, self.turning.c)
        if self.tool is None:
            w, x = wanted[0], gt.vector([wanted[k] for k in (1, 2, 3)])
            own = gt.vector([robot.e[k] for k in (1, 2, 3)])
            yield w * own - robot.e[0] * x - gt.cross(x, own) == np.zeros(3)  # imaginary part of conj(wanted) e
            return
        across = gt.cross(wanted, self._beside)
        held = robot.R @ self.tool
        yield gt.dot(held, across) == 0.0
        yield gt.dot(held, gt.cross(wanted, across)) == 0.0
        yield robot.q[4] == -robot.q[3]

    @property
    def _beside(self) -> Array:
        """The coordinate axis that the tool direction keeps the widest angle from."""
        directions = self.turning(np.linspace(0.0, 1.0, 101))
        directions = directions / np.linalg.norm(directions, axis=1)[:, None]
        return np.eye(3)[int(np.argmin(np.max(np.abs(directions), axis=0)))]

    def function(self, robot: gt.Model, guard: MotionConstraints, *targets: str) -> CausalFunction:
        """s and its derivatives as far as needed -> targets, of the robot as `robot` and of the guard's margins."""
        course = self

        def equations(model: Any) -> Iterator[Any]:
            yield from guard.equations(model)
            yield from course.equations(model.robot, model.s, model.metre)

        declared = {**guard.declarations(robot), "s": gt.variable(unit="1", start=0.0), "equations": equations}
        model = type("Restricted", (gt.Model,), declared)()
        return compile_causal(model, known="s", targets=targets)


def turning(at: Array, through: Array, argument: str) -> scipy.interpolate.PPoly:
    """A smooth course through directions or quaternions (n, d) at fractions (n,) of the way; equal ones: a constant.

    Raises ArgumentError, with the name `argument`, where two that follow one another are too far apart, or opposite.

    >>> course = gt.motion.axes.turning(np.array([0.0, 1.0]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), "goal")
    >>> course(0.5)
    array([0.5, 0.5, 0. ])
    """
    through = through / np.linalg.norm(through, axis=1)[:, None]
    if through.shape[1] == 4:  # e and -e are one orientation: the nearer sign
        for k in range(1, len(through)):
            through[k] *= 1.0 if through[k] @ through[k - 1] >= 0 else -1.0
    apart = np.degrees(np.arccos(np.clip(np.sum(through[1:] * through[:-1], axis=1), -1.0, 1.0)))
    if np.any(apart > WIDEST_DEG):
        k = int(np.argmax(apart))
        raise ArgumentError(
            f"the tool turns by {apart[k]:.4g} degrees from {100 * at[k]:.0f} % to {100 * at[k + 1]:.0f} % of the way; "
            f"declare a direction between them, {WIDEST_DEG:g} degrees is the most",
            argument,
        )
    if np.all(np.ptp(through, axis=0) < 1e-12):
        return scipy.interpolate.PPoly(through[:1][None], np.array([0.0, 1.0]))
    curve = scipy.interpolate.CubicSpline(at, through, bc_type="natural")
    return scipy.interpolate.PPoly(curve.c, curve.x)
