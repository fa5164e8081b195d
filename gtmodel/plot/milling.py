"""Pictures of milling: indices and natural frequencies over the redundant angle, tests, lobes, compensation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .style import (
    BLACK,
    BLUE,
    COLOURS,
    GREEN,
    ORANGE,
    PINK,
    SKY,
    curve,
    key_below,
    key_beside,
    plain_logarithm,
    styled,
    with_panels,
)

STATIC, DYNAMIC, AXES = ORANGE, BLUE, (BLUE, GREEN, PINK)
ORDER: tuple[dict[str, Any], ...] = tuple(dict(color=c) for c in (SKY, STATIC, BLACK))  # light below dark
SLICES = 100  # time slices, of which the largest error is drawn
DEEP = 5.0  # upper end of the lobes, relative to the cut and the smallest stable depth


@styled
def angle_figure(
    angles: np.ndarray, static: np.ndarray, dynamic: np.ndarray, frequency: np.ndarray, tooth: Sequence[float], *,
    reachable: np.ndarray, choices: Mapping[str, float] | None = None, title: str = "",
) -> Figure:  # fmt: skip
    """Draw static index, dynamic index and natural frequencies over the redundant angle, a panel each.

    angles (n,) [rad]; static, dynamic (n,) [m], frequency (n, 3) [Hz], NaN if undefined; tooth: frequencies [Hz] to
    mark, the tooth frequency first, then its harmonics; reachable (n,); choices: name -> angle [rad].
    """
    a = np.rad2deg(angles)
    figure, (top, middle, bottom) = with_panels(9.5, 7.6, 3, title=title, sharex=True)
    for axes, index, colour, name in (
        (top, static, STATIC, "static index, eq. (18), at the peak force"),
        (middle, dynamic, DYNAMIC, "dynamic index, eq. (19), maximum over time"),
    ):
        axes.semilogy(a, 1e3 * index, color=colour)
        axes.set(ylabel="deflection [mm]", title=name)
        _few_numbers(axes, 1e3 * index)
        if np.isfinite(index).any():
            least = int(np.nanargmin(index))
            axes.plot(a[least], 1e3 * index[least], "v", color=colour, markersize=8, linestyle="none",
                      label=f"minimum, {a[least]:.0f}°")  # fmt: skip
        for (choice, angle), style in zip((choices or {}).items(), ("--", ":", "-."), strict=False):
            deg = float(np.rad2deg(angle))
            axes.axvline(deg, color="0.3", linestyle=style, linewidth=1.2, label=f"{choice}, {deg:.0f}°")
    for j in range(3):
        if np.isfinite(frequency[:, j]).any():
            bottom.plot(a, frequency[:, j], color=AXES[j], label=f"mode along {'xyz'[j]}")
    highest = np.nanmax(frequency, initial=tooth[0])
    for n, f in enumerate(f for f in tooth if n_fits(f, highest)):
        bottom.axhline(f, color="black", linestyle="-" if n == 0 else "--", linewidth=0.9,
                       label={0: "tooth frequency", 1: "its harmonics"}.get(n))  # fmt: skip
    bottom.set(xlabel="angle A about the spindle [deg]", ylabel="frequency [Hz]", ylim=(0, 1.25 * highest),
               title="natural frequencies")  # fmt: skip
    for axes in (top, middle, bottom):
        edges = np.diff(np.concatenate([[0], ~reachable, [0]]).astype(int))
        half = (a[1] - a[0]) / 2
        for n, (first, end) in enumerate(zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)):
            axes.axvspan(a[first] - half, a[end - 1] + half, color="0.88", linewidth=0,
                         label="not reachable" if n == 0 and axes is top else None)  # fmt: skip
        axes.set_xlim(a[0], a[-1])
        if axes.get_legend_handles_labels()[0]:
            key_beside(axes)
    if not np.isfinite(dynamic).any():
        middle.text(0.5, 0.5, "no dynamic model", transform=middle.transAxes, ha="center", va="center")
    return figure


def _few_numbers(axes: Any, values: np.ndarray) -> None:
    """Set range and ticks of a logarithmic axis for positive values, which may lie within one decade."""
    if not np.isfinite(values).any():
        return
    low, high = 0.8 * np.nanmin(values), 1.25 * np.nanmax(values)
    axes.set_ylim(low, high)
    plain_logarithm(axes.yaxis)
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    axes.set_yticks([t for e in decades for t in 10.0**e * np.array([1, 2, 3, 5, 7]) if low < t < high])


def n_fits(f: float, highest: float) -> bool:
    """Return whether a tooth harmonic lies within the frequencies of the picture."""
    return f <= 1.25 * highest


@styled
def tests_figure(
    tooth: np.ndarray, predicted: Mapping[str, np.ndarray], measured: np.ndarray, chosen_by: Sequence[str], *,
    title: str = "",
) -> Figure:  # fmt: skip
    """Draw the mean deflection of each test [mm]: predicted by feed direction (bars) and measured (NaN if unknown)."""
    figure, (axes,) = with_panels(8.5, 4.0, grid=False)
    place, colours = np.arange(1, len(tooth) + 1), (SKY, BLUE)
    width = 0.7 / len(predicted)
    for n, (name, values) in enumerate(predicted.items()):
        axes.bar(
            place + (n - (len(predicted) - 1) / 2) * width,
            values,
            width,
            color=colours[n % 2],
            label=f"predicted, feed {name}",
        )
    none = ", ".join(str(k) for k in place[~np.isfinite(measured)])
    axes.plot(place, measured, "D", color="black", markersize=6, markeredgecolor="white", linestyle="none",
              label="measured, as published" + (f"; not published for tests {none}" if none else ""))  # fmt: skip
    axes.set_xticks(
        place, [f"{i}\n{f:g} Hz\n{c}" for i, f, c in zip(place, tooth, chosen_by, strict=True)], fontsize="small"
    )
    axes.set(
        ylabel="mean deflection [mm]",
        title=title,
        xlabel="test: number, tooth frequency, criterion for the choice of the pose",
    )
    axes.grid(axis="y", alpha=0.3)
    key_below(figure, axes)
    return figure


@styled
def lobes_figure(speed: np.ndarray, depth: np.ndarray, cut: tuple[float, float], *, title: str = "") -> Figure:
    """Draw the largest stable axial depth (n,) [m] over the spindle speed (n,) [1/s]; cut: declared speed and depth.

    If the depth is infinite nothing is shaded; if it is unknown (NaN) everything is.
    """
    figure, (axes,) = with_panels(8.0, 4.0)
    finite = np.where(np.isfinite(depth), 1e3 * depth, np.nan)
    some = np.isfinite(finite).any()
    top = 1.3 * max(1e3 * cut[1], float(np.nanpercentile(finite, 90)) if some else 0.0)
    if some:  # depths far above the cut are of no interest
        top = min(top, DEEP * max(1e3 * cut[1], float(np.nanmin(finite))))
    proven = np.where(np.isnan(depth), 0.0, np.where(np.isfinite(finite), finite, top))
    axes.fill_between(60 * speed, proven, top, color=ORANGE, alpha=0.18, linewidth=0,
                      label="not proven stable")  # fmt: skip
    axes.plot(60 * speed, finite, color=ORANGE, linewidth=1.2, label="largest depth proven stable")
    beyond = "" if speed[0] <= cut[0] <= speed[-1] else f" at {60 * cut[0]:g} rpm, not shown"
    axes.plot(60 * cut[0], 1e3 * cut[1], "o", color=BLUE, linestyle="none", label=f"declared cut{beyond}")
    axes.set(xlabel="spindle speed [rpm]", ylabel="axial depth [mm]", ylim=(0, top), title=title)
    axes.set_xlim(60 * speed[0], 60 * speed[-1])
    key_below(figure, axes, columns=3)
    return figure


@styled
def compensation_figure(
    time: np.ndarray, before: np.ndarray, after: Mapping[str, np.ndarray], *, title: str = ""
) -> Figure:
    """Draw the norm of the tool's error (t,) [m] over time [s], uncompensated and compensated, by name.

    The error oscillates with each tooth, so the maximum of each short time slice is drawn.
    """
    figure, (axes,) = with_panels(8.0, 4.4, title=title)
    slices = np.array_split(np.arange(len(time)), min(len(time), SLICES))
    middle = np.array([float(np.mean(time[rows])) for rows in slices])

    def largest(error: np.ndarray) -> np.ndarray:
        return np.array([1e3 * float(np.max(error[rows])) for rows in slices])

    axes.semilogy(middle, largest(before), color="0.6", label="not compensated")
    # largest error first, so that no curve hides another
    order = sorted(after, key=lambda name: -float(np.square(after[name]).mean()))
    for n, name in enumerate(order):
        look = ORDER[n] if n < len(ORDER) else curve(n + len(COLOURS))
        axes.semilogy(middle, largest(after[name]), label=name, **look)
    part = 1e3 * (time[-1] - time[0]) / len(slices)
    axes.set(xlabel="time [s]", ylabel="error of the tool [mm]", title=f"largest error in steps of {part:.3g} ms")
    axes.set_xlim(time[0], time[-1])
    key_below(figure, axes)
    return figure
