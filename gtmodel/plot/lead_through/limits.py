"""Limits of lead-through: gain over stiffness of the contact, damping over stiffness of a hand, cones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ..style import BLACK, BLUE, ORANGE, SHADES, curve, key_beside, plain_logarithm, styled, with_panels

WIDTH = 8.5  # inches


@styled
def stability_figure(
    stiffness: np.ndarray, limits: np.ndarray, contact: tuple[float, float], gain: float,
    hands: tuple[np.ndarray, Mapping[str, np.ndarray]] | None, *, title: str = "",
) -> Figure:  # fmt: skip
    """Gain limit over stiffness of the contact (n,), the contact and its effective gain, and damping over stiffness of
    a hand."""
    figure, panels = with_panels(WIDTH, 3.4 if hands is None else 6.2, 1 if hands is None else 2, title=title)
    panel = panels[0]
    panel.fill_between(stiffness, limits, limits.max() * 2, color=SHADES[0], label="oscillates")
    panel.loglog(stiffness, limits, color=BLUE, label="limit")
    panel.axhline(gain, color=BLACK, linewidth=0.9, linestyle="--", label="gain")
    panel.plot(*contact, "o", color=ORANGE, label="this contact")
    panel.set(xlabel="stiffness of the contact [N/m]", ylabel="force gain K [m/s/N]")
    panel.set_ylim(min(limits.min(), gain) / 2, max(limits.max(), gain) * 2)
    panel.margins(x=0.0)
    key_beside(panel)
    if hands is not None:
        at, curves = hands
        for k, (name, values) in enumerate(curves.items()):
            panels[1].semilogx(at, values, label=name, **curve(k))
        panels[1].axhline(0.0, color=BLACK, linewidth=0.8, linestyle="--", label="unstable below")
        panels[1].set(xlabel="stiffness of the hand [N/m]", ylabel="least damping ratio")
        plain_logarithm(panels[1].xaxis)
        panels[1].margins(x=0.0)
        key_beside(panels[1])
    return figure


@styled
def cones_figure(cones: np.ndarray, deviations: Mapping[str, Sequence[float]], *, title: str = "") -> Figure:
    """Deviation of the force [N] over the width of the cone (n,) [rad], for surfaces and filters."""
    figure, (panel,) = with_panels(WIDTH, 3.8, 1, title=title)
    for k, (name, values) in enumerate(deviations.items()):
        panel.plot(np.rad2deg(cones), values, marker="o", label=name, **curve(k))
    panel.set(xlabel="cone around the nominal normal [deg]", ylabel="deviation of the force [N], synthetic")
    panel.set_ylim(bottom=0.0)
    key_beside(panel)
    return figure


@styled
def residuals_figure(force: np.ndarray, moment: np.ndarray, *, title: str = "") -> Figure:
    """What a calibration leaves of the force (poses, 3) [N] and the moment (poses, 3) [N m], pose by pose."""
    figure, panels = with_panels(WIDTH, 4.6, 2, title=title, sharex=True)
    for panel, values, text in ((panels[0], force, "force [N]"), (panels[1], 1e3 * moment, "moment [mN m]")):
        for k, axis in enumerate("xyz"):
            panel.plot(
                np.arange(1, len(values) + 1), values[:, k], "o", markersize=4, label=axis, color=curve(k)["color"]
            )
        panel.axhline(0.0, color=BLACK, linewidth=0.8)
        panel.set_ylabel(f"residual, {text}")
        key_beside(panel)
    panels[1].set_xlabel("pose")
    return figure
