"""Which pictures a calibration has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from .findings import Found

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pictures(found: Found, title: str) -> Mapping[str, Callable[[], Figure]]:
    """File name -> drawing; those that the result can fill."""
    c, told, held = found.calibration, found.told[0], found.told[2]
    name = found.position
    what = "held-out poses" if held else "fitted poses"
    drawn: dict[str, Callable[[], Figure]] = {}
    if name in told:
        T = found.data.T[found.data.held_out if held else ~found.data.held_out]
        errors = {f"{what}, calibrated": told[name].sizes}
        if name in found.a_priori:
            errors[f"{what}, before"] = found.a_priori[name].sizes
        drawn["pose_errors"] = lambda: _plot().pose_errors_figure(errors, title, told[name].worst)
        drawn["workspace_errors"] = lambda: _plot().workspace_errors_figure(T, told[name].sizes, f"{title}: {what}")
    drawn["length_errors"] = lambda: _plot().length_errors_figure(
        c.residuals, found.problem.labels, f"{title}: fitted poses"
    )
    estimate, after = found.confidence.estimate, found.after
    if estimate is not None and after is not None:
        units = [u or "1" for u in estimate.units]
        drawn["deviations"] = lambda: _plot().deviations_figure(estimate.names, estimate.std, units, title)
        drawn["correlation"] = lambda: _plot().correlation_figure(after.names, after.correlation, title)
    return drawn


def _plot() -> Any:
    from ...plot import calibration

    return calibration
