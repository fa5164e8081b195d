"""What the pictures of a study of dynamic stiffness show: chosen from its results, drawn by gtmodel.plot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..vibration_result import entitled
from .experiments import Experiment
from .frequency_modal import ModalFit
from .options import FrequencyMap
from .oscillator_field import OscillatorField

_ORDER = ("x", "y", "z", "A")


def responses(experiments: Sequence[Experiment], fits: Sequence[ModalFit | None], title: str, note: str | None) -> Any:
    """The first experiment in each direction that gave a mode."""
    from ...plot.dynamic_stiffness import response_figure

    shown = {}
    for e, fit in zip(experiments, fits, strict=True):
        if fit is not None:
            shown.setdefault(
                e.direction,
                (
                    f"{e.source}" if "xyz"[e.direction] in e.source else f"{e.source} ({'xyz'[e.direction]})",
                    e.response,
                    fit,
                ),
            )
    return response_figure([shown[d] for d in sorted(shown)], title=entitled(title, note))


def lowest(map: FrequencyMap, experiments: Sequence[Experiment], field: OscillatorField, title: str) -> Any:
    """Lowest frequency over two coordinates within the poses, the others held."""
    from ...plot.dynamic_stiffness import lowest_frequency_figure

    over = [_ORDER.index(c) for c in map.over]
    poses = np.array([e.pose for e in experiments])
    low, high = poses.min(axis=0), poses.max(axis=0)
    low, high = np.where(high > low, low, low - 0.5), np.where(high > low, high, high + 0.5)
    at = (poses.min(axis=0) + poses.max(axis=0)) / 2
    if map.at is not None:
        at[:3] = map.at
    if map.at_angle is not None:
        at[3] = map.at_angle
    u, v = (np.linspace(low[c], high[c], map.points) for c in over)
    grid = np.tile(at, (len(u) * len(v), 1))
    grid[:, over[0]], grid[:, over[1]] = (a.ravel() for a in np.meshgrid(u, v))
    fn = field.value("fn", grid)
    limits = field.prediction_interval("fn", grid)
    softest = fn.argmin(axis=1)
    rows = np.arange(len(grid))
    wide = np.log(limits[rows, softest, 1] / limits[rows, softest, 0]) / 2
    shape = (len(v), len(u))
    unit = [np.rad2deg(1.0) if c == 3 else 1.0 for c in over]
    names = [f"{_ORDER[c]} [{'deg' if c == 3 else 'm'}]" for c in over]
    held = ", ".join(
        f"{_ORDER[c]} = {np.rad2deg(at[c]) if c == 3 else at[c]:.3g} {'deg' if c == 3 else 'm'}"
        for c in range(4)
        if c not in over
    )
    return lowest_frequency_figure(
        u * unit[0], v * unit[1], fn.min(axis=1).reshape(shape), wide.reshape(shape), poses[:, over] * unit,
        names=(names[0], names[1]), title=entitled(f"{title}\nat {held}", field.synthetic),
    )  # fmt: skip


def held_out(field: OscillatorField, errors: dict[Any, Any], title: str) -> Any:
    """Values held out against their predictions."""
    from ...plot.dynamic_stiffness import held_out_figure

    panels = {}
    for key, (error, std) in errors.items():
        g = field.processes[key]
        panels[f"{key[1]} in {key[0]}"] = (np.exp(g.y - error), np.exp(g.y), std * g.inflation)
    return held_out_figure(panels, title=entitled(title, field.synthetic))
