"""Milling by a robot that gives way: forces, deflection, where to put the work. Knows no robot; SI units and rad.

study                                         where to mill, by both indices over the angle: `MillingStudy`
Tool, Search, Modal, PathOffset               what it is asked for besides cutter and cut
Cutter, Coefficients, Cut                     what cuts, and how
forces, integrated_forces, force_spectrum     mechanistic forces: over discs, closed form, Fourier coefficients
mean_forces                                   averaged over a sample, closed form
peak_force, to_world, smooth_force_function   their largest, their directions, a smooth CasADi function
Oscillators, missing_z, AngleTable            m, c, k of a pose, of poses over the redundant angle
responses, steady_state, deflections          exact discretisation, exact periodic state, indices over poses (19)
static_index                                  |K^-1 F_peak| (18)
angle_sweep, AngleSweep, tool_rotations       where an arm can hold the tool, all branches
refine, Start                                 the best angle near a grid point, by nonlinear programming
guideline, Findings, nearest_mode, frequency_sensitivity   the answer in words
mode_coupling, critical_depth                 chatter without regeneration
stability_lobes, spectral_radius, stable_depth, proven_depth, certain_depth   regenerative chatter
compensate, tool_error                        a path offset against the deflection
"""

from .angle_table import AngleTable
from .compensation import Compensation, compensate, tool_error
from .compensation import offset as path_offset
from .cutter import Coefficients, Cut, Cutter, immersion, tooth_frequency
from .deflection import Deflection, cutting_force, deflections, static_index
from .directional import mean_directional_matrix
from .forces import forces, integrated_forces, mean_forces, peak_force, to_world
from .guideline import Findings, NearMode, choices, frequency_sensitivity, guideline, nearest_mode
from .lobes import Lobes, stability_lobes
from .milling_result import MillingStudy
from .milling_study import study
from .mode_coupling import ModeCoupling, critical_depth, mode_coupling
from .options import Modal, PathOffset, Search, Tool
from .oscillators import Oscillators, missing_z
from .redundant_angle import ANGLES, AngleSweep, angle_sweep, tool_rotations
from .refine import Refined, Start, refine
from .response import responses, steady_state
from .smooth import smooth_force_function
from .spectrum import at_angles, force_spectrum
from .stability import certain_depth, proven_depth, spectral_radius, stable_depth

__all__ = [
    "ANGLES", "AngleSweep", "AngleTable", "Coefficients", "Compensation", "Cut", "Cutter", "Deflection", "Findings",
    "Lobes", "MillingStudy", "Modal", "ModeCoupling", "NearMode", "Oscillators", "PathOffset", "Refined", "Search",
    "Start", "Tool", "angle_sweep", "at_angles", "certain_depth", "choices", "compensate", "critical_depth",
    "cutting_force", "deflections", "force_spectrum", "forces", "frequency_sensitivity", "guideline", "immersion",
    "integrated_forces", "mean_directional_matrix", "mean_forces", "missing_z", "mode_coupling", "nearest_mode",
    "path_offset", "peak_force", "proven_depth", "refine", "responses", "smooth_force_function", "spectral_radius",
    "stability_lobes", "stable_depth", "static_index", "steady_state", "study", "to_world", "tool_error",
    "tool_rotations", "tooth_frequency",
]  # fmt: skip
