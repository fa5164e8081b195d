"""The simulated plants: eq. (6.11) against scipy's filter, the rigid body against its own inverse dynamics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import gtmodel as gt
from gtmodel.loop import DrivePlant, ElasticPlant, RigidBodyPlant, Servo
from gtmodel.results import ArgumentError, Status
from tests.loop.bench import DRIVES

START = [-1.30, -1.39, -1.57]
# the recursion and scipy's add up in another order
ROUND_OFF = 1e-12


def test_drives_are_the_filter_of_the_thesis() -> None:
    inputs = np.cumsum(np.random.default_rng(1).normal(0, 1e-3, (200, 3)), axis=0)
    plant = DrivePlant(START, DRIVES["a"], DRIVES["b"], 5)
    found = []
    for u in inputs:
        found.append(plant.position_m - START)
        plant.step((u + START).tolist(), [0.0] * 3)
    for n in range(3):
        numerator = [0.0] * 5 + [DRIVES["b"][n]]
        expected = lfilter(numerator, [1.0, -DRIVES["a"][n]], inputs[:, n])
        assert np.array(found)[:, n] == pytest.approx(expected, abs=ROUND_OFF)


def _rigid(servo: Servo, tcp: np.ndarray) -> tuple[RigidBodyPlant, gt.CausalFunction]:
    robot = gt.robots.gantry_tau("l1_tape", inertia="model_2")
    forward = robot.causal("tau", "der(T,2)", prefer="T")
    plant = RigidBodyPlant(forward, robot.causal("T", ["q", "der(q)"]), tcp.tolist(), servo)
    return plant, robot.causal("T", "tau")


def test_a_plant_takes_one_number_for_each_cart() -> None:
    """One number, which NumPy and CasADi would give to all carts, is refused."""
    drives, robot = DrivePlant(START, DRIVES["a"], DRIVES["b"], 5), _rigid(Servo(), np.array([0.0, -0.9, 0.1]))[0]
    for plant in (drives, robot, ElasticPlant(drives, 8.0), ElasticPlant(robot, 8.0)):
        before = plant.position_m.tolist()
        for position in ([0.1], [0.1] * 4, 0.1):
            with pytest.raises(ArgumentError, match="3 numbers, for cart 1, cart 2, cart 3; found") as refusal:
                plant.step(position, [0.0] * 3)  # type: ignore[arg-type]
            assert refusal.value.argument == "position_m" and plant.position_m.tolist() == before
    with pytest.raises(ArgumentError, match="speed_m_s"):
        robot.step(START, [0.0])


def test_robot_comes_to_rest_where_servo_and_weight_balance() -> None:
    servo = Servo()
    plant, inverse_dynamics = _rigid(servo, np.array([0.0, -0.9, 0.1]))
    wanted = plant.position_m.copy()
    for _ in range(1500):
        plant.step(wanted.tolist(), [0.0] * 3)
    tau, status = inverse_dynamics(plant.tcp_m, [0.0] * 3, [0.0] * 3)
    assert status is Status.OK
    # friction is smooth: at rest there is none, and after 6 s nothing moves any more
    assert servo.kp_N_m * (wanted - plant.position_m) == pytest.approx(tau, abs=1e-3)
    assert np.abs(tau).max() > 50, "there is a weight to hold"


def test_substeps_converge_with_fourth_order() -> None:
    """Against the finest: halving the step makes the error at least ten times smaller; fourth order is 16."""
    ends = {}
    for substeps in (4, 8, 32):
        plant, _ = _rigid(Servo(substeps=substeps), np.array([0.0, -0.9, 0.1]))
        goal = plant.position_m + np.array([0.02, -0.01, 0.015])
        for _ in range(20):
            plant.step(goal.tolist(), [0.1, 0.0, -0.1])
        ends[substeps] = plant.position_m
    coarse, fine = (np.abs(ends[n] - ends[32]).max() for n in (4, 8))
    assert fine < coarse / 10


def _drives() -> DrivePlant:
    return DrivePlant(START, DRIVES["a"], DRIVES["b"], 5)


def test_arm_on_springs_is_the_filter_of_its_motor() -> None:
    """x / m = (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2), discretised by scipy for an input that is a polygon."""
    w, damping, h = 2 * np.pi * 12.0, 0.05, 0.004
    plant = ElasticPlant(_drives(), 12.0, damping, h)
    motor, arm = [], []
    for u in np.cumsum(np.random.default_rng(2).normal(0, 1e-3, (300, 3)), axis=0):
        motor.append(plant.position_m - START)
        arm.append(plant.arm_m - START)
        plant.step((u + START).tolist(), [0.0] * 3)
    bottom = [1.0, 2 * damping * w, w**2]
    numerator, denominator, _ = cont2discrete((bottom[1:], bottom), h, method="foh")
    expected = lfilter(numerator.ravel(), denominator, np.array(motor), axis=0)
    # scipy's recursion of three poles and zeros amplifies round-off near the unit circle
    assert np.array(arm) == pytest.approx(expected, abs=1e-9)
    assert np.abs(np.array(arm) - motor).max() > 1e-4, "there is something to see"


def test_stiff_springs_are_rigid_and_soft_ones_come_to_rest() -> None:
    goal = (np.array(START) + 0.05).tolist()
    stiff, soft = ElasticPlant(_drives(), 900.0, 1.0), ElasticPlant(_drives(), 8.0, 0.3)
    off = 0.0
    for _ in range(1500):
        for plant in (stiff, soft):
            plant.step(goal, [0.0] * 3)
        off = max(off, np.abs(stiff.arm_m - stiff.position_m).max())
    assert off < 1e-9
    assert soft.arm_m == pytest.approx(soft.position_m, abs=1e-9)
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="found"):
            ElasticPlant(_drives(), wrong)
