"""A motion under a law that samples: positions beside their reference, errors, and the forces that are held."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .style import colour, key_beside, styled, with_panels


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
