"""Expected errors of unknowns: by their unit, by the data where a unit says nothing, or as stated."""

from dataclasses import replace

import numpy as np

from gtmodel.calibrate import Choice, Correction, MeasuredPoses, calibrate, prepare
from gtmodel.calibrate.report.intervals import Confidence
from tests.calibrate.drawn import drawing, drawn, poses_of
from tests.calibrate.hexapod import hexapod

OFFSETS = (Correction("n", offset=True),)
GEOMETRY = Choice(free=["A", "B"])


def homed(seed: int, turns: float, poses: int = 40) -> MeasuredPoses:
    """Hexapod; each leg homed elsewhere by so many revolutions."""
    one = poses_of("hexapod", drawn("hexapod", seed, poses))
    n = np.asarray(one.measurements.values["n"]) + turns * np.array([1.0, -1.0, 0.5, -0.5, 0.2, -0.8])
    return replace(one, measurements=replace(one.measurements, values={**one.measurements.values, "n": n},
                                             corrections=OFFSETS))  # fmt: skip


def test_revolutions_have_the_size_that_moves_a_leg_by_a_millimetre() -> None:
    m = homed(1, 0.01).measurements
    u = prepare(hexapod(), m, actuators="n").unknowns
    offsets = [k for k, n in enumerate(u.names) if n.startswith("n.offset")]
    assert len(offsets) == 6
    np.testing.assert_allclose(u.sizes[offsets], 1e-3 / np.array(hexapod().c), rtol=0.01)  # 14 thousandths of a turn
    assert set(np.delete(u.sizes, offsets)) == {1e-3}
    stated = prepare(hexapod(), m, Choice(sizes={"n.offset": 1e-3}), actuators="n").unknowns
    assert set(stated.sizes) == {1e-3}


def test_sizes_in_metres_and_of_directions_stay() -> None:
    one = poses_of("three_link", drawn("three_link", 1, 20)).measurements
    assert set(prepare(drawing("three_link", 1), one).unknowns.sizes) == {1e-3}


def test_intervals_of_offsets_in_revolutions_are_not_withheld() -> None:
    """Beside free base joints offsets are determined to 0.06 revolutions, 4 mm: 60 times 0.001."""
    m, robot = homed(3, 0.01).measurements, drawing("hexapod", 3)
    by_unit = {"n.offset": 1e-3}
    for sizes, holds in (({}, True), (by_unit, False)):
        c = calibrate(prepare(robot, m, Choice(free=["A"], sizes=sizes), actuators="n"))
        assert c.estimate is not None
        times = [c.estimate.std[c.estimate.names.index(f"n.offset[{k}]")] / 1e-3 for k in range(6)]
        confidence = Confidence(c)
        assert max(times) > 15 and confidence.holds == holds, (max(times), confidence.reasons)
        if not holds:
            assert "n.offset" in confidence.reasons[0] and "change sizes" in confidence.reasons[0]
