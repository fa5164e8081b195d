"""report.html of a calibration: one file, with pictures if they are asked for; identical for identical input."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from hashlib import sha256
from html import escape
from typing import Any

import numpy as np

from gtmodel.calibrate import CalibrationStudy
from gtmodel.problem_files.base import Context
from gtmodel.results.disk import made
from gtmodel.results.written import png, versions

from .keys import Schema

REPORT = "report.html"
STYLE = (
    "body{font:15px/1.45 sans-serif;max-width:62em;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;margin:.6em 0}"
    "td,th{padding:.15em .7em;border-bottom:1px solid #ddd;text-align:left}"
    "td.n{text-align:right;font-variant-numeric:tabular-nums}img{max-width:100%}"
    ".good{background:#e3f4e3}.bad{background:#fbe3e0}.box{padding:.5em 1em;margin:.5em 0}"
    ".made{background:#fff3cd;padding:.5em 1em}"
)
UNDRAWN = "<p>Without pictures, which take most of the time: <code>gtmodel solve --plot</code> adds them.</p>"
CAPTIONS = {
    "pose_errors": "Positioning error per pose (compare Dressler 2012, Fig. 5.1); dashed: mean; ring: largest error.",
    "workspace_errors": "Positioning error over the workspace; squares: held-out poses; ring: largest error.",
    "length_errors": "Errors of each link, or coordinate of the tool, in the fitted poses.",
    "deviations": "Standard deviation of each unknown.",
    "correlation": "Correlation of the unknowns.",
    "stiffness": "Stiffness of each joint with 95 % confidence intervals, for both methods.",
}


def added(study: CalibrationStudy, problem: Schema, context: Context) -> CalibrationStudy:
    """Return the study with report.html among its files, unless it stopped before the fit."""
    if not study.files:
        return study
    page, behind = (stiffness_text, "parameters.toml") if study.joint_stiffness is not None else (text, "poses.csv")
    plain = partial(page, study.with_(figures={}), problem, context)
    drawn = partial(page, study, problem, context)
    return study.with_(files=made(study.files).with_(REPORT, plain, behind=behind, drawn=drawn))


def text(study: CalibrationStudy, problem: Schema, context: Context) -> str:
    """Return the page, without external links and without a date."""
    values, figures, title = study.values, study.figures, study.title
    parts = [f"<h1>{escape(title)}</h1>"]
    if values["synthetic"]:
        parts.append(f'<p class="made">Synthetic measurements: {escape(values["synthetic"])}</p>')
    good = values["numerics_sound"] and values["prediction_proven"] is not False
    parts.append("<h2>Verdict</h2>" + items(values["verdict"], good))
    if study.notes:
        parts.append("<h2>Notes</h2>" + items(study.notes))
    parts.append("" if figures else UNDRAWN)
    parts.append("<h2>Accuracy</h2>" + _accuracy(values))
    for name in ("pose_errors", "workspace_errors"):
        parts.append(picture(figures, name, CAPTIONS[name]))
    parts.append("<h2>Parameters</h2>" + _parameters(values))
    if values["measurement"]:
        parts.append("<h3>Measurement</h3>" + table(("name", "value"), list(values["measurement"].items())))
    parts += [picture(figures, name, CAPTIONS[name]) for name in ("deviations", "correlation")]
    if values["recordings"] is None:
        heads = ("link or coordinate", "mean error [mm]")
        parts.append("<h2>Links</h2>" + table(heads, list(values["link_errors_mm"].items())))
    parts.append(picture(figures, "length_errors", CAPTIONS["length_errors"]))
    parts.append("<h2>Identifiability</h2>" + _identifiability(values))
    parts.append(_outliers(values))
    parts.append(_sensitivity(values, problem))
    parts.append("<h2>Origin</h2>" + _provenance(problem, context, values["poses"]))
    return whole(title, parts)


def stiffness_text(study: CalibrationStudy, problem: Schema, context: Context) -> str:
    """Return the page for joint stiffness: verdict, stiffness by both methods, identifiability, origin."""
    values, figures, title = study.values, study.figures, study.title
    v = values["joint_stiffness"]
    parts = [f"<h1>{escape(title)}</h1>"]
    if values["synthetic"]:
        parts.append(f'<p class="made">Synthetic load tests: {escape(values["synthetic"])}</p>')
    sound = bool(v["adequate"]) and all(K > 0 for K in v["stiffness_MNm_rad"])
    parts.append("<h2>Verdict</h2>" + items((v["adequacy"], *study.notes), sound))
    parts.append("" if figures else UNDRAWN)
    rows = [
        (
            f"joint {j + 1}",
            K,
            "none: negative" if np.isnan(i[0]) else i[0],
            "" if np.isnan(i[0]) else i[1] if np.isfinite(i[1]) else "no upper bound",
        )
        for j, (K, i) in enumerate(zip(v["stiffness_MNm_rad"], v["interval_MNm_rad"], strict=True))
    ]
    heads = (f"method {v['method']}", "stiffness [MN m/rad]", "95 % from", "to")
    parts += ["<h2>Joint stiffness</h2>", table(heads, rows), picture(figures, "stiffness", CAPTIONS["stiffness"])]
    if v["other_method_MNm_rad"] is not None:
        rows = [(f"joint {j + 1}", K, "yes" if a else "no") for j, (K, a) in enumerate(
            zip(v["other_method_MNm_rad"], v["agree"], strict=True))]  # fmt: skip
        parts.append(table(("other method", "stiffness [MN m/rad]", "intervals overlap"), rows))
    if v["compensator_rate_N_m"] is not None:
        parts.append(table(("gravity compensator", "rate [N/m]", "std"), [("joint 2", *v["compensator_rate_N_m"])]))
    parts.append(f"<h2>Identifiability</h2><p>O1 = {v['observability_O1']:.4g}.</p>")
    parts.append(f"<p>Most informative tests: {', '.join(map(str, v['best_tests']))} (lines of the file).</p>")
    parts += ["<h2>Origin</h2>", _provenance(problem, context)]
    return whole(title, parts)


def whole(title: str, parts: Sequence[str]) -> str:
    """Return the HTML page with these parts."""
    body = "\n".join(p for p in parts if p)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def _accuracy(values: Mapping[str, Any]) -> str:
    rows: list[Sequence[Any]] = []
    for key, label in (("a_priori_mm", "before"), ("fitted_mm", "fitted poses"), ("held_out_mm", "held-out poses")):
        if values[key]:
            rows.append((label, values[key]["mean"], values[key]["rms"], values[key]["max"]))
    page = table(("positioning error", "mean [mm]", "rms [mm]", "max [mm]"), rows) if rows else ""
    page += _recordings(values["recordings"] or ())
    if values["orientation_deg"]:
        o = values["orientation_deg"]
        page += f"<p>Orientation error: mean {o['mean']:.3g}, max {o['max']:.3g} degrees.</p>"
    if values["largest"]:
        rows = [
            (
                w["part"],
                w["line"],
                w["error_mm"],
                w["column"],
                w["off_mm"],
                ", ".join(f"{x:.3f}" for x in w["position_m"]),
            )
            for w in values["largest"]
        ]
        heads = ("largest error", "line", "error [mm]", "worst column", "error in it [mm]", "at [m]")
        page += table(heads, rows)
    if values["principal"]:
        p = values["principal"]
        rows = [(f"({', '.join(f'{x:.2f}' for x in d)})", s) for s, d in zip(p["rms_mm"], p["directions"], strict=True)]
        page += table(("principal direction of the error", "rms [mm]"), rows)
    if values["repeatability_mm"] is not None:
        page += f"<p>Repeatability, from poses measured more than once: {values['repeatability_mm']:.3g} mm rms.</p>"
    return page


def _recordings(recordings: Sequence[Mapping[str, Any]]) -> str:
    rows: list[Sequence[Any]] = []
    for r in recordings:
        for name, e in r["errors"].items():
            for key, label in (("a_priori", "before"), ("fitted", "fitted"), ("held_out", "held out")):
                if e[key] is not None:
                    rows.append((r["name"], name, label, e[key]["mean"], e[key]["rms"], e[key]["max"], e["unit"]))
    return table(("measurements", "signal", "poses", "mean", "rms", "max", "unit"), rows) if rows else ""


def _parameters(values: Mapping[str, Any]) -> str:
    rows = []
    for u in values["unknowns"]:
        ends = u["interval_95"] or ["undetermined" if u["std"] is None else "see notes", ""]
        interval = [x if isinstance(x, str) else f"{x:.7g}" for x in ends]
        std = "" if u["std"] is None else f"{u['std']:.2g}"
        rows.append((u["name"], u["unit"], u["start"], u["value"], std, *interval))
    return table(("unknown", "unit", "before", "calibrated", "std", "95 % from", "to"), rows)


def _identifiability(values: Mapping[str, Any]) -> str:
    page = ""
    for key, label in (("identifiability_before", "Before the fit"), ("identifiability_after", "At the solution")):
        data = values[key]
        if data is None:
            continue
        indices = ", ".join(f"{n} = {v:.4g}" for n, v in data["observability"].items())
        page += f"<h3>{label}</h3>{items(data['notes'])}<p>Observability {indices} (r = {data['rank']}, "
        page += f"{data['scaling']}). Condition {data['condition']:.4g}.</p>"
    if values["correlated"]:
        page += "<h3>Correlated</h3>" + table(("unknown", "and", "correlation"), values["correlated"])
    return page


def _outliers(values: Mapping[str, Any]) -> str:
    if not values["outliers"]:
        return "<h2>Outliers</h2><p>None.</p>"
    if "column" not in values["outliers"][0]:
        rows = [(o["line"], o["link"], o["residual_mm"], f"{o['times']:.1f}") for o in values["outliers"]]
        return "<h2>Outliers</h2>" + table(("line", "signal", "error [mm]", "standard deviations"), rows)
    rows = [(o["pose"], o["column"], o["off_mm"], o["error_mm"], o["others_mm"]) for o in values["outliers"]]
    heads = ("pose", "worst column", "error in it [mm]", "error [mm]", "other poses [mm]")
    return "<h2>Outliers</h2>" + table(heads, rows)


def _sensitivity(values: Mapping[str, Any], problem: Schema) -> str:
    jacobian = values["sensitivity"]
    if not jacobian:
        return ""
    heads = list(next(iter(jacobian.values())))
    rows = [(name, *(entry[h] for h in heads)) for name, entry in jacobian.items()]
    step = problem.options().sensitivity_step
    note = f"Sums over the fitted poses of the changes for a step of {step:g} up and down (Dressler 2012, (5.8))."
    return f"<h2>Sensitivity</h2><p>{note}</p>" + table(("unknown", *heads), rows)


def _provenance(problem: Schema, context: Context, poses: Mapping[str, int] | None = None) -> str:
    rows: list[Sequence[Any]] = [("problem", context.name), ("robot", problem.robot)]
    files = (path for path in context.inputs.items() if path[1].is_file())
    hashes = [(f"{key}: {path.name}", f"sha256 {sha256(path.read_bytes()).hexdigest()}") for key, path in files]
    software = [(n, v) for n, v in versions().items() if n != "platform"]
    if poses is None:
        return table(("what", ""), [*rows, *hashes, *software])
    keys = ("keys of the problem", "sha256 " + sha256(problem.model_dump_json().encode()).hexdigest())
    counts = ("poses", f"{poses['fitted']} fitted, {poses['held_out']} held out")
    return table(("what", ""), [*rows, ("cost", problem.options().cost), *hashes, keys, *software, counts])


def items(sentences: Sequence[str], sound: bool | None = None) -> str:
    """Return a list of sentences; a verdict gets a green box if it is `sound`, otherwise a red one."""
    box = "" if sound is None else f' class="box {"good" if sound else "bad"}"'
    return f"<ul{box}>{''.join(f'<li>{escape(s)}</li>' for s in sentences)}</ul>"


def table(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table with numbers to six digits."""
    top = "".join(f"<th>{escape(h)}</th>" for h in heads)
    lines = ["<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows]
    return f"<table><tr>{top}</tr>{''.join(lines)}</table>"


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f'<td class="n">{value:.6g}</td>'
    return f"<td>{escape(str(value))}</td>"


def picture(figures: Mapping[str, Callable[[], Any]], name: str, caption: str) -> str:
    """Return an embedded picture with its caption, or an empty string if there is no such picture."""
    if name not in figures:
        return ""
    data = base64.b64encode(png(figures[name])).decode()
    caption = escape(caption)
    image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"
