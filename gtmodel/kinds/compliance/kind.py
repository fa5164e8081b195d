"""Kind "compliance": how a robot deflects under load and weight, and its lowest frequencies, over its workspace."""

from __future__ import annotations

from gtmodel.compliance import Springs, study
from gtmodel.compliance.compliance_result import WORDS
from gtmodel.compliance.compliance_study import grid_of, on_springs
from gtmodel.compliance.options import ArmSprings
from gtmodel.compliance.sprung_links import SprungLinks
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.results import listed

from .keys import Schema

NAME = "compliance"
ARGUMENTS = {"map": "section", "springs.pose": "arm.pose", "springs.joint": "arm.joint", "springs": ""}


def call(problem: Schema, context: Context) -> Call:
    """The study of the reported pose, then of the map."""
    if context.start is not None:
        raise InputError("--start: a map is computed from the beginning; leave it out")
    springs = _springs(problem)
    return Call(
        study, problem.model(context), springs, problem.load.options(), pose=problem.pose_m,
        map=problem.section.options(), frequencies=problem.frequencies,
        title=problem.title or f"{NAME} of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """The springs, and what was assumed."""
    springs, section = _springs(problem), problem.section.options()
    sprung = on_springs(
        problem.model(context), springs, problem.load.options(), problem.pose_m, section, problem.frequencies
    )
    grid = grid_of(sprung, section)
    lines = [f"{problem.title or NAME}: at ({listed(sprung.home)}) m, and on {grid.shape[0]} by {grid.shape[1]} points"]
    if isinstance(sprung, SprungLinks):
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
