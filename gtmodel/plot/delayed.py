"""Pictures of feedback with delay: largest pole over the gain, spread of the gain limit, runs near the limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .style import BLACK, BLUE, GREEN, ORANGE, SKY, key_beside, plain_logarithm, styled, with_panels

WIDTH = 8.5  # inches
BINS = 40


@styled
def radius_figure(curves: Mapping[str, tuple[np.ndarray, np.ndarray, float]], *, title: str = "") -> Figure:
    """Draw the largest modulus of the poles over the gain, a panel per axis; curves: gains, moduli, gain limit."""
    figure, panels = with_panels(WIDTH, 1.0 + 2.4 * len(curves), len(curves), title=title)
    for panel, (name, (gains, radii, limit)) in zip(panels, curves.items(), strict=True):
        panel.plot(gains, radii, color=BLUE)
        panel.axhline(1.0, color=BLACK, linewidth=0.8, linestyle="--")
        if np.isfinite(limit):
            panel.axvline(limit, color=ORANGE, linewidth=1.2, label=f"limit {limit:.3g}")
            key_beside(panel)
        panel.set(xlabel="gain P [1]", ylabel="largest |pole| [1]", title=f"along {name}")
        panel.margins(x=0.0)
    return figure


@styled
def box_figure(drawn: Mapping[str, tuple[np.ndarray, float, float, float]], *, title: str = "") -> Figure:
    """Draw histograms of the gain limit over random points of the parameter box, a panel per axis.

    drawn: limits (n,), the nominal limit, the lowest limit, and the recommended gain.
    """
    figure, panels = with_panels(WIDTH, 1.2 + 2.4 * len(drawn), len(drawn), title=title)
    for panel, (name, (limits, nominal, worst, recommended)) in zip(panels, drawn.items(), strict=True):
        panel.hist(limits, BINS, color=SKY)
        panel.axvline(nominal, color=BLACK, linewidth=1.0, label=f"nominal {nominal:.3g}")
        panel.axvline(worst, color=ORANGE, linewidth=1.2, label=f"worst {worst:.3g}")
        panel.axvline(recommended, color=GREEN, linewidth=1.2, linestyle="--", label=f"recommended {recommended:g}")
        panel.set(xlabel="gain limit [1]", ylabel="number of points", title=f"along {name}")
        key_beside(panel)
    return figure


@styled
def runs_figure(runs: Mapping[str, tuple[Sequence[Any], float]], beside: float, *, title: str = "") -> Figure:
    """Draw synthetic deviations at gains just below and just above the limit, two panels per axis."""
    count = 2 * len(runs)
    figure, panels = with_panels(WIDTH, 1.0 + 1.9 * count, count, title=title, sharex=True)
    for k, (name, (pair, limit)) in enumerate(runs.items()):
        for j, (run, share) in enumerate(zip(pair, (1 - beside, 1 + beside), strict=True)):
            panel = panels[2 * k + j]
            panel.plot(run.time, 1e6 * run.deviation, color=(BLUE, ORANGE)[j], linewidth=0.6)
            panel.set(
                ylabel="deviation [µm]",
                title=f"along {name}, gain {share * limit:.3g}: {100 * share:.0f} % of the limit",
            )
            panel.margins(x=0.0)
    panels[-1].set_xlabel("time [s], synthetic")
    return figure


@styled
def directions_figure(
    angles: np.ndarray, limits: np.ndarray, seen: Sequence[tuple[float, float | None, float | None]], *, title: str = ""
) -> Figure:
    """Draw the gain limit over the direction.

    seen: angle, largest gain with a stable run, smallest gain with an unstable run; None without runs.
    """
    figure, (panel,) = with_panels(WIDTH, 4.5, 1, title=title)
    panel.semilogy(np.rad2deg(angles), limits, color=BLUE, label="limit")
    bars = [(a, low, high) for a, low, high in seen if low is not None and high is not None]
    for k, (angle, stable, unstable) in enumerate(bars):
        label = None if k else "runs: stable to unstable"
        panel.plot(
            [np.rad2deg(angle)] * 2, [stable, unstable], "_-", color=BLACK, markersize=12, linewidth=2, label=label
        )
    for k, angle in enumerate(a for a, low, _ in seen if low is None):
        panel.axvline(np.rad2deg(angle), color=GREEN, linestyle="--", label=None if k else "predicted only")
    panel.set(xlabel="direction from y towards x [deg]", ylabel="gain limit [1]")
    panel.margins(x=0.0)
    plain_logarithm(panel.yaxis)
    key_beside(panel)
    return figure


@styled
def depth_figure(depths: Mapping[str, float], finer: Mapping[str, float], *, title: str = "") -> Figure:
    """Draw the depth at which a cut chatters over the gain, also computed with twice the number of steps."""
    figure, (panel,) = with_panels(WIDTH, 4.0, 1, title=title)
    for by_gain, label, style in ((depths, "nominal steps", "o-"), (finer, "twice the steps", "x--")):
        panel.plot([float(g) for g in by_gain], [1e3 * d for d in by_gain.values()], style, label=label)
    panel.set(xlabel="gain P [1]", ylabel="depth of chatter [mm]")
    panel.set_ylim(0.0, 1.1e3 * max([*depths.values(), *finer.values()]) or 1.0)  # no point on the frame
    key_beside(panel)
    return figure


@styled
def map_figure(
    joint_2: np.ndarray, joint_3: np.ndarray, limits: Mapping[str, np.ndarray], measured: np.ndarray, asked: np.ndarray,
    *, title: str = "",
) -> Figure:  # fmt: skip
    """Draw the 5 % quantile of the gain limit over two joint angles, a panel per direction.

    joint_2 (n,), joint_3 (m,) [rad]; limits (m, n) by direction; measured, asked (k, 2): measured poses, poses of the
    table [rad].
    """
    figure, panels = with_panels(WIDTH, 1.0 + 3.8 * len(limits), len(limits), title=title, sharex=True)
    for panel, (name, values) in zip(panels, limits.items(), strict=True):
        filled = panel.contourf(np.rad2deg(joint_2), np.rad2deg(joint_3), values, 12, cmap="viridis")
        figure.colorbar(filled, ax=panel, label="5 % quantile of the limit [1]")
        for poses, style, label in ((measured, "ko", "measured poses"), (asked, "r^", "poses of the table")):
            panel.plot(*np.rad2deg(poses).T, style, markersize=4, label=label)
        panel.set(ylabel="joint 3 [deg]", title=f"along {name}")
    panels[0].legend(loc="upper left")
    panels[-1].set_xlabel("joint 2 [deg]")
    return figure
