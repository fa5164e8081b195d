"""What an elastic study is asked for besides the robot and its two places, the tool, the cost and the mesh, and what
it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results import Options, Quantity, Row, Study, Unit, Within
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


OFF = 0.1  # error of the frequency that is reported
FORCE_SHARE = 1e-3  # of the limit: beyond, a motion passes it


ASSUMED = (
    "the plate follows its motion exactly: the tool's swing does not push it back",
    "plans keep the force limit at every instant; shaped motions need what the table says",
    "shaped motions leave the planned path, within its convex hull",
)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ElasticStudy(Study):
    """How an elastic tool swings after each of several motions; where a plan was not found there are no values.

    force: limit of the motors [N]. notes: where a mesh is too coarse for the oscillation. refined: whether the mesh is
    finer than the given one.
    """

    motions: Annotated[
        Mapping[str, Mapping[str, float]] | None,
        Quantity(
            "",
            "for each of rigid, ZV, ZVD and elastic: final_time_s, residual_mm (amplitude of the tool against the "
            "plate once that stands, root of the sum of squares of three directions), residual_10_percent_mm (the "
            "worst of a mode 10 % slower and faster than planned), peak_force_N: of the plans their own, of shaped "
            "ones what the robot with a rigid tool needs",
        ),
    ] = None
    frequency: Annotated[float | None, Quantity("Hz", "of the tool on its spring, the plate held")] = None
    static: Annotated[float | None, Quantity("m", "by which the tool hangs", written="mm")] = None
    elements: Annotated[
        int | None, Quantity("", "elements of the mesh: those of the file, or more where a check failed on them")
    ] = None
    resimulated_end: Annotated[
        float | None,
        Quantity(
            "m",
            "offset of the tool from where it hangs after an integrator ran the elastic plan's forces",
            written="mm",
        ),
    ] = None
    force: float = np.inf
    refined: bool = False

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.motions is None or self.static is None or self.resimulated_end is None:
            return []
        rows = [
            Row(name, f"{t['final_time_s']:.4f} s, swings {t['residual_mm']:.3g} mm; {100 * OFF:g} % off "
                f"{t['residual_10_percent_mm']:.3g} mm; largest force {t['peak_force_N']:.4g} N")
            for name, t in self.motions.items()
        ]  # fmt: skip
        rows += [
            Row("the tool hangs by", 1e3 * self.static, "mm"),
            Row("elastic plan, re-simulated: tool off", 1e3 * self.resimulated_end, "mm"),
        ]
        if self.refined:
            rows.append(Row("elements of the mesh, refined", self.elements))
        for name, m in self.motions.items():
            over = m["peak_force_N"] / self.force - 1
            if over > FORCE_SHARE:
                said = f"by {100 * over:.2g} %: plan with a limit of {self.force / (1 + over):.3g} N to stay near it"
                rows.append(Row(f"{name} passes the force limit", said))
        return rows + [Row("assumed", sentence) for sentence in ASSUMED]
