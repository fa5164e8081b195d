"""Excitation: how well a motion determines each parameter, and where it goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from matplotlib.figure import Figure

from .robot3d import draw_robot, fill, finish, pieces
from .style import COLOURS, colour, in_space, key_below, key_beside, styled, with_panels

WIDTH = 0.76  # of a group of bars, of their distance
AXES = "xyz"
PATHS = ("black", COLOURS[3], COLOURS[4])  # beside the links, which take the first colours


@styled
def information_figure(
    singular_values: Mapping[str, np.ndarray],
    names: Sequence[str],
    deviations: Mapping[str, Sequence[float]],
    *,
    amplitudes: np.ndarray | None = None,
    frequency: float = 1.0,
    title: str = "",
) -> Figure:
    """Singular values of the scaled regressor, relative standard deviations by parameter, amplitudes by harmonic.

    Args:
        singular_values: name of a motion -> (p,), largest first.
        deviations: name of a motion -> (p,) predicted standard deviations over nominal values, in the order of `names`.
        amplitudes: (harmonics, coordinates) [m] of the first motion; None for splines.
        frequency: of the first harmonic [Hz].
    """
    count = 2 if amplitudes is None else 3
    figure, panels = with_panels(9.0, 2.8 * count, count, title=title)
    for k, (name, s) in enumerate(singular_values.items()):
        panels[0].semilogy(np.arange(1, len(s) + 1), s, "o-", color=colour(k), label=f"{name}: {s[0] / s[-1]:.4g}")
    panels[0].set(xlabel="number of the singular value", ylabel="singular value [N]",
                  title="singular values of the scaled regressor, with its condition number")  # fmt: skip
    key_beside(panels[0])
    at = np.arange(len(names))
    for k, (name, row) in enumerate(deviations.items()):
        beside, width = _beside(k, len(deviations), WIDTH)
        panels[1].bar(at + beside, 100 * np.asarray(row), width, color=colour(k), label=name)
    panels[1].set_yscale("log")
    deviations_percent = 100 * np.concatenate([np.asarray(row, float) for row in deviations.values()] or [np.zeros(0)])
    deviations_percent = deviations_percent[np.isfinite(deviations_percent) & (deviations_percent > 0)]
    if deviations_percent.size:
        panels[1].set_ylim(bottom=deviations_percent.min() / 3)  # below the least one, which would have no bar else
    panels[1].set_xticks(at, names, rotation=30, ha="right")
    panels[1].set(ylabel="deviation [%]", xlabel="parameter", title="predicted standard deviation over nominal value")
    key_beside(panels[1])
    if amplitudes is not None:
        harmonics = frequency * np.arange(1, len(amplitudes) + 1)
        for k in range(amplitudes.shape[1]):
            beside, width = _beside(k, amplitudes.shape[1], 0.8 * frequency)
            label = AXES[k] if amplitudes.shape[1] == len(AXES) else f"coordinate {k}"
            panels[2].bar(harmonics + beside, 1e3 * amplitudes[:, k], width, color=colour(k), label=label)
        panels[2].set_xticks(harmonics)
        panels[2].set(xlabel="frequency [Hz]", ylabel="amplitude [mm]", title="harmonics of the optimised motion")
        key_beside(panels[2])
    return figure


def _beside(k: int, count: int, room: float) -> tuple[float, float]:
    """Where bar k of count stands about the middle of its group, and its width; room: that of the group."""
    width = room / count
    return (k - (count - 1) / 2) * width, width


@styled
def path_figure(
    paths: Mapping[str, np.ndarray],
    carts: np.ndarray,
    joints: np.ndarray,
    *,
    box: np.ndarray | None = None,
    directions: np.ndarray | None = None,
    title: str = "",
) -> Figure:
    """Paths (n, 3) [m] of the tool centre point by name, the robot where the first begins, and the box (2, 3) [m].

    carts, joints: (l, 3) ends of its links [m]; directions (l, 3) of its guideways, not drawn if left out.
    """
    figure, axes = in_space(8.0, 6.5, title=title)
    alone = [[k] for k in range(len(carts))]
    reach = float(np.mean(np.linalg.norm(joints - carts, axis=1))) / 2
    guideways = np.zeros((0, 2, 3)) if directions is None else pieces(carts, alone, directions, reach)
    draw_robot(axes, carts, joints, alone, guideways, width=1.0)
    for k, (name, path) in enumerate(paths.items()):
        axes.plot(*path.T, color=PATHS[k % len(PATHS)], linewidth=1.8 - 0.9 * min(k, 1), label=name)
    if box is not None:
        corners = np.array(list(product(*box.T)))
        for a, b in product(range(8), repeat=2):
            if a < b and np.sum(corners[a] != corners[b]) == 1:
                label = "box of the tool centre point" if (a, b) == (0, 1) else None
                axes.plot(*corners[[a, b]].T, color="0.5", linestyle=":", linewidth=1.0, label=label)
    finish(axes)
    key_below(figure, axes)
    fill(figure, axes)
    return figure
