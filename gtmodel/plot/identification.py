"""Pictures of an identification: measured and modelled efforts, friction over velocity, how well a motion determines
each parameter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np
from matplotlib.figure import Figure

from .robot3d import draw_robot, fill, finish, pieces
from .signals import PANEL_HEIGHT
from .style import (
    COLOURS,
    LIMIT,
    MEASURED,
    MODELLED,
    ORANGE,
    colour,
    in_space,
    key_below,
    key_beside,
    styled,
    with_panels,
)


@styled
def efforts_figure(
    time: np.ndarray,
    measured: np.ndarray,
    modelled: np.ndarray,
    names: Sequence[str],
    unit: str,
    title: str = "",
    most_s: float = 20.0,
) -> Figure:
    """Draw measured and modelled efforts (n, m) over time and their difference, one row per target.

    As in Dressler 2012, Figs. 6.5 and 6.6. A recording whose time begins anew is drawn behind the one before it. Only
    the first `most_s` seconds are drawn.
    """
    time, *efforts = _one_after_another(time, measured, modelled)
    measured, modelled = efforts
    rows = ~(time > time[0] + most_s)
    figure, panels = with_panels(11.0, 1.4 + PANEL_HEIGHT * len(names), len(names), 2, title=title, sharex=True,
                                 width_ratios=(2, 1))  # fmt: skip
    panels = panels.reshape(-1, 2)
    for k, ((axes, error), name) in enumerate(zip(panels, names, strict=True)):
        axes.plot(time[rows], modelled[rows, k], label="modelled", **MODELLED)
        axes.plot(time[rows], measured[rows, k], label="measured", **MEASURED)
        axes.set_ylabel(f"{name} [{unit}]")
        error.plot(time[rows], (measured - modelled)[rows, k], color="0.4", linewidth=0.8)
        error.set_ylabel(f"difference [{unit}]")
    panels[0, 0].set_title("measured and modelled")
    panels[0, 1].set_title("measured - modelled, enlarged")
    key_below(figure, panels[0, 0])
    for axes in panels[-1]:
        axes.set_xlabel("time [s]" if np.isfinite(time).all() else "time, recordings one after another [s]")
    return figure


def _one_after_another(time: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Times (n,) [s] that go on where they began anew, and values (n, m); a row of NaN parts two recordings."""
    steps = np.diff(time)
    new = np.flatnonzero(steps <= 0) + 1
    jumps = np.zeros(len(time))
    if len(new):
        jumps[new] = float(np.median(np.abs(steps))) - steps[new - 1]
    return [np.insert(np.asarray(v, float), new, np.nan, axis=0) for v in (time + np.cumsum(jumps), *values)]


@styled
def friction_figure(
    velocity: np.ndarray,
    friction: np.ndarray,
    law: np.ndarray,
    names: Sequence[str],
    units: tuple[str, str],
    title: str = "",
) -> Figure:
    """Draw the friction over velocity: efforts (n, m) less all other terms of the model, and the fitted law.

    As in Dressler 2012, Fig. 6.4, from one motion. units: of velocity and of the efforts.
    """
    figure, panels = with_panels(3.6 * len(names) + 0.2, 3.8, columns=len(names), title=title)
    for k, (axes, name) in enumerate(zip(panels, names, strict=True)):
        # dots: if the records are filtered, so is the law, and it is no longer a curve over velocity
        axes.plot(velocity[:, k], law[:, k], "o", color=ORANGE, markersize=5, label="fitted law at the same samples")
        axes.plot(velocity[:, k], friction[:, k], label="measured, minus all other terms of the model", **MEASURED)
        axes.set(title=name, xlabel=f"velocity [{units[0]}]", ylabel=f"friction [{units[1]}]")
    key_below(figure, panels[0])
    return figure


MARKERS = ("*", "s", "o", "D", "+", "x", "^", "v")
FASTEST = 1.0  # m/s, if there are no points


