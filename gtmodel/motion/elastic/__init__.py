"""Motions of a robot with an elastic tool, modelled as a mass on a spring.

elastic_study        residual vibration after rigid, shaped and elastic plans: `ElasticStudy`
ElasticTool, ElasticCost, ElasticMesh, ElasticSolver   its options

RigidMotion, ElasticMotion   the optimisations
ElasticTask, plans_on        the planning task, and the plans on one mesh
PlateMotion, swing           a motion of the plate, and the vibration of the tool
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
