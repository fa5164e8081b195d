"""Results of a motion study, and of a table of motions compared with published numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from ..results import Quantity, Row, Study
from ..results.options import Options, Unit
from .options import MotionProblem


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MotionStudy(Study):
    """An optimal motion; if it was not solved, all values but the final time are None.

    Trajectory and files are those of the exported motion, whose motor forces keep their limit at every instant; the
    optimum itself keeps it at the collocation points only. asked: the problem with its original mesh.
    """

    asked: MotionProblem
    final_time: Annotated[
        float | None,
        Quantity("s", "final time of the collocation optimum with mesh.control; for the motion see the exported one"),
    ] = None
    energy: Annotated[
        float | None, Quantity("", "sum over motors of int (F / force_unit_N)^2 dt of the optimum [s]")
    ] = None
    saturation: Annotated[
        Sequence[float] | None, Quantity("", "share of time in which each motor is within 1 % of its limit")
    ] = None
    optima: Annotated[
        Sequence[float] | None, Quantity("", "costs of the distinct optima that the starts ended in, best first")
    ] = None
    end_error: Annotated[
        float | None, Quantity("m", "distance to the goal after re-simulating the optimum's force")
    ] = None
    peak_force_between_nodes: Annotated[
        float | None, Quantity("N", "largest force of the optimum between its collocation points")
    ] = None
    elements: Annotated[
        int | None, Quantity("", "number of mesh elements; more than requested if the mesh was refined")
    ] = None
    attempt_iterations: Annotated[
        int | None,
        Quantity("", "iterations of the attempt that ended in the optimum; `iterations` is the sum over all attempts"),
    ] = None
    path_length: Annotated[
        float | None, Quantity("m", "length of the path; null for a free motion")
    ] = None  # fmt: skip
    cross_check_time: Annotated[
        float | None,
        Quantity("s", "final time along the path with squared speeds as unknowns; null for a free motion"),
    ] = None
    exported_final_time: Annotated[
        float | None,
        Quantity("s", "final time of the exported motion, whose forces keep their limit at every instant"),
    ] = None
    exported_energy: Annotated[float | None, Quantity("", "energy of the exported motion [s]")] = None
    exported_end_error: Annotated[
        float | None, Quantity("m", "distance to the goal after re-simulating the exported force")
    ] = None
    exported_peak_force: Annotated[float | None, Quantity("N", "largest exported force at any instant")] = None
    exported_defect: Annotated[
        float | None,
        Quantity("", "largest difference between collocated and re-simulated states at an element edge [m, m/s]"),
    ] = None
    exported_link_along_guideway: Annotated[
        float | None,
        Quantity("m", "smallest component of any link along its guideway; 0 at the boundary of the workspace"),
    ] = None
    exported_margins: Annotated[
        Mapping[str, float] | None,
        Quantity("", "smallest margin to each further limit, by key: in m for positions, else relative to the limit"),
    ] = None
    exported_clearance: Annotated[
        Sequence[float] | None,
        Quantity("m", "smallest distance of tool centre point and links from each obstacle"),
    ] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people: the exported motion first, then the optimum that it comes from."""
        if self.exported_final_time is None:
            return [Row("final time", self.final_time, "s")]
        rows = [
            Row("final time", self.exported_final_time, "s"),
            Row("energy", self.exported_energy, "s"),
            Row("end error, re-simulated", _scaled(1e3, self.exported_end_error), "mm"),
            Row("largest force at any instant", self.exported_peak_force, "N"),
        ]
        rows += [Row(f"margin to {key}", x) for key, x in (self.exported_margins or {}).items()]
        rows += [Row(f"distance from obstacle {n}", 1e3 * x, "mm") for n, x in enumerate(self.exported_clearance or ())]
        rows += [
            Row("optimum: final time", self.final_time, "s"),
            Row("optimum: cost", self.objective),
            Row("optimum: energy", self.energy, "s"),
            *(
                Row(f"optimum: motor {i + 1} at its limit", 100 * x, "% of the time")
                for i, x in enumerate(self.saturation or ())
            ),
            Row("optimum: end error, re-simulated", _scaled(1e3, self.end_error), "mm"),
        ]
        if self.asked.starts.count:
            rows += [Row(f"optimum {n}: cost", cost) for n, cost in enumerate(self.optima or (), 1)]
        if self.cross_check_time is not None:
            rows.append(Row("optimum: final time by squared speeds", self.cross_check_time, "s"))
        if self.asked.mesh.control != "constant":
            rows.append(Row("optimum: largest force between nodes", self.peak_force_between_nodes, "N"))
        if self.elements != self.asked.mesh.elements:
            rows.append(Row("mesh elements after refinement", self.elements))
        return rows


