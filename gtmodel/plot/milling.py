"""Where to mill: indices and mode frequencies over the angle, printed tests, stability lobes, compensation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from .panels import COLOURS, curve, with_panels

STATIC, DYNAMIC, AXES = "#d55e00", "#0072b2", ("#0072b2", "#009e73", "#cc79a7")
ORDER: tuple[dict[str, Any], ...] = tuple(dict(color=c) for c in ("#56b4e9", STATIC, "black"))  # light below dark


def angle_figure(
    angles: np.ndarray, static: np.ndarray, dynamic: np.ndarray, frequency: np.ndarray, tooth: Sequence[float], *,
    reachable: np.ndarray, choices: Mapping[str, float] | None = None, title: str = "",
) -> Figure:  # fmt: skip
    """Static and dynamic index over the redundant angle, below them the modes.

    angles (n,) [rad]; static, dynamic (n,) [m], frequency (n, 3) [Hz], NaN where there is none; tooth: frequencies
    [Hz] to mark, the tooth frequency first, then its harmonics; reachable (n,); choices: name -> angle [rad].
    """
    figure, (top, bottom) = with_panels(8.5, 6.2, 2, sharex=True, height_ratios=(3, 2))
    a = np.rad2deg(angles)
    top.semilogy(a, 1e3 * static, color=STATIC, label="static index (18), under the peak force")
    if np.isfinite(dynamic).any():
        top.semilogy(a, 1e3 * dynamic, color=DYNAMIC, label="dynamic index (19), largest over time")
    marked = choices or {}
    for name, angle in marked.items():
        colour = STATIC if name.startswith("static") else DYNAMIC
        side = "right" if angle == min(marked.values()) else "left"
        top.axvline(np.rad2deg(angle), color=colour, linestyle=":", linewidth=1.2)
        top.annotate(f" {name} ", (float(np.rad2deg(angle)), 0.97), xycoords=("data", "axes fraction"), rotation=90,
                     fontsize="small", color=colour, ha=side, va="top")  # fmt: skip
    for j in range(3):
        if np.isfinite(frequency[:, j]).any():
            bottom.plot(a, frequency[:, j], color=AXES[j], label=f"mode along {'xyz'[j]}")
    highest = np.nanmax(frequency, initial=tooth[0])
    for n, f in enumerate(f for f in tooth if n_fits(f, highest)):
        bottom.axhline(f, color="black", linestyle="-" if n == 0 else "--", linewidth=0.9,
                       label="tooth frequency" if n == 0 else None)  # fmt: skip
    for axes in (top, bottom):
        edges = np.diff(np.concatenate([[0], ~reachable, [0]]).astype(int))
        half = (a[1] - a[0]) / 2
        for first, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            axes.axvspan(a[first] - half, a[end - 1] + half, color="0.88", linewidth=0)
        axes.set_xlim(a[0], a[-1])
    top.plot([], [], color="0.88", linewidth=8, label="not reachable")
    top.set(ylabel="deflection [mm]", title=title)
    bottom.set(xlabel="angle A about the spindle [deg]", ylabel="natural frequency [Hz]", ylim=(0, 1.25 * highest))
    top.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    top.yaxis.set_minor_formatter(NullFormatter())
    low, high = (f(np.concatenate([static, dynamic])) for f in (np.nanmin, np.nanmax))
    decades = range(int(np.floor(np.log10(0.7e3 * low))), int(np.ceil(np.log10(1.4e3 * high))) + 1)
    ticks = [t * 10.0**e for e in decades for t in (1, 2, 5)]
    top.set_yticks([t for t in ticks if 0.7e3 * low < t < 1.4e3 * high])
    top.set_ylim(0.8e3 * low, 1.25e3 * high)
    top.legend(fontsize="small", loc="best")
    if bottom.get_legend_handles_labels()[0]:
        bottom.legend(fontsize="small", loc="best", ncols=2)
    return figure


def n_fits(f: float, highest: float) -> bool:
    """Whether a tooth harmonic lies within the picture's frequencies."""
    return f <= 1.25 * highest


