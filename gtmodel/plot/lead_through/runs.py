"""A run of lead-through in time: force with its spectrum, path and speeds, energy at the handle, a peg's torque."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..style import BLACK, BLUE, GREEN, HIGHLIGHT, ORANGE, PINK, key_beside, styled, with_panels

WIDTH = 8.5  # inches
AXES = tuple(zip("xyz", (BLUE, ORANGE, GREEN), strict=True))


def _shaded(panel: Any, time: np.ndarray, contact: np.ndarray) -> None:
    """Marks where the tool touches."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], contact.astype(int), [0]])))
    for k, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        last = time[min(end, len(time) - 1)]
        panel.axvspan(time[begin], last, color=HIGHLIGHT, zorder=0, label=None if k else "contact")


@styled
def force_figure(
    time: np.ndarray, force: np.ndarray, contact: np.ndarray, reference: float, cycle: float, *, title: str = ""
) -> Figure:
    """The force along the normal (n,) [N], where the tool touches, and its spectrum there."""
    figure, (panel, below) = with_panels(WIDTH, 5.6, 2, title=title)
    _shaded(panel, time, contact)
    panel.plot(time, force, color=BLUE, linewidth=0.8, label="on the tool")
    panel.axhline(reference, color=BLACK, linestyle="--", linewidth=0.8, label=f"reference {reference:g} N")
    panel.set(xlabel="time [s], synthetic", ylabel="force along normal [N]")
    panel.margins(x=0.0)
    key_beside(panel)
    held = force[contact] - force[contact].mean() if contact.any() else np.zeros(2)
    amplitude = 2 * np.abs(np.fft.rfft(np.hanning(len(held)) * held)) / max(np.hanning(len(held)).sum(), 1.0)
    below.semilogy(np.fft.rfftfreq(len(held), cycle)[1:], np.maximum(amplitude[1:], 1e-6), color=BLUE, linewidth=0.8)
    below.axvspan(0.0, 5.0, color=HIGHLIGHT, zorder=0, label="below 5 Hz")
    below.set(xlabel="frequency [Hz]", ylabel="amplitude in contact [N]")
    below.margins(x=0.0)
    key_beside(below)
    return figure


@styled
def path_figure(
    time: np.ndarray, position: np.ndarray, command: np.ndarray, contact: np.ndarray, *, title: str = ""
) -> Figure:
    """Position (n, 3) [m] of the tool and the commanded twist (n, 6) [m/s, rad/s]."""
    drawn = [(1e3 * position, "position [mm]"), (1e3 * command[:, :3], "command [mm/s]")]
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
    """Energy that the hand put in (n,) [J], what is stored (n,) [J], and the window of least energy."""
    figure, (panel, below) = with_panels(WIDTH, 5.0, 2, title=title, sharex=True)
    panel.plot(time, energy, color=BLUE, label="put in by the hand")
    below.plot(time, 1e3 * stored, color=ORANGE, linewidth=0.9, label="stored in mass and contact")
    for one in (panel, below):
        one.axvspan(*window, color=HIGHLIGHT, zorder=0, label=f"least window, {1e3 * worst:.3g} mJ")
        one.margins(x=0.0)
        key_beside(one)
    panel.set_ylabel("energy [J]")
    below.set(xlabel="time [s], synthetic", ylabel="energy [mJ]")
    return figure


@styled
def peg_figure(
    time: np.ndarray, moment: np.ndarray, misaligned: np.ndarray, about: np.ndarray, *, title: str = ""
) -> Figure:
    """Torque on the peg (n, 3) [N m], the angle to its hole (n,) [rad], and its turn about its axis (n,) [rad]."""
    figure, panels = with_panels(WIDTH, 6.4, 3, title=title, sharex=True)
    for n, (axis, colour) in enumerate(AXES):
        panels[0].plot(time, 1e3 * moment[:, n], color=colour, linewidth=0.9, label=axis)
    key_beside(panels[0])
    panels[0].set_ylabel("torque [mN m]")
    panels[1].plot(time, np.rad2deg(misaligned), color=BLUE)
    panels[1].set_ylabel("peg to hole [deg]")
    panels[2].plot(time, np.rad2deg(about), color=PINK)
    panels[2].set(xlabel="time [s], synthetic", ylabel="about the peg [deg]")
    for panel in panels:
        panel.margins(x=0.0)
    return figure
