"""Models 1 to 5 of D1 on synthetic robots of the printed error sizes (Dressler 2012, Table 5.3)."""

import numpy as np
import pytest

from tests.calibrate.d1 import fitted, mean_error, recorded, without_orientation

PRINTED = np.array([140.0, 120, 110, 100, 90]) * 1e-6  # m, means of models 1 to 5
STORY = 0.3
SEEDS = range(1, 8)
BEST = (False, True, False)  # straight pieces for actuator 2 alone, as the thesis chose


def test_six_links_predict_the_pose_better_than_three() -> None:
    r = recorded(1)
    three, six = mean_error(r, 1), mean_error(r, 3)
    assert len(r.fitted) + len(r.held_out) == 176 and six < 0.95 * three
    c = fitted(r, 3)
    assert c.estimate is not None and len(c.x) == 60
    turn = c.positioning_errors(r.held_out)["e"]
    assert np.degrees(np.abs(turn).max()) < 0.05  # 10 % of the variation of 0.5 deg
    assert "e" not in without_orientation(r.fitted).values


@pytest.mark.proof
def test_means_of_the_models_over_seven_robots() -> None:
    """Seeds 1 to 7. Models 1 and 2 tie here; the thesis's model 2 has the smaller mean and the greater peak."""
    found = []
    for seed in SEEDS:
        r = recorded(seed)
        found.append([mean_error(r, model, BEST) for model in (1, 2, 3, 4, 5)])
    one, two, three, four, five = means = np.mean(found, axis=0)
    assert means == pytest.approx(PRINTED, rel=STORY)
    assert min(one, two) > three > four > five
    assert two == pytest.approx(one, rel=0.05)
