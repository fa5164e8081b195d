"""Motions of a robot's tool centre point: limits, obstacles, paths, search, and the reference of a controller.

study           the optimal motion between two poses, free or along a path: `MotionStudy`
End, Limits, JointCone, Obstacle, Cost, Mesh, Starts, Solver, Export   what a motion is asked to be
Line, Polyline, Arc, Spline, Taught   paths to follow; read_points, of a file
axis_study      the optimal motion of a robot with three carts and three rotary axes: `AxisStudy`; AxisEnd, AxisLimits,
                ToolDirection, ToolCourse, AxisCost, AxisMesh, AxisSolver; the rest in `gtmodel.motion.axes`
table_study     several motions beside published numbers: `MotionTable`; a `TableRow` for each `MotionProblem`
elastic_study   how an elastic tool swings after motions planned rigid, shaped, and elastic: `ElasticStudy`; its options
                stand in `gtmodel.motion.elastic`
motion          the motion of a `MotionProblem` as an Optimization
"""

from . import axes, elastic
from .axes import (
    AxisCost,
    AxisEnd,
    AxisMesh,
    AxisSolver,
    AxisStudy,
    ToolCourse,
    ToolDirection,
    axis_study,
)
from .elastic import ElasticStudy, elastic_study
from .motion_study import MotionStudy, study
from .motion_table import MotionTable, Published, TableRow, table_study
from .options import (
    Arc,
    AxisLimits,
    Cost,
    End,
    Export,
    JointCone,
    Limits,
    Line,
    Mesh,
    Obstacle,
    Polyline,
    Shape,
    Solver,
    Spline,
    Starts,
    Taught,
)
from .paths import read_points
from .problem import MotionProblem
from .task import motion

__all__ = [
    "Arc", "AxisCost", "AxisEnd", "AxisLimits", "AxisMesh", "AxisSolver", "AxisStudy", "Cost", "ElasticStudy", "End",
    "Export", "JointCone", "Limits", "Line", "Mesh", "MotionProblem", "MotionStudy", "MotionTable", "Obstacle",
    "Polyline", "Published", "Shape", "Solver", "Spline", "Starts", "TableRow", "Taught", "ToolCourse",
    "ToolDirection", "axes", "axis_study", "elastic", "elastic_study", "motion", "read_points", "study", "table_study",
]  # fmt: skip
