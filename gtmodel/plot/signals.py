"""Signals of any trajectory over time: one panel for each unit; and its energy balance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .style import COLOURS, STYLES, key_beside, styled, with_panels

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
    for (label, row), colour in zip(rows.items(), COLOURS, strict=False):
        terms.plot(trajectory.time, row, color=colour, label=label)
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
