"""Motions of a robot whose tool swings on a spring.

elastic_study        plans with the tool rigid, shaped, and elastic, and what each leaves: `ElasticStudy`
Tool, Cost, Mesh, Solver   what it is asked for

RigidMotion, ElasticMotion   the optimisations
ElasticTask, plans_on        what is planned, and the plans on one mesh
PlateMotion, swing           a motion of the plate, and how the tool swings after it
"""

from .models import ElasticMotion, RigidMotion
from .options import Cost, Mesh, Solver, Tool
from .plans import ElasticTask, NoPlan, Plans, plans_on
from .plate_motion import PlateMotion, swing
from .swing_study import ElasticStudy, elastic_study

__all__ = [
    "Cost", "ElasticMotion", "ElasticStudy", "ElasticTask", "Mesh", "NoPlan", "Plans", "PlateMotion", "RigidMotion",
    "Solver", "Tool", "elastic_study", "plans_on", "swing",
]  # fmt: skip
