"""Options of an elastic study (tool, cost, mesh, solver) and its result."""

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
        float, Unit("kg"), Within(above=0.0), "vibrating mass; the plans with a rigid tool carry it as payload"
    ]
    frequency: Annotated[float, Unit("Hz"), Within(above=0.0), "natural frequency with the plate fixed"]
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
    """The cost: final time plus weighted energy.

    >>> gt.motion.elastic.ElasticCost(energy=-1.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: energy: must be at least 0; found -1
    """

    energy: Annotated[float, Within(least=0.0), "weight w of sum int (F / force_unit_N)^2"] = 0.01
    force_unit: Annotated[float, Unit("N"), Within(above=0.0), "reference force in the energy"] = 112.90322580645162


@dataclass(frozen=True)
class ElasticMesh(Options):
    """The collocation mesh (Radau, three points per element).

    >>> gt.motion.elastic.ElasticMesh(elements=2000)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: elements: must be more than 0 and at most 1000; found 2000
    """

    elements: Annotated[int, Within(above=0, most=MOST_ELEMENTS), "number of elements of the horizon"] = 40
    most_elements: MostElements = 160


@dataclass(frozen=True)
class ElasticSolver(Options):
    """Options of the solver.

    >>> gt.motion.elastic.ElasticSolver(barrier="slow")
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: barrier: expected one of auto, adaptive, monotone; found 'slow'
    """

    barrier: Barrier = "auto"


OFF = 0.1  # relative error of the frequency in the robustness result
FORCE_SHARE = 1e-3  # relative excess from which a motion exceeds the force limit


ASSUMED = (
    "the plate follows its motion exactly; the tool's vibration does not act back on it",
    "plans keep the force limit at every instant; shaped motions may exceed it",
    "shaped motions leave the planned path, but stay within its convex hull",
)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ElasticStudy(Study):
    """Residual vibration of an elastic tool after several motions; no values if a plan was not found.

    force: limit of the motors [N]. notes: warn of a mesh too coarse for the oscillation. refined: whether the mesh was
    refined.
    """

    motions: Annotated[
        Mapping[str, Mapping[str, float]] | None,
        Quantity(
            "",
            "for each of rigid, ZV, ZVD and elastic: final_time_s, residual_mm (amplitude of the tool relative to the "
            "plate at rest, norm over three directions), residual_10_percent_mm (the larger one for a mode 10 % "
            "slower or faster than planned), peak_force_N (from the plan; for shaped motions from inverse dynamics "
            "with a rigid tool)",
        ),
    ] = None
    frequency: Annotated[float | None, Quantity("Hz", "natural frequency of the tool with the plate fixed")] = None
    static: Annotated[float | None, Quantity("m", "static deflection of the tool", written="mm")] = None
    elements: Annotated[
        int | None, Quantity("", "number of mesh elements; more than requested if the mesh was refined")
    ] = None
    resimulated_end: Annotated[
        float | None,
        Quantity(
            "m",
            "offset of the tool from its static equilibrium after re-simulating the elastic plan's forces",
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
            Row(name, f"{t['final_time_s']:.4f} s, residual vibration {t['residual_mm']:.3g} mm, with {100 * OFF:g} % "
                f"frequency error {t['residual_10_percent_mm']:.3g} mm; peak force {t['peak_force_N']:.4g} N")
            for name, t in self.motions.items()
        ]  # fmt: skip
        rows += [
            Row("static deflection of the tool", 1e3 * self.static, "mm"),
            Row("elastic plan, re-simulated: tool offset", 1e3 * self.resimulated_end, "mm"),
        ]
        if self.refined:
            rows.append(Row("mesh elements after refinement", self.elements))
        for name, m in self.motions.items():
            over = m["peak_force_N"] / self.force - 1
            if over > FORCE_SHARE:
                advice = f"by {100 * over:.2g} %; plan with a limit of {self.force / (1 + over):.3g} N to stay near it"
                rows.append(Row(f"{name} exceeds the force limit", advice))
        return rows + [Row("assumed", sentence) for sentence in ASSUMED]
