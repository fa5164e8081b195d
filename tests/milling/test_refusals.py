"""Numbers that are none, and what a relative distance hides."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.milling import Oscillators, proven_depth, responses, stability_lobes, steady_state
from gtmodel.milling.angle_search import NEAR_HZ, _hertz_apart, nearest_mode
from tests.milling.thesis import CUT, CUTTER, OSCILLATORS, X


@pytest.mark.parametrize(
    "call",
    [
        lambda: next(iter(responses(OSCILLATORS[:1], np.full((5, 3), np.nan), 1e-3))),
        lambda: steady_state(OSCILLATORS[:1], np.full((3, 3), np.inf + 0j), 10.0),
        lambda: stability_lobes(OSCILLATORS[0], CUTTER, CUT.mode, CUT.radial_depth, X).depth_at([-3.0]),
        lambda: stability_lobes(OSCILLATORS[0], CUTTER, CUT.mode, CUT.radial_depth, X).depth_at([np.nan]),
        lambda: proven_depth(OSCILLATORS[0], CUTTER, CUT.mode, CUT.radial_depth, 0.0, X),
    ],
)
def test_no_answer_from_what_is_no_number(call) -> None:
    with pytest.raises(ValueError, match=r"finite|expected more than 0"):
        call()


def test_a_mode_near_in_hertz_counts_though_another_is_nearer_relative_to_itself() -> None:
    m, f = np.full((1, 3), 100.0), np.array([[18.0, 110.0, 300.0]])
    o = Oscillators.with_damping_ratio(m, m * (2 * np.pi * f) ** 2, np.full((1, 3), 0.03))
    near = nearest_mode(o, 20.7)  # 103.5 Hz, 6 % below the mode at 110; 20.7 Hz is 15 % above that at 18
    assert abs(near.distance) > NEAR_HZ > _hertz_apart(o, 20.7)
    assert _hertz_apart(o, 20.7) == pytest.approx(2.7)
