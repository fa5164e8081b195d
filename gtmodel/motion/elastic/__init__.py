"""Motions of a robot whose tool swings on a spring.

elastic_study        plans with the tool rigid, shaped, and elastic, and what each leaves: `ElasticStudy`
ElasticTool, ElasticCost, ElasticMesh, ElasticSolver   what it is asked for

RigidMotion, ElasticMotion   the optimisations
ElasticTask, plans_on        what is planned, and the plans on one mesh
PlateMotion, swing           a motion of the plate, and how the tool swings after it
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .options import (
        ElasticCost as ElasticCost,
        ElasticMesh as ElasticMesh,
        ElasticSolver as ElasticSolver,
        ElasticStudy as ElasticStudy,
        ElasticTool as ElasticTool,
    )
    from .plans import (
        ElasticMotion as ElasticMotion,
        ElasticTask as ElasticTask,
        Plans as Plans,
        PlansFailure as PlansFailure,
        PlateMotion as PlateMotion,
        RigidMotion as RigidMotion,
        plans_on as plans_on,
        swing as swing,
    )
    from .swing_study import elastic_study as elastic_study

public(__name__)
