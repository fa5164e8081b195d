"""Kind "lead_through": a tool guided by hand with two force sensors, against a synthetic contact."""

from __future__ import annotations

from gtmodel.control.lead_through import study
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of

from .keys import Schema

NAME = "lead_through"
ARGUMENTS = {"contact": "surface"}
TABLES = ("surface", "hole", "phases", "gains", "turning", "watch", "stiffness", "servo", "handle", "tool", "hand",
          "hands", "setup", "cones")  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """The study of the surface or the hole that the file declares."""
    if context.start is not None:
        raise InputError("--start: nothing is solved from a start here; leave it out")
    given = options_of(problem, *TABLES)
    surface, hole = given.pop("surface"), given.pop("hole")
    if (surface is None) == (hole is None):
        both = "both" if surface is not None else "none of them"
        raise InputError(f"expected one of [surface] and [hole]; found {both}", "surface")
    if problem.stiffness is not None and "force_gain_m_s_N" in problem.gains.model_fields_set:
        raise InputError("follows from [stiffness]; leave one of both out", "gains.force_gain_m_s_N")
    phases, gains, turning = (given.pop(name) for name in ("phases", "gains", "turning"))
    return Call(study, surface if hole is None else hole, phases, gains, turning, title=problem.title, **given)


def explain(problem: Schema, context: Context) -> str:
    """What is touched, by which law, and what the hand does."""
    lines = [f"{problem.title or NAME}: lead-through, a command every {1e3 * problem.gains.options().cycle:g} ms"]
    if problem.surface is not None:
        s = problem.surface.options()
        lines.append(f"  a surface of {s.stiffness:g} N/m, synthetic")
    if problem.hole is not None:
        h = problem.hole.options()
        lines.append(f"  a hole with {1e3 * h.clearance:g} mm of clearance, contacts of {h.stiffness:g} N/m, synthetic")
    seconds = sum(phase.options().duration for phase in problem.phases)
    lines.append(f"  {len(problem.phases)} phases of the hand, {seconds:g} s together")
    if problem.stiffness is not None:
        r = problem.stiffness.options()
        lines.append(f"  gain for contacts of {r.softest:g} to {r.stiffest:g} N/m, {r.share:g} of the limit")
    return "\n".join(lines)
