"""Pictures of learning control: error by iteration, Q filter and convergence, model errors, path of the tool (Dressler
2012, Figs. 7.10 to 7.19)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .style import BLACK, BLUE, GREEN, LIMIT, MODELLED, ORANGE, key_below, styled, with_panels


@styled
def course_figure(
    names: Sequence[str], errors: np.ndarray, predicted: np.ndarray, floors: Sequence[float], rates: Sequence[float],
    tool: np.ndarray | None = None, title: str = "",
) -> Figure:  # fmt: skip
    """Draw rms errors [m] by iteration, a panel per axis.

    Args:
        errors: (axes, runs), of the estimate. predicted: (axes, iterations + 1). floors, rates: by axis, the error
            that remains and sigma of (7.16).
        tool: (axes, runs), true error of the tool, if known.
    """
    figure, panels = with_panels(4.2 * len(names), 4.4, 1, len(names), title=title, sharey=True)
    for k, (panel, name) in enumerate(zip(panels, names, strict=True)):
        panel.semilogy(1e6 * predicted[k], label="predicted before learning", **MODELLED)
        panel.semilogy(1e6 * errors[k], "k.", markersize=7, label="error of the estimate", zorder=3)
        if tool is not None:
            panel.semilogy(1e6 * tool[k], "x", color=GREEN, label="error of the tool", zorder=3)
        panel.axhline(1e6 * floors[k], **LIMIT, label="predicted floor")
        n = np.arange(predicted.shape[1])
        panel.semilogy(n, 1e6 * predicted[k][0] * rates[k] ** n, "--", color="0.6", label="slowest rate")
        low = 0.5e6 * min(float(np.min(errors[k], initial=np.inf)), floors[k], float(predicted[k].min()))
        panel.set_ylim(bottom=low if low > 0 else None)
        panel.set(title=f"{name}: sigma {rates[k]:.2f}", xlabel="iteration")
    panels[0].set_ylabel("rms error [µm]")
    key_below(figure, *panels, columns=3)
    return figure


SMALLEST = 1e-2  # value of |Q| drawn


@styled
def filter_figure(
    names: Sequence[str], axes: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], *, title: str = ""
) -> Figure:
    """Draw 1 / |Q| and |1 - L T|, a panel per axis; learning converges if the second curve lies below the first.

    axes: frequency (k,) [Hz], Q (k,) and the largest |1 - L T| over the models (k,) of each axis.
    """
    figure, panels = with_panels(4.2 * len(names), 4.4, 1, len(names), title=title, sharey=True)
    for panel, name, (frequency, response, contraction) in zip(panels, names, axes, strict=True):
        f = frequency[1:]
        panel.loglog(f, 1 / np.maximum(np.abs(response[1:]), SMALLEST), color=BLUE, label="1 / |Q|")
        panel.loglog(f, contraction[1:], color=ORANGE, label="|1 - L T|, worst model")
        panel.axhline(1.0, **LIMIT)
        panel.set(title=name, xlabel="frequency [Hz]", xlim=(0.5, f[-1]), ylim=(0.05, 1 / SMALLEST))
    panels[0].set_ylabel("magnitude [1]")
    key_below(figure, *panels, columns=2)
    return figure


@styled
def mismatch_figure(
    off: np.ndarray, kalman: np.ndarray, kinematics: float, complementary: float, *, title: str = ""
) -> Figure:
    """Draw the rms error [m] of the Kalman filter (k,) over the relative error `off` (k,) of its model's frequency.

    kinematics, complementary: rms errors [m] of the estimate from the motors alone and of the complementary filter.
    """
    figure, (panel,) = with_panels(6.0, 4.4, title=title)
    order = np.argsort(off)
    panel.semilogy(100 * off[order], 1e6 * kalman[order], ".-", color=BLUE, markersize=8, label="Kalman filter")
    panel.axhline(1e6 * complementary, color=GREEN, linestyle="--", label="complementary filter")
    panel.axhline(1e6 * kinematics, color=ORANGE, linestyle=":", label="motors alone")
    panel.set(xlabel="error of the model's frequency [%]", ylabel="rms error of the estimate [µm]")
    key_below(figure, panel, columns=3)
    return figure


@styled
def tool_path_figure(
    reference: np.ndarray, tool: np.ndarray, *, before: np.ndarray | None = None, title: str = ""
) -> Figure:
    """Draw the planar paths (n, 2) [m] of the reference, of the tool in the last run and before learning."""
    figure, (panel,) = with_panels(5.0, 5.4, title=title)
    if before is not None:
        panel.plot(1e3 * before[:, 0], 1e3 * before[:, 1], color="0.6", linewidth=0.9, label="tool, before learning")
    panel.plot(1e3 * tool[:, 0], 1e3 * tool[:, 1], color=ORANGE, label="tool, last run")
    panel.plot(1e3 * reference[:, 0], 1e3 * reference[:, 1], "--", color=BLACK, linewidth=0.9, label="reference")
    panel.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    key_below(figure, panel, columns=3)
    return figure
