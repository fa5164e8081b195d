"""Closed loops: a simulated motion beside the measured one, and one under a law that samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .style import COLOURS, MEASURED, colour, key_beside, styled, with_panels


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
