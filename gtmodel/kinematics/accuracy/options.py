"""What an accuracy study asks for: errors of carts or links, a section, synthetic draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ...results.options import Long, Options, Unit, Within
from ..section import CrossSection
from .error_map import Method


@dataclass(frozen=True)
class LinkErrors(Options):
    """Errors of the three links: of their lengths, or of their cart joints' positions, in ellipsoids; some may be 0.

    >>> gt.kinematics.accuracy.LinkErrors("assembly", length=[1e-4, 1e-4])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: length: expected 3 numbers; found 2
    """

    name: Annotated[str, "name of the case"]
    length: Annotated[
        list[float] | None, Unit("m", written="um"), Within(least=0.0), Long(3), "greatest error of each link length"
    ] = None  # fmt: skip
    along: Annotated[
        list[float] | None, Unit("m", written="um"), Within(least=0.0), Long(3),
        "half-axis of each cart joint's ellipsoid along its guideway",
    ] = None  # fmt: skip
    across: Annotated[
        list[float] | None, Unit("m", written="um"), Within(least=0.0), Long(3),
        "half-axes of the ellipsoids across the guideways",
    ] = None  # fmt: skip
    method: Annotated[Method | None, "method of this case; that of the study if left out"] = None


@dataclass(frozen=True)
class ErrorSection(CrossSection):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x.

    >>> gt.kinematics.accuracy.ErrorSection(step=0.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: step: must be more than 0; found 0
    """

    step: Annotated[float, Unit("m"), Within(above=0.0), "step of the grid"] = 0.05
    low: Annotated[list[float] | None, Unit("m"), Long(2), "least (u, v); of the guideways if left out"] = None


@dataclass(frozen=True)
class MonteCarloDraws(Options):
    """Synthetic draws of the errors, beside their corners.

    >>> gt.kinematics.accuracy.MonteCarloDraws(samples=50)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: samples: must be at least 100 and at most 1e+06; found 50
    """

    samples: Annotated[int, Within(least=100, most=1000000), "draws for each case"] = 20000
    seed: Annotated[int, Within(least=0), "seed of the random numbers"] = 1
