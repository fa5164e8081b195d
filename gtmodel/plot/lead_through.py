"""Pictures of lead-through: gain limit and damping, and runs over time with force, path, speeds and energy at the
hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .style import (
    BLACK,
    BLUE,
    GREEN,
    HIGHLIGHT,
    ORANGE,
    PINK,
    SHADES,
    curve,
    key_below,
    key_beside,
    plain_logarithm,
    styled,
    with_panels,
)

WIDTH = 8.5  # inches


@styled
def stability_figure(
    stiffness: np.ndarray, limits: np.ndarray, contact: tuple[float, float], gain: float,
    hands: tuple[np.ndarray, Mapping[str, np.ndarray]] | None, *, title: str = "",
) -> Figure:  # fmt: skip
    """Draw the gain limit over the contact stiffness (n,) with this contact and its effective gain, and below the
    smallest damping ratio over the stiffness of the hand."""
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
        hand_stiffness, curves = hands
        for k, (name, values) in enumerate(curves.items()):
            panels[1].semilogx(hand_stiffness, values, label=name, **curve(k))
        panels[1].axhline(0.0, color=BLACK, linewidth=0.8, linestyle="--", label="stability limit")
        panels[1].set(xlabel="stiffness of the hand [N/m]", ylabel="smallest damping ratio [1]")
        plain_logarithm(panels[1].xaxis)
        panels[1].margins(x=0.0)
        key_beside(panels[1])
    return figure


@styled
def cones_figure(cones: np.ndarray, deviations: Mapping[str, Sequence[float]], *, title: str = "") -> Figure:
    """Draw the deviation of the force [N] over the width of the cone (n,) [rad], a curve per surface and filter."""
    figure, (panel,) = with_panels(WIDTH, 3.8, 1, title=title)
    for k, (name, values) in enumerate(deviations.items()):
        panel.plot(np.rad2deg(cones), values, marker="o", label=name, **curve(k))
    panel.set(xlabel="cone around the nominal normal [deg]", ylabel="deviation of the force [N], synthetic")
    panel.set_ylim(bottom=0.0)
    key_beside(panel)
    return figure


@styled
def residuals_figure(force: np.ndarray, moment: np.ndarray, *, title: str = "") -> Figure:
    """Draw the residuals of force (poses, 3) [N] and moment (poses, 3) [N m] after a calibration, by pose."""
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


AXES = tuple(zip("xyz", (BLUE, ORANGE, GREEN), strict=True))


def _shaded(panel: Any, time: np.ndarray, contact: np.ndarray) -> None:
    """Mark the times of contact."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], contact.astype(int), [0]])))
    for k, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        last = time[min(end, len(time) - 1)]
        panel.axvspan(time[begin], last, color=HIGHLIGHT, zorder=0, label=None if k else "contact")


@styled
def force_figure(
    time: np.ndarray, force: np.ndarray, contact: np.ndarray, reference: float, cycle: float, *, title: str = ""
) -> Figure:
    """Draw the force along the normal (n,) [N] with the times of contact, and its spectrum in contact."""
    figure, (panel, below) = with_panels(WIDTH, 5.6, 2, title=title)
    _shaded(panel, time, contact)
    panel.plot(time, force, color=BLUE, linewidth=0.8, label="force on the tool")
    panel.axhline(reference, color=BLACK, linestyle="--", linewidth=0.8, zorder=3, label=f"reference {reference:g} N")
    panel.set(xlabel="time [s], synthetic", ylabel="force along normal [N]")
    panel.margins(x=0.0)
    key_beside(panel)
    e = force[contact] - force[contact].mean() if contact.any() else np.zeros(2)
    amplitude = 2 * np.abs(np.fft.rfft(np.hanning(len(e)) * e)) / max(np.hanning(len(e)).sum(), 1.0)
    below.semilogy(np.fft.rfftfreq(len(e), cycle)[1:], np.maximum(amplitude[1:], 1e-6), color=BLUE, linewidth=0.8)
    below.axvspan(0.0, 5.0, color=HIGHLIGHT, zorder=0, label="below 5 Hz")
    below.set(xlabel="frequency [Hz]", ylabel="amplitude in contact [N]")
    below.margins(x=0.0)
    key_beside(below)
    return figure


