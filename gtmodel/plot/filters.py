"""Pictures of filters: estimates and errors, innovations with their expected bands, attitude errors between
references."""

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

BINS = 7  # of the time since the previous reference


@styled
def gap_figure(
    panels: Sequence[tuple[float, np.ndarray, Mapping[str, np.ndarray]]], labels: Mapping[str, str], *, title: str = ""
) -> Figure:
    """Draw the mean error over the time since the previous reference, a panel per gap length and a curve per method.

    panels: length of the gap [s], time since its start (n,) [s], errors (n,) by method [rad]. labels: of the methods.
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
        panel.set(title=f"references {gap:g} s apart", xlabel="time since the previous one [s]")
    axes[0].set_ylabel("mean error [deg]")
    key_below(figure, *axes, columns=2)
    return figure


@styled
def turn_residual_figure(parts: Sequence[tuple[np.ndarray, np.ndarray]], *, title: str = "") -> Figure:
    """Draw the rotations between successive references minus those of the gyro, calibrated on each part separately.

    parts: time (n,) [s] and rotation vectors (n, 3) [rad] of each part.
    """
    figure, panels = with_panels(7.0, 5.4, 3, 1, title=title, sharex=True)
    for k, panel in enumerate(panels):
        for n, (time, residual) in enumerate(parts):
            panel.plot(time, np.degrees(residual[:, k]), color=colour(n), linestyle="none", marker=".", markersize=3)
        panel.axhline(0.0, **LIMIT)
        panel.set_ylabel(f"about {'xyz'[k]} [deg]")
    panels[-1].set_xlabel("time of the reference [s]; one colour per part")
    return figure


WIDTH = 9.0  # inches
SHORT = 25  # samples averaged per point of the comparison
COARSE = 50  # samples averaged per point of the normalised innovations
BAND = 0.999
LINES = {"slope of four positions": SKY, "tracker alone": ORANGE, "fused": BLUE, "smoothed": GREEN}


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
    """Draw the velocity errors (n, 3) [m/s] of each estimate, a panel per axis, with ±2 standard deviations (fused)."""
    figure, panels = with_panels(WIDTH, 1.2 + 2.6 * len(axes), len(axes), title=title, sharex=True)
    for panel, name, k in zip(panels, axes, pick, strict=True):
        for label, error in errors.items():
            panel.plot(time, 1e3 * error[:, k], color=LINES.get(label, PINK), linewidth=0.9, label=label)
        for sign in (-1, 1):
            label = "±2 standard deviations, fused" if sign > 0 else None
            panel.plot(time, sign * 2e3 * deviation[:, k], "--", color=BLACK, linewidth=0.9, label=label)
        panel.set_ylabel(f"error of velocity {name} [mm/s]")
        panel.margins(x=0.0)
    panels[-1].set_xlabel("time [s]")
    key_below(figure)
    return figure


@styled
def baselines_figure(
    time: np.ndarray, errors: Mapping[str, np.ndarray], bend: np.ndarray, *, pick: Sequence[int], title: str = ""
) -> Figure:
    """Draw the mean |error| of the velocity [m/s] over short stretches by method; bend: mask (n,) of marked times."""
    figure, (panel,) = with_panels(WIDTH, 4.4, title=title)
    rows = len(time) // SHORT
    middle = time[: rows * SHORT].reshape(rows, SHORT).mean(axis=1)
    for label, error in errors.items():
        size = np.abs(error[: rows * SHORT, pick]).mean(axis=1).reshape(rows, SHORT)
        panel.plot(middle, 1e3 * size.mean(axis=1), color=LINES.get(label, PINK), linewidth=1.4, label=label)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(bend, int), [0]])))
    for n, (first, last) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        label = "bend of the path" if n == 0 else None
        panel.axvspan(time[first], time[min(last, len(time) - 1)], color=HIGHLIGHT, zorder=0, label=label)
    panel.set(yscale="log", xlabel="time [s]", ylabel=f"mean |error| over {SHORT} samples [mm/s]")
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
    """Draw the estimates (n, k) of each state in a panel, with bands of ±2 standard deviations (n, d) if d = k.

    errors: the values are errors, with bands about zero.
    """
    figure, panels = with_panels(WIDTH, 1.2 + 2.1 * len(estimates), len(estimates), title=title, sharex=True)
    for panel, (name, values) in zip(panels, estimates.items(), strict=True):
        band = 2 * deviations[name]
        for k in range(values.shape[1]):
            label = name if values.shape[1] == 1 else f"{name}[{k}]"
            if band.shape == values.shape:
                middle = 0.0 if errors else values[:, k]
                panel.fill_between(time, middle - band[:, k], middle + band[:, k], color=colour(k), alpha=0.2)
            panel.plot(time, values[:, k], color=colour(k), linewidth=0.9, label=label)
            if name in smoothed:
                panel.plot(time, smoothed[name][:, k], "--", color=BLACK, linewidth=0.9, label=f"{label}, smoothed")
        quantity = f"error of {name}" if errors else name
        panel.set_ylabel(quantity if units[name] in ("1", "?") else f"{quantity} [{units[name]}]")
        panel.margins(x=0.0)
    panels[-1].set_xlabel("time [s]; bands: ±2 standard deviations")
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
    """Draw the normalised innovations (n, k) of each sensor with limits at ±2, and below the mean of their squares over
    short stretches with the 99.9 % band of a consistent filter."""
    names = [name for name, values in white.items() if np.isfinite(values).any()]
    figure, panels = with_panels(WIDTH, 1.2 + 2.1 * (len(names) + 1), len(names) + 1, title=title, sharex=True)
    for panel, name in zip(panels, names, strict=False):
        colours, parts = (BLUE, ORANGE, GREEN), white[name].shape[1]
        for k in range(parts):
            label = "xyz"[k % 3] if parts > 1 else None
            panel.plot(time, white[name][:, k], ".", markersize=1.2, color=colours[k % 3], label=label)
        for limit in (-2, 2):
            panel.axhline(limit, **LIMIT)
        panel.set(ylabel="normalised [1]", title=f"innovations of the {name}")
    last = panels[-1]
    rows = len(nis) // COARSE
    if rows:
        cut = rows * COARSE
        numbers = count[:cut].reshape(rows, COARSE).sum(axis=1)
        mean = nis[:cut].reshape(rows, COARSE).sum(axis=1) / np.maximum(numbers, 1)
        ends = np.array(chi_squared_ends(BAND, np.maximum(numbers, 1))) / np.maximum(numbers, 1)
        middle = time[:cut].reshape(rows, COARSE).mean(axis=1)
        last.fill_between(middle, ends[0], ends[1], color=SHADES[1], label="99.9 % band of a consistent filter")
        last.plot(middle, mean, ".-", color=BLUE, linewidth=0.8, label=f"mean over {COARSE} samples")
        last.set_yscale("log")
    last.set(ylabel="ratio [1]", xlabel="time [s]", title="squared innovations / value that the filter expects")
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
    """Draw one state over time: truth, estimate, and the error with ±2 standard deviations."""
    figure, (above, below) = with_panels(WIDTH, 5.6, 2, title=title, sharex=True)
    above.plot(time, estimate, color=BLUE, linewidth=2.0, label="fused")
    above.plot(time, truth, "--", color=BLACK, linewidth=0.9, label="truth")
    above.set(ylabel=label, title="estimate")
    below.plot(time, estimate - truth, color=BLUE, linewidth=0.9)
    for sign in (-1, 1):
        label_ = "±2 standard deviations" if sign > 0 else None
        below.plot(time, sign * 2 * deviation, color="0.4", linewidth=0.9, label=label_)
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
    """Draw the velocity error of each method over one sensor parameter; open dots if the filter is not consistent."""
    figure, (panel,) = with_panels(7.0, 4.6, title=title)
    for name, error in errors.items():
        colour = LINES.get(name, PINK)
        panel.plot(values, 1e3 * np.asarray(error), "-", color=colour, label=name)
        if name == "fused":
            ok = np.asarray(consistent, bool)
            x, y = np.asarray(values), 1e3 * np.asarray(error)
            panel.plot(x[ok], y[ok], "o", color=colour, label="innovations in their band")
            panel.plot(x[~ok], y[~ok], "o", color=colour, markerfacecolor="white", label="innovations outside it")
    if printed is not None:
        panel.axvline(printed, **LIMIT, label="limit of Table 10")
    if min(values) > 0:
        panel.set_xscale("log")
    panel.set(yscale="log", xlabel=label, ylabel="velocity error [mm/s]")
    key_below(figure, columns=3)
    return figure
