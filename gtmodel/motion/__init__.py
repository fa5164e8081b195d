"""Motions of a robot's tool centre point: limits, obstacles, paths, search, and the reference of a controller.

End, Limits, JointCone, Obstacle, Cost, Mesh, Starts, Solver, Export   what a motion is asked to be
Line, Polyline, Arc, Spline, Taught   paths to follow; read_points, of a file
motion, MotionTask   the motion as an Optimization
axis_study      the optimal motion of a robot with three carts and three rotary axes: `AxisStudy`; AxisEnd, AxisLimits,
                ToolDirection, ToolCourse, AxisCost, AxisMesh, AxisSolver; the rest in `gtmodel.motion.axes`
elastic_study   how an elastic tool swings after motions planned rigid, shaped, and elastic: `ElasticStudy`; its options
                stand in `gtmodel.motion.elastic`
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
from .task import MotionTask, motion

__all__ = [
    "Arc", "AxisCost", "AxisEnd", "AxisLimits", "AxisMesh", "AxisSolver", "AxisStudy", "Cost", "ElasticStudy", "End",
    "Export", "JointCone", "Limits", "Line", "Mesh", "MotionTask", "Obstacle", "Polyline", "Shape", "Solver", "Spline",
    "Starts", "Taught", "ToolCourse", "ToolDirection", "axes", "axis_study", "elastic", "elastic_study", "motion",
    "read_points",
]  # fmt: skip
