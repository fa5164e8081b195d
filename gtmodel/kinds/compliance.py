"""Kind "compliance": deflection of a robot under load and weight, and its lowest frequencies, over its workspace."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gtmodel import compliance
from gtmodel.compliance import Springs, options
from gtmodel.compliance.options import WORDS, ArmSprings
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results import listed

RESULT = "gtmodel.compliance.ComplianceStudy"


class Schema(RobotProblem):
    """Stiffness, deflection and natural frequencies of a parallel robot, with [links], or a serial arm, with [arm]."""

    links: Made[options.RodSprings] | None = Field(default=None, description="links of a parallel robot")
    carts: Made[options.CartSprings] = Made[options.CartSprings].left_out()
    frame: Made[options.FrameSprings] = Made[options.FrameSprings].left_out()
    arm: Made[options.ArmSprings] | None = Field(default=None, description="joints of a serial arm")
    load: Made[options.Load] = Made[options.Load].left_out()
    pose_m: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="tool centre point of the reported pose; home if left out"
    )
    frequencies: Annotated[int, Field(ge=1, le=12)] = Field(default=3, description="number of reported frequencies")
    section: Made[options.ComplianceMap] = Made[options.ComplianceMap].left_out()


# "springs": "": the file has no [springs]; springs.links.stiffness is links.stiffness_N_m there
ARGUMENTS = {"map": "section", "springs.pose": "arm.pose", "springs.joint": "arm.joint", "springs": ""}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the reported pose and of the map."""
    if context.start is not None:
        raise InputError("--start: a map does not use an earlier result; leave it out")
    springs = _springs(problem)
    return Call(
        compliance.study, problem.model(context), springs, problem.load.options(), pose=problem.pose_m,
        map=problem.section.options(), frequencies=problem.frequencies,
        title=problem.title or f"{problem.kind} of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the springs and the assumptions."""
    springs, section = _springs(problem), problem.section.options()
    sprung = compliance.compliance_study.on_springs(
        problem.model(context), springs, problem.load.options(), problem.pose_m, section, problem.frequencies
    )
    grid = compliance.compliance_study.grid_of(sprung, section)
    lines = [f"{problem.heading}: at ({listed(sprung.home)}) m, and on {grid.shape[0]} by {grid.shape[1]} points"]
    if isinstance(sprung, compliance.sprung_links.SprungLinks):
        lines.append("C = U^-1 (diag(1/k) + G diag(1/k_s) G') U^-T; the rows of U are the unit vectors of the links")
        for name, c in sprung.structure(sprung.at_home).by_group.items():
            soft = c[c > 0]
            text = f"{1e-6 / soft.max():.4g} to {1e-6 / soft.min():.4g} MN/m or MN.m/rad" if soft.size else "rigid"
            lines.append(f"  {WORDS[name]}: {text}")
    else:
        lines.append("C = J diag(1/k) J', springs only in the joints")
    return "\n".join([*lines, *(f"  {sentence}" for sentence in sprung.assumptions)])


def _springs(problem: Schema) -> Springs | ArmSprings:
    tables = [key for key in ("links", "arm") if getattr(problem, key) is not None]
    if len(tables) != 1:
        raise InputError(
            "expected one of [links], for a parallel robot, and [arm], for a serial arm",
            tables[-1] if tables else "links",
        )
    if problem.arm is None:
        assert problem.links is not None
        return Springs(problem.links.options(), problem.carts.options(), problem.frame.options())
    useless = [k for k in ("carts", "frame", "frequencies") if k in problem.model_fields_set]
    useless += [f"section.{k}" for k in ("along_m", "cone_deg") if k in problem.section.model_fields_set]
    if useless:
        raise InputError("is for parallel robots; an [arm] has springs only in its joints: leave it out", useless[0])
    return problem.arm.options()
