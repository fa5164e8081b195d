"""The bound over the whole box of models, not its grid: draws, narrow modes and wide boxes, and what runs do there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gtmodel.control import learning
from gtmodel.results.refusal import ArgumentError

TS, N = 0.004, 825
LIGHT = 0.01  # damping of a box whose set has so many models that only the proof has time for it
DRAWS, MANY = 20, 400  # models of the suite, and with -m proof
RUNS = 40
ROUNDING = 1e-12
LEFT = 0.3  # of the error before learning, above which no later run is; a light tool rings where Q is near 0
BOXES: list[tuple[str, dict[str, Any], float, float]] = [
    # law, design, frequency, damping: the light ones passed the five models of a coarse set and diverged between them
    ("shift", {}, 11.5, 0.05),
    ("shift", {}, 7.4, 0.2),
    ("shift", {"frequency_share": 0.3}, 11.5, 0.05),
    ("shift", {"frequency_share": 0.2}, 11.5, 0.005),
    ("inverse", {"frequency_share": 0.2, "change": 0.01}, 20.0, 0.02),
]


def boxed(law: Any, more: dict[str, Any], frequency: float, damping: float) -> tuple[Any, Any, Any]:
    robot = learning.LearningRobot(frequency=(frequency,), damping=(damping,))
    design = learning.LearningDesign(case="3", law=law, **more)
    return robot, design, learning.design_axis(robot, 0, design, N, 100)


def draw(robot: Any, design: Any, rng: np.random.Generator) -> learning.AxisPlant:
    f, (low, high) = design.frequency_share, design.damping_shares
    return robot.plant(0, 1 + f * rng.uniform(-1, 1), np.exp(rng.uniform(np.log(low), np.log(high))))


@pytest.mark.parametrize(
    ("box", "draws"),
    [
        pytest.param(b, n, id=f"{b[0]}-{b[2]:g}-{b[3]:g}-{n}", marks=pytest.mark.proof if n == MANY else ())
        for n in (DRAWS, MANY) for b in BOXES if n == MANY or b[3] > LIGHT
    ],
)  # fmt: skip
def test_nothing_diverges_over_the_box(box: tuple[str, dict[str, Any], float, float], draws: int) -> None:
    robot, design, axis = boxed(*box)
    # Q and L as they are realised: rows of the maps in the middle of the run, over frequency
    f = np.linspace(0.0, 80.0, 8001 if draws == MANY else 2001)  # the modes of a few draws are no narrower than 0.5 Hz
    k = np.arange(N) - N // 2
    waves = np.exp(2j * np.pi * TS * np.outer(f, k))
    Q = waves @ axis.law.Q.dense()[N // 2]
    L = waves @ axis.law.L.dense()[N // 2]
    rng, r = np.random.default_rng(11), learning.SquarePath().samples(TS)[:, 0]
    worst = 0.0
    for n in range(draws):
        plant = draw(robot, design, rng)
        worst = max(worst, float(np.abs(Q * (1 - L * learning.frequency_response(plant.signals["tool"], f))).max()))
        if n % 5 == 0:
            T = learning.lifted(plant.signals["tool"], N)
            run = learning.learn(axis.law, r - T(r), T, RUNS)
            size = np.linalg.norm(run.errors[:, 100:725], axis=1)
            assert size[RUNS // 2 :].max() < LEFT * size[0], n
            change = np.linalg.norm(np.diff(run.inputs, axis=0), axis=1)
            # it still comes nearer
            assert change[-1] < 0.5 * change[RUNS // 2] + ROUNDING * np.abs(run.inputs).max(), n
    assert worst < 1, worst
    assert worst < axis.bound.value + 0.02  # and the bound that was said is that of the draws


def test_a_box_of_narrow_modes_that_its_filter_does_not_cover_is_refused() -> None:
    # with five models the bound said 0.93, and a model between two of them has the spectral radius 2.7
    with pytest.raises(ArgumentError) as error:
        boxed("shift", {"frequency_share": 0.3, "lags": 400, "damping_shares": (1.0, 1.0)}, 11.5, 0.004)
    assert error.value.argument == "cutoff" and "diverge" in error.value.message


@pytest.mark.parametrize("shift", [0, 20])
def test_a_law_of_case_1_that_diverges_in_longer_runs_is_refused_before_it_runs(shift: int) -> None:
    with pytest.raises(ArgumentError) as error:
        learning.study(learning.LearningRobot(), design=learning.LearningDesign(shift=shift))
    assert error.value.argument == "law"
    # its spectral radius is below 1 in a run of 825 samples, and yet errors grow before they would fall
    T = learning.lifted(learning.flexible_axis(7.4, 0.2).signals["motor"], N)
    law = learning.simple_law(N, 0.9, shift, 10.0)
    assert learning.spectral_radius(law.map(T)) < 1
    run = learning.learn(law, 1e-3 * np.random.default_rng(0).normal(size=N), T, runs=200)
    size = np.linalg.norm(run.errors, axis=1)
    assert size.max() > 10 * size[0]
