"""Drift of a force sensor's bias: named if left out, estimated, with intervals that hold: synthetic, by seed.

A set: 100 poses in random order or along a slow sweep, mass 0.5 to 5 kg, white noise of 0.05 N and 0.003 N m, and 2 N
of drift over the recording, linear or a random walk.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError, Trajectory

L = gt.control.lead_through
SEED, POSES, SIZE, ARM = 4301, 100, 2.0, 0.05  # m: the drift's moment over its force
FEW, MANY = 10, 400
WITHIN = 0.003  # of the mass: issue 43
TIME = 3.0 * np.arange(POSES)
RUNS = pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])


class Set(NamedTuple):
    turns: np.ndarray
    forces: np.ndarray
    moments: np.ndarray
    mass: float
    bias: np.ndarray  # (poses, 3) N, true


def drawn(kind: str, k: int, *, sweep: bool = False) -> Set:
    rng = np.random.default_rng([SEED, k])
    Rotation = scipy.spatial.transform.Rotation
    turns = Rotation.random(POSES, rng=rng).as_matrix()
    if sweep:
        s, start = np.linspace(0, 2 * np.pi, POSES)[:, None], rng.uniform(0, 2 * np.pi, 3)
        angles = s * [1.0, 1.5, 1.0] + start
        turns = Rotation.from_euler("ZYX", np.column_stack([angles[:, 0], np.pi * np.sin(angles[:, 1:])])).as_matrix()
    mass = float(rng.uniform(0.5, 5.0))
    sensor = L.SyntheticSensor(
        mass=mass, centre=tuple(rng.uniform(-0.2, 0.2, 3)), force_noise=0.05, moment_noise=0.003,
        force_bias=(3.0, -1.0, 2.0),
    )  # fmt: skip
    f, m = sensor.readings_at_rest(turns, rng)
    way, steps = rng.normal(size=3), rng.normal(size=(POSES, 3))
    drift = {
        "none": np.zeros((POSES, 3)),
        "linear": np.linspace(0, SIZE, POSES)[:, None] * way / np.linalg.norm(way),
        "walk": np.cumsum(steps, axis=0) * SIZE / np.sqrt(3 * POSES),
    }[kind]
    return Set(turns, f + drift, m + ARM * drift, mass, sensor.force_bias + drift)


def calibrated(s: Set, **other: Any) -> Any:
    return L.calibrate_wrench(s.turns, s.forces, s.moments, **({"time": TIME} | other))


def alarms(s: Set, **other: Any) -> set[str]:
    return {a.name for a in calibrated(s, **other).alarms}


def least_hits(count: int) -> int:
    """Of intervals that contain the truth with a probability of 95 %."""
    return gt.inference.binomial_band(count, 0.95)[0]


def most_alarms(count: int) -> int:
    """Of clean sets, each with an alarm with a probability of 1 %."""
    return gt.inference.binomial_band(count, 0.01)[1]


@RUNS
def test_a_linear_drift_of_2_n_is_named_and_once_estimated_the_mass_is_within_3_per_mille(count: int) -> None:
    hits, off, doubtful = 0, 0, 0
    for k in range(count):
        s = drawn("linear", k)
        named = next(a for a in calibrated(s).alarms if a.name == "force_drift")
        size = float(re.findall(r"drift by ([0-9.]+) N over the recording", named.evidence)[0])
        assert size == pytest.approx(SIZE, abs=0.1) and 'drift = "linear"' in named.remedy
        c = calibrated(s, drift="linear")
        doubtful += not c.status.ok
        low, high = c.force.interval("mass")
        hits += low <= s.mass <= high
        off += not abs(c.force.value("mass") - s.mass) < WITHIN * s.mass
    assert hits >= least_hits(count) and off <= 0.01 * count + 1 and doubtful <= most_alarms(count)


@RUNS
@pytest.mark.parametrize("sweep", [False, True], ids=["random order", "sweep"])
def test_a_random_walk_is_named_and_intervals_by_blocks_hold(sweep: bool, count: int) -> None:
    mass, bias, off = 0, np.zeros(3), 0
    for k in range(count):
        s = drawn("walk", k, sweep=sweep)
        assert {"force_coloured", "force_drift"} & alarms(s)
        c = calibrated(s, drift="blocks")
        low, high = c.force.intervals(["mass", "bias_force_x", "bias_force_y", "bias_force_z"])
        mass += low[0] <= s.mass <= high[0]
        bias += (low[1:] <= s.bias[-1]) & (s.bias[-1] <= high[1:])
        off += not abs(c.force.value("mass") - s.mass) < WITHIN * s.mass
    assert mass >= least_hits(count)
    assert bias.sum() >= least_hits(3 * count)
    assert sweep or off <= 0.05 * count + 1


TEMPERATURE = 293.0 + 8.0 * (1 - np.exp(-np.arange(POSES) / 20.0)) + np.sin(np.arange(POSES) / 6.0)
SESSION = np.repeat([3.0, 1.0, 2.0], [30, 40, 30])
KNOWN = {"session": SESSION, "temperature": TEMPERATURE}


@RUNS
def test_clean_sets_with_time_session_and_temperature_raise_an_alarm_in_1_per_cent(count: int) -> None:
    found = [calibrated(drawn("none", k, sweep=k % 2 == 0), **KNOWN) for k in range(count)]
    assert sum(not c.status.ok for c in found) <= most_alarms(count), [c.alarms for c in found if not c.status.ok]


def with_bias(s: Set, change: np.ndarray) -> Set:
    return Set(s.turns, s.forces + change, s.moments + ARM * change, s.mass, s.bias + change)


@pytest.mark.parametrize("kind", ["session", "temperature"])
def test_a_drift_with_a_known_condition_is_named_by_it_and_estimated(kind: str) -> None:
    way = np.array([0.0, 0.6, 0.8])
    steps = {3.0: 0.7, 1.0: 2.5, 2.0: 0.0}
    amount = np.array([steps[x] for x in SESSION]) if kind == "session" else 0.2 * (TEMPERATURE - TEMPERATURE[-1])
    s = with_bias(drawn("none", 5), amount[:, None] * way)
    strongest = calibrated(s, **KNOWN).alarms[0]
    assert strongest.name.endswith(f"_{kind}") and f'drift = "{kind}"' in strongest.remedy
    c = calibrated(s, **KNOWN, drift=[kind])
    assert c.status.ok and abs(c.force.value("mass") - s.mass) < WITHIN * s.mass
    expected = {f"session_{x:g}": steps[x] * way for x in (3.0, 1.0)} if kind == "session" else {"thermal": 0.2 * way}
    for name, value in expected.items():
        for axis, x in zip("xyz", value, strict=True):
            place = c.force.names.index(f"{name}_force_{axis}")
            assert c.force.values[place] == pytest.approx(x, abs=5 * c.force.std[place])
    assert c.force.values[:3] == pytest.approx(s.bias[-1], abs=5 * c.force.std[0])


def test_several_drifts_are_estimated_together_and_the_study_returns_them() -> None:
    s = drawn("linear", 1)
    step = np.where(SESSION == 3.0, 1.0, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    s = with_bias(s, step + 0.3 * (TEMPERATURE - TEMPERATURE[-1])[:, None] * np.array([0.0, 0.0, 1.0]))
    turn = scipy.spatial.transform.Rotation.from_matrix(s.turns).as_rotvec()
    units = {"turn": "rad", "force": "N", "moment": "N.m", "session": "1", "temperature": "K"}
    log = Trajectory(TIME, {"turn": turn, "force": s.forces, "moment": s.moments, **KNOWN}, units)
    study = L.wrench_study(log, drift=["linear", "session", "temperature"])
    assert study.status.ok and study.mass == pytest.approx(s.mass, rel=WITHIN)
    assert study.force_changes["session_3"] == pytest.approx([1.0, 0.0, 0.0], abs=0.3)
    assert study.force_thermal == pytest.approx([0.0, 0.0, 0.3], abs=0.05)
    assert np.linalg.norm(study.force_drift) * TIME[-1] == pytest.approx(SIZE, abs=0.4)
    assert L.wrench_study(log, drift="blocks").force_changes.keys() == {f"block_{k}" for k in range(1, 10)}


def test_blocks_of_one_bias_give_the_same_load_as_a_fit_of_differences() -> None:
    """By another road: deviations from the mean of each block, in NumPy."""
    s = drawn("walk", 2)
    c = calibrated(s, drift="blocks")
    g, block = s.turns.transpose(0, 2, 1) @ [0.0, 0.0, -9.81], np.arange(POSES) * 10 // POSES
    dg = np.vstack([g[block == b] - g[block == b].mean(axis=0) for b in range(10)])
    df = np.vstack([s.forces[block == b] - s.forces[block == b].mean(axis=0) for b in range(10)])
    assert c.force.value("mass") == pytest.approx(np.sum(dg * df) / np.sum(dg**2), rel=1e-10)
    without = [np.sum((dg * df)[block != b]) / np.sum(dg[block != b] ** 2) for b in range(10)]
    spread = np.sum((np.array(without) - c.force.value("mass")) ** 2) * 9 / 10
    assert c.force.std[3] == pytest.approx(np.sqrt(spread), rel=1e-8)


@pytest.mark.parametrize(
    ("other", "argument"),
    [
        ({"drift": "quadratic"}, "drift"),
        ({"drift": ["none", "linear"]}, "drift"),
        ({"drift": ["blocks", "linear"]}, "drift"),
        ({"drift": True, "time": None}, "time"),
        ({"drift": "session"}, "session"),
        ({"drift": "temperature"}, "temperature"),
        ({"drift": "temperature", "temperature": np.full(POSES, 293.0)}, "temperature"),
        ({"session": np.arange(POSES) % 2}, "session"),
        ({"session": [1.0]}, "session"),
        ({"time": TIME[::-1]}, "time"),
        ({"time": np.r_[TIME[:50], TIME[:50]]}, "time"),
    ],
)
def test_a_condition_that_is_missing_or_wrong_is_named(other: dict[str, Any], argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        calibrated(drawn("none", 0), **other)
    assert caught.value.argument == argument


def test_true_and_false_keep_their_meaning_and_a_clock_may_restart_with_a_session() -> None:
    s = drawn("linear", 3)
    for old, new in ((True, "linear"), (False, "none"), (True, ["linear"])):
        assert str(calibrated(s, drift=old)) == str(calibrated(s, drift=new))
    assert calibrated(drawn("none", 0), session=np.repeat([1, 2], 50), time=np.r_[TIME[:50], TIME[:50]]).status.ok


@RUNS
@pytest.mark.parametrize("sweep", [False, True], ids=["random order", "sweep"])
def test_intervals_of_a_random_walk_hold_and_the_mass_is_as_good_as_possible(sweep: bool, count: int) -> None:
    """The estimate reaches the bound of Cramer and Rao for the true walk: no other one is better."""
    mass, bias, far, least, doubtful, named = 0, np.zeros(3), 0.0, 0.0, 0, 0
    for k in range(count):
        s = drawn("walk", k, sweep=sweep)
        c = calibrated(s, drift="random_walk")
        low, high = c.force.intervals(["mass", "bias_force_x", "bias_force_y", "bias_force_z"])
        mass += low[0] <= s.mass <= high[0]
        bias += (low[1:] <= s.bias[-1]) & (s.bias[-1] <= high[1:])
        far += (c.force.value("mass") - s.mass) ** 2
        least += bound(s) ** 2
        doubtful += not c.status.ok
        named += any("because of the order of the poses" in note for note in c.notes)
    assert mass >= least_hits(count)
    assert bias.sum() >= least_hits(3 * count)
    assert np.sqrt(far / least) <= 1 + 3 / np.sqrt(2 * count)
    assert doubtful <= most_alarms(count)
    assert named == (count if sweep else 0)


def bound(s: Set) -> float:
    """Least standard deviation of the mass [kg] with the true sizes of walk and noise, by the information matrix."""
    n = np.arange(POSES)
    C = 0.05**2 * np.eye(POSES) + SIZE**2 / (3 * POSES) * np.minimum(n[:, None], n)
    g = s.turns.transpose(0, 2, 1) @ [0.0, 0.0, -9.81]
    one = np.ones(POSES)
    information = sum(
        x @ np.linalg.solve(C, x) - (x @ np.linalg.solve(C, one)) ** 2 / (one @ np.linalg.solve(C, one)) for x in g.T
    )
    return float(1 / np.sqrt(information))


@pytest.mark.parametrize("count", [FEW, pytest.param(20, marks=pytest.mark.proof)])
@pytest.mark.parametrize("kind", ["none", "linear"])
def test_a_random_walk_covers_no_drift_and_a_linear_one(kind: str, count: int) -> None:
    hits = 0
    for k in range(count):
        s = drawn(kind, k)
        c = calibrated(s, drift="random_walk")
        low, high = c.force.interval("mass")
        hits += low <= s.mass <= high
        assert abs(c.force.value("mass") - s.mass) < WITHIN * s.mass
    assert hits >= least_hits(count)


def table(count: int) -> None:
    """The table of docs/kinds/wrench_calibration.md."""
    for sweep in (False, True):
        for drift in ("none", "linear", "blocks", "random_walk"):
            rows = []
            for k in range(count):
                s = drawn("walk", k, sweep=sweep)
                estimate = calibrated(s, drift=drift).force
                low, high = estimate.interval("mass")
                rows.append((s.mass, estimate.value("mass") - s.mass, (high - low) / 2))
            mass, error, half = np.array(rows).T
            print(
                f"{'slow sweep' if sweep else 'random':<11}{drift:<12}rms {1e3 * np.sqrt(np.mean(error**2)):5.2g} g, "
                f"half-width {1e3 * np.mean(half):5.3g} g, {100 * np.mean(np.abs(error) <= half):.0f} % hit, "
                f"{100 * np.mean(np.abs(error) >= WITHIN * mass):.0f} % off"
            )


if __name__ == "__main__":
    table(MANY)
