"""Sections of a calibration's report: accuracy, parameters, identifiability, outliers, sensitivity, joint stiffness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...results.page.page import PageTable, Part, Sections


def sections_of(values: Mapping[str, Any]) -> Sections:
    """Return the sections for the values of a calibration."""
    measurement, links = list((values["measurement"] or {}).items()), values["recordings"] is None
    return {
        "Accuracy": _accuracy(values),
        "Parameters": [_parameters(values), PageTable(("measurement", "value"), measurement)],
        "Links": [PageTable(("link or coordinate", "mean error [mm]"), list(values["link_errors_mm"].items()))]
        if links else [],
        "Identifiability": _identifiability(values),
        "Outliers": [_outliers(values["outliers"])] if values["outliers"] else ["None."],
        "Sensitivity": _sensitivity(values),
    }  # fmt: skip


def _accuracy(values: Mapping[str, Any]) -> list[Part]:
    labels = (("a_priori_mm", "before"), ("fitted_mm", "fitted poses"), ("held_out_mm", "held-out poses"))
    rows = [(label, *(values[key][n] for n in ("mean", "rms", "max"))) for key, label in labels if values[key]]
    parts: list[Part] = [PageTable(("positioning error", "mean [mm]", "rms [mm]", "max [mm]"), rows)]
    parts.append(_recordings(values["recordings"] or ()))
    if values["orientation_deg"]:
        o = values["orientation_deg"]
        parts.append(f"Orientation error: mean {o['mean']:.3g}, max {o['max']:.3g} degrees.")
    heads = ("largest error", "line", "error [mm]", "worst column", "error in it [mm]", "at [m]")
    keys = ("part", "line", "error_mm", "column", "off_mm")
    parts.append(PageTable(heads, [
        (*(w[key] for key in keys), ", ".join(f"{x:.3f}" for x in w["position_m"])) for w in values["largest"] or ()
    ]))  # fmt: skip
    if values["principal"]:
        p = values["principal"]
        rows = [(f"({', '.join(f'{x:.2f}' for x in d)})", s) for s, d in zip(p["rms_mm"], p["directions"], strict=True)]
        parts.append(PageTable(("principal direction of the error", "rms [mm]"), rows))
    if values["repeatability_mm"] is not None:
        rms = f"{values['repeatability_mm']:.3g} mm rms"
        parts.append(f"Repeatability, from poses measured more than once: {rms}.")
    return parts


def _recordings(recordings: Sequence[Mapping[str, Any]]) -> PageTable:
    parts = (("a_priori", "before"), ("fitted", "fitted"), ("held_out", "held out"))
    rows = [
        (r["name"], name, label, e[key]["mean"], e[key]["rms"], e[key]["max"], e["unit"])
        for r in recordings for name, e in r["errors"].items() for key, label in parts if e[key] is not None
    ]  # fmt: skip
    return PageTable(("measurements", "signal", "poses", "mean", "rms", "max", "unit"), rows)


def _parameters(values: Mapping[str, Any]) -> PageTable:
    rows = []
    for u in values["unknowns"]:
        ends = u["interval_95"] or ["undetermined" if u["std"] is None else "see notes", ""]
        interval = [x if isinstance(x, str) else f"{x:.7g}" for x in ends]
        std = "" if u["std"] is None else f"{u['std']:.2g}"
        rows.append((u["name"], u["unit"], u["start"], u["value"], std, *interval))
    return PageTable(("unknown", "unit", "before", "calibrated", "std", "95 % from", "to"), rows)


def _identifiability(values: Mapping[str, Any]) -> list[Part]:
    parts: list[Part] = []
    for key, label in (("identifiability_before", "Before the fit"), ("identifiability_after", "At the solution")):
        data = values[key]
        if data is not None:
            indices = ", ".join(f"{n} = {v:.4g}" for n, v in data["observability"].items())
            rank = f"r = {data['rank']}, {data['scaling']}"
            parts += [f"{label}: observability {indices} ({rank}), condition {data['condition']:.4g}.", data["notes"]]
    parts.append(PageTable(("correlated unknown", "and", "correlation"), values["correlated"] or []))
    return parts


def _outliers(outliers: Sequence[Mapping[str, Any]]) -> PageTable:
    if "column" not in outliers[0]:
        rows = [(o["line"], o["link"], o["residual_mm"], f"{o['times']:.1f}") for o in outliers]
        return PageTable(("line", "signal", "error [mm]", "standard deviations"), rows)
    rows = [(o["pose"], o["column"], o["off_mm"], o["error_mm"], o["others_mm"]) for o in outliers]
    return PageTable(("pose", "worst column", "error in it [mm]", "error [mm]", "other poses [mm]"), rows)


def _sensitivity(values: Mapping[str, Any]) -> list[Part]:
    jacobian = values["sensitivity"]
    if not jacobian:
        return []
    heads = list(next(iter(jacobian.values())))
    rows = [(name, *(entry[h] for h in heads)) for name, entry in jacobian.items()]
    note = "Sums over the fitted poses of the changes for a small step up and down (Dressler 2012, (5.8))."
    return [note, PageTable(("unknown", *heads), rows)]


def stiffness_sections(v: Mapping[str, Any]) -> Sections:
    """Return the sections for the values of a joint stiffness study."""
    rows = []
    for j, (K, (low, high)) in enumerate(zip(v["stiffness_MNm_rad"], v["interval_MNm_rad"], strict=True)):
        ends = ("none: negative", "") if np.isnan(low) else (low, high if np.isfinite(high) else "no upper bound")
        rows.append((f"joint {j + 1}", K, *ends))
    parts: list[Part] = [PageTable((f"method {v['method']}", "stiffness [MN m/rad]", "95 % from", "to"), rows)]
    if v["other_method_MNm_rad"] is not None:
        both = zip(v["other_method_MNm_rad"], v["agree"], strict=True)
        other = [(f"joint {j + 1}", K, "yes" if a else "no") for j, (K, a) in enumerate(both)]
        parts.append(PageTable(("other method", "stiffness [MN m/rad]", "intervals overlap"), other))
    if v["compensator_rate_N_m"] is not None:
        rate = [("joint 2", *v["compensator_rate_N_m"])]
        parts.append(PageTable(("gravity compensator", "rate [N/m]", "std"), rate))
    best = ", ".join(map(str, v["best_tests"]))
    identifiable = f"O1 = {v['observability_O1']:.4g}. Most informative tests: {best} (lines of the file)."
    return {"Joint stiffness": [v["adequacy"], *parts], "Identifiability": [identifiable]}
