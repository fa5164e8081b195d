"""Kind "lead_through": hand guiding of a tool with two force sensors, against a synthetic contact."""

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
    """Hand guiding of a tool with force sensors at handle and tool, against a synthetic [surface] or [hole]."""

    surface: Made[SyntheticSurface] | None = Field(default=None, description="surface that the tool follows")
    hole: Made[SyntheticHole] | None = Field(default=None, description="hole for a peg")
    phases: list[Made[GuidePhase]] = Field(min_length=1, description="actions of the hand, in order")
    gains: Made[SurfaceGains] = Made[SurfaceGains].left_out()
    turning: Made[TurningGains] = Made[TurningGains].left_out()
    watch: Made[OscillationWatch] = Made[OscillationWatch].left_out()
    stiffness: Made[StiffnessRange] | None = Field(
        default=None, description="range of contact stiffness that determines the gain of the force control"
    )
    servo: Made[ServoChain] = Made[ServoChain].left_out()
    handle: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()
    tool: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()
    hand: Made[Hand] | None = Field(default=None, description="impedance of the hand in the run; no hand if left out")
    hands: Made[HandRange] | None = Field(
        default=None, description="range of hand impedances for which the loop must be stable"
    )
    setup: Made[GuideSetup] = Made[GuideSetup].left_out()
    cones: Made[ConeComparison] | None = Field(
        default=None, description="compare widths of the cone of (8.10), with and without a filter"
    )


ARGUMENTS = {"contact": "surface"}
TABLES = ("surface", "hole", "phases", "gains", "turning", "watch", "stiffness", "servo", "handle", "tool", "hand",
          "hands", "setup", "cones")  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the surface or the hole in the file."""
    if context.start is not None:
        raise InputError("--start: this kind does not use an earlier result; leave it out")
    options = options_of(problem, *TABLES)
    surface, hole = options.pop("surface"), options.pop("hole")
    if (surface is None) == (hole is None):
        present = "both" if surface is not None else "neither"
        raise InputError(f"expected one of [surface] and [hole]; found {present}", "surface")
    if problem.stiffness is not None and "force_gain_m_s_N" in problem.gains.model_fields_set:
        raise InputError("follows from [stiffness]; leave one of the two out", "gains.force_gain_m_s_N")
    phases, gains, turning = (options.pop(name) for name in ("phases", "gains", "turning"))
    return Call(
        lead_through.study, surface if hole is None else hole, phases, gains, turning, title=problem.title, **options
    )


def explain(problem: Schema, context: Context) -> str:
    """Describe the contact, the law and the phases of the hand."""
    lines = [f"{problem.heading}: lead-through, a command every {1e3 * problem.gains.options().cycle:g} ms"]
    if problem.surface is not None:
        s = problem.surface.options()
        lines.append(f"  a surface of {s.stiffness:g} N/m, synthetic")
    if problem.hole is not None:
        h = problem.hole.options()
        lines.append(f"  a hole with {1e3 * h.clearance:g} mm of clearance, contacts of {h.stiffness:g} N/m, synthetic")
    seconds = sum(phase.options().duration for phase in problem.phases)
    lines.append(f"  {len(problem.phases)} phases of the hand, {seconds:g} s in total")
    if problem.stiffness is not None:
        r = problem.stiffness.options()
        lines.append(f"  gain for contacts of {r.softest:g} to {r.stiffest:g} N/m: {r.share:g} times the limit")
    return "\n".join(lines)
