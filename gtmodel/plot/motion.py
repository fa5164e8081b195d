"""Path, velocities and motor forces of a motion."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory

COLOURS = ("#0072b2", "#d55e00", "#009e73")  # readable with colour-blind eyes


def motion_figure(
    trajectory: Trajectory, polynomial: tuple[np.ndarray, np.ndarray] | None = None, *, force_limit: float
) -> Figure:
    """Four panels: the path from the side and from the front, TCP velocity, and motor forces with their limit.

    Args:
        trajectory: with T [m], der(T) [m/s], tau [N]; the motion that is exported.
        polynomial: times (n,) and forces (n, motors) of the collocation optimum, drawn faintly: they may overshoot
            between its points.
        force_limit: [N].
    """
    figure = Figure(figsize=(10.5, 7.0), layout="constrained")
    side, front, speed, force = figure.subplots(2, 2).ravel()
    T = trajectory["T"]
    for axes, (a, b), names in ((side, (0, 2), "xz"), (front, (1, 2), "yz")):
        axes.plot(T[[0, -1], a], T[[0, -1], b], color="0.7", linestyle="--", label="straight line")
        axes.plot(T[:, a], T[:, b], color="black", label="optimal path")
        axes.plot(T[0, a], T[0, b], "o", color="black", markerfacecolor="white", label="start")
        axes.plot(T[-1, a], T[-1, b], "o", color="black", label="goal")
        axes.set_xlabel(f"{names[0]} [m]")
        axes.set_ylabel(f"{names[1]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
    side.set_title("path seen from the side")
    front.set_title("path seen along the guideways")
    side.legend(fontsize="small")
    time = trajectory.time
    for k, name in enumerate("xyz"):
        speed.plot(time, trajectory["der(T)"][:, k], color=COLOURS[k], label=name)
    speed.set_title("TCP velocity")
    speed.set_ylabel("velocity [m/s]")
    for k in range(trajectory["tau"].shape[1]):
        if polynomial is not None:
            force.plot(polynomial[0], polynomial[1][:, k], color=COLOURS[k], alpha=0.3, linewidth=0.8)
        force.step(time, trajectory["tau"][:, k], where="pre", color=COLOURS[k], label=f"motor {k + 1}")
    for sign in (-1, 1):
        force.axhline(sign * force_limit, color="0.4", linestyle=":")
    highest = 0.0 if polynomial is None else float(np.max(np.abs(polynomial[1])))
    reach = 1.1 * max(1.4 * force_limit, float(np.max(np.abs(trajectory["tau"]))), highest)
    force.set_ylim(-reach, reach)
    force.set_title("motor forces, constant per element" + ("; faint: polynomial" if polynomial is not None else ""))
    force.set_ylabel("force [N]")
    for axes in (speed, force):
        axes.set_xlabel("time [s]")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", ncols=3, loc="lower right")
    if trajectory.title:
        figure.suptitle(f"{trajectory.title}: {trajectory.duration:.4f} s")
    return figure
