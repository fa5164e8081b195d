"""The table that people see of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...results import Row

WORST_ROWS = 5
SHOWN_WEAK = 3
WEAK = "determined no better than"  # of a combination, in words


def rows_of(values: Mapping[str, Any]) -> list[Row]:
    """The table that people see."""
    rows = []
    for u in values["unknowns"]:
        rows.append(Row(u["name"], u["value"], u["unit"]))
        if u["interval_95"] is not None:
            low, high = u["interval_95"]
            rows.append(Row("  95 %", f"{low:.7g} to {high:.7g}"))
        elif u["std"] is None:
            rows.append(Row("  95 %", "not determined by these poses"))
        else:
            rows.append(Row("  std, were residuals noise", u["std"], u["unit"]))
    if values["recordings"] is None:
        rows += [Row(f"mean length error of {n}", v, "mm") for n, v in values["link_errors_mm"].items()]
    for recording in values["recordings"] or ():
        rows += _of_recording(recording)
    headline = (("a_priori_mm", "before"), ("fitted_mm", "fitted poses"), ("held_out_mm", "held-out poses"))
    for key, said in headline if values["recordings"] is None else ():
        if values[key]:
            rows.append(Row(f"positioning error, {said}: mean", values[key]["mean"], "mm"))
            rows.append(Row("  greatest", values[key]["max"], "mm"))
    if values["worst"]:
        w = values["worst"]
        at = ", ".join(f"{x:.3f}" for x in w["position_m"])
        rows.append(Row("worst place", f"({at}) m, line {w['line']}: {w['error_mm']:.3g} mm"))
    if values["principal"]:
        for size, d in zip(values["principal"]["rms_mm"], values["principal"]["directions"], strict=True):
            rows.append(Row(f"rms along ({', '.join(f'{x:.2f}' for x in d)})", size, "mm"))
    if values["repeatability_mm"] is not None:
        rows.append(Row("repeatability, rms", values["repeatability_mm"], "mm"))
    if values["identifiability_after"]:
        sentences = values["identifiability_after"]["notes"]
        rows += [Row("identifiability", s) for s in sentences if WEAK not in s]
        weak = sum(WEAK in s for s in sentences)
        if values["recordings"] is not None and weak <= SHOWN_WEAK:
            rows += [Row("identifiability", s) for s in sentences if WEAK in s]
        elif weak:
            rows.append(Row("identifiability", f"{weak} combinations are {WEAK} they were known; see result.json"))
    rows += [
        Row("outlier", f"line {o['line']}, {o['link']}: {o['residual_mm']:.3g} mm, {o['times']:.1f} deviations")
        for o in values["outliers"][:WORST_ROWS]
    ]
    noted = values.get("notes", ())  # they have rows of their own
    rows += [Row("verdict", s) for s in values["verdict"] if s not in noted]
    if values["synthetic"]:
        rows.append(Row("synthetic", values["synthetic"].partition(";")[0]))
    return rows


def _of_recording(recording: Mapping[str, Any]) -> list[Row]:
    """Errors of what some measurements measured."""
    rows = []
    for name, e in recording["errors"].items():
        for key, said in (("a_priori", "before"), ("fitted", "fitted"), ("held_out", "held out")):
            if e[key] is not None:
                rows.append(Row(f"{recording['name']}, {name}, {said}: rms", e[key]["rms"], e["unit"]))
                rows.append(Row("  greatest", e[key]["max"], e["unit"]))
    return rows
