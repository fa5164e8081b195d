"""Optimal motions of a robot's tool centre point: limits, obstacles, paths, search, and references for a controller.

study           the optimal motion between two poses, free or along a path: `MotionStudy`
End, Limits, JointCone, Obstacle, Cost, MotionMesh, Starts, Solver, Export   options of a motion
Line, Polyline, Arc, Spline, Taught   paths to follow; read_points reads them from a file
axis_study      the optimal motion of a robot with three carts and three rotary axes: `AxisStudy`; AxisEnd, AxisLimits,
                ToolDirection, ToolCourse, AxisCost, AxisMesh, AxisSolver; the rest in `gtmodel.motion.axes`
arm_study       the optimal motion of a serial arm through waypoints, with distances of its links kept: `ArmStudy`;
                ArmPose, Waypoint, ArmLimits
table_study     several motions compared with published numbers: `MotionTable`; a `TableRow` per `MotionProblem`
elastic_study   vibration of an elastic tool after rigid, shaped and elastic plans: `ElasticStudy`; its options are in
                `gtmodel.motion.elastic`
motion          the motion of a `MotionProblem` as an Optimization
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from . import arms as arms, axes as axes, elastic as elastic
    from .arms import (
        ArmLimits as ArmLimits,
        ArmPose as ArmPose,
        ArmStudy as ArmStudy,
        Waypoint as Waypoint,
        arm_study as arm_study,
    )
    from .axes import (
        AxisCost as AxisCost,
        AxisEnd as AxisEnd,
        AxisMesh as AxisMesh,
        AxisSolver as AxisSolver,
        AxisStudy as AxisStudy,
        ToolCourse as ToolCourse,
        ToolDirection as ToolDirection,
        axis_study as axis_study,
    )
    from .elastic import ElasticStudy as ElasticStudy, elastic_study as elastic_study
    from .motion_study import study as study, table_study as table_study
    from .options import (
        Arc as Arc,
        AxisLimits as AxisLimits,
        Cost as Cost,
        End as End,
        Export as Export,
        JointCone as JointCone,
        Limits as Limits,
        Line as Line,
        MotionMesh as MotionMesh,
        MotionProblem as MotionProblem,
        Obstacle as Obstacle,
        Polyline as Polyline,
        Shape as Shape,
        Solver as Solver,
        Spline as Spline,
        Starts as Starts,
        Taught as Taught,
    )
    from .paths import read_points as read_points
    from .results import (
        MotionStudy as MotionStudy,
        MotionTable as MotionTable,
        Published as Published,
        TableRow as TableRow,
    )
    from .task import motion as motion

public(__name__)
