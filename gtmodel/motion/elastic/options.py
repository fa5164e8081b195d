"""What an elastic study is asked for besides the robot and its two places: the tool, the cost, the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results import Options, Unit, Within
from ..options import Barrier, MostElements

MOST_ELEMENTS = 1000
GRAVITY = 9.81


@dataclass(frozen=True)
class ElasticTool(Options):
    """A tool as a mass on a spring at the plate, equally stiff in all directions.

    >>> tool = gt.motion.elastic.ElasticTool(mass=5.0, frequency=6.0, damping=0.02)
    >>> round(tool.stiffness), round(1e3 * tool.sag, 1)  # [N/m], [mm]
    (7106, 6.9)
    """

    mass: Annotated[
        float, Unit("kg"), Within(above=0.0), "mass of what swings; the plans with a rigid tool carry it as payload"
    ]
    frequency: Annotated[float, Unit("Hz"), Within(above=0.0), "natural frequency with the plate held"]
    damping: Annotated[float, Within(least=0.0, below=1.0), "damping ratio"] = 0.0

    @property
    def stiffness(self) -> float:
        """Stiffness of the spring [N/m]."""
        return self.mass * (2 * np.pi * self.frequency) ** 2

    @property
    def sag(self) -> float:
        """Static deflection of the tool under its weight [m]."""
        return GRAVITY * self.mass / self.stiffness


@dataclass(frozen=True)
class ElasticCost(Options):
    """What is minimised: final time plus weighted energy.

    >>> gt.motion.elastic.ElasticCost(energy=-1.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: energy: must be at least 0; found -1
    """

    energy: Annotated[float, Within(least=0.0), "weight w of sum int (F / force_unit_N)^2"] = 0.01
    force_unit: Annotated[float, Unit("N"), Within(above=0.0), "unit of force in the energy"] = 112.90322580645162


@dataclass(frozen=True)
class ElasticMesh(Options):
    """Where the equations are collocated (Radau, three points per element).

    >>> gt.motion.elastic.ElasticMesh(elements=2000)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: elements: must be more than 0 and at most 1000; found 2000
    """

    elements: Annotated[int, Within(above=0, most=MOST_ELEMENTS), "number of elements of the horizon"] = 40
    most_elements: MostElements = 160


@dataclass(frozen=True)
class ElasticSolver(Options):
    """How the plans are searched.

    >>> gt.motion.elastic.ElasticSolver(barrier="slow")
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: barrier: expected one of auto, adaptive, monotone; found 'slow'
    """

    barrier: Barrier = "auto"