@styled
def path_figure(
    time: np.ndarray, position: np.ndarray, command: np.ndarray, contact: np.ndarray, *, title: str = ""
) -> Figure:
    """Draw the position (n, 3) [m] of the tool and the commanded twist (n, 6) [m/s, rad/s]."""
    drawn = [(1e3 * position, "position [mm]"), (1e3 * command[:, :3], "velocity [mm/s]")]
    drawn += [(np.rad2deg(command[:, 3:]), "rate [deg/s]")] if command[:, 3:].any() else []
    figure, panels = with_panels(WIDTH, 1.0 + 1.8 * len(drawn), len(drawn), title=title, sharex=True)
    for panel, (values, text) in zip(panels, drawn, strict=True):
        _shaded(panel, time, contact)
        for n, (axis, colour) in enumerate(AXES):
            panel.plot(time, values[:, n], color=colour, linewidth=0.9, label=axis)
        panel.set_ylabel(text)
        panel.margins(x=0.0)
        key_beside(panel)
    panels[-1].set_xlabel("time [s], synthetic")
    return figure


@styled
def energy_figure(
    time: np.ndarray, energy: np.ndarray, stored: np.ndarray, window: tuple[float, float], worst: float,
    *, title: str = "",
) -> Figure:  # fmt: skip
    """Draw the energy supplied by the hand (n,) [J], the stored energy (n,) [J], and the window of least energy."""
    figure, (panel, below) = with_panels(WIDTH, 5.0, 2, title=title, sharex=True)
    panel.plot(time, energy, color=BLUE, label="supplied by the hand")
    below.plot(time, 1e3 * stored, color=ORANGE, linewidth=0.9, label="stored in mass and contact")
    for axes in (panel, below):
        axes.axvspan(*window, color=HIGHLIGHT, zorder=0, label=f"lowest window, {1e3 * worst:.3g} mJ")
        axes.margins(x=0.0)
        key_beside(axes)
    panel.set_ylabel("energy [J]")
    below.set(xlabel="time [s], synthetic", ylabel="energy [mJ]")
    return figure


@styled
def peg_figure(
    time: np.ndarray, moment: np.ndarray, misaligned: np.ndarray, about: np.ndarray, *, title: str = ""
) -> Figure:
    """Draw the torque on the peg (n, 3) [N m], its misalignment (n,) [rad], its rotation about its axis (n,) [rad]."""
    figure, panels = with_panels(WIDTH, 6.4, 3, title=title, sharex=True)
    for n, (axis, colour) in enumerate(AXES):
        panels[0].plot(time, 1e3 * moment[:, n], color=colour, linewidth=0.9, label=axis)
    key_beside(panels[0])
    panels[0].set_ylabel("torque [mN m]")
    panels[1].plot(time, np.rad2deg(misaligned), color=BLUE)
    panels[1].set_ylabel("misalignment [deg]")
    panels[2].plot(time, np.rad2deg(about), color=PINK)
    panels[2].set(xlabel="time [s], synthetic", ylabel="rotation about axis [deg]")
    for panel in panels:
        panel.margins(x=0.0)
    return figure


_LABELS = ("force along normal [N]", "commanded speed [m/s]", "height above plate [mm]")


@styled
def guided_figure(
    cycle_s: float, runs: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], reference: float, title: str = ""
) -> Figure:
    """Draw force, commanded speed and height above the plate over time.

    Args:
        cycle_s: sampling period [s].
        runs: by label, (n,) each: force [N], commanded speed [m/s], height above the plate [mm].
        reference: reference of the force [N].
    """
    figure, panels = with_panels(8.5, 7.0, 3, title=title, sharex=True)
    panels[0].axhline(reference, color="black", linestyle="--", linewidth=1.0, zorder=3, label="reference")
    for n, (label, series) in enumerate(runs.items(), 1):
        for axes, values in zip(panels, series, strict=True):
            axes.plot(cycle_s * np.arange(len(values)), values, label=label, **curve(n))
    for axes, text in zip(panels, _LABELS, strict=True):
        axes.set_ylabel(text)
    figure.align_ylabels(panels)
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0])
    return figure
