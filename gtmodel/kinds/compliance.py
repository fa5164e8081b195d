"""Kind "compliance": how a robot deflects under load and weight, and its lowest frequencies, over its workspace."""

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
    """How a robot deflects: stiffness, deflection, natural frequencies. [links] for a parallel robot, [arm] for a
    serial one."""

    links: Made[options.RodSprings] | None = Field(default=None, description="of a parallel robot")
    carts: Made[options.CartSprings] = Made[options.CartSprings].left_out()
    frame: Made[options.FrameSprings] = Made[options.FrameSprings].left_out()
    arm: Made[options.ArmSprings] | None = Field(default=None, description="of a serial arm")
    load: Made[options.Load] = Made[options.Load].left_out()
    pose_m: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="tool centre point whose numbers are reported; home if left out"
    )
    frequencies: Annotated[int, Field(ge=1, le=12)] = Field(default=3, description="how many are reported")
    section: Made[options.ComplianceMap] = Made[options.ComplianceMap].left_out()


NAME = "compliance"
ARGUMENTS = {"map": "section", "springs.pose": "arm.pose", "springs.joint": "arm.joint", "springs": ""}


def call(problem: Schema, context: Context) -> Call:
    """The study of the reported pose, then of the map."""
    if context.start is not None:
        raise InputError("--start: a map is computed from the beginning; leave it out")
    springs = _springs(problem)
    return Call(
        compliance.study, problem.model(context), springs, problem.load.options(), pose=problem.pose_m,
        map=problem.section.options(), frequencies=problem.frequencies,
        title=problem.title or f"{NAME} of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """The springs, and what was assumed."""
    springs, section = _springs(problem), problem.section.options()
    sprung = compliance.compliance_study.on_springs(
        problem.model(context), springs, problem.load.options(), problem.pose_m, section, problem.frequencies
    )
    grid = compliance.compliance_study.grid_of(sprung, section)
    lines = [f"{problem.title or NAME}: at ({listed(sprung.home)}) m, and on {grid.shape[0]} by {grid.shape[1]} points"]
    if isinstance(sprung, compliance.sprung_links.SprungLinks):
        lines.append("C = U^-1 (diag(1/k) + G diag(1/k_s) G') U^-T, U the unit vectors of the links as rows")
        for name, c in sprung.structure(sprung.at_home).by_group.items():
            given = c[c > 0]
            text = f"{1e-6 / given.max():.4g} to {1e-6 / given.min():.4g} MN/m or MN.m/rad" if given.size else "rigid"
            lines.append(f"  {WORDS[name]}: {text}")
    else:
        lines.append("C = J diag(1/k) J', springs in the joints alone")
    return "\n".join([*lines, *(f"  {sentence}" for sentence in sprung.assumptions)])


def _springs(problem: Schema) -> Springs | ArmSprings:
    given = [key for key in ("links", "arm") if getattr(problem, key) is not None]
    if len(given) != 1:
        raise InputError(
            "expected one of [links], for a parallel robot, and [arm], for a serial one",
            given[-1] if given else "links",
        )
    if problem.arm is None:
        assert problem.links is not None
        return Springs(problem.links.options(), problem.carts.options(), problem.frame.options())
    own = problem.model_fields_set, problem.section.model_fields_set
    useless = [k for k in ("carts", "frame", "frequencies") if k in own[0]]
    useless += [f"section.{k}" for k in ("along_m", "cone_deg") if k in own[1]]
    if useless:
        raise InputError("is for parallel robots; an [arm] is compliant in its joints alone: leave it out", useless[0])
    return problem.arm.options()
