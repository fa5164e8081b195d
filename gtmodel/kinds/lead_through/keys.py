"""The keys of kind "lead_through"."""

from __future__ import annotations

from pydantic import Field

from gtmodel.control.lead_through.gains import SurfaceGains
from gtmodel.control.lead_through.hand import GuidePhase, Hand
from gtmodel.control.lead_through.options import ConeComparison, GuideSetup, HandRange, ServoChain, StiffnessRange
from gtmodel.control.lead_through.scenes import SyntheticHole, SyntheticSurface
from gtmodel.control.lead_through.synthetic_sensor import SyntheticSensor
from gtmodel.control.lead_through.turning import TurningGains
from gtmodel.control.lead_through.watch import OscillationWatch
from gtmodel.problem_files.base import Problem
from gtmodel.problem_files.from_options import Made

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
