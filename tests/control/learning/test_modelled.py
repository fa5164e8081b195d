"""Robots by plants: identified from a log against the truth, and the set of their models against the closed form."""

from __future__ import annotations

import control
import numpy as np
import pytest

from gtmodel.control import learning
from gtmodel.control.learning.options import Case
from gtmodel.results import SolveStatus
from gtmodel.results.refusal import ArgumentError

TS = 0.004
F = np.linspace(0.5, 25.0, 100)
NEAR = 2e-3  # of the largest response below 25 Hz, from 5000 samples with 1 um and 0.07 m/s2 of noise


def log(seed: int, frequency: float, damping: float, size: int = 5000) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """An axis under a random reference, synthetic, with noise of motors, gauges and accelerometer."""
    rng = np.random.default_rng(seed)
    r = 1e-3 * np.repeat(rng.normal(size=size // 10), 10)
    made = {name: T(r) for name, T in learning.flexible_axis(frequency, damping).maps(size).items()}
    deviations = {"motor": 1e-6, "tool": 1e-6, "acceleration": 0.07}
    return r, {name: x + deviations[name] * rng.normal(size=size) for name, x in made.items()}


def apart(a: learning.AxisPlant, b: learning.AxisPlant, name: str) -> float:
    one, two = a.responses(F)[name], b.responses(F)[name]
    return float(np.abs(one - two).max() / np.abs(two).max())


@pytest.mark.parametrize(("frequency", "damping"), [(7.4, 0.2), (11.5, 0.05)])
@pytest.mark.parametrize("seed", [1, 2])
def test_an_axis_identified_from_a_log_is_the_true_one(seed: int, frequency: float, damping: float) -> None:
    r, signals = log(seed, frequency, damping)
    made, true = learning.identified_axis(r, signals), learning.flexible_axis(frequency, damping)
    assert all(apart(made, true, name) < NEAR for name in signals)
    mode = learning.ModelledRobot([made]).mode(0)
    assert mode == pytest.approx((frequency, damping), rel=0.01)


def test_the_delay_is_where_the_response_begins() -> None:
    r, signals = log(3, 11.5, 0.05)
    assert learning.begin(r, signals["motor"]) == 6  # five samples of delay, and one of the hold
    with pytest.raises(ArgumentError) as error:
        learning.begin(np.sin(np.arange(2000) / 7), signals["motor"][:2000])
    assert error.value.argument == "delay"


@pytest.mark.parametrize(("frequency", "damping", "near"), [(1.06, 1.0, 0.01), (1.0, 0.6, 0.05), (0.94, 1.6, 0.08)])
def test_the_set_of_a_robot_by_plants_is_that_of_its_parameters(frequency: float, damping: float, near: float) -> None:
    # what differs is the zero of z'' = w2 (z_c - z) + 2 zeta w (z_c' - z'), which the plant does not say apart
    robot = learning.ModelledRobot([learning.flexible_axis(11.5, 0.05)])
    moved, same = robot.plant(0, frequency, damping), learning.flexible_axis(11.5 * frequency, 0.05 * damping)
    assert all(apart(moved, same, name) < near for name in ("motor", "tool", "acceleration"))
    rest = np.array([0.0])
    assert abs(moved.responses(rest)["tool"][0] - 1) < 1e-9
    assert moved.signals["motor"] is robot.plants[0].signals["motor"]


@pytest.fixture(scope="module")
def identified() -> learning.ModelledRobot:
    axes = ((4, 7.4, 0.2), (5, 11.5, 0.05))
    return learning.ModelledRobot([learning.identified_axis(*log(seed, f, z)) for seed, f, z in axes])


# cases 1 and 2A, and all four of them with the true robot: tests/control/learning/test_cases.py
@pytest.mark.parametrize("case", [*(pytest.param(c, marks=pytest.mark.proof) for c in ("1", "2A")), "2B", "3"])
def test_every_case_learns_with_an_identified_robot(case: Case, identified: learning.ModelledRobot) -> None:
    design, path = learning.LearningDesign(case=case, iterations=6), learning.SquarePath(corrected=250)
    truth = learning.SyntheticExperiment(learning.LearningRobot(), path)
    s = learning.study(identified, path, design, experiment=truth)
    known = learning.study(learning.LearningRobot(), path, design)
    assert s.status is SolveStatus.SOLVED and s.tool_share is not None and known.tool_share is not None
    assert s.reached == pytest.approx(s.floor, rel=0.2)
    assert np.all(np.array(s.tool_share) < 1.2 * np.array(known.tool_share) + 0.005)


def test_refusals() -> None:
    r, signals = log(6, 11.5, 0.05)
    for wrong in ({"tool": signals["tool"]}, {"motor": np.full(5000, np.nan)}, {"motor": np.zeros(5000)}):
        with pytest.raises(ArgumentError) as error:
            learning.identified_axis(r, wrong)
        assert error.value.argument == "signals"
    axis = learning.flexible_axis(11.5, 0.05)
    unstable = learning.AxisPlant({"motor": control.StateSpace([[1.1]], [[1.0]], [[1.0]], [[0.0]], TS)})
    for plants, argument in (
        ([], "plants"), ([axis, learning.flexible_axis(11.5, 0.05, sample_time=0.002)], "plants"),
        ([learning.AxisPlant({"tool": axis.signals["tool"]})], "plants[0]"), ([unstable], "plant"),
    ):  # fmt: skip
        with pytest.raises(ArgumentError) as error:
            learning.ModelledRobot(plants)
        assert error.value.argument == argument
    with pytest.raises(ArgumentError) as error:
        learning.study(learning.lag_robot([0.2], [0.8], 3, TS), design=learning.LearningDesign(case="3"))
    assert "case" in error.value.argument
