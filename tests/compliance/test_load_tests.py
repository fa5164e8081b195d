"""Joint stiffness from static load tests: made up, with planted tilt, from files, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compliance import (
    GravityCompensator,
    Load,
    LoadTestColumn,
    LoadTests,
    MeasuredTests,
    Setup,
    StiffnessStudy,
    SyntheticTests,
    made_load_tests,
    read_load_tests,
    stiffness_study,
)
from gtmodel.results import ArgumentError, SolveStatus
from tests.support.commands import CLONE

TRUTH = [3.93, 3.46, 2.77, 1.57, 0.24, 0.17]
MADE = SyntheticTests(stiffness=[1e6 * x for x in TRUTH], seed=9)
LOADS = [Load(force) for force in ([2000.0, 0.0, 0.0], [0.0, 2000.0, 0.0], [0.0, 0.0, -4000.0])]
SETUP = Setup(tool=[0.1, 0.05, 0.4])
COLUMNS = LoadTests(
    q=LoadTestColumn("q", "deg"), force=LoadTestColumn("force", "N"), moment=LoadTestColumn("moment", "N.m"),
    displacement=LoadTestColumn("displacement", "mm"), rotation=LoadTestColumn("rotation", "rad"),
)  # fmt: skip
WRIST = replace(COLUMNS, wrist=LoadTestColumn("wrist", "mm"))
SPRING = GravityCompensator(0.3, 0.25, 8e5, 0.2)
METHODS = ["complete_pose", "decoupled"]


@pytest.fixture(scope="module")
def robot():
    return gt.robots.kr500()


@pytest.fixture(scope="module")
def poses() -> list[list[float]]:
    """Of the shipped problem [rad]."""
    tests = gt.load(CLONE / "problems" / "stiffness_kr500.toml").arguments[1]
    return tests.q[:: len(LOADS)].tolist()


@pytest.fixture(scope="module")
def made(robot, poses) -> MeasuredTests:
    """The tests of the shipped problem."""
    return made_load_tests(robot, MADE, poses, LOADS, SETUP)


@pytest.fixture(scope="module")
def shipped(robot, made) -> StiffnessStudy:
    return stiffness_study(robot, made, SETUP)


def test_the_shipped_tests_are_recovered_and_say_that_they_are_synthetic(shipped) -> None:
    s = shipped
    assert s.status is SolveStatus.SOLVED and all(check.passed for check in s.checks.values())
    # six intervals of 95 % for the seed of the file, and the printed values inside
    assert all(low < 1e6 * k < high for k, (low, high) in zip(TRUTH, s.stiffness_interval, strict=True))
    assert s.interval("stiffness[3]") == tuple(s.stiffness_interval[3])
    assert s.interval("compliance[3]")[1] == pytest.approx(1 / s.stiffness_interval[3][0], rel=1e-12)
    with pytest.raises(ArgumentError, match=r"'stiffness\[6\]' was not estimated"):
        s.interval("stiffness[6]")
    assert all(s.agree) and s.adequate
    assert s.synthetic == "seed 9, noise 2e-05 m and 0.0001 rad"
    assert s.files["parameters.toml"].startswith("# synthetic: seed 9")
    assert "synthetic: seed 9" in s.figure("stiffness").axes[0].get_title()
    assert np.all(s.softest < s.stiffest) and len(s.best_tests) == 10


@pytest.mark.parametrize("method", METHODS)
def test_planted_tilt_fails_the_check_and_is_said(robot, poses, method) -> None:
    setup = replace(SETUP, method=method)
    found = stiffness_study(robot, made_load_tests(robot, replace(MADE, tilt=3.0), poses, LOADS, setup), setup)
    assert not found.checks["chi_squared_p"].passed and not found.adequate
    assert "the model lacks an effect" in found.adequacy and found.notes[0].startswith("the residuals are larger")
    assert "bearings tilt" in found.synthetic


@pytest.mark.parametrize("method", METHODS)
def test_a_measured_file_gives_what_its_tests_gave(robot, poses, tmp_path, method) -> None:
    setup = replace(SETUP, method=method, complementary=True)
    a = stiffness_study(robot, made_load_tests(robot, MADE, poses, LOADS, setup), setup)
    path = tmp_path / "tests.csv"
    path.write_text(a.files["load_tests.csv"])
    b = stiffness_study(robot, read_load_tests(path, WRIST), setup)
    np.testing.assert_allclose(b.stiffness, a.stiffness, rtol=1e-8)
    assert b.best_tests == a.best_tests and b.synthetic == a.synthetic
    # without a target at the wrist centre, that follows from the pose
    plain = stiffness_study(robot, read_load_tests(path, COLUMNS), setup)
    np.testing.assert_allclose(plain.stiffness, a.stiffness, rtol=0.05)
    with pytest.raises(ArgumentError, match=r"tests.csv line 2: .* is in mm here and declared in m"):
        read_load_tests(path, replace(COLUMNS, displacement=LoadTestColumn("displacement", "m")))
    with pytest.raises(ArgumentError) as caught:
        read_load_tests(path, replace(COLUMNS, force=LoadTestColumn("q", "deg")))
    assert caught.value.argument == "tests.force.column"


def test_a_compensator_given_or_estimated(robot, poses) -> None:
    def found(**changes: Any) -> StiffnessStudy:
        setup = replace(SETUP, compensator=replace(SPRING, **changes))
        return stiffness_study(robot, made_load_tests(robot, MADE, poses, LOADS, setup), setup)

    given, told = found(), found(estimate_rate=True)
    assert given.compensator_rate is None
    np.testing.assert_allclose(given.stiffness, MADE.stiffness, rtol=0.1)
    rate, std = told.compensator_rate
    assert abs(rate - 8e5) < 3 * std and std < 8e5 and told.other_method is None and told.adequate


def test_what_cannot_be_used_is_named(robot, poses, made) -> None:
    decoupled = replace(SETUP, method="decoupled", compensator=replace(SPRING, estimate_rate=True))
    one = made_load_tests(robot, MADE, poses, LOADS[2:], SETUP)
    for call, argument in (
        (lambda: stiffness_study(gt.robots.gantry_tau("l1_tape"), made, SETUP), "robot"),
        (lambda: stiffness_study(robot, one, SETUP), "load"),
        (lambda: stiffness_study(robot, made, decoupled), "setup.method"),
        (lambda: made_load_tests(robot, replace(MADE, stiffness=[1e6]), poses, LOADS, SETUP), "truth.stiffness"),
        (lambda: made_load_tests(robot, MADE, [], LOADS, SETUP), "poses"),
        (lambda: stiffness_study(robot, part(made, slice(1)), SETUP), "tests"),
        (lambda: stiffness_study(robot, replace(part(made), displacement=np.zeros_like(made.displacement))), "tests"),
    ):
        with pytest.raises(ArgumentError) as caught:
            call()
        assert caught.value.argument == argument


def part(tests: MeasuredTests, rows: Any = slice(None)) -> MeasuredTests:
    """Some of the tests as if they were measured, without a target at the wrist centre."""
    return MeasuredTests(tests.q[rows], tests.wrench[rows], tests.displacement[rows], lines=tests.numbered[rows] - 1)


def test_displacements_with_the_sign_turned_are_told_in_a_sentence(robot, made) -> None:
    found = stiffness_study(robot, replace(part(made), displacement=-made.displacement), SETUP)
    assert found.adequate, "residuals alone do not show it"
    assert "joints 1, 2, 3, 4, 5, 6 is negative beyond noise" in found.notes[0] and "wrong sign" in found.notes[0]
    assert found.softest is None and not found.checks["negative_compliances"].passed
    shown = {row.label: str(row.value) for row in found.rows}
    assert shown["stiffness of joint 1"].endswith("(negative, no interval)")


def test_copied_rows_are_told(robot, made, shipped) -> None:
    twice = replace(part(made, np.r_[0:30, 0:30]), lines=np.arange(2, 62))
    copied = stiffness_study(robot, twice, SETUP)
    assert not copied.checks["copied_rows"].passed and "copied_rows" not in shipped.checks
    assert copied.notes[0].startswith("30 of 60 tests are copies of others in every digit, the first line 32 of line 2")
    assert "negative_compliances" not in shipped.checks and "copies" not in "".join(shipped.notes)


def test_stopped_it_claims_nothing(robot, made) -> None:
    found = stiffness_study(robot, made, SETUP, stop=lambda: True)
    assert found.status is SolveStatus.INTERRUPTED and found.stiffness is None and found.rows == []
