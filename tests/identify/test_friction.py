"""Friction from constant-velocity runs: exact lines come back, intervals hold, and what is open stays open."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from gtmodel.identify import (
    Runs,
    concatenate,
    constant_velocity_log,
    constant_velocity_runs,
    identify_friction,
    mass_by_norm,
)
from gtmodel.results import ArgumentError, TrajectoryError

PATTERN = np.array([[-7.9, -0.65, 8.55], [-11.7, -0.96, 12.66], [-9.0, -1.5, 10.5]])
PLUS, MINUS = np.array([189.0, 262.0, 239.0]), np.array([146.0, 119.0, 177.0])
FORTH, BACK = np.array([205.0, 190.0, 186.0]), np.array([158.0, 134.0, 197.0])
MASS = 22.4
SPEEDS = np.array([0.1, 0.3, 0.6, 1.0])


def runs(noise: float = 0.0, seed: int = 0, poses: int = 3) -> Runs:
    """Synthetic: force noise of this standard deviation [N] on the mean of every run."""
    v = np.concatenate([SPEEDS, -SPEEDS] * poses)
    pose = np.repeat(np.arange(poses), 2 * SPEEDS.size)
    v = np.repeat(v[:, None], 3, axis=1)
    force = MASS * PATTERN[pose] + np.where(v > 0, PLUS + FORTH * v, -MINUS + BACK * v)
    force += np.random.default_rng(seed).normal(0.0, noise, force.shape) if noise else 0.0
    return Runs(v, force, pose, np.ones(len(pose)), np.zeros_like(v))


def test_exact_runs_of_several_poses_give_all_parameters() -> None:
    fit = identify_friction(runs(), PATTERN, gravity="poses")
    assert fit.mass == pytest.approx(MASS, rel=1e-12)
    for found, true in (
        (fit.coulomb_plus, PLUS), (fit.coulomb_minus, MINUS), (fit.viscous_plus, FORTH), (fit.viscous_minus, BACK)
    ):  # fmt: skip
        assert np.allclose(found, true, rtol=1e-11)
    assert np.allclose(fit.force(np.array([0.5, -0.5]), 2, pose=1), MASS * PATTERN[1, 2] + [332.0, -275.5], rtol=1e-11)


def test_the_most_symmetric_mass_leaves_the_least_asymmetry() -> None:
    fit = identify_friction(runs(poses=1), PATTERN[:1])

    def asymmetry(mass: float) -> float:
        return float(np.sum(((PLUS - MINUS) / 2 + (MASS - mass) * PATTERN[0]) ** 2))

    assert fit.mass == pytest.approx(minimize_scalar(asymmetry).x, rel=1e-8)
    assert np.allclose((fit.coulomb_plus - fit.coulomb_minus) @ PATTERN[0], 0.0, atol=1e-9)
    assert np.allclose(fit.coulomb_plus + fit.coulomb_minus, PLUS + MINUS, rtol=1e-11)
    # whichever mass: the same forces
    assert np.allclose(fit.force(SPEEDS, 0), runs(poses=1).force[:4, 0], rtol=1e-11)
    assert "cannot be distinguished on one actuator" in fit.notes[0]
    assert "fc+ by +7.90, +0.65, -8.55 N" in fit.notes[1]


def test_symmetric_friction_is_determined_from_one_pose() -> None:
    data = runs(poses=1)
    level = (PLUS + MINUS) / 2
    force = MASS * PATTERN[:1] + np.sign(data.velocity) * level + FORTH * data.velocity
    fit = identify_friction(data._replace(force=force), PATTERN[:1], symmetric=True)
    assert fit.mass == pytest.approx(MASS, rel=1e-12)
    assert np.allclose(fit.coulomb_plus, level) and np.allclose(fit.viscous_minus, FORTH)
    assert len(fit.notes) == 1


@pytest.mark.parametrize(("count", "low", "high"), [(50, 41, 50), pytest.param(200, 179, 198, marks=pytest.mark.proof)])
def test_intervals_hold_the_truth_as_often_as_they_say(count: int, low: int, high: int) -> None:
    """Seeds fixed beforehand; 99.9 % band of a binomial at 0.95."""
    truth = {"m": MASS, "coulomb_plus[1]": PLUS[1], "viscous_minus[2]": BACK[2]}
    hits = dict.fromkeys(truth, 0)
    for seed in range(count):
        estimate = identify_friction(runs(3.0, seed), PATTERN, gravity="poses").estimate
        for name, true in truth.items():
            start, end = estimate.interval(name)
            hits[name] += start <= true <= end
    assert all(low <= n <= high for n in hits.values()), hits


def test_norms_of_the_asymmetry() -> None:
    middle = MASS * PATTERN[0] + (PLUS - MINUS) / 2
    found = mass_by_norm(middle, PATTERN[0])
    masses = np.linspace(-100, 100, 200001)
    left = np.abs(middle - masses[:, None] * PATTERN[0])
    assert found.two == pytest.approx(masses[np.argmin((left**2).sum(axis=1))], abs=1e-3)
    assert found.maximum == pytest.approx(masses[np.argmin(left.max(axis=1))], abs=1e-3)
    least = masses[left.sum(axis=1) <= left.sum(axis=1).min() + 1e-9]
    # |g1| + |g2| = |g3|: the 1-norm is flat between two carts
    assert found.one == pytest.approx((least[0], least[-1]), abs=2e-3) and least[-1] - least[0] > 1
    assert len(set(mass_by_norm([1.0, 2.0, 6.0], [1.0, 1.0, 1.0]).one)) == 1


def law(v: np.ndarray) -> np.ndarray:
    return np.where(v > 0, PLUS + FORTH * v, np.where(v < 0, -MINUS + BACK * v, 0.0))


def test_runs_are_found_in_a_log() -> None:
    log = constant_velocity_log(SPEEDS.tolist(), law, np.full(3, 30.0), seed=3, noise=0.0)
    found = constant_velocity_runs(log)
    assert np.allclose(found.velocity[:, 0], np.repeat(SPEEDS, 2) * np.tile([1, -1], 4), rtol=1e-4)
    assert np.allclose(found.force, law(found.velocity), rtol=1e-4)
    assert log.trajectory.synthetic == "seed 3, white force noise 0 N, positions in steps of 1e-06 m"
    again = constant_velocity_log(SPEEDS.tolist(), law, np.full(3, 30.0), seed=3, noise=0.0)
    assert again.trajectory == log.trajectory
    with pytest.raises(TrajectoryError, match=r"no run of 5 s at constant velocity"):
        constant_velocity_runs(log, shortest=5.0)


@pytest.mark.parametrize("symmetric", [False, True])
@pytest.mark.parametrize("gravity", ["most_symmetric", "poses"])
@pytest.mark.parametrize("seed", range(3))
def test_signs_that_no_drive_can_have_are_refused(seed: int, gravity: Any, symmetric: bool) -> None:
    data = runs(3.0, seed)
    how = dict(gravity=gravity, symmetric=symmetric)
    for wrong in (data._replace(force=-data.force), data._replace(velocity=-data.velocity)):
        with pytest.raises(ArgumentError, match=r"cart 1: friction would drive it .* check the sign"):
            identify_friction(wrong, PATTERN, **how)
    one = data.force * [1, 1, -1]
    with pytest.raises(ArgumentError, match=r"cart 3: friction would drive it"):
        identify_friction(data._replace(force=one), PATTERN, **how)
    # both reversed: friction brakes again, but gravity pulls upwards
    both = data._replace(force=-data.force, velocity=-data.velocity)
    with pytest.raises(ArgumentError, match=r"the mass would be negative, -.* kg"):
        identify_friction(both, PATTERN, **how)


def test_each_alarm_has_a_key_that_makes_it_a_note() -> None:
    data = runs(3.0, 1)
    copied = Runs(*(np.concatenate([part] * 2) for part in data))
    both = data._replace(force=-data.force, velocity=-data.velocity)
    exchanged = data._replace(force=data.force[:, [1, 0, 2]])
    one = data._replace(force=data.force * [1, 1, -1])
    for wrong, names in (
        (copied, ["copied_rows"]),
        (both, ["negative_mass"]),
        (exchanged, ["exchanged_columns"]),
        (one, ["driving_friction", "exchanged_columns"]),
    ):
        with pytest.raises(ArgumentError, match=rf'if it is right, accept = \["{names[0]}"\]'):
            identify_friction(wrong, PATTERN, gravity="poses")
        fit = identify_friction(wrong, PATTERN, gravity="poses", accept=names)
        assert all(any(note.startswith(f"accepted ({name}): ") for note in fit.notes) for name in names)
    old = identify_friction(copied, PATTERN, gravity="poses", accept=["copied_runs"])  # the name of before
    assert any(note.startswith("accepted (copied_rows): ") for note in old.notes)


def test_friction_and_masses_about_zero_are_not_refused() -> None:
    v = runs().velocity
    held = 0
    for seed in range(50):
        noise = np.random.default_rng(seed).normal(0.0, 3.0, v.shape)
        fit = identify_friction(runs()._replace(force=noise), PATTERN, gravity="poses")
        low, high = fit.estimate.interval("m")
        held += low <= 0.0 <= high
    assert held >= 40  # of 95 % intervals of 50 draws fewer hold the truth less than once in ten thousand


@pytest.mark.parametrize("times", [2, 20])
def test_copied_runs_are_refused(times: int) -> None:
    data = runs(3.0, 1)
    copied = Runs(*(np.concatenate([part] * times) for part in data))
    with pytest.raises(ArgumentError, match=rf"{24 * (times - 1)} of {24 * times} runs are copies of others"):
        identify_friction(copied, PATTERN)
    # a log joined to itself: times differ, and with them the last digits of the means
    log = constant_velocity_log(SPEEDS.tolist(), law, np.full(3, 30.0), seed=3, noise=5.0)
    found = constant_velocity_runs(log)
    later = found._replace(velocity=found.velocity * (1 + 1e-15), pose=found.pose + 1)
    with pytest.raises(ArgumentError, match=r"runs are copies of others"):
        identify_friction(concatenate([found, later]), PATTERN[:2])


def test_what_no_fit_can_take_is_said() -> None:
    data = runs(3.0, 1)
    with pytest.raises(ArgumentError, match=r"loads no cart.*kind = \"identification\""):
        identify_friction(data, 0 * PATTERN)
    with pytest.raises(ArgumentError, match=r"run 3 of cart 2 .* not finite"):
        force = data.force.copy()
        force[2, 1] = np.nan
        identify_friction(data._replace(force=force), PATTERN)
    with pytest.raises(ArgumentError, match=r"has pose 3; the pattern has 2"):
        identify_friction(data, PATTERN[:2])
    with pytest.raises(ArgumentError, match=r"have the shape"):
        identify_friction(data, PATTERN[:, :2])


def test_refusals() -> None:
    one_way = runs(poses=1)
    with pytest.raises(ArgumentError, match=r"cart 1, pose 1: 0 velocities in direction minus"):
        identify_friction(Runs(*(part[:4] for part in one_way)), PATTERN[:1])
    with pytest.raises(ArgumentError, match=r"gravity loads the actuators alike in all poses"):
        identify_friction(runs(poses=2), PATTERN[[0, 0]], gravity="poses")


def drawn(seed: int, poses: int, *, alike: bool) -> tuple[Runs, np.ndarray]:
    """A SYNTHETIC plant of its own for every seed, each second one with two carts that are nearly the same. alike: all
    carts run at one velocity."""
    rng = np.random.default_rng(seed)
    pattern = rng.uniform(-12, 12, (poses, 3))
    friction = [rng.uniform(60, 300, 3) for _ in range(4)]
    if seed % 2:
        friction = [x[0] * np.array([1.0, 1.02, 0.9]) for x in friction]
    plus, _, forth, back = friction
    minus = plus  # friction that differs by direction would pass for gravity in a single pose
    speeds = rng.uniform(0.05, 1.2, 5)
    v = np.concatenate([speeds, -speeds] * poses)[:, None] * np.ones(3)
    v = v if alike else v * rng.uniform(0.5, 1.5, v.shape)
    pose = np.repeat(np.arange(poses), 10)
    force = rng.uniform(5, 40) * pattern[pose] + np.where(v > 0, plus + forth * v, -minus + back * v)
    force += rng.normal(0, rng.uniform(0.2, 5), v.shape)
    return Runs(v, force, pose, np.ones(len(pose)), rng.uniform(0, 1, v.shape)), pattern


@pytest.mark.parametrize("count", [20, pytest.param(60, marks=pytest.mark.proof)])
@pytest.mark.parametrize(("poses", "alike"), [(1, False), (2, True), (3, True), (3, False)])
def test_forces_in_exchanged_columns_are_recognised_and_no_others(poses: int, alike: bool, count: int) -> None:
    seen = 0
    for seed in range(count):
        data, pattern = drawn(seed, poses, alike=alike)
        assert len(identify_friction(data, pattern).notes) <= 3  # honest: never refused
        exchanged = data._replace(force=data.force[:, [1, 0, 2]])
        try:
            identify_friction(exchanged, pattern)
        except ArgumentError as error:
            seen += "force 1, force 2 look exchanged" in str(error)
    assert seen >= 0.95 * count  # a pattern may be alike for two carts


def test_what_no_run_tells_of_the_columns_is_said() -> None:
    data, pattern = drawn(0, 1, alike=True)
    assert "in another cart's column" in identify_friction(data, pattern).notes[-1]
    data, pattern = drawn(0, 3, alike=True)
    assert "column" not in identify_friction(data, pattern).notes[-1]


@pytest.mark.parametrize("cart", [0, 1, 2])
def test_a_reversed_force_shows_by_gravity_where_friction_is_small(cart: int) -> None:
    """Less friction than noise gives no sign, but its levels follow gravity backwards."""
    for seed in range(20):
        data, pattern = drawn(seed, 3, alike=True)
        rng = np.random.default_rng(seed)
        force = 20.0 * pattern[data.pose] + rng.normal(0.0, 1.0, data.force.shape)
        identify_friction(data._replace(force=force), pattern)
        with pytest.raises(ArgumentError, match=rf"force {cart + 1} looks reversed|cart {cart + 1}: friction would"):
            identify_friction(data._replace(force=force * np.where(np.arange(3) == cart, -1, 1)), pattern)


@pytest.mark.parametrize("shift", [0.0, 0.1, -3.7])
def test_copied_runs_are_refused_wherever_they_are_said_to_be(shift: float) -> None:
    data, pattern = drawn(4, 2, alike=False)
    copied = Runs(*(np.concatenate([part, part[5:9]]) for part in data))
    copied.position[20:] += shift
    with pytest.raises(ArgumentError, match=r"4 of 24 runs are copies of .* the first run 21 of run 6"):
        identify_friction(copied, pattern)


def test_runs_that_were_written_down_in_few_digits_may_agree() -> None:
    data, pattern = drawn(4, 2, alike=True)
    coarse = data._replace(force=np.round(data.force, -1))
    twice = Runs(*(np.concatenate([part, part]) for part in coarse))
    twice.position[20:] += 0.1
    once, again = (identify_friction(runs, pattern).estimate for runs in (coarse, twice))
    np.testing.assert_allclose(again.values, once.values, rtol=1e-6)  # every run counts twice


def test_no_runs_cannot_be_concatenated() -> None:
    with pytest.raises(ArgumentError, match="no runs"):
        concatenate([])


@pytest.mark.parametrize(
    ("middle", "pattern", "message"),
    [
        (np.ones((1, 2)), np.ones((1, 3)), r"\(1, 2\).*\(1, 3\)"),
        (np.ones((1, 2)), np.zeros((1, 2)), "loads no cart"),
        (np.array([]), np.array([]), "loads no cart"),
        (np.array([1.0, np.nan]), np.ones(2), "not finite"),
    ],
)
def test_the_mass_by_norm_needs_levels_and_loads(middle, pattern, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        mass_by_norm(middle, pattern)


@pytest.mark.parametrize(
    ("velocities", "options", "message"),
    [
        ([0.2], {"acceleration": 0.0}, "acceleration: .*0"),
        ([0.2], {"sample_time": -0.004}, "sample_time: .*-0.004"),
        ([0.2], {"travel": 0.0}, "travel: .*0"),
        ([0.2], {"longest": 0.0}, "longest: .*0"),
        ([0.2], {"noise": -1.0}, "noise: .*-1"),
        ([0.2, 0.0], {}, "velocities: .*0"),
        ([], {}, "velocities: .*none"),
    ],
)
def test_a_synthetic_log_needs_numbers_above_zero(velocities, options: dict[str, float], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        constant_velocity_log(velocities, np.sign, np.array([30.0]), **{"seed": 1, "noise": 5.0, **options})
