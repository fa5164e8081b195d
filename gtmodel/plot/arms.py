"""Pictures of serial arms: the postures of a pose, joint coordinates along a path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .style import BLUE, COLOURS, LIMIT, ORANGE, STYLES, key_below, styled, with_panels

SHOWN = 12  # postures of a pose that are drawn, with labels


def _scales(revolute: Sequence[bool]) -> tuple[np.ndarray, list[str]]:
    return np.where(revolute, np.degrees(1.0), 1e3), ["deg" if r else "mm" for r in revolute]


@styled
def postures_figure(
    q: np.ndarray, inside: np.ndarray, joints: Sequence[str], revolute: Sequence[bool], limits: np.ndarray,
    labels: Sequence[str], *, title: str = "",
) -> Figure:  # fmt: skip
    """Draw the postures of the first pose as lines over the joints, with the limits as bars.

    Args:
        q: (m, k, n) [rad, m]. inside: (m, k), whether a posture is within limits; others are dotted.
        limits: (n, 2), infinite if a joint has none. labels: of the postures.
    """
    factor, units = _scales(revolute)
    figure, (axes,) = with_panels(8.0, 4.8, title=title)
    at = np.arange(len(joints))
    for j, (low, high) in enumerate(limits * factor[:, None]):
        if np.isfinite(low) and np.isfinite(high):
            axes.bar(j, high - low, 0.5, low, color="0.92", edgecolor="0.7", zorder=0,
                     label="limits" if j == 0 else None)  # fmt: skip
    for n, k in enumerate(np.flatnonzero(np.isfinite(q[0]).all(axis=1))[:SHOWN]):
        style = STYLES[n // len(COLOURS) % 2] if inside[0, k] else ":"
        label = f"{labels[k]}{'' if inside[0, k] else ' (beyond limits)'}"
        axes.plot(at, q[0, k] * factor, style, marker="o", color=COLOURS[n % len(COLOURS)], label=label)
    axes.set_xticks(at, [f"{j}\n[{u}]" for j, u in zip(joints, units, strict=True)])
    axes.set_ylabel("joint coordinate [" + ", ".join(dict.fromkeys(units)) + "]")
    key_below(figure, axes, columns=3)
    return figure


@styled
def path_figure(
    chosen: np.ndarray, q: np.ndarray, inside: np.ndarray, joints: Sequence[str], revolute: Sequence[bool],
    limits: np.ndarray, jumps: Sequence[int], *, title: str = "",
) -> Figure:  # fmt: skip
    """Draw each joint along a path: the chosen posture, all others as dots, limits, and jumps as vertical lines.

    Args:
        chosen: (m, n) [rad, m]. q, inside: all postures (m, k, n), and whether each is within limits (m, k).
        limits: (n, 2). jumps: rows, counted from 0.
    """
    factor, units = _scales(revolute)
    m, k, n = q.shape
    figure, panels = with_panels(8.5, 1.0 + 1.25 * n, n, title=title, sharex=True)
    row = np.arange(1, m + 1)
    for j, axes in enumerate(panels):
        others: Any = np.where(inside, q[:, :, j], np.nan) * factor[j]
        axes.plot(np.repeat(row, k), others.ravel(), ".", color="0.75", markersize=2.5,
                  label="postures within limits" if j == 0 else None)  # fmt: skip
        breaks = np.insert(chosen[:, j] * factor[j], jumps, np.nan)  # no line across a jump
        axes.plot(np.insert(row.astype(float), jumps, np.nan), breaks, color=BLUE, label="path" if j == 0 else None)
        drawn = axes.get_ylim()
        for limit in limits[j] * factor[j]:
            if np.isfinite(limit) and drawn[0] - np.ptp(drawn) < limit < drawn[1] + np.ptp(drawn):
                axes.axhline(
                    limit,
                    **LIMIT,
                    label="limit" if "limit" not in axes.get_legend_handles_labels()[1] and j == 0 else None,
                )
        for number, jump in enumerate(jumps):
            axes.axvline(jump + 0.5, color=ORANGE, label="jump" if j == 0 and number == 0 else None)
        axes.set_ylabel(f"{joints[j]}\n[{units[j]}]")
    panels[-1].set_xlabel("row")
    key_below(figure, *panels)
    return figure
