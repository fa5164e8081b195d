"""The optimum of an optimal control problem: its controls with their bounds, and everything else it moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .signals import PANEL_HEIGHT, called
from .style import LIMIT, curve, key_beside, styled, with_panels

MOST_PANELS, MOST_CURVES = 5, 8


@styled
def optimum_figure(
    trajectory: Trajectory, controls: Sequence[str], bounds: Mapping[str, tuple[float, float]], *, steps: bool = False,
    title: str = "",
) -> Figure:  # fmt: skip
    """Controls and other quantities over time, a panel for each unit, of many the largest.

    Args:
        controls: names of the inputs that were optimised, as in the trajectory; derivatives are not drawn.
        steps: controls are constant on each element, and drawn so.
        bounds: scalar name, such as "u" or "tau[0]" -> lower and upper bound, infinite where there is none.
    """
    panels: dict[tuple[str, str], dict[str, np.ndarray]] = {}
    for name in trajectory.names:
        if not name.startswith("der("):
            of = "controls" if name in controls else "states and other quantities"
            panels.setdefault((of, trajectory.unit(name)), {}).update(_scalars(name, trajectory[name]))
    order = sorted(panels, key=lambda key: key[0] == "controls")  # what moves first, below it what moves it
    drawn = [key for key in order if key[0] == "controls"][:2]
    rest = [key for key in order if key not in drawn]
    drawn = rest[: MOST_PANELS - len(drawn)] + drawn
    left = len(order) - len(drawn)
    said = title + (f"\n{left} units more are not drawn" if left else "")
    figure, stack = with_panels(
        8.5, 1.2 + PANEL_HEIGHT * max(1, len(drawn)), max(1, len(drawn)), title=said, sharex=True
    )
    for axes, (of, unit) in zip(stack, drawn, strict=False):
        _curves(axes, trajectory.time, panels[of, unit], bounds, steps=steps and of == "controls")
        count = len(panels[of, unit])
        axes.set_title(of + (f": the {MOST_CURVES} largest of {count} in {unit or '1'}" if count > MOST_CURVES else ""))
        axes.set_ylabel(called(list(dict.fromkeys(n.partition("[")[0] for n in panels[of, unit])), unit))
        axes.margins(x=0.0)
        key_beside(axes)
    stack[-1].set_xlabel("time [s]")
    return figure


def _scalars(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Components of a quantity by name, such as "tau[0]"."""
    if values.ndim == 1:
        return {name: values}
    places = np.ndindex(*values.shape[1:])
    return {f"{name}[{','.join(map(str, at))}]": values[(slice(None), *at)] for at in places}


def _curves(
    axes: Any, time: np.ndarray, curves: Mapping[str, np.ndarray], bounds: Mapping[str, tuple[float, float]], *,
    steps: bool,
) -> None:  # fmt: skip
    """The largest curves in the order given, and the bounds of what is drawn, equal ones once."""
    largest = sorted(curves, key=lambda name: -float(np.nanmax(np.abs(curves[name]), initial=0.0)))[:MOST_CURVES]
    shown = [name for name in curves if name in largest]
    for k, name in enumerate(shown):
        axes.plot(time, curves[name], label=name, drawstyle="steps-pre" if steps else "default", **curve(k))
    ends = {end for name in shown for end in bounds.get(name, ()) if np.isfinite(end)}
    for k, end in enumerate(sorted(ends)):
        axes.axhline(end, label="bound" if k == 0 else None, **LIMIT)
