"""Delayed feedback from an external sensor: gain limits and margins. Independent of any robot; SI units and rad.

Loop
    CorrectedPlant, equivalent_plant, rigid_plant, linear_plant, side_by_side   plants
    servo_plant                      a robot of any model under its own law, as a plant
    DelayedLoop                      plant, exact delay and law from sample to sample, as a companion matrix
    gain_limit -> GainLimit          the first unstable gain, and ranges of gains that are stable again
    run_along -> DelayedRun          simulation along a path, SinePath, with noise
    loop_margins -> LoopMargins      gain, phase, delay and disk margins; delay_margin, disk_margin alone
    margin_limit                     the greatest gain that keeps declared margins, GainMargins

Plants from measurements
    fit_command_step -> Estimate     m, c, k from the vibration after one command; command_response
    fit_gain_field -> GainField      m, c, k over two joints; limits_over, recommended_over
Uncertain plants
    worst_case -> WorstCase          the least limit over a box of parameters; recommended_gain in steps
    off_axis_plant, off_axis_limits  along a direction between two axes; plant_of_limit, limits_that_meet
Studies
    delayed_feedback -> DelayedFeedbackStudy     all of these, with pictures: `gt.control.delayed_feedback`
    feedback_map -> FeedbackMapStudy             limits over two joints; MeasuredPlants, SyntheticCommands, GainMap
    FeedbackTiming, FeedbackAxis, FeedbackBox, GainMargins, OffAxisRun, FeedbackCut   their options
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .command_step import command_response as command_response, fit_command_step as fit_command_step
    from .limit import (
        GainLimit as GainLimit,
        WorstCase as WorstCase,
        gain_limit as gain_limit,
        recommended_gain as recommended_gain,
        worst_case as worst_case,
    )
    from .loop import DelayedLoop as DelayedLoop
    from .map_study import (
        GainField as GainField,
        MeasuredPlants as MeasuredPlants,
        feedback_map as feedback_map,
        fit_gain_field as fit_gain_field,
        limits_over as limits_over,
        recommended_over as recommended_over,
        synthetic_plants as synthetic_plants,
        true_plants as true_plants,
    )
    from .margins import (
        LoopMargins as LoopMargins,
        delay_margin as delay_margin,
        disk_margin as disk_margin,
        loop_margins as loop_margins,
        margin_limit as margin_limit,
    )
    from .off_axis import (
        limits_that_meet as limits_that_meet,
        off_axis_limits as off_axis_limits,
        off_axis_plant as off_axis_plant,
        plant_of_limit as plant_of_limit,
    )
    from .options import (
        DelayedFeedbackStudy as DelayedFeedbackStudy,
        FeedbackAxis as FeedbackAxis,
        FeedbackBox as FeedbackBox,
        FeedbackCut as FeedbackCut,
        FeedbackMapStudy as FeedbackMapStudy,
        FeedbackTiming as FeedbackTiming,
        GainMap as GainMap,
        GainMargins as GainMargins,
        OffAxisRun as OffAxisRun,
        SinePath as SinePath,
        SyntheticCommands as SyntheticCommands,
    )
    from .plants import (
        CorrectedPlant as CorrectedPlant,
        equivalent_plant as equivalent_plant,
        linear_plant as linear_plant,
        rigid_plant as rigid_plant,
        side_by_side as side_by_side,
    )
    from .run import DelayedRun as DelayedRun, run_along as run_along
    from .servo import servo_plant as servo_plant
    from .study import delayed_feedback as delayed_feedback

public(__name__)
