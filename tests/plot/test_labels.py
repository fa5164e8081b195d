"""Words in pictures stay clear of one another: levels and guideways, panels of assembly modes."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.plot.robot3d import modes_figure
from gtmodel.plot.workspace import error_figure


def levels_shown(guideways: np.ndarray) -> list[tuple[np.ndarray, bool]]:
    u = np.linspace(0.0, 2.0, 21)
    axes: Any = error_figure(u, u, 1e-4 * np.add.outer(u, u**2), guideways).axes[0]
    labels = [t for t in axes.texts if t.get_text() not in ("", "1")]
    return [(np.array(t.get_position()), t.get_visible()) for t in labels]


def test_the_number_of_a_guideway_is_not_covered_by_that_of_a_level() -> None:
    free = levels_shown(np.array([[-9.0, -9.0]]))
    assert len(free) > 3 and all(shown for _, shown in free)
    place = free[len(free) // 2][0]
    beside = levels_shown(place[None])
    hidden = [np.linalg.norm(at - place) for at, shown in beside if not shown]
    assert hidden and max(hidden) < 0.2 and len(hidden) < len(beside)


def test_titles_of_panels_are_clear_of_the_axes_names_above() -> None:
    # synthetic, tall like an F1
    rng = np.random.default_rng(4)
    R = Rotation.random(8, rng=rng).as_matrix()
    A, T = (rng.uniform(-1, 1, (n, 3)) * [0.6, 0.9, 1.1] for n in (6, 8))
    figure = modes_figure(A, 0.1 * rng.normal(size=(6, 3)), R, T, title="F1")
    figure.draw_without_rendering()
    panels: list[Any] = list(figure.axes)
    lowest = min(axis.label.get_window_extent().y0 for axis in (panels[0].xaxis, panels[0].yaxis))
    titles = [panel.title.get_window_extent() for panel in panels[4:]]
    assert len(titles) == 4 and max(title.y1 for title in titles) < lowest
