"""Pictures of filters: estimates beside the truth, innovations beside what is expected of them, errors of the attitude
between references."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import (
    BLACK,  # fmt: skip
    BLUE,
    GREEN,
    HIGHLIGHT,
    LIMIT,
    ORANGE,
    PINK,
    SHADES,
    SKY,
    colour,
    curve,
    key_below,
    plain_logarithm,
    styled,
    with_panels,
)

BINS = 7  # of the time since the left reference: a reference in each of them


@styled
def gap_figure(
    panels: Sequence[tuple[float, np.ndarray, Mapping[str, np.ndarray]]], labels: Mapping[str, str], *, title: str = ""
) -> Figure:
    """One panel per length of gap: mean error over the time since the left end, one curve per method.

    panels: length of the gap [s], time since its left end (n,) [s], errors (n,) by method [rad]. labels: of methods.
    """
    figure, axes = with_panels(4.2 * len(panels), 4.2, 1, len(panels), title=title, sharey=True)
    axes = np.atleast_1d(axes).ravel()
    for panel, (gap, since, errors) in zip(axes, panels, strict=True):
        edges = np.linspace(0.0, float(since.max()), BINS + 1)
        place = np.clip(np.searchsorted(edges, since, side="right") - 1, 0, len(edges) - 2)
        full = [k for k in range(len(edges) - 1) if np.any(place == k)]
        middle = [float(np.mean(since[place == k])) for k in full]
        for n, (name, label) in enumerate(labels.items()):
            means = [float(np.degrees(np.mean(errors[name][place == k]))) for k in full]
            panel.semilogy(middle, np.maximum(means, 1e-3), label=label, **curve(n))
        panel.set(title=f"references {gap:g} s apart", xlabel="time since the left one [s]")
    axes[0].set_ylabel("mean error [deg]")
    key_below(figure, *axes, columns=2)
    return figure


@styled
def turn_residual_figure(parts: Sequence[tuple[np.ndarray, np.ndarray]], *, title: str = "") -> Figure:
    """Turns between neighbouring references less those of the gyro, calibrated on each part by itself.

    parts: time (n,) [s] and rotation vectors (n, 3) [rad] of each.
    """
    figure, panels = with_panels(7.0, 5.4, 3, 1, title=title, sharex=True)
    for k, panel in enumerate(panels):
        for n, (time, left) in enumerate(parts):
            panel.plot(time, np.degrees(left[:, k]), color=colour(n), linestyle="none", marker=".", markersize=3)
        panel.axhline(0.0, **LIMIT)
        panel.set_ylabel(f"about {'xyz'[k]} [deg]")
    panels[-1].set_xlabel("time of the reference [s]; the parts differ in colour")
    return figure


WIDTH = 9.0  # inches
SHORT = 25  # instants of one point of the comparison
COARSE = 50  # instants whose mean normalised innovation is one point
BAND = 0.999
LINES = {"slope of four": SKY, "tracker alone": ORANGE, "fused": BLUE, "smoothed": GREEN}


@styled
def error_figure(
    time: np.ndarray,
    errors: Mapping[str, np.ndarray],
    deviation: np.ndarray,
    *,
    axes: Sequence[str],
    pick: Sequence[int],
    title: str = "",
) -> Figure:
    """Errors of the velocity (n, 3) [m/s] by estimate, a panel for each axis, with two deviations of the fused."""
    figure, panels = with_panels(WIDTH, 1.2 + 2.6 * len(axes), len(axes), title=title, sharex=True)
    for panel, name, k in zip(panels, axes, pick, strict=True):
        for label, error in errors.items():
            panel.plot(time, 1e3 * error[:, k], color=LINES.get(label, PINK), linewidth=0.9, label=label)
        for sign in (-1, 1):
            label = "two deviations of the fused" if sign > 0 else None
            panel.plot(time, sign * 2e3 * deviation[:, k], "--", color=BLACK, linewidth=0.9, label=label)
        panel.set_ylabel(f"error of {name} velocity [mm/s]")
        panel.margins(x=0.0)
    panels[-1].set_xlabel("time [s]")
    key_below(figure)
    return figure


@styled
def baselines_figure(
    time: np.ndarray, errors: Mapping[str, np.ndarray], bend: np.ndarray, *, pick: Sequence[int], title: str = ""
) -> Figure:
    """Mean |error| of the velocity [m/s] in short stretches by method, and where the path bends (n,)."""
    figure, (panel,) = with_panels(WIDTH, 4.4, title=title)
    rows = len(time) // SHORT
    at = time[: rows * SHORT].reshape(rows, SHORT).mean(axis=1)
    for label, error in errors.items():
        size = np.abs(error[: rows * SHORT, pick]).mean(axis=1).reshape(rows, SHORT)
        panel.plot(at, 1e3 * size.mean(axis=1), color=LINES.get(label, PINK), linewidth=1.4, label=label)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(bend, int), [0]])))
    for n, (first, last) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        label = "at a bend" if n == 0 else None
        panel.axvspan(time[first], time[min(last, len(time) - 1)], color=HIGHLIGHT, zorder=0, label=label)
    panel.set(yscale="log", xlabel="time [s]", ylabel=f"mean |error| of {SHORT} instants [mm/s]")
    panel.margins(x=0.0)
    plain_logarithm(panel.yaxis)
    key_below(figure, columns=5)
    return figure


@styled
def estimates_figure(
    time: np.ndarray,
    estimates: Mapping[str, np.ndarray],
    deviations: Mapping[str, np.ndarray],
    smoothed: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    *,
    errors: bool = False,
    title: str = "",
) -> Figure:
    """Estimates (n, k) of each state, a panel for each, with bands of two deviations (n, d) where d = k; or their
    `errors`, with bands about zero."""
    figure, panels = with_panels(WIDTH, 1.2 + 2.1 * len(estimates), len(estimates), title=title, sharex=True)
    for panel, (name, values) in zip(panels, estimates.items(), strict=True):
        off = 2 * deviations[name]
        for k in range(values.shape[1]):
            label = name if values.shape[1] == 1 else f"{name}[{k}]"
            if off.shape == values.shape:
                middle = 0.0 if errors else values[:, k]
                panel.fill_between(time, middle - off[:, k], middle + off[:, k], color=colour(k), alpha=0.2)
            panel.plot(time, values[:, k], color=colour(k), linewidth=0.9, label=label)
            if name in smoothed:
                panel.plot(time, smoothed[name][:, k], "--", color=BLACK, linewidth=0.9, label=f"{label} smoothed")
        shown = f"error of {name}" if errors else name
        panel.set_ylabel(shown if units[name] in ("1", "?") else f"{shown} [{units[name]}]")
        panel.margins(x=0.0)
    panels[-1].set_xlabel("time [s]; bands of two deviations")
    key_below(figure, columns=4)
    return figure


@styled
def innovations_figure(
    time: np.ndarray,
    white: Mapping[str, np.ndarray],
    nis: np.ndarray,
    count: np.ndarray,
    chi_squared_ends: Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]],
    *,
    title: str = "",
) -> Figure:
    """Normalised innovations of each sensor (n, k) with two deviations, and the mean of the squares in short stretches
    with the band in which 99.9 % of a right filter's lie."""
    names = [name for name, values in white.items() if np.isfinite(values).any()]
    figure, panels = with_panels(WIDTH, 1.2 + 2.1 * (len(names) + 1), len(names) + 1, title=title, sharex=True)
    for panel, name in zip(panels, names, strict=False):
        colours = (BLUE, ORANGE, GREEN)
        for k in range(white[name].shape[1]):
            panel.plot(time, white[name][:, k], ".", markersize=1.2, color=colours[k % 3], label="xyz"[k % 3])
        for limit in (-2, 2):
            panel.axhline(limit, **LIMIT)
        panel.set(ylabel="[deviations]", title=f"innovations of the {name}")
    last = panels[-1]
    rows = len(nis) // COARSE
    if rows:
        cut = rows * COARSE
        numbers = count[:cut].reshape(rows, COARSE).sum(axis=1)
        mean = nis[:cut].reshape(rows, COARSE).sum(axis=1) / np.maximum(numbers, 1)
        ends = np.array(chi_squared_ends(BAND, np.maximum(numbers, 1))) / np.maximum(numbers, 1)
        at = time[:cut].reshape(rows, COARSE).mean(axis=1)
        last.fill_between(at, ends[0], ends[1], color=SHADES[1], label="99.9 % of a right filter's")
        last.plot(at, mean, ".-", color=BLUE, linewidth=0.8, label=f"mean of {COARSE} instants")
        last.set_yscale("log")
    last.set(ylabel="ratio [1]", xlabel="time [s]", title="squares of all innovations over what the filter expects")
    last.margins(x=0.0)
    plain_logarithm(last.yaxis)
    key_below(figure, columns=5)
    for handle in figure.legends[0].legend_handles if figure.legends else ():
        if isinstance(handle, Line2D):
            handle.set_markersize(5)
    return figure


