"""Clean logs raise no alarm, planted faults raise one: synthetic logs of two axes by seed, stated beforehand.

A log: 1,500 samples of 4 ms, masses 1 to 10 kg, viscous friction 2 to 30 kg/s, white noise of 0.2 to 1 N; the model
starts from other numbers, by up to a third.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError

CLEAN, PLANTED = 4003, 4004  # seeds
MOST_ALARMS, LEAST_FOUND = 15, 190  # of 400 clean logs, of 200 with a fault: issue 40
FEW, FEW_ALARMS = 20, 3  # more alarms of so few logs have a probability of 0.1 % at 1 % each
FAULTS = ("exchanged", "reversed", "unit", "load")


class Stage(gt.Model):
    m = gt.parameter([3.0, 5.0], unit="kg")
    d = gt.parameter([10.0, 15.0], unit="kg/s")
    q, tau = gt.variable(2, unit="m"), gt.variable(2, unit="N")

    def equations(self) -> Any:
        v = gt.der(self.q)
        yield self.tau == self.m * gt.der(v) + self.d * v


TIME = 0.004 * np.arange(1500)


FREQUENCIES = 2 * np.pi * np.array([0.5, 1.1, 1.9])


def drawn(seed: int, k: int) -> tuple[Stage, gt.Trajectory]:
    rng = np.random.default_rng([seed, k])
    m, d = rng.uniform(1, 10, 2), rng.uniform(2, 30, 2)
    phase = FREQUENCIES * TIME[:, None, None] + rng.uniform(0, 2 * np.pi, (2, 3))
    size = 0.2 / 3
    q, v, a = (np.sum(size * FREQUENCIES**n * wave, axis=2)
               for n, wave in enumerate((np.sin(phase), np.cos(phase), -np.sin(phase))))  # fmt: skip
    tau = m * a + d * v + rng.uniform(0.2, 1.0) * rng.normal(size=q.shape)
    robot = Stage(m=m * rng.uniform(0.75, 1.33, 2), d=d * rng.uniform(0.75, 1.33, 2))
    return robot, gt.Trajectory(TIME, {"q": q, "tau": tau}, {"q": "m", "tau": "N"})


def spoilt(log: gt.Trajectory, fault: str) -> gt.Trajectory:
    tau = log["tau"]
    later = TIME[:, None] > TIME[-1] / 2
    other = {
        "exchanged": lambda: tau[:, ::-1],
        "reversed": lambda: tau * [1.0, -1.0],
        "unit": lambda: 1000 * tau,
        "load": lambda: np.where(later, 1.6 * tau, tau),  # taken up half-way: the model lacks it
    }[fault]()
    return gt.Trajectory(log.time, {"q": log["q"], "tau": other}, {"q": "m", "tau": "N"})


def alarms(robot: Stage, log: gt.Trajectory) -> list[str]:
    """Failed checks, or that the log was refused; the first half is fitted, the second one held out."""
    half = len(TIME) // 2
    first, second = (gt.Trajectory(log.time[p], {n: log[n][p] for n in ("q", "tau")}, {"q": "m", "tau": "N"})
                     for p in (slice(half), slice(half, None)))  # fmt: skip
    try:
        s = gt.identify.study(robot, first, ["m", "d"], held_out=second)
    except ArgumentError:
        return ["refused"]
    return [name for name, check in s.checks.items() if not check.passed]


def clean_alarms(count: int) -> list[list[str]]:
    return [found for k in range(count) if (found := alarms(*drawn(CLEAN, k)))]


def missed(count: int) -> list[str]:
    faults = [FAULTS[k % len(FAULTS)] for k in range(count)]
    drawn_ = [drawn(PLANTED, k) for k in range(count)]
    return [fault for fault, (robot, log) in zip(faults, drawn_, strict=True) if not alarms(robot, spoilt(log, fault))]


def test_clean_logs_raise_hardly_an_alarm_and_faults_do() -> None:
    assert len(clean_alarms(FEW)) <= FEW_ALARMS
    assert len(missed(FEW)) <= FEW - LEAST_FOUND * FEW // 200


@pytest.mark.proof
def test_of_400_clean_logs_15_raise_an_alarm_at_most_and_of_200_faults_190_are_found() -> None:
    found, not_found = clean_alarms(400), missed(200)
    assert len(found) <= MOST_ALARMS, found
    assert len(not_found) <= 200 - LEAST_FOUND, not_found
