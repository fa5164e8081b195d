"""Lead-through with two force sensors, at handle and tool (Dressler 2012, chapter 8). Robot-independent; SI units, rad.

Wrenches
    calibrate_wrench -> WrenchCalibration   bias, mass and centre of a sensor's load from poses; contact wrenches
    read_wrenches, WrenchForm               readings from files, with orientations in the same or another file
    lever_arm -> LeverArm                   point of application of forces; moment_about another point
    sign_test -> SignTest                   whether the sensor reports the force on the tool, tested before any motion
    WrenchStatus                            why a wrench cannot be used

Surface
    SurfaceLaw, SurfaceGains, SurfaceState  guiding along a surface with force control along its normal, per cycle
    OscillationWatch                        reduces the gain if the contact oscillates
    guide -> GuidedRun                      simulation against a SyntheticSurface, with a ServoChain
    force_loop                              the force loop as a delayed loop: limits from eigenvalues, margins

Six degrees of freedom
    MountedSensor                           frame, bias, load and lever arm of a sensor: readings to wrenches
    LeadThroughLaw, LeadThroughState        from the readings of both sensors to a twist: surface, or peg in a hole
    TurningLaw, TurningGains, TurningState  the rotation: guided by the handle, aligned by the tool's torque
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .calibration import WrenchCalibration as WrenchCalibration, calibrate_wrench as calibrate_wrench
    from .gains import (
        GuidePhase as GuidePhase,
        Hand as Hand,
        OscillationWatch as OscillationWatch,
        SurfaceGains as SurfaceGains,
        TurningGains as TurningGains,
        TurningLaw as TurningLaw,
        TurningState as TurningState,
    )
    from .hand_range import (
        HandStability as HandStability,
        hand_matrix as hand_matrix,
        hand_stability as hand_stability,
    )
    from .judgement import PassivityBook as PassivityBook, passivity_book as passivity_book
    from .law import (
        LeadThroughLaw as LeadThroughLaw,
        LeadThroughState as LeadThroughState,
        SurfaceLaw as SurfaceLaw,
        SurfaceState as SurfaceState,
    )
    from .limits import (
        GuidedRun as GuidedRun,
        cone_deviations as cone_deviations,
        guide as guide,
        simulated_limit as simulated_limit,
    )
    from .options import (
        ConeComparison as ConeComparison,
        Drift as Drift,
        GuideSetup as GuideSetup,
        HandRange as HandRange,
        LeadThroughStudy as LeadThroughStudy,
        ServoChain as ServoChain,
        StiffnessRange as StiffnessRange,
        SyntheticReadings as SyntheticReadings,
        WrenchStudy as WrenchStudy,
    )
    from .reading import WrenchForm as WrenchForm, read_wrenches as read_wrenches
    from .scenes import (
        Contact as Contact,
        SyntheticHole as SyntheticHole,
        SyntheticSensor as SyntheticSensor,
        SyntheticSurface as SyntheticSurface,
    )
    from .sensor import MountedSensor as MountedSensor, SignTest as SignTest, sign_test as sign_test
    from .study import study as study
    from .tool_run import ToolRun as ToolRun, force_loop as force_loop, guide_tool as guide_tool
    from .wrench import WrenchStatus as WrenchStatus, moment_about as moment_about
    from .wrench_study import LeverArm as LeverArm, lever_arm as lever_arm, wrench_study as wrench_study

public(__name__)
