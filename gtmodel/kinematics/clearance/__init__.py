"""Clearance of a serial arm: the required distance between links and from obstacles, and the distances of postures."""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .distances import (
        Body as Body,
        LeastDistance as LeastDistance,
        LinkDistances as LinkDistances,
        link_distances as link_distances,
    )
    from .options import (
        BoxObstacle as BoxObstacle,
        CapsuleObstacle as CapsuleObstacle,
        Clearance as Clearance,
        LinkCapsule as LinkCapsule,
        PlaneObstacle as PlaneObstacle,
    )

public(__name__)
