"""report.html of a calibration of joint stiffness, in the dress of the kinematic one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from html import escape
from typing import Any

from matplotlib.figure import Figure

from gtmodel.problem_files.base import Context
from gtmodel.results.written import versions

from .calibration_report import STYLE, picture, table

CAPTION = "Stiffness by joint with 95 % intervals, by method."


def text(
    values: Mapping[str, Any], figures: Mapping[str, Callable[[], Figure]], title: str, robot: str, context: Context
) -> str:
    """The page: result, what is claimed in print and what the tests support, what each unknown is told by."""
    v = values["joint_stiffness"]
    parts = [f"<h1>{escape(title)}</h1>"]
    if values["synthetic"]:
        parts.append(f'<p class="made">Synthetic load tests: {escape(values["synthetic"])}</p>')
    sound = "good" if v["adequate"] and all(K > 0 for K in v["stiffness_MNm_rad"]) else "bad"
    sentences = "".join(f"<li>{escape(s)}</li>" for s in (v["adequacy"], *v["said"]))
    parts.append(f'<h2>Verdict</h2><ul class="box {sound}">{sentences}</ul>')
    rows = [
        (
            f"joint {j + 1}",
            K,
            "none: negative" if i[0] is None else i[0],
            "" if i[0] is None else "no upper end" if i[1] is None else i[1],
        )
        for j, (K, i) in enumerate(zip(v["stiffness_MNm_rad"], v["interval_MNm_rad"], strict=True))
    ]
    heads = (f"by {v['method']}", "stiffness [MN m/rad]", "95 % from", "to")
    parts += ["<h2>Joint stiffness</h2>", table(heads, rows), picture(figures, "stiffness", CAPTION)]
    if v["other_method_MNm_rad"] is not None:
        rows = [(f"joint {j + 1}", K, "yes" if a else "no") for j, (K, a) in enumerate(
            zip(v["other_method_MNm_rad"], v["agree"], strict=True))]  # fmt: skip
        parts.append(table(("by the other method", "stiffness [MN m/rad]", "intervals overlap"), rows))
    if v["compensator_rate_N_m"] is not None:
        parts.append(table(("gravity compensator", "rate [N/m]", "std"), [("joint 2", *v["compensator_rate_N_m"])]))
    told = "".join(f"<li>{escape(s)}</li>" for s in v["told"])
    parts.append(f"<h2>What the tests tell</h2><ul>{told}</ul><p>O1 = {v['observability_O1']:.4g}.</p>")
    parts.append(f"<p>The tests that tell most: {', '.join(map(str, v['best_tests']))} (lines of the file).</p>")
    rows = [("problem", context.name), ("robot", robot)]
    for key, path in context.inputs.items():
        if path.is_file():
            rows.append((f"{key}: {path.name}", "sha256 " + hashlib.sha256(path.read_bytes()).hexdigest()))
    rows += [(n, x) for n, x in versions().items() if n != "platform"]
    parts += ["<h2>Where this comes from</h2>", table(("what", ""), rows)]
    body = "\n".join(parts)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )
