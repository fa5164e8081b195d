"""The result of an optimisation study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from .._lazy import hint
from ..results import Quantity, Row, Study

if TYPE_CHECKING:
    from .solution import Solution
else:
    Solution = hint("gtmodel.optimize.solution", "Solution")

TRIED = ("defect", "violation_between_nodes", "cost_error")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class OptimizationStudy(Study):
    """Result of an optimal control study. solution: from `solve`. where: file and line the message refers to."""

    solution: Solution
    final_time: Annotated[float, Quantity("s", "end of the horizon")]
    where: Annotated[
        str | None,
        Quantity("", "file and line the message refers to; null if the problem was solved without reservation"),
    ] = None
    free: Annotated[
        Mapping[str, float],
        Quantity("", "every optimised constant in SI units, by its name in the class"),
    ] = field(default_factory=dict)
    defect: Annotated[
        float | None,
        Quantity("", "largest difference of re-simulated and collocated states at an element edge, in nominals"),
    ] = None
    violation_between_nodes: Annotated[
        float | None,
        Quantity(
            "", "largest excess over a bound or path constraint at any instant, in the unit of its row `violated`"
        ),
    ] = None  # fmt: skip
    cost_error: Annotated[
        float | None, Quantity("", "re-simulated minus collocated integral cost, in the unit of the objective")
    ] = None
    violated: Annotated[str | None, Quantity("", "variable or constraint of violation_between_nodes")] = None
    violated_at: Annotated[float | None, Quantity("s", "instant of violation_between_nodes")] = None
    violation_unit: Annotated[str | None, Quantity("", "unit of violation_between_nodes; null if unknown")] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("objective", self.objective), Row("final time", self.final_time, "s")]
        rows += [Row(name, value) for name, value in self.free.items() if name != "final_time"]
        units = {"defect": "nominal", "violation_between_nodes": self.violation_unit or ""}
        resimulated = ((name, getattr(self, name)) for name in TRIED)
        rows += [Row(n.replace("_", " "), value, units.get(n, "")) for n, value in resimulated if value is not None]
        return rows + ([Row("violated", f"{self.violated} at {self.violated_at:.4g} s")] if self.violated else [])
