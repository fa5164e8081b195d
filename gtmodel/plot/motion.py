"""Pictures of optimal motions: path, velocities, forces, controls, axis motions, and the swing of an elastic tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..results.trajectory import Trajectory
from .robot3d import fill, finish
from .signals import PANEL_HEIGHT, called
from .style import COLOURS, LIMIT, colour, curve, in_space, key_below, key_beside, key_under, styled, with_panels


def draw_path(axes: Any, T: np.ndarray, plane: str, path: np.ndarray | None = None) -> None:
    """Draw the path of a motion with its start and goal, at equal scales.

    Args:
        T: (n, 3) [m]. plane: two of x, y, z, such as "xz".
        path: (k, 3) [m], the prescribed path; the straight line if left out.
    """
    a, b = map("xyz".index, plane)
    line, name = (T[[0, -1]], "straight line") if path is None else (path, "prescribed path")
    axes.plot(T[:, a], T[:, b], color="black", label="optimal path")
    axes.plot(line[:, a], line[:, b], color="0.6", linestyle="--", linewidth=0.9, zorder=3, label=name)
    axes.plot(T[0, a], T[0, b], "o", color="black", markerfacecolor="white", label="start")
    axes.plot(T[-1, a], T[-1, b], "o", color="black", label="goal")
    axes.set(xlabel=f"{plane[0]} [m]", ylabel=f"{plane[1]} [m]")
    axes.set_aspect("equal", adjustable="datalim")


def head(figure: Figure, trajectory: Trajectory) -> None:
    """Set the title of a figure: the title and the duration of the motion."""
    if trajectory.title:
        figure.suptitle(f"{trajectory.title}: {trajectory.duration:.4f} s")


@styled
def motion_figure(
    trajectory: Trajectory,
    polynomial: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    force_limit: float,
    obstacles: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    path: np.ndarray | None = None,
    constant: bool = True,
) -> Figure:
    """Draw the path from the side and from the front, the TCP velocity, and the motor forces with their limit.

    Args:
        trajectory: the exported motion, with T [m], der(T) [m/s], tau [N].
        polynomial: times (n,) and forces (n, motors) of the collocation polynomials, drawn faintly; they may overshoot
            between the collocation points.
        force_limit: [N].
        obstacles: boxes as (center, size) [m].
        path: (n, 3) [m], the prescribed path, drawn instead of the straight line.
        constant: forces are constant per element and drawn as steps.
    """
    figure, (side, front, speed, force) = with_panels(10.0, 7.8, 2, 2)
    T = trajectory["T"]
    for axes, plane in ((side, "xz"), (front, "yz")):
        a, b = map("xyz".index, plane)
        for center, size in obstacles:
            low = center - size / 2
            axes.add_patch(Rectangle((low[a], low[b]), size[a], size[b], color="0.85", zorder=0))
        draw_path(axes, T, plane, path)
    side.set_title("path of the tool centre point, x-z plane")
    front.set_title("path of the tool centre point, y-z plane")
    for axes in (side, front):
        key_under(axes)
    time = trajectory.time
    for k, name in enumerate("xyz"):
        speed.plot(time, trajectory["der(T)"][:, k], color=COLOURS[k], label=name)
    speed.set_title("velocity of the tool centre point")
    speed.set_ylabel("velocity [m/s]")
    for k in range(trajectory["tau"].shape[1]):
        if polynomial is not None:
            force.plot(polynomial[0], polynomial[1][:, k], color=colour(k), alpha=0.3, linewidth=0.8)
        style = "steps-pre" if constant else "default"
        force.plot(time, trajectory["tau"][:, k], drawstyle=style, color=colour(k), label=f"motor {k + 1}")
    for sign in (-1, 1):
        force.axhline(sign * force_limit, label="limit" if sign == 1 else None, **LIMIT)
    highest = 0.0 if polynomial is None else float(np.max(np.abs(polynomial[1])))
    reach = 1.1 * max(1.4 * force_limit, float(np.max(np.abs(trajectory["tau"]))), highest)
    force.set_ylim(-reach, reach)
    title_text = "motor forces, constant per element" if constant else "motor forces"
    force.set_title(title_text + ("; faint: collocation" if polynomial is not None else ""))
    force.set_ylabel("force [N]")
    for axes in (speed, force):
        axes.set_xlabel("time [s]")
        key_under(axes)
    head(figure, trajectory)
    return figure


@styled
def force_figure(runs: Sequence[tuple[str, Trajectory]], *, force_limit: float) -> Figure:
    """Draw motor forces over time, one panel per motor and one curve per motion, as in Dressler 2012, Fig. 3.10.

    Args:
        runs: (label, motion) with tau [N].
        force_limit: [N].
    """
    figure, panels = with_panels(8.0, 7.0, runs[0][1]["tau"].shape[1], title="motor forces", sharex=True)
    for k, axes in enumerate(panels):
        for n, (label, run) in enumerate(runs):
            axes.plot(run.time, run["tau"][:, k], color=COLOURS[n % len(COLOURS)], linewidth=1.0, label=label)
        for sign in (-1, 1):
            axes.axhline(sign * force_limit, label="limit" if sign == 1 else None, **LIMIT)
        axes.set_ylabel(f"force of motor {k + 1} [N]")
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0], columns=5)
    return figure


@styled
def space_figure(runs: Sequence[tuple[str, Trajectory]]) -> Figure:
    """Draw the path of the tool centre point of each motion in space, as in Dressler 2012, Fig. 3.9.

    Args:
        runs: (label, motion) with T [m].
    """
    figure, axes = in_space(8.0, 6.0, title="paths of the tool centre point")
    for n, (label, run) in enumerate(runs):
        axes.plot(*run["T"].T, color=COLOURS[n % len(COLOURS)], label=label)
    T = runs[0][1]["T"]
    axes.plot(*T[0], "o", markerfacecolor="white", markeredgecolor="black", linestyle="none", label="start")
    axes.plot(*T[-1], "o", color="black", linestyle="none", label="goal")
    finish(axes)
    key_below(figure, axes, columns=6)
    fill(figure, axes)
    return figure


@styled
def axis_motion_figure(
    trajectory: Trajectory, *, force_limit: float, torque_limit: float, path: np.ndarray | None = None
) -> Figure:
    """Draw the path of the tool centre point from two sides, cart positions and forces, axis angles and torques.

    Args:
        trajectory: with q (6) [m, rad], T (3) [m] and tau (6) [N, N.m].
        force_limit: of the carts [N]; torque_limit: of the rotary axes [N.m].
        path: (n, 3) [m], the prescribed path, drawn instead of the straight line.
    """
    figure, panels = with_panels(12.0, 7.8, 2, 3)
    panels = panels.reshape(2, 3)
    draw_path(panels[0, 0], trajectory["T"], "xz", path)
    draw_path(panels[1, 0], trajectory["T"], "yz", path)
    panels[0, 0].set_title("path of the tool centre point, x-z plane")
    panels[1, 0].set_title("path of the tool centre point, y-z plane")
    for axes in panels[:, 0]:
        key_under(axes, columns=2)
    carts, angles = trajectory["q"][:, :3], np.degrees(trajectory["q"][:, 3:])
    forces, torques = trajectory["tau"][:, :3], trajectory["tau"][:, 3:]
    for axes, curves, symbol, first, title, unit, limit in (
        (panels[0, 1], carts, "q", 1, "positions of the carts", "position [m]", None),
        (panels[1, 1], forces, "motor ", 1, "forces of the carts", "force [N]", force_limit),
        (panels[0, 2], angles, "q", 4, "angles of the rotary axes", "angle [deg]", None),
        (panels[1, 2], torques, "motor ", 4, "torques of the rotary axes", "torque [N m]", torque_limit),
    ):
        for k in range(3):
            axes.plot(trajectory.time, curves[:, k], color=COLOURS[k], label=f"{symbol}{first + k}")
        for bound in (-limit, limit) if limit is not None else ():
            axes.axhline(bound, label="limit" if bound == limit else None, **LIMIT)
        axes.set_title(title)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(unit)
        key_under(axes)
    head(figure, trajectory)
    return figure


@styled
def arm_motion_figure(
    trajectory: Trajectory,
    *,
    speed: np.ndarray,
    effort: np.ndarray,
    passed: Sequence[float],
    shapes: Sequence[tuple[str, np.ndarray, float]] = (),
    distances: Mapping[str, np.ndarray] | None = None,
    required: float | None = None,
) -> Figure:
    """Draw the path of an arm's tool from the side and from above, joint speeds and efforts as shares of their limits,
    and the smallest distances.

    Args:
        trajectory: with q, der(q), tau (n, k) and T (n, 3) [m].
        speed, effort: limits (k,), infinite if there is none.
        passed: times [s] of the poses, start and goal included.
        shapes: ("link" or "obstacle", points (k, 3) [m], radius [m]): hulls of the points with that radius.
        distances: pair -> distance (n,) [m]; required: their bound [m].
    """
    figure, panels = with_panels(12.0, 8.2, 2, 2 if distances is None else 3)
    panels = panels.reshape(2, -1)
    T, time = trajectory["T"], trajectory.time
    at = [int(np.argmin(np.abs(time - t))) for t in passed]
    drawn = set[tuple[str, int, int]]()
    for axes, (a, b) in zip(panels[:, 0], ((0, 2), (0, 1)), strict=True):
        for kind, points, radius in shapes:
            label = "links at the poses" if kind == "link" else "obstacles"
            shown = (
                {"facecolor": "0.88", "edgecolor": "0.6"} if kind == "link" else {"facecolor": colour(1), "alpha": 0.5}
            )
            around = (points[:, None, [a, b]] + radius * ROUND).reshape(-1, 2)
            outline = around[scipy.spatial.ConvexHull(around, qhull_options="QJ").vertices]
            axes.fill(*outline.T, label=None if (label, a, b) in drawn else label, linewidth=0.7, **shown)
            drawn.add((label, a, b))
        axes.plot(T[:, a], T[:, b], color="black", label="path of the tool")
        axes.plot(T[at, a], T[at, b], "o", color="black", markerfacecolor="white", label="poses")
        axes.set(xlabel=f"{'xyz'[a]} [m]", ylabel=f"{'xyz'[b]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
    panels[0, 0].set_title("from the side")
    panels[1, 0].set_title("from above")
    key_under(panels[1, 0], columns=2)
    curves = [
        (panels[0, 1], "speed", 100 * trajectory["der(q)"] / speed, "joint speed [% of its limit]"),
        (panels[1, 1], "effort", 100 * trajectory["tau"] / effort, "motor effort [% of its limit]"),
    ]
    for axes, title, shares, label in curves:
        for k in range(shares.shape[1]):
            axes.plot(time, shares[:, k], label=f"joint {k + 1}", **curve(k))
        for bound in (-100.0, 100.0):
            axes.axhline(bound, label="limit" if bound > 0 else None, **LIMIT)
        axes.set(title=title, xlabel="time [s]", ylabel=label)
    key_under(panels[1, 1])
    if distances is not None:
        for k, (name, values) in enumerate(distances.items()):
            panels[0, 2].plot(time, 1e3 * values, label=name, **curve(k))
        if required is not None:
            panels[0, 2].axhline(1e3 * required, label="required", **LIMIT)
        panels[0, 2].set(title="smallest distances", xlabel="time [s]", ylabel="distance [mm]")
        key_under(panels[0, 2], columns=2)
        angles = np.degrees(trajectory["q"])
        for k in range(angles.shape[1]):
            panels[1, 2].plot(time, angles[:, k], label=f"joint {k + 1}", **curve(k))
        panels[1, 2].set(title="joints", xlabel="time [s]", ylabel="angle [deg]")
        key_under(panels[1, 2])
    for t in passed[1:-1]:
        for axes in panels[:, 1:].ravel():
            axes.axvline(t, color="0.6", linewidth=0.8, linestyle=":")
    head(figure, trajectory)
    return figure


@styled
def swing_figure(
    swings: Mapping[str, tuple[np.ndarray, np.ndarray]],
    ratios: np.ndarray,
    residuals: Mapping[str, np.ndarray],
    *,
    title: str = "",
) -> Figure:
    """Draw the swing of the tool over time, and the residual swing over the error of the planned frequency.

    Args:
        swings: motion -> times (n,) [s], offsets of the tool from its rest position (n, 3) [m]; the direction of the
            largest swing is drawn.
        ratios: (r,) true frequency over planned frequency. residuals: motion -> amplitudes (r,) [m] after the motion.
    """
    figure, (upper, lower) = with_panels(8.0, 7.0, 2, title=title)
    largest = max(swings.values(), key=lambda s: np.abs(s[1]).max())[1]
    k = int(np.argmax(np.abs(largest).max(axis=0)))
    for n, (name, (t, x)) in enumerate(swings.items()):
        upper.plot(t, 1e3 * x[:, k], label=name, linewidth=1.2, **curve(n))
        lower.plot(ratios, 1e3 * residuals[name], label=name, **curve(n))
    upper.set(xlabel="time [s]", ylabel=f"tool relative to plate, {'xyz'[k]} [mm]",
              title=f"{'xyz'[k]}, the direction of the largest swing")  # fmt: skip
    lower.set(
        title="residual swing if the frequency differs from the planned one",
        xlabel="true frequency / planned frequency [1]",
        ylabel="swing after the motion [mm]",
        ylim=(0, None),
    )
    key_below(figure)
    return figure


TURN = np.linspace(0.0, 2 * np.pi, 24)
ROUND = np.stack([np.cos(TURN), np.sin(TURN)], axis=1)


MOST_PANELS, MOST_CURVES, MOST_NAMED = 5, 8, 6


@styled
def optimum_figure(
    trajectory: Trajectory, controls: Sequence[str], bounds: Mapping[str, tuple[float, float]], *, steps: bool = False,
    title: str = "",
) -> Figure:  # fmt: skip
    """Draw controls and other quantities over time, a panel per unit; of many curves only the largest.

    Args:
        controls: names of the optimised inputs in the trajectory; derivatives are not drawn.
        steps: controls are constant on each element and drawn as steps.
        bounds: scalar name, such as "u" or "tau[0]" -> lower and upper bound, infinite if there is none.
    """
    panels: dict[tuple[str, str], dict[str, np.ndarray]] = {}
    for name in trajectory.names:
        if not name.startswith("der("):
            role = "controls" if name in controls else "states and other quantities"
            panels.setdefault((role, trajectory.unit(name)), {}).update(_scalars(name, trajectory[name]))
    order = sorted(panels, key=lambda key: key[0] == "controls")  # states above, controls below
    drawn = [key for key in order if key[0] == "controls"][:2]
    rest = [key for key in order if key not in drawn]
    drawn = rest[: MOST_PANELS - len(drawn)] + drawn
    left_out = [f"{n} [{unit or '1'}]" for key in order if key not in drawn for unit in [key[1]] for n in panels[key]]
    more = f" and {len(left_out) - MOST_NAMED} more" if len(left_out) > MOST_NAMED else ""
    heading = title + (f"\nnot drawn: {', '.join(left_out[:MOST_NAMED])}{more}" if left_out else "")
    figure, stack = with_panels(
        8.5, 1.2 + PANEL_HEIGHT * max(1, len(drawn)), max(1, len(drawn)), title=heading, sharex=True
    )
    titled: set[str] = set()
    for axes, (role, unit) in zip(stack, drawn, strict=False):
        _curves(axes, trajectory.time, panels[role, unit], bounds, steps=steps and role == "controls")
        count = len(panels[role, unit])
        if count > MOST_CURVES:
            axes.set_title(f"{role}: {MOST_CURVES} largest of {count} in {unit or '1'}")
        elif role not in titled:
            axes.set_title(role)
        titled.add(role)
        axes.set_ylabel(called(list(dict.fromkeys(n.partition("[")[0] for n in panels[role, unit])), unit))
        axes.margins(x=0.0)
        key_beside(axes)
    stack[-1].set_xlabel("time [s]")
    return figure


def _scalars(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return the components of a quantity by name, such as "tau[0]"."""
    if values.ndim == 1:
        return {name: values}
    indices = np.ndindex(*values.shape[1:])
    return {f"{name}[{','.join(map(str, index))}]": values[(slice(None), *index)] for index in indices}


def _curves(
    axes: Any, time: np.ndarray, curves: Mapping[str, np.ndarray], bounds: Mapping[str, tuple[float, float]], *,
    steps: bool,
) -> None:  # fmt: skip
    """Draw the largest curves in their order, and their bounds, equal bounds once."""
    largest = sorted(curves, key=lambda name: -float(np.nanmax(np.abs(curves[name]), initial=0.0)))[:MOST_CURVES]
    drawn = [name for name in curves if name in largest]
    for k, name in enumerate(drawn):
        axes.plot(time, curves[name], label=name, drawstyle="steps-pre" if steps else "default", **curve(k))
    finite = {bound for name in drawn for bound in bounds.get(name, ()) if np.isfinite(bound)}
    for k, bound in enumerate(sorted(finite)):
        axes.axhline(bound, label="bound" if k == 0 else None, **LIMIT)
