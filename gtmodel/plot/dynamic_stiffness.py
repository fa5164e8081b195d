"""Frequency responses with their fitted modes, frequencies over the pose, and predictions of held-out values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .style import COLOURS, HEIGHT, MEASURED, MODELLED, key_below, plain_logarithm, styled, with_panels

UNITS = {"m": ("kg", 1.0), "c": ("kN s/m", 1e-3), "k": ("MN/m", 1e-6)}
Q95 = 1.96  # standard deviations of a 95 % interval


@styled
def response_figure(shown: Sequence[tuple[str, Any, Any]], *, title: str = "") -> Figure:
    """Size and phase of receptances, a column each (compare Cvitanic 2021, Fig. 6).

    shown: name, gtmodel.vibration.FrequencyResponse and ModalFit of it. The fitted lines are dark, modes are marked.
    """
    figure, axes = with_panels(3.6 * len(shown), 5.6, 2, len(shown), title=title, fontsize="medium", sharex="col",
                               height_ratios=[2, 1])  # fmt: skip
    axes = axes.reshape(2, -1)
    for column, (name, response, fit) in zip(axes.T, shown, strict=True):
        top = 3 * float(fit.response.frequency[-1])
        rows = response.frequency <= top
        f, H = response.frequency[rows], response.receptance[rows]
        own, G = fit.response.frequency, fit.response.receptance
        fine = np.linspace(own[0], own[-1], 400)
        model = fit.at(2j * np.pi * fine + response.decay)
        for axis, of in zip(column, (lambda z: 1e6 * np.abs(z), lambda z: np.rad2deg(np.angle(z))), strict=True):
            axis.plot(f, of(H), ".", color="0.75", markersize=3, label="measured")
            axis.plot(own, of(G), label="measured, used for the fit", **MEASURED)
            axis.plot(fine, of(model), label="fitted modes", **MODELLED)
            for k, mode in enumerate(fit.fn):
                axis.axvline(
                    mode, color="black", linestyle=":", linewidth=0.8, label="natural frequency" if k == 0 else None
                )
        size = 1e6 * np.abs(H)
        column[0].set(yscale="log", ylim=(size[size > 0].min() / 2, 3 * 1e6 * np.abs(model).max()))
        low, high = fit.interval("fn[0]")
        said = f"{fit.fn[0]:.4g} Hz ({low:.4g}..{high:.4g}), {fit.m[0]:.3g} kg, zeta {fit.zeta[0]:.3g}"
        column[0].set_title(f"{name}\n{said}", fontsize="small")
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
    """Natural frequency of the softest direction (len(v), len(u)) [Hz] over two coordinates of the pose.

    Beside it its relative 95 % error; poses (n, 2): where was measured, whatever the other coordinates.
    """
    figure, (left, right) = with_panels(10.5, 4.6, 1, 2, title=title, grid=False, fontsize="medium", sharey=True)
    for axis, values, label, colours in (
        (left, frequency, "lowest natural frequency [Hz]", HEIGHT),
        (right, 100 * relative, "its relative 95 % error [%]", "magma_r"),
    ):
        drawn = axis.contourf(u, v, values, levels=14, cmap=colours)
        name, _, unit = label.partition(" [")
        figure.colorbar(drawn, ax=axis).ax.set_title(
            f"[{unit}", fontsize="small"
        )  # beside, it would name the next panel
        axis.plot(
            *poses.T,
            "o",
            color="white",
            markeredgecolor="black",
            markersize=4,
            linestyle="none",
            label="measured, other coordinates differ",
        )
        axis.set(xlabel=names[0], title=name)
    left.set_ylabel(names[1])
    key_below(figure, left)
    return figure


@styled
def held_out_figure(panels: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], *, title: str = "") -> Figure:
    """Predicted against measured values that the fit had not seen, one panel each, with 95 % intervals.

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
            (inside, COLOURS[0], "95 % interval of the prediction holds what was measured"),
            (~inside, COLOURS[1], "it does not"),
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
