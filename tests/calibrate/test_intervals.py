"""Intervals are given where residuals are noise, and withheld where they are not."""

from pathlib import Path

import numpy as np
import pytest

from gtmodel.calibrate import Calibration, Fit, calibrate, prepare, read_poses, study
from gtmodel.calibrate.report.intervals import Confidence
from gtmodel.results import ArgumentError, SolveStatus
from tests.calibrate.shipped import MEASURED, path_of, robot, shipped, solved, written
from tests.calibrate.synthetic import measured, true_robot

SEEDS = range(20)
NOISE = {"q": 13e-6, "T": 50e-6}  # m: repeatability and tracker


@pytest.fixture(scope="module")
def fits() -> list[Calibration]:
    """Of poses with nothing but normal noise (synthetic, seeds 0..19)."""
    problem = prepare(true_robot("three_link"), measured("three_link", 60, NOISE, 0))
    return [calibrate(problem.on(measured("three_link", 60, NOISE, seed))) for seed in SEEDS]


def test_noise_alone_keeps_its_intervals(fits: list[Calibration]) -> None:
    """A false alarm in 2 % of the fits at most (two tests of 1 %): more than three of 20 in 1e-3 of all draws."""
    assert sum(not Confidence(c).holds for c in fits) <= 3


def test_a_noise_stated_too_small_takes_them_away(fits: list[Calibration]) -> None:
    m = fits[0].problem.measurements
    small = {n: 0.5 * np.asarray(s) for n, s in m.noise.items()}
    problem = prepare(true_robot("three_link"), type(m)(m.values, small))
    reasons = Confidence(calibrate(problem)).reasons
    assert "times the stated noise" in reasons[0] and "95 % intervals are not valid" in reasons[-1]


def test_guideway_errors_are_seen_in_the_order_of_their_own_positions() -> None:
    v = shipped("l1").values
    assert not v["intervals_hold"] and all(u["interval_95"] is None and u["std"] > 0 for u in v["unknowns"])
    for arm in range(3):
        assert any(f"arm[{arm}].rod, poses ordered by q[{arm}]" in s for s in v["notes"])
    rows = [row for row in shipped("l1").rows if "95 %" in row.label]
    assert rows == [] and "95 % intervals are not valid" in str(shipped("l1").files["parameters.toml"])


def test_an_interval_is_given_by_name_where_it_holds() -> None:
    done = study(true_robot("three_link"), measured("three_link", 60, NOISE, 0), Fit(sensitivity_step=0.0))
    assert done.intervals_hold and done.unknowns and done.estimate is not None and not done.withheld
    for u in done.unknowns:
        assert done.interval(u["name"]) == tuple(u["interval_95"])
    low, high = done.interval("L[0]", 0.5)
    assert done.interval("L[0]")[0] < low < high < done.interval("L[0]")[1]
    with pytest.raises(ArgumentError, match="'L' was not estimated"):
        done.interval("L")


def test_an_interval_that_does_not_hold_is_refused_with_its_reason() -> None:
    done = shipped("l1")
    with pytest.raises(ArgumentError, match="95 % intervals are not valid: the residuals are not independent"):
        done.interval("L[0]")
    assert done.estimate is None and done.withheld == done.notes[-1]
    with pytest.raises(ArgumentError, match="no estimates"):
        study(robot("l1"), read_poses(path_of("l1"), MEASURED["l1"]), stop=lambda: True).interval("L[0]")


def test_a_calibration_gives_the_interval_of_its_estimate(fits: list[Calibration]) -> None:
    c = fits[0]
    assert c.estimate is not None and c.interval("L[0]", 0.9) == c.estimate.interval("L[0]", 0.9)
    with pytest.raises(ArgumentError, match="there is no estimate"):
        calibrate(c.problem, confidence=False).interval("L[0]")


def test_one_cart_in_other_units_is_no_sound_calibration(tmp_path: Path) -> None:
    """Its direction takes the factor up, so that no held-out error tells it."""
    outcome = solved("l1", written(tmp_path, "l1", lambda r: [str(float(r[0]) / 10), *r[1:]]))
    assert not outcome.checks["moved_too_far"].passed
    assert any("the length of v[0] changed by a factor of 10" in s for s in outcome.values["notes"])
    assert outcome.values["prediction_proven"] is False
    assert any(s.startswith("prediction not proven") and "v[0]" in s for s in outcome.values["verdict"])
    assert "moved_too_far" not in shipped("l1").checks and "moved_too_far" not in shipped("f1").checks


def test_holding_every_pose_out_is_refused() -> None:
    with pytest.raises(ArgumentError) as caught:
        solved("l1", held_out=1)
    assert caught.value.argument == "held_out"


def test_one_arm_may_be_calibrated_alone() -> None:
    outcome = solved("l1", free=["L[0]", "A[0]"])
    assert outcome.status is SolveStatus.CHECK_FAILED and "mean_error_mm" in outcome.message  # the other two are as bad
    assert [u["name"] for u in outcome.values["unknowns"]] == [
        "A[0,0]",
        "A[0,1]",
        "A[0,2]",
        "L[0]",
    ]
    assert outcome.values["link_errors_mm"]["arm[0].rod"] < outcome.values["link_errors_mm"]["arm[1].rod"]


def test_unlike_units_are_not_tied() -> None:
    with pytest.raises(ArgumentError, match=r"'A\[0,0\]' in m is tied to 'v\[0,0\]' in 1"):
        solved("l1", tied={"A[0,0]": "v[0,0]"})