def tests_figure(
    tooth: np.ndarray, predicted: Mapping[str, np.ndarray], measured: np.ndarray, chosen_by: Sequence[str], *,
    title: str = "",
) -> Figure:  # fmt: skip
    """Mean deflection of each test [mm]: predicted bars by feed direction, measured ones beside them (NaN: none)."""
    figure, (axes,) = with_panels(8.5, 4.0, grid=False)
    place, colours = np.arange(1, len(tooth) + 1), ("#56b4e9", "#0072b2")
    width = 0.8 / (len(predicted) + 1)
    for n, (name, values) in enumerate(predicted.items()):
        axes.bar(place + (n - 1) * width, values, width, color=colours[n % 2], label=f"predicted, feed {name}")
    axes.bar(
        place + (len(predicted) - 1) * width, np.nan_to_num(measured), width, color="0.3", label="measured (print)"
    )
    axes.set_xticks(
        place, [f"{i}\n{f:g} Hz\n{c}" for i, f, c in zip(place, tooth, chosen_by, strict=True)], fontsize="small"
    )
    axes.set(ylabel="mean deflection [mm]", title=title, xlabel="test")
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize="small")
    return figure


def lobes_figure(speed: np.ndarray, depth: np.ndarray, cut: tuple[float, float], *, title: str = "") -> Figure:
    """Greatest stable axial depth (n,) [m] over spindle speed (n,) [1/s]; cut: speed and depth of the declared one.

    Where the depth is infinite nothing is shaded, where it is NaN, not known, everything.
    """
    figure, (axes,) = with_panels(8.0, 4.0)
    shown = np.where(np.isfinite(depth), 1e3 * depth, np.nan)
    top = 1.3 * max(1e3 * cut[1], float(np.nanpercentile(shown, 90)) if np.isfinite(shown).any() else 0.0)
    proven = np.where(np.isnan(depth), 0.0, np.where(np.isfinite(shown), shown, top))
    axes.fill_between(60 * speed, proven, top, color="#d55e00", alpha=0.18, linewidth=0,
                      label="not proven stable")  # fmt: skip
    axes.plot(60 * speed, shown, color="#d55e00", linewidth=1.2)
    beyond = "" if speed[0] <= cut[0] <= speed[-1] else f" at {60 * cut[0]:g} rpm, not shown"
    axes.plot(60 * cut[0], 1e3 * cut[1], "o", color="#0072b2", label=f"declared cut{beyond}")
    axes.set(xlabel="spindle speed [rpm]", ylabel="axial depth [mm]", ylim=(0, top), title=title)
    axes.set_xlim(60 * speed[0], 60 * speed[-1])
    axes.legend(fontsize="small")
    return figure


def compensation_figure(
    time: np.ndarray, before: np.ndarray, after: Mapping[str, np.ndarray], *, title: str = ""
) -> Figure:
    """Norm of the tool's error (t,) [m] over time [s], without and with offsets, by name."""
    figure, (axes,) = with_panels(8.0, 4.0)
    axes.plot(time, 1e3 * before, color="0.6", linewidth=0.7, label="not compensated")
    # largest first, so that none hides another
    order = sorted(after, key=lambda name: -float(np.square(after[name]).mean()))
    for n, name in enumerate(order):
        axes.plot(
            time,
            1e3 * after[name],
            linewidth=0.9,
            label=name,
            **ORDER[n] if n < len(ORDER) else curve(n + len(COLOURS)),
        )
    axes.set(xlabel="time [s]", ylabel="error of the tool [mm]", title=title)
    axes.set_xlim(time[0], time[-1])
    axes.set_ylim(bottom=0)
    axes.legend(fontsize="small", loc="center right")
    return figure
