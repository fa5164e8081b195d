"""One motion of a table, and what a source prints of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..results.options import Options, Unit
from .problem import MotionProblem


@dataclass(frozen=True)
class Published(Options):
    """Numbers that a source prints for a row of the table. They stand beside the computed ones and are never a check,
    because the poses and limits of the source are unpublished.

    >>> printed = gt.motion.Published(final_time=0.89, energy=27.0, iterations=36)
    >>> ends = {"start": gt.motion.End([0.0, -0.9, 0.1]), "goal": gt.motion.End([0.9, -0.9, 0.45])}
    >>> robot, limits = gt.robots.gantry_tau("l1_tape"), gt.motion.Limits(force=700.0)
    >>> problem = gt.motion.MotionProblem(robot=robot, limits=limits, **ends)
    >>> gt.motion.TableRow("time-optimal", problem, published=printed).published.final_time
    0.89
    """

    final_time: Annotated[float, Unit("s"), "final time"]
    energy: Annotated[float, "energy, in the source's own unit"]
    iterations: Annotated[int, "number of iterations"]


@dataclass(frozen=True)
class TableRow:
    """One motion of a table.

    name: what the row is called. problem: the motion. most_iterations: bound on the iterations of the attempt that
    found the motion; a check fails where it takes more. published: what a source prints.
    """

    name: str
    problem: MotionProblem
    most_iterations: int | None = None
    published: Published | None = None
