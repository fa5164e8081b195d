"""The picture of the block-triangular form: one framed block each, nothing above the diagonal blocks."""

import io

import numpy as np

import gtmodel as gt
from gtmodel.plot.structure import structure_figure


def test_nothing_stands_right_of_its_block_and_the_picture_renders() -> None:
    f = gt.robots.gantry_tau("l1_tape").causal(known="tau", targets="der(T,2)", prefer="T")
    order = {name: n for n, name in enumerate(u for b in f.plan.blocks for u in b.unknowns)}
    last = np.cumsum([len(b.unknowns) for b in f.plan.blocks])
    for b, end in zip(f.plan.blocks, last, strict=True):
        assert all(order[u] < end for uses in b.uses for u in uses if u in order)
    figure = structure_figure(f)
    axes = figure.axes[0]
    assert len(axes.patches) == len(f.plan.blocks)
    assert axes.get_xlabel() and axes.get_ylabel() and "der(T,2)" in axes.get_title()
    target = io.BytesIO()
    figure.savefig(target, format="png")
    assert target.getvalue().startswith(b"\x89PNG")
