"""What an excitation study gives: the motion found, and how much more informative it is than random ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ...results import Row, Study

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExcitationStudy(Study):
    """The motion found beside random ones; all None where it was stopped before the first of these was drawn."""

    condition: Annotated[
        float | None,
        "condition number of the regressor along the optimised motion, columns scaled by nominal values",
    ] = None
    random_condition: Annotated[Mapping[str, float] | None, "of the random motions: best, median"] = None
    improvement: Annotated[
        float | None, "best random condition number over the optimised one"
    ] = None  # fmt: skip
    criterion: Annotated[str | None, "what was optimised"] = None
    parameters: Annotated[
        Sequence[Mapping[str, Any]] | None,
        "for each: name, nominal, unit, deviation (predicted standard deviation in an experiment), "
        "random_deviation (along the best random motion), ratio of the two; and, with monte_carlo, seen_deviation, "
        "random_seen_deviation and hits of its 95 % interval along the optimised motion",
    ] = None
    coverage: Annotated[
        Mapping[str, Any] | None,
        "with monte_carlo: runs, band of hits, pooled share of 95 % intervals that hold the truth; or null",
    ] = None
    singular_values: Annotated[
        Mapping[str, Array] | None,
        "of the scaled regressor per root of samples, largest first: optimised and random",
    ] = None
    limits: Annotated[
        Mapping[str, float] | None,
        "by key: the least margin on the fine grid, relative to the bound, or in m for places",
    ] = None
    coefficients: Annotated[
        Mapping[str, Array] | None,
        "of the optimised motion: place_m, cosine_m and sine_m (harmonics, 3); of a spline controls_m",
    ] = None
    unknowns: Annotated[Array | None, "what --start takes"] = None
    draws: Annotated[int | None, "number of random motions"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.random_condition is None or self.parameters is None:
            return []
        rows = [
            Row("condition number, optimised", self.condition),
            Row(f"best of {self.draws} random motions", self.random_condition["best"]),
            Row("their median", self.random_condition["median"]),
            Row("best random over optimised", self.improvement),
        ]
        for p in self.parameters:
            text = f"{p['deviation']:.3g}, random {p['random_deviation']:.3g}"
            rows.append(Row(f"{p['name']} = {p['nominal']:g}, deviation", text, p["unit"]))
        rows += [Row(f"least margin of {key}", margin) for key, margin in (self.limits or {}).items()]
        if self.coverage is not None:
            low, high = self.coverage["band"]
            hits = [p["hits"] for p in self.parameters]
            label = f"hits of {self.coverage['runs']} synthetic fits, {low} to {high} expected"
            rows.append(Row(label, f"{min(hits)} to {max(hits)}"))
            rows.append(Row("pooled coverage of 95 % intervals", self.coverage["pooled"]))
        return rows
