"""Pictures of a robot's deflection: maps over a section, joint stiffness with intervals, frequency responses with
fitted modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .style import COLOURS, HEIGHT, MEASURED, MODELLED, key_below, plain_logarithm, styled, with_panels
from .workspace import mark_guideways

LEVELS = 12
DASHES = 22  # directions drawn along the longer side
DASH = 0.6  # length of a dash, relative to their distance
TAIL = 99.0  # percentile; larger values, near singular poses, would take all the colours
BORDER = 0.15  # around the map [m]
ROOM, MAP, WIDTHS = 2.3, 4.6, (6.0, 9.0)  # inches: beside a map, its height, of the figure


@styled
def map_figure(
    u: np.ndarray,
    v: np.ndarray,
    values: np.ndarray,
    *,
    label: str,
    marks: np.ndarray,
    directions: np.ndarray | None = None,
    point: np.ndarray | None = None,
    title: str = "",
    names: tuple[str, str] = ("u", "v"),
) -> Figure:
    """Draw a contour map of a quantity over a section.

    Args:
        u, v: coordinates of the grid [m]. values: (len(u), len(v)), NaN if undefined. label: quantity with its unit.
        marks: (m, 2), intersections of the guideways with the section [m].
        directions: (len(u), len(v), 2), unit vectors projected into the section, drawn as dashes.
        point: (2,), the pose whose numbers are reported.
    """
    figure, (axes,) = with_panels(7.5, 6.0, grid=False)
    known = np.ma.masked_invalid(values).T
    if known.count():
        top = float(np.percentile(known.compressed(), TAIL))
        levels = MaxNLocator(LEVELS).tick_values(known.min(), max(top, known.min() * 1.001))
        extend = "max" if levels[-1] < known.max() else "neither"
        filled = axes.contourf(u, v, known, levels, cmap=HEIGHT, extend=extend)
        axes.contour(u, v, known, filled.levels, colors="white", linewidths=0.4)
        figure.colorbar(filled, ax=axes, label=label)
    if directions is not None:
        step = max(1, -(-max(len(u), len(v)) // DASHES))
        every = slice(step // 2, None, step)
        x, y = np.meshgrid(u[every], v[every], indexing="ij")
        d = directions[every, every]
        spacing = step * max(np.ptp(u) / (len(u) - 1), np.ptp(v) / (len(v) - 1))
        axes.quiver(x, y, d[..., 0], d[..., 1], angles="xy", pivot="mid", headwidth=0, headlength=0, headaxislength=0,
                    color="white", width=0.003, scale_units="xy", scale=1 / (DASH * spacing))  # fmt: skip
        axes.plot([], [], "-", color="0.6", label="most compliant direction, projected into the section (white)")
    if point is not None:
        axes.plot(
            *point,
            "o",
            color=COLOURS[1],
            markersize=7,
            linestyle="none",
            markeredgecolor="white",
            label="reported pose",
        )
    mark_guideways(axes, marks)
    axes.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]", title=title)
    if known.count():
        inside = ~np.ma.getmaskarray(known)
        ranges = []
        for limit, c, along, others in ((axes.set_xlim, u, 0, marks[:, 0]), (axes.set_ylim, v, 1, marks[:, 1])):
            drawn = np.concatenate([np.asarray(c)[inside.any(axis=along)], others])
            limit(drawn.min() - BORDER, drawn.max() + BORDER)
            ranges.append(np.ptp(drawn) + 2 * BORDER)
        # as wide as the map, with room for the colour bar
        figure.set_size_inches(float(np.clip(ROOM + MAP * ranges[0] / ranges[1], *WIDTHS)), 6.0)
    axes.set_aspect("equal")
    key_below(figure, axes, columns=2)
    return figure


@styled
def shares_figure(shares: Mapping[str, float], *, title: str = "") -> Figure:
    """Draw the share of each compliant element in the work of a load, 0 to 1."""
    figure, (axes,) = with_panels(7.5, 2.6, grid=False)
    names = list(shares)[::-1]
    bars = axes.barh(names, [100 * shares[n] for n in names], color=COLOURS[0])
    axes.bar_label(bars, fmt="%.0f %%", padding=3)
    axes.set(xlim=(0, 112 * max(shares.values())), xlabel="share of the work [%]", title=title)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


MARKERS = ("o", "s", "D")
APART = 0.16  # offset between methods; joints are 1 apart


@styled
def stiffness_figure(
    fits: Sequence[tuple[str, np.ndarray, np.ndarray]], true: np.ndarray | None = None, *, title: str = ""
) -> Figure:
    """Draw the stiffness of each joint with its interval, one point per method.

    fits: name of a method, stiffness (k,) and intervals (k, 2) [N.m/rad]; true (k,): stiffness of synthetic tests.
    Values that are not positive are left out; an interval without an upper end is drawn as an arrow.
    """
    figure, (axes,) = with_panels(7.0, 4.2)
    for m, (name, K, ends) in enumerate(fits):
        place = np.arange(1, len(K) + 1) + APART * (m - (len(fits) - 1) / 2)
        K, ends = K / 1e6, ends / 1e6
        positive = (K > 0) & (ends[:, 0] > 0)
        open_end = positive & ~np.isfinite(ends[:, 1])
        high = np.where(open_end, 2 * K, ends[:, 1])
        bars = np.abs(np.stack([K - ends[:, 0], high - K]))
        style = dict(color=COLOURS[m % 3], marker=MARKERS[m % 3], linestyle="none", markersize=5, capsize=3)
        axes.errorbar(place[positive], K[positive], bars[:, positive], lolims=open_end[positive], label=name, **style)
    if true is not None:
        k = np.arange(1, len(true) + 1)
        axes.hlines(true / 1e6, k - 0.3, k + 0.3, color="black", linewidth=0.8, label="true")
    axes.set(xlabel="joint", ylabel="stiffness [MN m/rad]", yscale="log", title=title)
    plain_logarithm(axes.yaxis)
    key_below(figure, axes)
    return figure


UNITS = {"m": ("kg", 1.0), "c": ("kN s/m", 1e-3), "k": ("MN/m", 1e-6)}
Q95 = 1.96  # standard deviations of a 95 % interval


@styled
def response_figure(shown: Sequence[tuple[str, Any, Any]], *, title: str = "") -> Figure:
    """Draw magnitude and phase of receptances, a column each (compare Cvitanic 2021, Fig. 6).

    shown: name, gtmodel.vibration.FrequencyResponse and its ModalFit. The frequencies used for the fit are dark, modes
    are marked.
    """
    figure, axes = with_panels(3.6 * len(shown), 5.6, 2, len(shown), title=title, fontsize="medium", sharex="col",
                               height_ratios=[2, 1])  # fmt: skip
    axes = axes.reshape(2, -1)
    for column, (name, response, fit) in zip(axes.T, shown, strict=True):
        top = 3 * float(fit.response.frequency[-1])
        rows = response.frequency <= top
        f, H = response.frequency[rows], response.receptance[rows]
        fitted, G = fit.response.frequency, fit.response.receptance
        fine = np.linspace(fitted[0], fitted[-1], 400)
        model = fit.at(2j * np.pi * fine + response.decay)
        for axis, part in zip(column, (lambda z: 1e6 * np.abs(z), lambda z: np.rad2deg(np.angle(z))), strict=True):
            axis.plot(f, part(H), ".", color="0.75", markersize=3, label="measured")
            axis.plot(fitted, part(G), label="measured, used for the fit", **MEASURED)
            axis.plot(fine, part(model), label="fitted modes", **MODELLED)
            for k, mode in enumerate(fit.fn):
                axis.axvline(
                    mode, color="black", linestyle=":", linewidth=0.8, label="natural frequency" if k == 0 else None
                )
        size = 1e6 * np.abs(H)
        column[0].set(yscale="log", ylim=(size[size > 0].min() / 2, 3 * 1e6 * np.abs(model).max()))
        low, high = fit.interval("fn[0]")
        numbers = f"{fit.fn[0]:.4g} Hz ({low:.4g}..{high:.4g}), {fit.m[0]:.3g} kg, zeta {fit.zeta[0]:.3g}"
        column[0].set_title(f"{name}\n{numbers}", fontsize="small")
        column[1].set(xlabel="frequency [Hz]", ylim=(-190, 190), yticks=[-180, -90, 0, 90, 180], xlim=(0, top))
    for size, phase in axes.T:
        size.set_ylabel("receptance [µm/N]")
        phase.set_ylabel("phase [deg]")
    key_below(figure, axes[0, 0])
    return figure


@styled
def lowest_frequency_figure(
    u: np.ndarray, v: np.ndarray, frequency: np.ndarray, relative: np.ndarray, poses: np.ndarray, *,
    names: tuple[str, str], title: str = "",
) -> Figure:  # fmt: skip
    """Draw the lowest natural frequency (len(v), len(u)) [Hz] and its relative 95 % error over two pose coordinates.

    poses (n, 2): measured poses; their other coordinates may differ from those of the map.
    """
    figure, (left, right) = with_panels(10.5, 4.6, 1, 2, title=title, grid=False, fontsize="medium", sharey=True)
    for axis, values, label, colours in (
        (left, frequency, "lowest natural frequency [Hz]", HEIGHT),
        (right, 100 * relative, "its relative 95 % error [%]", "magma_r"),
    ):
        drawn = axis.contourf(u, v, values, levels=14, cmap=colours)
        name, _, unit = label.partition(" [")
        # above the bar: beside it, the unit would seem to belong to the next panel
        figure.colorbar(drawn, ax=axis).ax.set_title(f"[{unit}", fontsize="small")
        axis.plot(
            *poses.T,
            "o",
            color="white",
            markeredgecolor="black",
            markersize=4,
            linestyle="none",
            label="measured poses (other coordinates differ)",
        )
        axis.set(xlabel=names[0], title=name)
    left.set_ylabel(names[1])
    key_below(figure, left)
    return figure


@styled
def held_out_figure(panels: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], *, title: str = "") -> Figure:
    """Draw predicted over measured held-out values with 95 % intervals, one panel per quantity.

    panels: "m in x" -> predicted (n,), measured (n,), standard deviation of the logarithm (n,).
    """
    columns = 3
    rows = -(-len(panels) // columns)
    figure, axes = with_panels(3.5 * columns, 3.1 * rows, rows, columns, title=title, fontsize="medium")
    for axis, (name, (predicted, measured, std)) in zip(axes, panels.items(), strict=False):
        unit, scale = UNITS[name[0]]
        predicted, measured = scale * predicted, scale * measured
        half = np.exp(Q95 * std)
        inside = (measured < predicted * half) & (measured > predicted / half)
        for rows_, colour, label in (
            (inside, COLOURS[0], "measured value inside the 95 % interval"),
            (~inside, COLOURS[1], "outside"),
        ):
            bars = np.stack([predicted - predicted / half, predicted * half - predicted])[:, rows_]
            axis.errorbar(measured[rows_], predicted[rows_], yerr=bars, fmt="o", color=colour, markersize=3,
                          elinewidth=0.6, label=label)  # fmt: skip
        ends = [measured.min() / 1.2, measured.max() * 1.2]
        axis.plot(ends, ends, color="black", linewidth=0.8, label="predicted = measured")
        axis.set(xscale="log", yscale="log", title=f"{name}: {inside.sum()} of {len(inside)} inside", xlim=ends)
        axis.set(xlabel=f"measured [{unit}]", ylabel=f"predicted [{unit}]")
        for ticks in (axis.xaxis, axis.yaxis):
            plain_logarithm(ticks)
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    key_below(figure)
    return figure
