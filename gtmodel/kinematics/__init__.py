"""Kinematics that a model's equations alone do not answer.

workspace_study   which tool centre points a robot reaches: a WorkspaceStudy; its options in `workspace`
causality_study   any causality on many points, and the orientation of the plate: a CausalityStudy; see `causality`
modes_study       every pose in which six links can be assembled, with certificates: a ModesStudy; see `assembly_modes`
accuracy_study    greatest positioning errors over a section, from errors of carts and links: an AccuracyStudy; what it
                  is asked for, and its parts, in `accuracy`
assembly_modes    every pose in which a platform on six legs of given lengths can be assembled
section           a plane across the guideways
workspace         which tool centre points are reached, and why not the others
mechanism         a robot on guideways as arrays: `Mechanism`
singularity       how far a pose is from a singular one, as lengths and angles
WristPartition    all branches of the inverse kinematics of a six-axis arm with a wrist centre
MotionMaps        velocity and acceleration maps of any position causality

Guideways as measured
    fit_guideway        line through cart points and what is left over: a GuidewayFit
    backlash            play of the drive from a forward and a backward run: a Backlash
    cyclic_term         sinusoid along the guideway: a CyclicTerm
    MeasurementError    measurements that cannot be evaluated

Orientation of the plate
    grid                points of a box about a tool centre point
    orientation_map     orientation at every point: an OrientationMap
    zyz                 ZYZ Euler angles of quaternions or matrices
    rotation_vector     small turns from a reference
"""

from . import accuracy, assembly_modes, causality, section, singularity, workspace
from .accuracy import AccuracyStudy, accuracy_study
from .assembly_modes import ModesStudy, modes_study
from .causality import CausalityStudy, causality_study
from .guideways import GuidewayFit, MeasurementError, fit_guideway
from .maps import MotionMaps
from .orientation import OrientationMap, grid, orientation_map
from .rotations import rotation_vector, zyz
from .transmission import Backlash, CyclicTerm, backlash, cyclic_term
from .workspace import WorkspaceStudy, workspace_study
from .wrist_partition import InverseBranches, WristPartition

__all__ = [
    "AccuracyStudy",
    "Backlash",
    "CausalityStudy",
    "CyclicTerm",
    "GuidewayFit",
    "InverseBranches",
    "MeasurementError",
    "ModesStudy",
    "MotionMaps",
    "OrientationMap",
    "WorkspaceStudy",
    "WristPartition",
    "accuracy",
    "accuracy_study",
    "assembly_modes",
    "backlash",
    "causality",
    "causality_study",
    "cyclic_term",
    "fit_guideway",
    "grid",
    "modes_study",
    "orientation_map",
    "rotation_vector",
    "section",
    "singularity",
    "workspace",
    "workspace_study",
    "zyz",
]
