"""Milling with a compliant robot: forces, deflection, chatter, choice of pose. Independent of the robot; SI units, rad.

study                                         where to mill, from both indices over the angle -> MillingStudy
MillingTool, MillingSearch, Modal, PathOffset options of the study besides cutter and cut
Cutter, CuttingCoefficients, Cut              tool, material and engagement
forces, integrated_forces, force_spectrum     mechanistic forces: summed over discs, closed form, Fourier coefficients
mean_forces                                   forces averaged over a sample, closed form
peak_force, to_world, smooth_force_function   largest force, world coordinates, a smooth CasADi function
Oscillators, missing_z, AngleTable            m, c, k of poses, also over the redundant angle
responses, steady_state, deflections          exact discretisation, exact periodic state, indices of poses (19)
static_index                                  |K^-1 F_peak| (18)
angle_sweep, AngleSweep, tool_rotations       angles at which an arm can hold the tool, all branches
refine, Start                                 the best angle near a grid point, by nonlinear programming
guideline, Findings, nearest_mode, frequency_sensitivity   recommendations in sentences
mode_coupling, critical_depth                 chatter without regeneration
stability_lobes, spectral_radius, stable_depth, proven_depth, certain_depth   regenerative chatter
CorrectedCut, CorrectedTool, chatter_radius, corrected_depth   chatter with a delayed tool correction
compensate, tool_error                        path offset against the deflection
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .angle_search import (
        Findings as Findings,
        NearMode as NearMode,
        choices as choices,
        frequency_sensitivity as frequency_sensitivity,
        guideline as guideline,
        nearest_mode as nearest_mode,
    )
    from .chatter import (
        Lobes as Lobes,
        ModeCoupling as ModeCoupling,
        critical_depth as critical_depth,
        mode_coupling as mode_coupling,
        stability_lobes as stability_lobes,
    )
    from .compensation import (
        Compensation as Compensation,
        compensate as compensate,
        path_offset as path_offset,
        tool_error as tool_error,
    )
    from .corrected_cut import (
        ChatterRadius as ChatterRadius,
        CorrectedCut as CorrectedCut,
        CorrectedTool as CorrectedTool,
        chatter_radius as chatter_radius,
        corrected_depth as corrected_depth,
    )
    from .cutter import (
        Cut as Cut,
        Cutter as Cutter,
        CuttingCoefficients as CuttingCoefficients,
        immersion as immersion,
        tooth_frequency as tooth_frequency,
    )
    from .deflection import (
        Deflection as Deflection,
        cutting_force as cutting_force,
        deflections as deflections,
        responses as responses,
        static_index as static_index,
        steady_state as steady_state,
    )
    from .forces import (
        at_angles as at_angles,
        force_spectrum as force_spectrum,
        forces as forces,
        integrated_forces as integrated_forces,
        mean_directional_matrix as mean_directional_matrix,
        mean_forces as mean_forces,
        peak_force as peak_force,
        to_world as to_world,
    )
    from .milling_study import study as study
    from .options import (
        MillingSearch as MillingSearch,
        MillingStudy as MillingStudy,
        MillingTool as MillingTool,
        Modal as Modal,
        PathOffset as PathOffset,
    )
    from .oscillators import Oscillators as Oscillators, missing_z as missing_z
    from .pose_dynamics import (
        ANGLES as ANGLES,
        AngleSweep as AngleSweep,
        AngleTable as AngleTable,
        angle_sweep as angle_sweep,
        tool_rotations as tool_rotations,
    )
    from .smooth_forces import smooth_force_function as smooth_force_function
    from .stability import (
        certain_depth as certain_depth,
        proven_depth as proven_depth,
        spectral_radius as spectral_radius,
        stable_depth as stable_depth,
    )
    from .task import Refined as Refined, Start as Start, refine as refine

public(__name__)