@styled
def levels_figure(
    points: Sequence[tuple[str, np.ndarray, np.ndarray]],
    lines: Sequence[Callable[[np.ndarray], np.ndarray]],
    gravity: np.ndarray,
    *,
    title: str = "",
) -> Figure:
    """Draw the force at constant velocity of each actuator: measured points, the fitted law, and their difference.

    Args:
        points: name of a pose, velocities (runs, carts) [m/s] and forces (runs, carts) [N], with the gravity forces
            converted to the pose of the lines.
        lines: by actuator, velocity -> modelled force [N]; not called at zero.
        gravity: (carts,) gravity force, drawn dotted [N].
    """
    rows = 2 if points else 1
    figure, panels = with_panels(3.6 * len(lines), 1.4 + 2.4 * rows, rows, len(lines), title=title, fontsize="medium",
                                 sharex=True, height_ratios=[2, 1][:rows])  # fmt: skip
    panels = panels.reshape(rows, -1)
    moving = np.concatenate([np.abs(v[np.isfinite(v)]) for _, v, _ in points] or [np.zeros(0)])
    fastest = float(moving.max()) if moving.size else FASTEST
    ahead = np.linspace(1e-6, 1.05 * fastest, 50)
    for i, axes in enumerate(panels[0]):
        for n, way in enumerate((ahead, -ahead[::-1])):
            axes.plot(way, lines[i](way), color="black", linewidth=1.2, label="fitted law" if n == 0 else None)
        axes.plot([0, 0], [lines[i](-ahead[:1])[0], lines[i](ahead[:1])[0]], color="black", linewidth=0.6)
        axes.axhline(float(gravity[i]), label="gravity", **LIMIT)
        axes.set(title=f"actuator {i + 1}", ylabel="force at constant velocity [N]")
        for k, (name, v, tau) in enumerate(points):
            look = dict(linestyle="none", color=colour(k), marker=MARKERS[k % len(MARKERS)], markersize=5,
                        markerfacecolor="none")  # fmt: skip
            axes.plot(v[:, i], tau[:, i], label=f"measured, {name}", **look)
            panels[1, i].plot(v[:, i], tau[:, i] - _law_in_motion(lines[i], v[:, i]), **look)
    for axes in panels[1:].ravel():
        axes.axhline(0.0, color="black", linewidth=1.0)
        axes.set_ylabel("measured - law [N]")
    for axes in panels[-1]:
        axes.set_xlabel("velocity [m/s]")
    key_below(figure, panels[0, 0])
    return figure


def _law_in_motion(line: Callable[[np.ndarray], np.ndarray], v: np.ndarray) -> np.ndarray:
    """Return the law, NaN where the velocity is zero or unknown."""
    moves = np.isfinite(v) & (v != 0)
    force = np.full(len(v), np.nan)
    force[moves] = line(v[moves])
    return force


WIDTH = 0.76  # of a group of bars, relative to the distance of groups
AXES = "xyz"
PATHS = ("black", COLOURS[3], COLOURS[4])  # the links take the first colours


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
    """Draw the singular values of the scaled regressor, relative standard deviations by parameter, harmonic amplitudes.

    Args:
        singular_values: name of a motion -> (p,), largest first.
        deviations: name of a motion -> (p,) predicted standard deviation / nominal value, in the order of `names`.
        amplitudes: (harmonics, coordinates) [m] of the first motion; None for splines.
        frequency: of the first harmonic [Hz].
    """
    count = 2 if amplitudes is None else 3
    figure, panels = with_panels(9.0, 2.8 * count, count, title=title)
    for k, (name, s) in enumerate(singular_values.items()):
        panels[0].semilogy(np.arange(1, len(s) + 1), s, "o-", color=colour(k), label=f"{name}: {s[0] / s[-1]:.4g}")
    panels[0].set(xlabel="number of the singular value", ylabel="singular value [N]",
                  title="singular values of the scaled regressor; legend: condition number")  # fmt: skip
    key_beside(panels[0])
    places = np.arange(len(names))
    for k, (name, row) in enumerate(deviations.items()):
        offset, width = _bar(k, len(deviations), WIDTH)
        panels[1].bar(places + offset, 100 * np.asarray(row), width, color=colour(k), label=name)
    panels[1].set_yscale("log")
    deviations_percent = 100 * np.concatenate([np.asarray(row, float) for row in deviations.values()] or [np.zeros(0)])
    deviations_percent = deviations_percent[np.isfinite(deviations_percent) & (deviations_percent > 0)]
    if deviations_percent.size:
        panels[1].set_ylim(bottom=deviations_percent.min() / 3)  # so that the smallest one has a bar too
    panels[1].set_xticks(places, names, rotation=30, ha="right")
    panels[1].set(ylabel="deviation [%]", xlabel="parameter", title="predicted standard deviation / nominal value")
    key_beside(panels[1])
    if amplitudes is not None:
        harmonics = frequency * np.arange(1, len(amplitudes) + 1)
        for k in range(amplitudes.shape[1]):
            offset, width = _bar(k, amplitudes.shape[1], 0.8 * frequency)
            label = AXES[k] if amplitudes.shape[1] == len(AXES) else f"coordinate {k + 1}"
            panels[2].bar(harmonics + offset, 1e3 * amplitudes[:, k], width, color=colour(k), label=label)
        panels[2].set_xticks(harmonics)
        panels[2].set(xlabel="frequency [Hz]", ylabel="amplitude [mm]", title="harmonics of the optimised motion")
        key_beside(panels[2])
    return figure


def _bar(k: int, count: int, room: float) -> tuple[float, float]:
    """Return the offset of bar k from the middle of its group of `count` bars, and its width; room: of the group."""
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
    """Draw paths (n, 3) [m] of the tool centre point by name, the robot at the start of the first, the box (2, 3) [m].

    carts, joints: (l, 3) ends of the links [m]; directions (l, 3) of the guideways, which are not drawn if left out.
    """
    figure, axes = in_space(8.0, 6.5, title=title)
    single = [[k] for k in range(len(carts))]
    reach = float(np.mean(np.linalg.norm(joints - carts, axis=1))) / 2
    guideways = np.zeros((0, 2, 3)) if directions is None else pieces(carts, single, directions, reach)
    draw_robot(axes, carts, joints, single, guideways, width=1.0)
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
