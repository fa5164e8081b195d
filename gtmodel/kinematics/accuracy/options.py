"""Options and result of the accuracy study: errors of carts or links, section, synthetic draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ...results import Quantity, Row, Study, listed
from ...results.options import Long, Options, Unit, Within
from ..section import CrossSection
from .corners import Method


@dataclass(frozen=True)
class LinkErrors(Options):
    """Errors of the three links: of their lengths, or of the positions of their cart joints within ellipsoids.

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
        "half-axis of the ellipsoid of each cart joint along its guideway",
    ] = None  # fmt: skip
    across: Annotated[
        list[float] | None, Unit("m", written="um"), Within(least=0.0), Long(3),
        "half-axes of the ellipsoids across the guideways",
    ] = None  # fmt: skip
    method: Annotated[Method | None, "method of this case; default: the method of the study"] = None


@dataclass(frozen=True)
class ErrorSection(CrossSection):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x.

    >>> gt.kinematics.accuracy.ErrorSection(step=0.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: step: must be more than 0; found 0
    """

    step: Annotated[float, Unit("m"), Within(above=0.0), "step of the grid"] = 0.05
    low: Annotated[list[float] | None, Unit("m"), Long(2), "lower bounds of (u, v); default: the guideways"] = None


@dataclass(frozen=True)
class MonteCarloDraws(Options):
    """Synthetic draws of the errors, for comparison with the corners.

    >>> gt.kinematics.accuracy.MonteCarloDraws(samples=50)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: samples: must be at least 100 and at most 1e+06; found 50
    """

    samples: Annotated[int, Within(least=100, most=1000000), "draws for each case"] = 20000
    seed: Annotated[int, Within(least=0), "seed of the random numbers"] = 1


Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AccuracyStudy(Study):
    """Greatest positioning errors over a rectangle of a cross-section, and over the reachable part of the section."""

    cases: Annotated[
        Sequence[Mapping[str, Any]],
        "for each case: name, errors, method; over the rectangle min_um, max_um, their places min_at_m, max_at_m "
        "in (u, v), centre_um and nearest_guideway to the maximum (from 1); reached_min_um and reached_max_um over "
        "all reachable points; monte_carlo_um and its corner_um at the place of the maximum; and shape, the "
        "parallelepiped at the centre: link_angles_deg, pyramid_angles_deg, faces_um2, longest_diagonal_um",
    ]
    window: Annotated[
        Array, Quantity("m", "the rectangle: lower and upper bounds of (u, v)")
    ]  # fmt: skip
    guideways: Annotated[Array, Quantity("m", "intersections of the guideways with the section, (u, v)")]
    section: Annotated[Mapping[str, Any], "the section: one of its points, and its normal"]
    points: Annotated[
        Mapping[str, Any],
        "number of grid points in the rectangle, and numbers of points without an error, by reason",
    ]

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        low, high = self.window
        rows = [Row("rectangle from (u, v)", listed(low), "m"), Row("to", listed(high), "m")]
        for case in self.cases:
            name = case["name"]
            rows += [
                Row(f"{name}: corners by", case["method"]),
                Row(f"{name}: least error in the rectangle", case["min_um"], "um"),
                Row(f"{name}: greatest", case["max_um"], "um"),
                Row(f"{name}: at (u, v)", listed(case["max_at_m"]), "m"),
                Row(f"{name}: nearest guideway", case["nearest_guideway"]),
                Row(
                    f"{name}: in the centre", "out of reach" if np.isnan(case["centre_um"]) else case["centre_um"], "um"
                ),
                Row(f"{name}: over all that is reached, least", case["reached_min_um"], "um"),
                Row(f"{name}: over all that is reached, greatest", case["reached_max_um"], "um"),
                Row(f"{name}: synthetic draws at the greatest", case["monte_carlo_um"], "um"),
            ]
        return rows


def _or_out_of_reach(value: float) -> float | str:
    return "out of reach" if np.isnan(value) else value
