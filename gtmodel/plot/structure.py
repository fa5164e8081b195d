"""Picture of the block-triangular form of a causality: which equation uses which unknown, in order of computation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..compiler.causal import CausalFunction
from .style import BLUE, GREEN, ORANGE, styled

COLOURS = {
    "explicit": "0.6",
    "linear": BLUE,
    "quadratic": GREEN,
    "sphere pencil": GREEN,
    "angle": GREEN,
    "Newton": ORANGE,
}
MAX_LABELS = 60  # more labels are not readable


@styled
def structure_figure(function: CausalFunction) -> Figure:
    """Draw the incidence matrix: rows are equations, columns are unknowns, and blocks are framed.

    The unknowns left of a block are computed before it. There are no entries to the right of a block.
    """
    blocks = [b for b in function.plan.blocks if b.unknowns]  # a condition on known values has no unknowns
    names = [n for b in blocks for n in b.unknowns]
    column = {n: k for k, n in enumerate(names)}
    size = max(1, len(names))
    side = min(14.0, 3.0 + 0.16 * size)
    figure = Figure(figsize=(side + 2.0, side), layout="constrained")
    axes = figure.subplots()
    points: list[tuple[int, int]] = []
    row = 0
    labels: list[str] = []
    for b in blocks:
        n = len(b.unknowns)
        colour = COLOURS.get(b.kind, "0.3")
        axes.add_patch(Rectangle((row - 0.5, row - 0.5), n, n, facecolor=colour, alpha=0.25, edgecolor=colour))
        for k, uses in enumerate(b.uses):
            points += [(column[u], row + k) for u in uses if u in column]
        labels += [e.rpartition(" (")[0] for e in b.equations]
        row += n
    if points:
        x, y = np.array(points).T
        axes.plot(x, y, ".", color="black", markersize=max(1.5, 7.0 - 0.05 * size))
    axes.set_xlim(-0.5, size - 0.5)
    axes.set_ylim(size - 0.5, -0.5)
    axes.set_aspect("equal")
    if size <= MAX_LABELS:
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize="xx-small")
        axes.set_yticks(range(len(labels)), labels, fontsize="xx-small")
    axes.set_xlabel("unknown, in the order of computation")
    axes.set_ylabel("equation")
    kinds = sorted({b.kind for b in blocks})
    handles = [Rectangle((0, 0), 1, 1, color=COLOURS.get(k, "0.3"), alpha=0.4, label=k) for k in kinds]
    axes.legend(handles=handles, loc="lower left", fontsize="small")
    inputs, outputs = (", ".join(s.name for s in signals) for signals in (function.inputs, function.outputs))
    axes.set_title(f"{function.flat.title}: {outputs} from {inputs or 'nothing'}", fontsize="medium")
    return figure
