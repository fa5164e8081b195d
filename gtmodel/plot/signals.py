"""Pictures of trajectories over time: signals by unit, energy balance, simulated against measured motion, tracking of
a reference."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .style import COLOURS, MEASURED, STYLES, colour, curve, key_below, key_beside, styled, with_panels

ENERGIES = ("energy.stored", "energy.supplied", "energy.dissipated")
PANEL_HEIGHT = 2.1  # inches
LETTERS = 18  # characters of the axis label of a panel


@styled
def signals_figure(
    trajectory: Trajectory, names: Iterable[str] | None = None, *, marks: Sequence[float] = ()
) -> Figure:
    """Draw signals over time, one panel per unit; the components of a vector share a line style.

    Args:
        names: signals to draw; by default all except the energies, which `energy_figure` draws.
        marks: times [s] marked by a thin line in every panel, such as state changes.
    """
    chosen = [n for n in trajectory.names if n not in ENERGIES] if names is None else list(names)
    panels: dict[str, list[str]] = {}
    for name in chosen:
        panels.setdefault(trajectory.unit(name), []).append(name)
    count = max(1, len(panels))
    figure, stack = with_panels(8.5, 1.2 + PANEL_HEIGHT * count, count, title=trajectory.title, sharex=True)
    for axes, (unit, members) in zip(stack, panels.items(), strict=False):
        for k, name in enumerate(members):
            _draw(axes, trajectory, name, k)
        _finish(axes, called(members, unit))
        for time in marks:
            axes.axvline(time, color="0.75", linewidth=0.6, zorder=0)
    stack[-1].set_xlabel("time [s]")
    return figure


@styled
def energy_figure(trajectory: Trajectory) -> Figure:
    """Draw the change of the stored energy with the supplied and dissipated energy, and below the balance error.

    trajectory: with energy.stored, energy.supplied and energy.dissipated [J].
    """
    stored, supplied, dissipated = (trajectory[name] for name in ENERGIES)
    figure, (terms, error) = with_panels(8.5, 5.4, 2, title=trajectory.title, sharex=True, height_ratios=(2, 1))
    rows = {"change of stored": stored - stored[0], "supplied": supplied, "dissipated": dissipated}
    for (label, row), color in zip(rows.items(), COLOURS, strict=False):
        terms.plot(trajectory.time, row, color=color, label=label)
    _finish(terms, "energy [J]")
    terms.set_title("energy balance")
    error.plot(trajectory.time, stored - stored[0] - supplied + dissipated, color="black")
    error.set_title("balance error: change of stored - supplied + dissipated")
    error.set_ylabel("error [J]")
    error.set_xlabel("time [s]")
    return figure


def _draw(axes: Axes, trajectory: Trajectory, name: str, n: int) -> None:
    """Draw signal n of a panel, counted from 0, with one line style and a colour per component; if that pair is in use,
    take the next free one."""
    values = trajectory[name]
    columns = values.reshape(len(values), -1)
    for k in range(columns.shape[1]):
        # scalars of one unit are distinguished by colour
        colour = len(axes.get_lines()) if values.ndim == 1 else k
        used = {(line.get_color(), line.get_linestyle()) for line in axes.get_lines()}
        pairs = [(COLOURS[(colour + i) % len(COLOURS)], STYLES[(n + j) % len(STYLES)])
                 for j in range(len(STYLES)) for i in range(len(COLOURS))]  # fmt: skip
        color, style = next((p for p in pairs if p not in used), pairs[0])
        label = name if values.ndim == 1 else f"{name}[{k}]"
        axes.plot(trajectory.time, columns[:, k], style, color=color, label=label)


def called(names: Sequence[str], unit: str) -> str:
    """Return an axis label: the names of the signals, as many as fit, with their unit."""
    fitting = []
    for name in names:
        if fitting and len(", ".join([*fitting, name])) > LETTERS:
            fitting.append("...")
            break
        fitting.append(name)
    return f"{', '.join(fitting)} [{unit or '1'}]"


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    axes.margins(x=0.0)
    key_beside(axes)


@styled
def closed_loop_figure(runs: Sequence[tuple[str, Trajectory]], *, title: str = "") -> Figure:
    """Draw the motion of each recording, and below it the error in millionths of the unit (µm, µrad).

    runs: name and trajectory of each recording, with "measured" and "simulated", (n,) or (n, axes) each.
    """
    n = len(runs)
    figure, panels = with_panels(8.5, 1.0 + 3.8 * n, 2 * n, title=title, height_ratios=[2, 1] * n)
    for k, (name, trajectory) in enumerate(runs):
        motion, error = panels[2 * k], panels[2 * k + 1]
        motion.sharex(error)
        unit, time = trajectory.unit("measured"), trajectory.time
        measured, simulated = (trajectory[n].reshape(len(time), -1) for n in ("measured", "simulated"))
        for i in range(measured.shape[1]):
            axis = "" if measured.shape[1] == 1 else f", axis {i + 1}"
            motion.plot(time, simulated[:, i], color=COLOURS[i % len(COLOURS)], linewidth=2.2, label=f"simulated{axis}")
            motion.plot(time, measured[:, i], markevery=max(1, len(time) // 400), label=f"measured{axis}", **MEASURED)
            error.plot(time, 1e6 * (simulated - measured)[:, i], color=COLOURS[i % len(COLOURS)], linewidth=0.8)
        motion.set_ylabel(f"position [{unit}]")
        motion.tick_params(labelbottom=False)
        if len(runs) > 1:
            motion.set_title(name, fontsize="medium")
        rms = 1e6 * float(np.sqrt(np.mean((simulated - measured) ** 2)))
        error.set(ylabel=f"error [µ{unit}]", title=f"simulated - measured, {rms:.3g} µ{unit} rms")
        error.title.set_fontsize("small")
        for axes in (motion, error):
            axes.margins(x=0.0)
        key_beside(motion)
    panels[-1].set_xlabel("time [s]")
    return figure


@styled
def sampled_loop_figure(motion: Trajectory, samples: Trajectory, *, title: str = "") -> Figure:
    """Draw the displacement of each axis with its reference, the error in µm, and the motor forces.

    Args:
        motion: "reference", "position" and "forces", (n, axes) each.
        samples: of the control law, with the "forces" that it computed.
    """
    figure, (position, error, force) = with_panels(8.5, 8.0, 3, title=title, sharex=True)
    time = motion.time
    for k in range(motion["position"].shape[1]):
        begin = motion["reference"][0, k]
        position.plot(time, motion["position"][:, k] - begin, color=colour(k), label=f"axis {k + 1}")
        position.plot(time, motion["reference"][:, k] - begin, color="black", linewidth=0.8, linestyle="--", zorder=3)
        error.plot(time, 1e6 * (motion["reference"] - motion["position"])[:, k], color=colour(k), linewidth=0.9)
        force.step(time, motion["forces"][:, k], where="pre", color=colour(k), linewidth=0.9)
    position.set_ylabel("displacement [m]")
    position.set_title("displacement from the start; dashed: reference")
    error.set_ylabel("error [µm]")
    force.set_ylabel("motor force [N]")
    spacing = float(np.median(np.diff(samples.time))) if len(samples) > 1 else 0.0
    force.set_title(f"held between {len(samples)} samples, one every {1e3 * spacing:g} ms")
    force.set_xlabel("time [s]")
    for axes in (position, error, force):
        axes.margins(x=0.0)
    key_beside(position)
    return figure


_AXES = "xyz"
SMALLEST_MM = 1e-3  # below any measurement; zero has no logarithm


@styled
def tracking_figure(wanted: Trajectory, runs: Mapping[str, Trajectory], title: str = "") -> Figure:
    """Draw the tool centre point of each run with the reference, and below the errors of tool centre point and carts.

    Args:
        wanted: the reference, T (n, 3) [m] and q (n, k) [m, rad], a row per cycle.
        runs: by label, T and q of the cycles of each run.
    """
    figure, panels = with_panels(8.5, 9.0, 5, title=title, sharex=True)
    for k, axes in enumerate(panels[:3]):
        axes.plot(wanted.time, wanted["T"][:, k], color="black", linewidth=1.0, label="reference")
        for n, (label, run) in enumerate(runs.items(), 1):
            axes.plot(run.time, run["T"][:, k], linewidth=1.2, label=label, **_dashed(n))
        axes.set_ylabel(f"TCP {_AXES[k]} [m]")
    for name, axes in zip(("T", "q"), panels[3:], strict=True):
        for n, (label, run) in enumerate(runs.items(), 1):
            error = 1e3 * (run[name] - wanted[name][: len(run)])
            size = np.linalg.norm(error, axis=1) if name == "T" else np.abs(error).max(axis=1)
            axes.plot(run.time, np.maximum(size, SMALLEST_MM), label=label, **curve(n))
        axes.set_yscale("log")
        axes.set_ylim(bottom=SMALLEST_MM / 2)
        worst = "worst cart [mm]" if wanted.unit("q") == "m" else "worst joint [mrad]"
        axes.set_ylabel("TCP error [mm]" if name == "T" else worst)
    panels[0].set_xlim(wanted.time[0], wanted.time[-1])
    figure.align_ylabels(panels)
    panels[3].set_title(f"errors; values below {1e3 * SMALLEST_MM:g} µm are drawn as {1e3 * SMALLEST_MM:g} µm")
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0])
    return figure


def _dashed(n: int) -> dict[str, Any]:
    """Return the look of curve n: never a solid line, so that a solid reference stays visible."""
    return dict(color=colour(n), linestyle=STYLES[1:][n // len(COLOURS) % 3])
