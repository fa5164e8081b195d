"""Kinematic analyses of robots: workspace, assembly modes, accuracy, singularities, guideways.

workspace_study   reachable tool centre points of a robot: a WorkspaceStudy; options in `workspace`
causality_study   any causality at many points, and the plate's orientation: a CausalityStudy; options in `causality`
modes_study       all assembly modes of six links, with certificates: a ModesStudy; options in `assembly_modes`
accuracy_study    largest positioning errors over a section, from errors of carts and links: an AccuracyStudy; options
                  and parts in `accuracy`
assembly_modes    all assembly modes of a platform on six legs of known lengths
planar_modes      all assembly modes of a planar platform on three rods: 3-RPR, 3-RRR with its motors held
section           a plane across the guideways
workspace         reachable tool centre points, and the reason why the other points cannot be reached
mechanism         a robot on guideways as arrays: `Mechanism`
mobility          degrees of freedom, redundant constraints and idle motions of a mechanism: `model.mobility()`
singularity       distance of a pose from a singularity, as lengths and angles
postures_study    all postures of an arm for a pose, a table or a path: a PosturesStudy; poses as ToolPose, ToolPoses
postures          all postures of a serial arm for poses: named branches, limits, nearest ones; a Postures
along_path        one posture for each row of a path, without jumps where the arm allows it: a PosturePath
chain_of          joint axes of an arm's model: a Chain, the argument of `postures` and `closed_form`
ElbowAngle        redundancy of seven joints resolved by the elbow; LockedJoint: by a joint that is held
link_distances    distances of an arm's links from each other and from obstacles: a LinkDistances; declared by a
                  `Clearance` of LinkCapsule, CapsuleObstacle, BoxObstacle, PlaneObstacle
MotionMaps        velocity and acceleration maps of any position causality

Measured guideways
    fit_guideway        line fitted to cart points, with residuals: a GuidewayFit
    backlash            backlash of the drive from a forward and a backward run: a Backlash
    cyclic_term         sinusoidal error along the guideway: a CyclicTerm
    MeasurementError    raised if measurements cannot be evaluated

Orientation of the plate
    grid                points of a box about a tool centre point
    orientation_map     orientation at every point: an OrientationMap
    zyz                 ZYZ Euler angles of quaternions or matrices
    rotation_vector     rotations from a reference, as vectors
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from ..geometry.chains import (
        Chain as Chain,
        ClosedForm as ClosedForm,
        ElbowAngle as ElbowAngle,
        LockedJoint as LockedJoint,
        PostureJump as PostureJump,
        PosturePath as PosturePath,
        Postures as Postures,
        along_path as along_path,
        closed_form as closed_form,
        elbow_angle as elbow_angle,
        postures as postures,
    )
    from ..geometry.rotations import rotation_vector as rotation_vector, zyz as zyz
    from . import (
        accuracy as accuracy,
        arm_postures as arm_postures,
        assembly_modes as assembly_modes,
        causality as causality,
        clearance as clearance,
        mobility as mobility,
        section as section,
        singularity as singularity,
        workspace as workspace,
    )
    from .accuracy import AccuracyStudy as AccuracyStudy, accuracy_study as accuracy_study
    from .arm_postures import (
        PosturesStudy as PosturesStudy,
        ToolColumns as ToolColumns,
        ToolPose as ToolPose,
        ToolPoses as ToolPoses,
        postures_study as postures_study,
        read_tool_poses as read_tool_poses,
    )
    from .assembly_modes import ModesStudy as ModesStudy, modes_study as modes_study
    from .causality import CausalityStudy as CausalityStudy, causality_study as causality_study
    from .clearance import (
        BoxObstacle as BoxObstacle,
        CapsuleObstacle as CapsuleObstacle,
        Clearance as Clearance,
        LeastDistance as LeastDistance,
        LinkCapsule as LinkCapsule,
        LinkDistances as LinkDistances,
        PlaneObstacle as PlaneObstacle,
        link_distances as link_distances,
    )
    from .orientation import OrientationMap as OrientationMap, grid as grid, orientation_map as orientation_map
    from .planar_platform import planar_modes as planar_modes
    from .serial_chain import chain_of as chain_of
    from .singularity import MotionMaps as MotionMaps
    from .transmission import (
        Backlash as Backlash,
        CyclicTerm as CyclicTerm,
        GuidewayFit as GuidewayFit,
        MeasurementError as MeasurementError,
        backlash as backlash,
        cyclic_term as cyclic_term,
        fit_guideway as fit_guideway,
    )
    from .workspace import WorkspaceStudy as WorkspaceStudy, workspace_study as workspace_study

public(__name__)
