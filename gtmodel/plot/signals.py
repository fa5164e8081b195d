"""Signals of any trajectory over time, one panel for each unit: its energy balance, a simulated motion beside the
measured one, how well a reference was followed."""

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
LETTERS = 18  # of names along a panel


@styled
def signals_figure(
    trajectory: Trajectory, names: Iterable[str] | None = None, *, marks: Sequence[float] = ()
) -> Figure:
    """Stacked panels with a common time axis, one for each unit; the components of a vector share a line style.

    Args:
        names: what to draw; by default everything but the energies, which `energy_figure` draws.
        marks: times [s] that a thin line marks in every panel, such as changes of states.
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
    """Change of the stored energy against what was supplied and dissipated; below, by how much they disagree.

    The trajectory holds energy.stored, energy.supplied and energy.dissipated [J].
    """
    stored, supplied, dissipated = (trajectory[name] for name in ENERGIES)
    figure, (terms, error) = with_panels(8.5, 5.4, 2, title=trajectory.title, sharex=True, height_ratios=(2, 1))
    rows = {"stored, since the start": stored - stored[0], "supplied": supplied, "dissipated": dissipated}
    for (label, row), own in zip(rows.items(), COLOURS, strict=False):
        terms.plot(trajectory.time, row, color=own, label=label)
    _finish(terms, "energy [J]")
    terms.set_title("where the energy goes")
    error.plot(trajectory.time, stored - stored[0] - supplied + dissipated, color="black")
    error.set_title("error of the balance: stored - supplied + dissipated")
    error.set_ylabel("error [J]")
    error.set_xlabel("time [s]")
    return figure


def _draw(axes: Axes, trajectory: Trajectory, name: str, n: int) -> None:
    """The n-th signal of a panel, from 0: one style, a colour for each component; the next free pair where it is
    taken already."""
    values = trajectory[name]
    columns = values.reshape(len(values), -1)
    for k in range(columns.shape[1]):
        # scalars of one unit are distinguished by colour
        colour = len(axes.get_lines()) if values.ndim == 1 else k
        shown = {(line.get_color(), line.get_linestyle()) for line in axes.get_lines()}
        pairs = [(COLOURS[(colour + i) % len(COLOURS)], STYLES[(n + j) % len(STYLES)])
                 for j in range(len(STYLES)) for i in range(len(COLOURS))]  # fmt: skip
        color, style = next((p for p in pairs if p not in shown), pairs[0])
        label = name if values.ndim == 1 else f"{name}[{k}]"
        axes.plot(trajectory.time, columns[:, k], style, color=color, label=label)


def called(names: Sequence[str], unit: str) -> str:
    """Names of the signals in a panel, as many as there is room for, with their unit."""
    shown = []
    for name in names:
        if shown and len(", ".join([*shown, name])) > LETTERS:
            shown.append("...")
            break
        shown.append(name)
    return f"{', '.join(shown)} [{unit or '1'}]"


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label)
    axes.margins(x=0.0)
    key_beside(axes)


@styled
def closed_loop_figure(runs: Sequence[tuple[str, Trajectory]], *, title: str = "") -> Figure:
    """Per recording its motion, and below its error in thousandths of a thousandth of the unit (µm, µrad).

    runs: name and trajectory with "measured" and "simulated", (n,) or (n, axes) each.
    """
    n = len(runs)
    figure, panels = with_panels(8.5, 1.0 + 3.8 * n, 2 * n, title=title, height_ratios=[2, 1] * n)
    for k, (name, trajectory) in enumerate(runs):
        motion, error = panels[2 * k], panels[2 * k + 1]
        motion.sharex(error)
        unit, time = trajectory.unit("measured"), trajectory.time
        measured, simulated = (trajectory[n].reshape(len(time), -1) for n in ("measured", "simulated"))
        for i in range(measured.shape[1]):
            of = "" if measured.shape[1] == 1 else f"[{i}]"
            motion.plot(time, simulated[:, i], color=COLOURS[i % len(COLOURS)], linewidth=2.2, label=f"simulated{of}")
            motion.plot(time, measured[:, i], markevery=max(1, len(time) // 400), label=f"measured{of}", **MEASURED)
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
    """Change of each position and its reference, the error in µm, and the forces.

    Args:
        motion: "reference", "position" and "forces", (n, k) each, at rows.
        samples: of the law, "forces" as it computed them.
    """
    figure, (where, error, force) = with_panels(8.5, 8.0, 3, title=title, sharex=True)
    time = motion.time
    for k in range(motion["position"].shape[1]):
        begin = motion["reference"][0, k]
        where.plot(time, motion["reference"][:, k] - begin, color="black", linewidth=0.8, linestyle="--")
        where.plot(time, motion["position"][:, k] - begin, color=colour(k), label=f"[{k}]")
        error.plot(time, 1e6 * (motion["reference"] - motion["position"])[:, k], color=colour(k), linewidth=0.9)
        force.step(time, motion["forces"][:, k], where="pre", color=colour(k), linewidth=0.9)
    where.set_ylabel("change of position [m]")
    where.set_title("position and, dashed, reference")
    error.set_ylabel("error [µm]")
    force.set_ylabel("force held [N]")
    spacing = float(np.median(np.diff(samples.time))) if len(samples) > 1 else 0.0
    force.set_title(f"{len(samples)} samples, one every {1e3 * spacing:g} ms")
    force.set_xlabel("time [s]")
    for axes in (where, error, force):
        axes.margins(x=0.0)
    key_beside(where)
    return figure


_AXES = "xyz"
SMALLEST_MM = 1e-3  # what no measurement would show; zero has no logarithm


@styled
def tracking_figure(wanted: Trajectory, runs: Mapping[str, Trajectory], title: str = "") -> Figure:
    """The tool centre point of each run beside its reference, and below, its distance from it.

    Args:
        wanted: T (n, 3) [m] and q (n, k) [m], a row per cycle.
        runs: by label; T and q of the cycles that a run lasted.
    """
    figure, panels = with_panels(8.5, 9.0, 5, title=title, sharex=True)
    for k, axes in enumerate(panels[:3]):
        axes.plot(wanted.time, wanted["T"][:, k], color="black", linewidth=1.0, label="reference")
        for n, (label, run) in enumerate(runs.items(), 1):
            axes.plot(run.time, run["T"][:, k], linewidth=1.2, label=label, **_dashed(n))
        axes.set_ylabel(f"T_{_AXES[k]} [m]")
    for name, axes in zip(("T", "q"), panels[3:], strict=True):
        for n, (label, run) in enumerate(runs.items(), 1):
            off = 1e3 * (run[name] - wanted[name][: len(run)])
            size = np.linalg.norm(off, axis=1) if name == "T" else np.abs(off).max(axis=1)
            axes.plot(run.time, np.maximum(size, SMALLEST_MM), label=label, **curve(n))
        axes.set_yscale("log")
        axes.set_ylim(bottom=SMALLEST_MM / 2)
        axes.set_ylabel("error of T [mm]" if name == "T" else "worst cart [mm]")
    panels[0].set_xlim(wanted.time[0], wanted.time[-1])
    figure.align_ylabels(panels)
    panels[3].set_title(f"errors; below {1e3 * SMALLEST_MM:g} µm they are drawn as {1e3 * SMALLEST_MM:g} µm")
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0])
    return figure


def _dashed(n: int) -> dict[str, Any]:
    """The n-th curve beside one that is drawn in full."""
    return dict(color=colour(n), linestyle=STYLES[1:][n // len(COLOURS) % 3])
