"""A predictive controller of the L1 that commands servos: its spectral radius, against free motions of the robot as
rigid bodies under the same servos, which another library integrates in many steps of a cycle."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import cgen
from gtmodel.loop import RigidBodyPlant, Servo
from gtmodel.predictive import AxisServo, ControlHorizon, Controller, Measurement, controller
from gtmodel.results import ArgumentError, Status

GOAL = np.array([0.5, -0.9, 0.3])
INERTIA = np.array([36.6, 27.9, 54.3])  # of the carts at the goal, kg
PERIOD = 0.004
# several modes begin together, and the delay passes first; the programs are solved to 1e-6 of their cost
SEVERAL, FLOOR = 2.0, 1e-9  # -, m


def of_rate(rate: float, damping: float) -> AxisServo:
    return AxisServo(tuple(rate**2 * INERTIA), tuple(2 * damping * rate * INERTIA))


@cache
def law_of(servo: AxisServo | None, delay: int) -> Controller:
    """A short horizon: with the cost after it, the gains are those of any other."""
    return controller(
        gt.robots.gantry_tau("l1_tape", inertia="model_2"),
        ControlHorizon(period=PERIOD, stages=4, length=0.02, delay=delay, causality="inverse"),
        tolerances={"T": 0.001, "der(T)": 0.1, "der(T,2)": 10.0}, targets={"T": GOAL}, references=["T"],
        limits={"tau": (-700.0, 700.0)}, measured={"q": Measurement(deviation=1e-5, jump=0.02)},
        disturbance={"tau": 100.0}, servo=servo,
    )  # fmt: skip


@pytest.mark.parametrize(("rate", "delay"), [(5.0, 3), (500.0, 0)])  # and two cycles below
def test_the_loop_settles_under_a_servo_of_any_bandwidth_behind_any_delay(rate: float, delay: int) -> None:
    law = law_of(of_rate(rate, 0.5 if delay else 1.0), delay)
    assert law.radius() < 0.995
    assert law.radius(speeds=False) < 0.97


@pytest.mark.proof
def test_the_loop_settles_on_the_whole_grid() -> None:
    for delay in range(4):
        for rate in (5.0, 10.0, 20.0, 50.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0):
            for damping in (0.5, 1.0):
                law = law_of(of_rate(rate, damping), delay)
                assert law.radius() < 0.995, (delay, rate, damping)
                for factor in (0.7, 1.3):  # servos that the controller does not know exactly
                    kp, kd = (tuple(factor * np.array(g)) for g in (law.servo.stiffness, law.servo.damping))  # type: ignore[union-attr]
                    assert law.radius(AxisServo(kp, kd)) < 0.995, (delay, rate, damping, factor)


@cache
def rigid() -> tuple:
    robot = gt.robots.gantry_tau("l1_tape", inertia="model_2")
    return robot.causal("tau", "der(T,2)", prefer="T"), robot.causal("T", ["q", "der(q)"])


@pytest.mark.parametrize(("rate", "speeds"), [(30.0, True), (200.0, True), (200.0, False), (500.0, True)])
def test_a_free_motion_decays_as_the_spectral_radius_says(rate: float, speeds: bool) -> None:
    servo, delay = of_rate(rate, 0.6), 2
    law = law_of(servo, delay)
    plant = RigidBodyPlant(*rigid(), (GOAL + 1e-3).tolist(), Servo(servo.stiffness, servo.damping, 16), PERIOD)  # type: ignore[arg-type]
    run, pipe, errors, last = law.begin(), [], [], plant.position_m
    run.state["speeds"] = float(speeds)
    goal, _, _ = rigid()[1](GOAL, np.zeros(3))
    for _ in range(80):
        result = run.step({"q": plant.position_m})
        assert result.status == Status.OK
        u = result.values["q.command"]
        pipe.append((u, (u - last) / PERIOD * speeds))
        last = u
        if len(pipe) > delay:
            plant.step(*pipe.pop(0))
        errors.append(np.abs(plant.position_m - goal).max())
    envelope = SEVERAL * errors[0] * law.radius(speeds=speeds) ** np.arange(len(errors)) + FLOOR
    assert np.all(errors < envelope)


def test_a_servo_too_fast_for_the_period_is_refused() -> None:
    with pytest.raises(ArgumentError) as caught:
        law_of(of_rate(1e4, 0.7), 0)
    assert caught.value.argument == "servo"


def test_c_equals_python_bit_for_bit(tmp_path: Path) -> None:
    laws = {"law": law_of(of_rate(200.0, 0.6), 2)}
    cgen.generate(laws, tmp_path / "c", name="servo")
    report = cgen.check(tmp_path / "c", laws, points=30)
    assert report.message.startswith("the C code equals Python bit for bit"), report.message
    assert report.rows_ok["law"] > 15