@styled
def state_figure(
    time: np.ndarray, truth: np.ndarray, estimate: np.ndarray, deviation: np.ndarray, label: str, *, title: str = ""
) -> Figure:
    """One state over time: truth, estimate, and the error with two deviations."""
    figure, (above, below) = with_panels(WIDTH, 5.6, 2, title=title, sharex=True)
    above.plot(time, truth, color=BLACK, linewidth=2.0, label="truth")
    above.plot(time, estimate, color=BLUE, linewidth=0.9, label="fused")
    above.set(ylabel=label, title="estimate")
    below.plot(time, estimate - truth, color=BLUE, linewidth=0.9)
    for sign in (-1, 1):
        label_ = "two deviations about zero" if sign > 0 else None
        below.plot(time, sign * 2 * deviation, "--", color=BLACK, linewidth=0.9, label=label_)
    below.set(ylabel=label, title="error", xlabel="time [s]")
    below.margins(x=0.0)
    key_below(figure)
    return figure


@styled
def sweep_figure(
    values: Sequence[float],
    errors: Mapping[str, Sequence[float]],
    consistent: Sequence[bool],
    label: str,
    printed: float | None,
    *,
    title: str = "",
) -> Figure:
    """Velocity error of each method over one number of the sensors; open dots where the filter is not consistent."""
    figure, (panel,) = with_panels(7.0, 4.6, title=title)
    for name, error in errors.items():
        colour = LINES.get(name, PINK)
        panel.plot(values, 1e3 * np.asarray(error), "-", color=colour, label=name)
        if name == "fused":
            right = np.asarray(consistent, bool)
            x, y = np.asarray(values), 1e3 * np.asarray(error)
            panel.plot(x[right], y[right], "o", color=colour, label="innovations in their band")
            panel.plot(x[~right], y[~right], "o", color=colour, markerfacecolor="white", label="innovations outside it")
    if printed is not None:
        panel.axvline(printed, **LIMIT, label="limit of Table 10")
    if min(values) > 0:
        panel.set_xscale("log")
    panel.set(yscale="log", xlabel=label, ylabel="velocity error [mm/s]")
    key_below(figure, columns=3)
    return figure
