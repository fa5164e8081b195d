"""A given motion in place of the sines: an excitation's trajectory identifies the L1; what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import SyntheticLog, multisine, read_motion, synthetic_study
from gtmodel.results import ArgumentError
from tests.identify.plants import BAND, SAMPLE_TIME, plant

PERIOD = 8.0  # s
LINKS = gt.robots.inertia_variant("links")
WAY = SyntheticLog(seed=2012, duration=12.0)


@pytest.fixture(scope="module")
def motion() -> np.ndarray:
    """A closed motion of the tool."""
    time = SAMPLE_TIME * np.arange(round(PERIOD / SAMPLE_TIME) + 1)
    return multisine(time, np.asarray(plant().home, dtype=float), np.full(3, 0.3), np.array(BAND), seed=9)


def test_a_given_motion_runs_several_times(motion: np.ndarray):
    way = SyntheticLog(seed=2012, duration=12.0, repeats=2)
    found = synthetic_study(LINKS.robot, way, LINKS.free, plant=LINKS.robot.with_(m_a=[0.5, 1.0, 1.5]), motion=motion)
    assert all(check.passed for check in found.checks.values()), found.checks
    # the ends cut by the filter are half a second each; the sines of the held-out motion are 12 s long
    assert 2 * PERIOD - 2.0 < found.trajectory.time[-1] < 2 * PERIOD
    assert found.parameters["m_p"] == pytest.approx(9.13, abs=0.6)


@pytest.mark.parametrize(
    ("change", "options", "argument"),
    [
        (lambda T: T[:, :2], {}, "motion"),
        (lambda T: T + np.linspace(0, 0.1, len(T))[:, None], {"repeats": 2}, "synthetic.repeats"),
        (lambda T: T + 5.0, {}, "motion"),
        (lambda T: T, {"reference": "nothing"}, "synthetic.reference"),
    ],
)
def test_wrong_motions_are_named(motion: np.ndarray, change, options, argument):
    with pytest.raises(ArgumentError) as caught:
        synthetic_study(LINKS.robot, SyntheticLog(**options), LINKS.free, motion=change(motion))
    assert caught.value.argument == argument


def test_a_motion_is_read_from_a_file(motion: np.ndarray, tmp_path: Path):
    time = SAMPLE_TIME * np.arange(len(motion))
    gt.Trajectory(time, {"T": motion}, {"T": "m"}).to_csv(tmp_path / "trajectory.csv")
    np.testing.assert_array_equal(read_motion(tmp_path / "trajectory.csv", LINKS.robot, WAY), motion)
    for options, argument in (
        ({"reference": "q"}, "motion"),
        ({"sample_time": 0.008}, "motion"),
        ({"reference": "nothing"}, "synthetic.reference"),
    ):
        with pytest.raises(ArgumentError) as caught:
            read_motion(tmp_path / "trajectory.csv", LINKS.robot, SyntheticLog(**options))
        assert caught.value.argument == argument


def test_many_axes_move_each_at_its_own_frequency() -> None:
    time = np.arange(0.0, 8.0, 0.01)
    q = multisine(time, np.zeros(20), np.ones(20), np.array([0.5, 1.1]), seed=2)
    assert np.all(np.isfinite(q)) and np.allclose(np.abs(q).max(axis=0), 1.0)
    assert np.linalg.matrix_rank(q) == 20
    turns = np.sum(np.diff(np.sign(q[np.abs(q).min(axis=1) > 0]), axis=0) != 0, axis=0)
    assert turns.min() >= 2  # none at a frequency near zero
