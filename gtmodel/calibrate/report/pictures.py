"""Which pictures a calibration has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .findings import CalibrationFindings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pictures(findings: CalibrationFindings, title: str) -> Mapping[str, Callable[[], Figure]]:
    """File name -> drawing; those that the result can fill."""
    c, headline, held = findings.calibration, findings.headline[0], findings.headline[2]
    name = findings.position
    what = "held-out poses" if held else "fitted poses"
    drawn: dict[str, Callable[[], Figure]] = {}
    parts = findings.beside or not findings.data.whole
    if parts:
        of_parts = {title: sizes for part in findings.parts for title, sizes in _of_part(part).items()}
        if of_parts:
            drawn["pose_errors"] = lambda: _plot().pose_errors_figure(
                of_parts, f"{title}: errors by pose", None, "error [mm]"
            )
    elif name in headline:
        T = findings.data.T[findings.unseen if held else ~findings.data.held_out]
        errors = {f"{what}, calibrated": headline[name].sizes}
        if name in findings.a_priori:
            errors[f"{what}, before"] = findings.a_priori[name].sizes
        drawn["pose_errors"] = lambda: _plot().pose_errors_figure(
            errors, f"{title}: errors by pose", headline[name].worst
        )
        if T.shape[1] > 1:
            drawn["workspace_errors"] = lambda: _plot().workspace_errors_figure(
                T, headline[name].sizes, f"{title}: errors by place, {what}"
            )
    if not parts:
        drawn["length_errors"] = lambda: _plot().length_errors_figure(
            c.residuals, findings.problem.labels, f"{title}: length errors of the fitted poses"
        )
    estimate, after = findings.confidence.estimate, findings.after
    if estimate is not None and after is not None:
        units = [u or "1" for u in estimate.units]
        drawn["deviations"] = lambda: _plot().deviations_figure(
            estimate.names, estimate.std, units, f"{title}: standard deviations"
        )
        drawn["correlation"] = lambda: _plot().correlation_figure(
            after.names, after.correlation, f"{title}: correlation"
        )
    return drawn


def _of_part(part: CalibrationFindings) -> dict[str, np.ndarray]:
    """Sizes [m] of the errors of what some measurements measured, before and after, by what to call them."""
    errors, _, held = part.headline
    what = "held-out poses" if held else "fitted poses"
    sizes = {}
    for name in part.problem.judged:
        if name in errors and name.partition("@")[0] != part.data.pose.orientation:
            sizes[f"{part.data.name}, {name}, {what}"] = errors[name].sizes
            if name in part.a_priori:
                sizes[f"{part.data.name}, {name}, before"] = part.a_priori[name].sizes
    return sizes


def _plot() -> Any:
    from ...plot import calibration

    return calibration
