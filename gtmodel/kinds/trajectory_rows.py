"""The table of kind "trajectory": the exported motion first, then the optimum that it comes from."""

from __future__ import annotations

from typing import Any

from gtmodel.problem_files.base import Row

from .motion_planning import Plan


def rows_of(plan: Plan, values: dict[str, Any], cost: float, finer: str) -> list[Row]:
    """What people see. The head is the motion of the files and of the trajectory, which keeps its force at every
    instant; what IPOPT found keeps it at the collocation points only.

    cost: of the optimum. finer: what is to be said of a refined mesh.
    """
    problem = plan.problem
    rows = [
        Row("final time", values["exported_final_time_s"], "s"),
        Row("energy", values["exported_energy"], "s"),
        Row("end error, re-simulated", 1e3 * values["exported_end_error_m"], "mm"),
        Row("largest force at any instant", values["exported_peak_force_N"], "N"),
    ]
    rows += [Row(f"margin to {key}", x, "") for key, x in values["exported_margins"].items()]
    rows += [Row(f"distance from obstacle {n}", 1e3 * x, "mm") for n, x in enumerate(values["exported_clearance_m"])]
    rows += [
        Row("optimum: final time", values["final_time_s"], "s"),
        Row("optimum: cost", cost, ""),
        Row("optimum: energy", values["energy"], "s"),
        *(
            Row(f"optimum: motor {i + 1} at its limit", 100 * x, "% of the time")
            for i, x in enumerate(values["saturation"])
        ),
        Row("optimum: end error, re-simulated", 1e3 * values["end_error_m"], "mm"),
    ]
    if problem.starts.count:
        rows += [Row(f"optimum {n}: cost", cost, "") for n, cost in enumerate(values["optima"], 1)]
    if values["second_road_time_s"] is not None:
        rows.append(Row("optimum: final time by squared speeds", values["second_road_time_s"], "s"))
    if problem.mesh.control != "constant":
        rows.append(Row("optimum: largest force between its points", values["peak_force_between_nodes_N"], "N"))
    if finer:
        rows.append(Row("elements of the mesh, refined", values["elements"]))
    return rows
