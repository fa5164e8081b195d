"""Sessions of one robot: those that agree within their noise, and those that do not."""

from dataclasses import replace

import numpy as np

from gtmodel.calibrate import MeasuredPoses, calibrate, prepare, study
from gtmodel.calibrate.report.diagnostics import between_sessions
from tests.calibrate.drawn import KINDS, drawing, drawn, poses_of

STRETCHED = np.array([0.0, 2e-3, 0.0])  # m: of the second cart, on the second day
FIT = KINDS["three_link"].fit


def days(seed: int, shift: np.ndarray | float = 0.0) -> MeasuredPoses:
    values = [drawn("three_link", 2 * seed + k, 40) for k in (0, 1)]
    values[1]["q"] = values[1]["q"] + shift
    both = poses_of("three_link", {n: np.vstack([v[n] for v in values]) for n in values[0]})
    return replace(both, measurements=replace(both.measurements, sessions=["monday"] * 40 + ["friday"] * 40))


def test_recordings_that_agree_are_not_said_to_differ() -> None:
    robot = drawing("three_link", 1)
    for seed in range(8):
        c = calibrate(prepare(robot, days(seed).measurements))
        assert between_sessions(c) is None


def test_recordings_with_disjoint_intervals_are_said_with_how_much() -> None:
    poses = days(1, STRETCHED)
    apart = between_sessions(calibrate(prepare(drawing("three_link", 1), poses.measurements)))
    assert apart is not None and apart.worst.startswith("A[1,") and set(apart.pair) == {"monday", "friday"}
    (low, high), (least, most) = apart.intervals
    assert high < least or most < low
    # two values that lie d apart have the standard deviation d / sqrt(2); part of the shift is along two axes
    assert 0.2 * 2e-3 < apart.spread[apart.worst] < 2e-3
    notes = study(drawing("three_link", 1), poses, FIT).notes
    assert any(n.startswith("recordings have disjoint 95 % intervals of") and "not the machine" in n for n in notes)
    assert not any("disjoint" in n for n in study(drawing("three_link", 1), days(1), FIT).notes)


def test_intervals_say_which_recording_they_describe() -> None:
    one = poses_of("three_link", drawn("three_link", 1, 80))
    for poses, what in ((one, "noise of this recording; "), (days(1), "noise of these recordings; ")):
        assert any(what in s for s in study(drawing("three_link", 1), poses, FIT).verdict or ())