def _scaled(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value


@dataclass(frozen=True)
class Published(Options):
    """Published numbers for a row of the table. They are only reported, never checked, because the source does not give
    its poses and limits.

    >>> printed = gt.motion.Published(final_time=0.89, energy=27.0, iterations=36)
    >>> ends = {"start": gt.motion.End([0.0, -0.9, 0.1]), "goal": gt.motion.End([0.9, -0.9, 0.45])}
    >>> robot, limits = gt.robots.gantry_tau("l1_tape"), gt.motion.Limits(force=700.0)
    >>> problem = gt.motion.MotionProblem(robot=robot, limits=limits, **ends)
    >>> gt.motion.TableRow("time-optimal", problem, published=printed).published.final_time
    0.89
    """

    final_time: Annotated[float, Unit("s"), "final time"]
    energy: Annotated[float, "energy in the source's unit"]
    iterations: Annotated[int, "number of iterations"]


@dataclass(frozen=True)
class TableRow:
    """One motion of a table.

    name: name of the row. problem: the motion. most_iterations: bound of the check on the iterations of the attempt
    that ended in the optimum. published: published numbers.
    """

    name: str
    problem: MotionProblem
    most_iterations: int | None = None
    published: Published | None = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MotionTable(Study):
    """A comparison of several optimal motions; `motions` are their studies up to the first that was not solved."""

    asked: Sequence[TableRow]
    motions: Sequence[MotionStudy]
    entries: Annotated[
        Sequence[Mapping[str, Any]],
        Quantity(
            "",
            "one entry per row: name, cost, iterations, final_time_s, energy, saturation, optima, exported values",
            key="rows",
        ),
    ]
    saving: Annotated[float | None, Quantity("", "time saving of the first row relative to the last")] = None
    energy_ratio: Annotated[
        float | None, Quantity("", "energy of the first row divided by that of the last")
    ] = None  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        if self.saving is None or self.energy_ratio is None:
            return []
        rows: list[Row] = []
        for row, s in zip(self.asked, self.motions, strict=True):
            p = row.published
            final_time, energy, iterations = (None,) * 3 if p is None else (p.final_time, p.energy, p.iterations)
            rows += [
                Row(f"{row.name}: final time [s]", s.final_time, _published(final_time)),
                Row(f"{row.name}: energy [s]", s.energy, _published(energy)),
                Row(f"{row.name}: iterations", s.attempt_iterations, _published(iterations)),
                Row(f"{row.name}: motors at their limit [%]", " ".join(f"{100 * x:.0f}" for x in s.saturation or ())),
            ]
            if len(s.optima or ()) > 1:
                rows.append(Row(f"{row.name}: optima", " ".join(f"{x:.6f}" for x in s.optima or ())))
        return [
            *rows,
            Row(f"time saving of {self.asked[0].name}", 100 * self.saving, f"% relative to {self.asked[-1].name}"),
            Row(f"energy ratio of {self.asked[0].name}", self.energy_ratio, f"to {self.asked[-1].name}"),
        ]


def _published(value: float | None) -> str:
    return "" if value is None else f"published {value:g}"
