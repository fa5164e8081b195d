"""The friction study, called on objects."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import (
    ConstantVelocity,
    FrictionCoefficients,
    HeldPose,
    Runs,
    SyntheticRuns,
    constant_velocity_log,
    friction_study,
    published_friction_study,
)
from gtmodel.lang import Model
from gtmodel.results import ArgumentError, SolveStatus

PATTERN = [-176.9, -14.6, 191.5]
PLUS, MINUS = [189.12, 262.59, 239.06], [145.69, 119.23, 177.22]
FORTH, BACK = [205.03, 190.0, 185.94], [158.01, 133.76, 197.52]
MASS = 22.38
TABLE = FrictionCoefficients(PLUS, MINUS, FORTH, BACK, MASS)  # Dressler 2012, Tables 6.1 and 6.2
STAR = HeldPose(name="star", holding=PATTERN, holding_mass=MASS)
SPEEDS = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0]
MADE = SyntheticRuns(PLUS, MINUS, FORTH, BACK, MASS, velocities=SPEEDS, seed=61)
FEW = replace(MADE, velocities=[0.2, 0.5, 1.0], seed=5)
PLACES = [[0.5, -0.9, 0.3], [0.5, -1.1, 0.5], [0.5, -0.7, 0.5], [0.5, -1.1, 0.1], [0.5, -0.7, 0.1]]
POSES = [HeldPose(name=f"place {n}", tcp=place) for n, place in enumerate(PLACES)]


@pytest.fixture(scope="module")
def l1() -> Model:
    return gt.robots.gantry_tau("l1_tape")


@pytest.fixture(scope="module")
def found(l1):
    return friction_study(l1, MADE, POSES)


def test_slopes_of_synthetic_logs_are_within_one_percent(found) -> None:
    assert found.status is SolveStatus.SOLVED and found.runs == 2 * len(MADE.velocities) * len(POSES)
    assert np.allclose(found.viscous_plus, FORTH, rtol=0.01) and np.allclose(found.viscous_minus, BACK, rtol=0.01)
    assert found.checks["slope_error"].passed
    # levels are left open by the choice of the mass, their sum is not
    assert np.allclose(found.coulomb_plus + found.coulomb_minus, np.add(PLUS, MINUS), atol=2.0)


def test_what_is_synthetic_says_so(found) -> None:
    assert found.synthetic.startswith("seed 61, white force noise 5 N")
    assert found.files["parameters.toml"].startswith("# synthetic: seed 61")
    assert "synthetic: seed 61" in found.figure("friction")._suptitle.get_text()
    kept = tomllib.loads(found.files["parameters.toml"])
    assert kept["viscous_plus_kg_s"] == list(found.viscous_plus) and kept["mass_kg"] == found.mass


def test_poses_tell_the_mass_where_friction_does_not_change(l1) -> None:
    s = friction_study(l1, MADE, POSES, gravity="poses")
    low, high = s.mass_interval
    assert s.interval("m") == (low, high)
    assert low < MASS < high and high - low < 0.1
    assert np.allclose(s.coulomb_plus, PLUS, atol=1.0) and np.allclose(s.coulomb_minus, MINUS, atol=1.0)


def test_table_6_1_by_three_norms(l1) -> None:
    s = published_friction_study(l1, TABLE, STAR)
    assert s.mass == s.mass_by_norm["two"] == pytest.approx(22.7, abs=0.05)  # the thesis: 22.38 by eye
    assert s.mass_by_norm["one"] == pytest.approx([19.63, 25.99], abs=0.01) and s.mass_by_norm["maximum"] < 18.0
    # fc+ + fc- by cart is the same combination of forces whatever the mass
    assert np.allclose(s.coulomb_plus + s.coulomb_minus, np.add(PLUS, MINUS), atol=1e-9)
    assert s.objective < s.asymmetry
    assert "actuator 3" in [axes.get_title() for axes in s.figure("friction").axes]


def test_recordings_and_their_runs_give_what_made_up_ones_do(l1) -> None:
    def law(v: np.ndarray) -> np.ndarray:
        return np.array(PATTERN) + np.where(v > 0, PLUS + FORTH * v, np.where(v < 0, -np.array(MINUS) + BACK * v, 0.0))

    log = constant_velocity_log(FEW.velocities, law, np.full(3, 30.0), seed=5, noise=5.0, title="star")
    s, made = (
        friction_study(l1, [[log]], [STAR], constant_velocity=ConstantVelocity(slowest=0.1)),
        friction_study(l1, FEW, [STAR]),
    )
    np.testing.assert_allclose(s.viscous_plus, made.viscous_plus, rtol=1e-9)
    assert s.mass == pytest.approx(made.mass) and "slope_error" not in s.checks and s.runs == made.runs
    with pytest.raises(ArgumentError) as caught:
        friction_study(l1, [[log]], [STAR], constant_velocity=ConstantVelocity(steady_acceleration=1e-9))
    assert caught.value.argument == "runs[0]"


def test_a_plant_without_viscous_friction_has_no_relative_error_of_it(l1) -> None:
    s = friction_study(l1, replace(MADE, viscous_plus=[0.0] * 3, viscous_minus=[0.0] * 3), POSES)
    assert set(s.checks) == {"least_friction_N"} and np.all(np.abs(s.viscous_plus) < 1.0)


def test_each_slope_is_held_against_its_own_noise_and_advice_asks_for_what_is_not_done_yet(l1) -> None:
    s = friction_study(l1, replace(FEW, viscous_minus=[158.01, 1e-3, 197.52]), [STAR])
    # the largest relative error is that of the flat line, and all of it is noise
    assert s.checks["slope_error"].passed and s.checks["slope_error"].value < s.checks["slope_error"].bound
    choice = s.checks["least_friction_N"].advice
    symmetric = friction_study(l1, FEW, [STAR], directions="symmetric").checks["least_friction_N"].advice
    assert "poses" in choice and symmetric != choice and "gravity =" not in symmetric


@pytest.mark.parametrize(
    ("runs", "poses", "options", "argument"),
    [
        (FEW, [], {}, "poses"),
        (FEW, [HeldPose()], {}, "poses[0]"),
        (FEW, [STAR, HeldPose(tcp=PLACES[0], holding=PATTERN)], {}, "poses[1]"),
        (FEW, [HeldPose(holding=PATTERN)], {}, "poses[0].holding_mass"),
        (FEW, [STAR, HeldPose(holding=[1.0], holding_mass=1.0)], {}, "poses"),
        (FEW, [STAR], {"gravity": "poses"}, "poses"),
        (replace(FEW, coulomb_plus=[1.0]), [STAR], {}, "runs.coulomb_plus"),
        (replace(FEW, velocities=[0.5]), [STAR], {}, "runs.velocities"),
        (replace(FEW, velocities=[0.5, 0.5]), [STAR], {}, "runs"),
        ([[], []], [STAR], {}, "runs"),
        ([[]], [STAR], {}, "runs"),
        (Runs(np.ones((2, 3)), np.ones((2, 2)), np.zeros(2), np.ones(2), np.ones((2, 3))), [STAR], {}, "runs"),
    ],
)
def test_what_cannot_be_used_is_named(l1, runs, poses, options: dict[str, Any], argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        friction_study(l1, runs, poses, **options)
    assert caught.value.argument == argument


@pytest.mark.parametrize("tcp", [[0.5, -0.9], [0.5, -9.0, 0.3]])
def test_a_place_that_cannot_be_weighed_is_named(l1, tcp) -> None:
    with pytest.raises(ArgumentError) as caught:
        friction_study(l1, FEW, [HeldPose(tcp=tcp)])
    assert caught.value.argument == "poses[0].tcp"


def test_coefficients_of_other_carts_are_named(l1) -> None:
    with pytest.raises(ArgumentError) as caught:
        published_friction_study(l1, replace(TABLE, viscous_minus=[1.0]), STAR)
    assert caught.value.argument == "published.viscous_minus"


@pytest.mark.parametrize("make", [gt.robots.f1_gantry_tau, gt.robots.kr500])
def test_a_robot_that_its_tool_point_does_not_place_or_without_masses(make) -> None:
    with pytest.raises(ArgumentError) as caught:
        friction_study(make(), FEW, POSES[:1])
    assert caught.value.argument == "robot"


def test_interrupted_it_has_no_numbers(l1) -> None:
    s = friction_study(l1, FEW, [STAR], stop=lambda: True)
    assert s.status is SolveStatus.INTERRUPTED and s.mass is None and not s.files
