"""Feedback with delay: how far corrections from an external sensor may be turned up. Knows no robot; SI units and rad.

Loop
    CorrectedPlant, equivalent_plant, rigid_plant, linear_plant, side_by_side   what a correction acts on
    DelayedLoop                      plant, exact delay and law from sample to sample, as a companion matrix
    gain_limit -> GainLimit          the first gain that is unstable, and ranges that are stable again
    run_along -> DelayedRun          in time along a path that steers, SinePath, with noise
    loop_margins -> LoopMargins      in gain, phase, delay and as a disk; delay_margin, disk_margin alone

What is uncertain
    worst_case -> WorstCase          the least limit over a box of parameters; recommended_gain of many limits
    off_axis_plant, off_axis_limits  along a direction between two axes; plant_of_limit, limits_that_meet
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .limit import GainLimit as GainLimit, gain_limit as gain_limit
    from .loop import DelayedLoop as DelayedLoop
    from .margins import (
        LoopMargins as LoopMargins,
        delay_margin as delay_margin,
        disk_margin as disk_margin,
        loop_margins as loop_margins,
    )
    from .off_axis import (
        limits_that_meet as limits_that_meet,
        off_axis_limits as off_axis_limits,
        off_axis_plant as off_axis_plant,
        plant_of_limit as plant_of_limit,
    )
    from .plants import (
        CorrectedPlant as CorrectedPlant,
        equivalent_plant as equivalent_plant,
        linear_plant as linear_plant,
        rigid_plant as rigid_plant,
        side_by_side as side_by_side,
    )
    from .run import DelayedRun as DelayedRun, SinePath as SinePath, run_along as run_along
    from .worst_case import WorstCase as WorstCase, recommended_gain as recommended_gain, worst_case as worst_case

public(__name__)
