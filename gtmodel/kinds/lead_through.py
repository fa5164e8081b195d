"""Kind "lead_through": a tool guided by hand with two force sensors, against a synthetic contact."""

from __future__ import annotations

from pydantic import Field

from gtmodel.control import lead_through
from gtmodel.control.lead_through.gains import GuidePhase, Hand, OscillationWatch, SurfaceGains, TurningGains
from gtmodel.control.lead_through.options import ConeComparison, GuideSetup, HandRange, ServoChain, StiffnessRange
from gtmodel.control.lead_through.scenes import SyntheticHole, SyntheticSensor, SyntheticSurface
from gtmodel.problem_files.base import Call, Context, InputError, Problem
from gtmodel.problem_files.from_options import Made, options_of

RESULT = "gtmodel.control.lead_through.LeadThroughStudy"


class Schema(Problem):
    """Guiding a tool by hand with force sensors at handle and tool, against a synthetic [surface] or [hole]."""

    surface: Made[SyntheticSurface] | None = Field(default=None, description="that the tool follows")
    hole: Made[SyntheticHole] | None = Field(default=None, description="into which a peg goes")
    phases: list[Made[GuidePhase]] = Field(min_length=1, description="what the hand does, one after the other")
    gains: Made[SurfaceGains] = Made[SurfaceGains].left_out()
    turning: Made[TurningGains] = Made[TurningGains].left_out()
    watch: Made[OscillationWatch] = Made[OscillationWatch].left_out()
    stiffness: Made[StiffnessRange] | None = Field(
        default=None, description="contacts to be met, from which the gain of the force control follows"
    )
    servo: Made[ServoChain] = Made[ServoChain].left_out()
    handle: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()
    tool: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()
    hand: Made[Hand] | None = Field(default=None, description="impedance of the hand in the run; none if left out")
    hands: Made[HandRange] | None = Field(
        default=None, description="impedances over which the loop with a hand is to be stable"
    )
    setup: Made[GuideSetup] = Made[GuideSetup].left_out()
    cones: Made[ConeComparison] | None = Field(
        default=None, description="also compare widths of the cone of (8.10), with and without a filter"
    )


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
    return Call(
        lead_through.study, surface if hole is None else hole, phases, gains, turning, title=problem.title, **given
    )


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
