"""The study of a motion of six axes: optimise, re-simulate, try with all axes free, on a finer mesh where it helps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from ...lang import Model
from ...results import Trajectory, Work
from ...results.check import failed_of
from ...results.door import study_function
from ...results.work import Progress, never, silent
from ..finer_mesh import finer_mesh, refined, refinement_note
from ..options import AxisLimits, Shape
from .options import AxisCost, AxisEnd, AxisMesh, AxisSolver, ToolCourse
from .planning import plan_of
from .problem import AxisProblem
from .result import AxisStudy
from .trial import MENDED, AxisOutcome, on_this_mesh


@study_function
def axis_study(
    robot: Model,
    start: AxisEnd,
    goal: AxisEnd,
    *,
    limits: AxisLimits,
    path: Shape | None = None,
    tool: ToolCourse | None = None,
    degrees_of_freedom: Literal[5, 6] = 5,
    cost: AxisCost | None = None,
    mesh: AxisMesh | None = None,
    solver: AxisSolver | None = None,
    earlier: Trajectory | None = None,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> AxisStudy:
    """Time- or energy-optimal motion of the F1 from rest to rest, free between positions of its axes or along a path.

    Args:
        robot: an F1, three carts q1 to q3 [m] and three rotary axes q4 to q6 [rad].
        start, goal: positions of all axes; along a path the tool centre point will do, with the tool's direction.
        limits: motor forces and torques, and what else the motion must keep.
        path: `Line`, `Polyline`, `Arc`, `Spline` or `Taught` of `gtmodel.motion`; free if left out.
        tool: how the tool is held along the path: which axis of the plate it is, and directions on the way.
        degrees_of_freedom: 5 keeps q4 = -q5 all the way, 6 leaves all axes free.
        cost, mesh, solver: what is minimised, and how. Where a check fails that a finer mesh can mend, one is taken.
        earlier: the trajectory of an earlier study to start from.
        progress, max_seconds, stop: see `gtmodel.results.Work`. Stopped while it optimises, it holds the best iterate.

    Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.motion import AxisEnd, AxisLimits, AxisMesh
    >>> start, goal = AxisEnd([0.72, 0.26, 0.21], [0.0, 0.0, 0.0]), AxisEnd([0.9, 0.5, 0.35], [0.2, -0.2, -0.15])
    >>> limits = AxisLimits(force=1000.0, torque=40.0)
    >>> s = gt.motion.axis_study(gt.robots.catalogue.make("f1"), start, goal, limits=limits, mesh=AxisMesh(6, 6))
    >>> s.tcp.shape
    (2, 3)
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    problem = AxisProblem(
        robot=robot, start=start, goal=goal, limits=limits, path=path, tool=tool or ToolCourse(),
        degrees_of_freedom=degrees_of_freedom, cost=cost or AxisCost(), mesh=mesh or AxisMesh(),
        solver=solver or AxisSolver(), earlier=earlier, title=title,
    )  # fmt: skip
    work.step("equations")
    plan = plan_of(problem)
    work.step("transcribing")
    given = on_this_mesh(plan, problem.mesh, None, work)
    iterations = given.study.iterations or 0

    def finer(outcome: AxisOutcome) -> AxisMesh | None:
        return finer_mesh(outcome.mesh, outcome.checks, MENDED) if outcome.study.status.converged else None

    def again(before: AxisOutcome, mesh: AxisMesh) -> AxisOutcome | str:
        nonlocal iterations
        after = on_this_mesh(plan, mesh, before.solution, work)
        iterations += after.study.iterations or 0
        return after if after.study.status.converged else f"on {mesh.elements} elements: {after.study.message}"

    outcome, trouble = refined(given, finer, again, work.interrupted)
    study, message = outcome.study, outcome.study.message
    if outcome is not given:
        end = "" if study.status.ok else ";"
        message += end + refinement_note(problem.mesh.elements, outcome.mesh.elements, failed_of(given.checks))
    message = "; ".join(filter(None, [message, trouble]))
    return study.with_(iterations=iterations, message=message, refined=outcome is not given)
