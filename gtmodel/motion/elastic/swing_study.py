"""The elastic study: residual vibration of an elastic tool after rigid, shaped and elastic plans."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ... import view
from ...lang import Model
from ...results import SolveStatus, Work
from ...results.options import Long, Within
from ...results.trajectory_files import TRAJECTORY
from ...results.work import WorkOptions, study_function
from ..finer_mesh import OnMesh, study_on_meshes
from .options import ElasticCost, ElasticMesh, ElasticSolver, ElasticStudy, ElasticTool
from .plans import MENDED, ElasticTask, Plans, PlansFailure, PlateMotion, plans_on, swing, too_coarse

RATIOS = np.linspace(0.6, 1.4, 81)


@study_function
def elastic_study(
    robot: Model,
    start: Annotated[Sequence[float], Long(3)],
    goal: Annotated[Sequence[float], Long(3)],
    tool: ElasticTool,
    *,
    force: Annotated[float, Within(above=0.0)],
    cost: ElasticCost | None = None,
    mesh: ElasticMesh | None = None,
    solver: ElasticSolver | None = None,
    **work_options: Unpack[WorkOptions],
) -> ElasticStudy:
    """Compare the residual vibration of an elastic tool after four motions from rest to rest: the optimal motion with a
    rigid tool, that motion shaped by ZV and by ZVD, and the optimal motion with the elastic tool.

    Args:
        robot: a three-link robot without the tool; plans with a rigid tool carry its mass as payload.
        start, goal: (3,) tool centre points at both ends [m].
        tool: mass, natural frequency and damping.
        force: limit of every motor [N].
        cost, mesh, solver: see `ElasticCost`, `ElasticMesh`, `ElasticSolver`. The mesh is refined if that can make a
            failed check pass.
        progress, max_seconds, stop: see `gtmodel.results.Work`. A study stopped during refinement contains the
            previous result; stopped earlier it has no values.

    Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.motion.elastic import ElasticMesh, ElasticTool
    >>> robot, tool = gt.robots.gantry_tau("l1_tape"), ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> coarse = ElasticMesh(elements=24, most_elements=24)
    >>> s = gt.motion.elastic_study(robot, [0.0, -0.9, 0.1], [0.9, -0.9, 0.45], tool, force=700.0, mesh=coarse)
    >>> s.motions["ZV"]["residual_mm"] < 1e-3 * s.motions["rigid"]["residual_mm"]
    True
    """
    work = Work(**work_options)
    task = ElasticTask(
        robot=robot, start=start, goal=goal, tool=tool, force=force, cost=cost or ElasticCost(),
        solver=solver or ElasticSolver(),
    )  # fmt: skip
    work.step("rigid plan")

    def solved(mesh: ElasticMesh, before: OnMesh | None) -> OnMesh:
        plans = plans_on(mesh, task, None if before is None else before.kept, work)
        return OnMesh(mesh, _study_of(plans, work.title), plans)

    return study_on_meshes(solved, mesh or ElasticMesh(), MENDED, work.interrupted)


def _study_of(outcome: Plans | PlansFailure, title: str) -> ElasticStudy:
    if isinstance(outcome, PlansFailure):
        return ElasticStudy(
            status=outcome.status, message=outcome.message, title=title, iterations=outcome.iterations
        )  # fmt: skip
    task, elastic, tool = outcome.task, outcome.elastic, outcome.task.tool
    ends = "; ".join(f"{n} {t['final_time_s']:.4g} s, {t['residual_mm']:.3g} mm" for n, t in outcome.table.items())
    plans = (("rigid", outcome.rigid), ("elastic", elastic))
    limits = {"tau": (-task.force, task.force)}
    open_ends = [f"{name} plan: {plan.reservation}" for name, plan in plans if plan.reservation]
    return ElasticStudy(
        status=SolveStatus.SOLVED,
        message="; ".join([ends, *open_ends]),
        title=title,
        objective=elastic.objective,
        iterations=outcome.iterations,
        checks=outcome.checks,
        motions=outcome.table,
        frequency=tool.frequency,
        static=tool.sag,
        elements=outcome.mesh.elements,
        resimulated_end=outcome.left,
        force=task.force,
        notes=too_coarse(tool, outcome.mesh, elastic.final_time),
        trajectory=elastic.trajectory,
        machine_files=(TRAJECTORY,),
        figures={"swing": partial(_figure, outcome.motions, tool, title)},
        scenes={"motion": partial(view.scene, task.robot, elastic.trajectory, limits=limits, title=title)},
    )


def _figure(motions: list[PlateMotion], tool: ElasticTool, title: str) -> Any:
    from ...plot.motion import swing_figure

    swings = {m.name: swing(m.plate, tool) for m in motions}
    curves = {m.name: m.residual(RATIOS, tool) for m in motions}
    return swing_figure(swings, RATIOS, curves, title=title)
