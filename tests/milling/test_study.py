"""The milling study, called on objects: dynamics from three sources, places, stops, and what cannot be used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.milling import (
    AngleTable,
    MillingSearch,
    Modal,
    Oscillators,
    PathOffset,
    study,
)  # fmt: skip
from gtmodel.results import SolveStatus
from gtmodel.robots import kr500_limits, kr500_tables
from gtmodel.vibration import fit_oscillator_field
from tests.milling.shipped import ANGLES, GIVEN, MEASURED, PRINTED_CHOICE, RPM, TOOL
from tests.milling.thesis import CUT, CUTTER, OSCILLATORS, K
from tests.support.refusals import argument_of_refusal

COARSE = MillingSearch(refine=0, step=np.radians(4.0))


@pytest.fixture(scope="module")
def kr500():
    return gt.robots.kr500()


def milled(robot, cutter=CUTTER, cut=CUT, **changes):
    return study(robot, cutter, cut, **GIVEN | changes)


@pytest.fixture(scope="module")
def whole(kr500):
    search = replace(
        PRINTED_CHOICE, speeds=[1500 * RPM, 3225 * RPM], feed_directions=[[0.0, 1.0, 0.0]], refine=3,
        speed_range=[1200 * RPM, 3600 * RPM],
    )  # fmt: skip
    return milled(
        kr500, search=search, lobes=(600 * RPM, 6000 * RPM), compensation=PathOffset(), tests=kr500_tables()
    )  # fmt: skip


def test_it_answers_in_words(whole) -> None:
    s = whole
    assert s.status is SolveStatus.SOLVED and all(check.passed for check in s.checks.values())
    assert s.guideline[0].startswith("use the dynamic model: at 64.5 Hz its angle 51 deg")
    assert "6.28 Hz above the mode along y at 58.2 Hz" in s.guideline[1]
    assert s.static_choice == pytest.approx(np.radians(110)) and s.ratio > 3
    # the index of the refined angle is not above that of the grid, which holds the printed choice
    grid = s.combinations[0]
    assert 1e3 * s.dynamic_index <= grid["index_mm"] < 1e3 * s.static_choice_index
    angle, rpm, index = s.free_speed
    assert 49 <= angle <= 110 and 1200 <= rpm <= 3600 and index < 1e3 * s.dynamic_index
    assert len(s.combinations) == 6 and all(ok for *_, ok in s.refined)
    assert s.spectral_radius < 1 and s.mode_coupling.startswith("no sign")
    none, static, dynamic, slow = s.compensation_rms
    assert dynamic < 1e-3 * none and static < slow < 0.2 * none
    assert s.files["compensation.csv"].startswith("time_s,x_m,y_m,z_m,offset_x_m") and len(s.printed_mean["+x"]) == 12
    said = [row.value for row in s.rows if row.label == "printed tests"]
    assert any(x.startswith("test 9 is missed") for x in said) and any(x.startswith("test 10 is missed") for x in said)
    assert sum(row.label.startswith("test ") for row in s.rows) == 12


def test_pictures(whole, monkeypatch) -> None:
    monkeypatch.setattr("gtmodel.milling.milling_study.SPEEDS", 9)  # of the lobes, each proven
    assert set(whole.figures) == {"angle", "lobes", "compensation", "printed_tests"}
    for name in whole.figures:
        whole.figure(name).canvas.draw()
    static, dynamic, modes = whole.figure("angle").axes
    assert static.get_title().startswith("static index") and dynamic.get_title().startswith("dynamic index")
    # the least of each curve is marked where the curve has it, whatever was chosen
    for panel, index in ((static, static.lines[0]), (dynamic, dynamic.lines[0])):
        mark = next(line for line in panel.lines if line.get_label().startswith("minimum"))
        assert mark.get_ydata()[0] == np.nanmin(index.get_ydata())
    assert "tooth frequency" in modes.get_legend_handles_labels()[1]


def test_static_alone_and_the_unreachable_part(kr500) -> None:
    found = milled(kr500, dynamics=None)
    low, high = found.reachable[0]
    assert -np.pi < low < found.static_angle < high < np.pi
    assert found.guideline is None and found.objective is None
    found.figure("angle").canvas.draw()


def test_dynamics_from_joint_stiffness_are_refined_in_reach(kr500) -> None:
    modal = Modal([170.0, 100.0, 280.0], [0.09, 0.1, 0.09])
    found = milled(kr500, dynamics=modal, search=MillingSearch(refine=2, step=np.radians(5.0)))
    low, high = found.reachable[0]
    assert low <= found.dynamic_angle <= high and "not a measurement" in found.dynamics
    assert 1e3 * found.dynamic_index <= found.combinations[0]["index_mm"] and all(ok for *_, ok in found.refined)
    assert found.static_choice == found.static_angle


@pytest.fixture(scope="module")
def field():
    o = OSCILLATORS[np.array([3, 1, 0, 5, 4, 9])]
    angles = np.deg2rad([49.0, 52.0, 110.0, 45.0, 110.0, 53.0])
    x, y = np.array([[-0.01073] * 3 + [0.6159] * 2 + [-0.00025], [-2.40047] * 5 + [-2.11124]])
    poses = np.column_stack([x, y, np.full(6, 0.30341), angles])
    return fit_oscillator_field(
        poses, o.m, o.c, o.k, starts=1, calibrate=False, synthetic="a field through six printed poses"
    )[0]  # fmt: skip


def test_a_field_over_the_poses_says_that_it_is_synthetic(kr500, field) -> None:
    found = milled(kr500, dynamics=field, source="field.toml", search=replace(COARSE, refine=1))
    assert found.dynamics == (
        "Gaussian processes over the pose, field.toml; synthetic: a field through six printed poses"
    )
    assert "synthetic dynamics" in found.figure("angle").get_suptitle()
    assert 1e3 * found.dynamic_index <= found.combinations[0]["index_mm"] and found.refined[0][2]


def test_nothing_is_answered_where_a_field_knows_little_more_than_the_mean_of_its_poses(kr500, field) -> None:
    away = [1.8, 1.0, 0.5]
    assert argument_of_refusal(lambda: milled(kr500, dynamics=field, place=away, search=COARSE)) == "dynamics"
    beside = milled(kr500, dynamics=field, search=replace(COARSE, places=[away])).combinations
    assert "measured poses are too far" in beside[1]["reason"] and "index_mm" in beside[0]


def test_places_that_cannot_be_reached_say_why(kr500) -> None:
    places = [[0.6159, -2.40092, 0.30447], [9.0, 0.0, 0.0]]
    found = milled(kr500, search=replace(COARSE, places=places)).combinations
    assert [("index_mm" in c) for c in found] == [True, True, False]
    assert "it is out of reach" in found[2]["reason"]


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"cut": replace(CUT, radial_depth=0.03)}, "cut.radial_depth"),
        ({"speed": 0.0}, "speed"),
        ({"speed": 1e9 * RPM}, "speed"),
        ({"search": MillingSearch(speeds=[2.0, -1.0])}, "search.speeds[1]"),
        ({"search": MillingSearch(feed_directions=[[0.0, 0.0, 1.0]])}, "search.feed_directions[0]"),
        ({"feed": [0.0, 0.0, 1.0]}, "feed"),
        ({"place": [9.0, 0.0, 0.0]}, "place"),
        ({"limits": np.radians([[-1.0, 1.0]] * 6)}, "place"),
        ({"limits": [[1.0, -1.0]]}, "limits"),
        ({"tool": replace(TOOL, spindle=[0.0] * 3)}, "tool"),
        ({"joint_stiffness": [1.0] * 5}, "joint_stiffness"),
        ({"search": MillingSearch(static_choice=0.0)}, "search.static_choice"),
        ({"search": replace(PRINTED_CHOICE, speed_range=[50.0, 20.0])}, "search.speed_range"),
        ({"lobes": (10.0, 2.0)}, "lobes"),
        ({"lobes": (2.0, 10.0), "dynamics": None}, "lobes"),
        ({"compensation": PathOffset(), "dynamics": None}, "compensation"),
        ({"dynamics": AngleTable(np.radians([150.0, 151.0, 152.0]), MEASURED)}, "dynamics"),
        ({"cutter": replace(CUTTER, coefficients=replace(K, K_tc=903.77))}, "cutter.coefficients.K_tc"),
        ({"cutter": replace(CUTTER, diameter=25.4)}, "cutter.diameter"),
        ({"cut": replace(CUT, feed_per_tooth=0.526)}, "cut.feed_per_tooth"),
        ({"cut": replace(CUT, axial_depth=5.08)}, "cut.axial_depth"),
    ],
)
def test_what_cannot_be_used_is_named(kr500, changes, argument) -> None:
    assert argument_of_refusal(lambda: milled(kr500, **changes)) == argument


def test_a_robot_that_is_no_arm_is_named() -> None:
    l1 = gt.robots.gantry_tau("l1_tape")
    assert argument_of_refusal(lambda: milled(l1)) == "robot"
    assert argument_of_refusal(lambda: milled(l1, limits=kr500_limits())) == "robot"


@pytest.mark.parametrize(("after", "known"), [(0, False), (2, True), (3, True)])
def test_stopped_it_keeps_what_stiffness_tells(kr500, after: int, known: bool) -> None:
    """The first look is before the arm's model is made: then there is nothing to keep."""
    asked: list[None] = []

    def stop() -> bool:
        asked.append(None)
        return len(asked) > after

    found = milled(kr500, search=COARSE, stop=stop)
    assert found.status is SolveStatus.INTERRUPTED and found.guideline is None
    assert (found.static_index is not None and found.static_index > 0) is known


def test_what_the_report_leaves_open_is_said(kr500) -> None:
    coarse = replace(PRINTED_CHOICE, step=np.radians(10.0))

    def rows(**changes) -> dict[str, str]:
        return {row.label: str(row.value) for row in milled(kr500, search=coarse, **changes).rows}

    usual = rows()
    assert "not steady" not in usual and "runout" not in usual["regenerative chatter"]
    # a tenth of a per cent of damping: two seconds from rest are not enough
    slack = Oscillators(MEASURED.m, MEASURED.c / 100, MEASURED.k)
    assert "of the transient along" in rows(dynamics=AngleTable(ANGLES, slack))["not steady"]
    out = replace(CUTTER, runout=np.array([0.0, 2e-5]))
    assert "runout is not included" in rows(cutter=out)["regenerative chatter"]
    uneven = rows(cutter=replace(CUTTER, tooth_angles=np.radians([0.0, 150.0])))["regenerative chatter"]
    assert uneven != usual["regenerative chatter"] and "runout" not in uneven
    assert rows(speed=6 * RPM)["regenerative chatter"].startswith("unknown")
