"""Tools on the L1, simulated with friction: the law knows them by a log, and says before by what factor they learn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.control import learning
from gtmodel.results import SolveStatus

SIZE = 1500
FALLS = 10.0  # the least factor
SAID = 0.25  # share by which predicted and reached factor may differ: the robot is not linear, its friction not either


@dataclass(frozen=True)
class Excitation(learning.SquarePath):
    """Random motion of some 2 mm up to 30 Hz in place of the square, synthetic."""

    ramp: int = 100
    corrected: int = SIZE - 200

    def samples(self, sample_time: float) -> np.ndarray:
        """x and y (SIZE, 2) [m]."""
        band = scipy.signal.butter(3, [0.3, 30.0], "band", fs=1 / sample_time, output="sos")
        return 0.012 * scipy.signal.sosfiltfilt(band, np.random.default_rng(5).normal(size=(SIZE, 2)), axis=0)


@pytest.mark.proof
@pytest.mark.parametrize(("mass", "frequency", "damping"), [(1.0, 15.0, 0.1), (5.0, 10.0, 0.05)])
def test_a_tool_known_by_a_log_learns_by_the_factor_that_was_said(
    mass: float, frequency: float, damping: float
) -> None:
    robot = gt.robots.gantry_tau("l1_tape", inertia="model_2")
    tip = learning.ElasticTip(mass=mass, frequency=frequency, damping=damping)
    noise, path = learning.LearningNoise(repeats=3), learning.SquarePath(side_time=0.3)
    random = learning.SimulatedMotion(robot, tip, Excitation(), noise)
    run = random.run(np.zeros((SIZE, 2)))
    axes = [
        learning.identified_axis(random.reference[:, k], {s: run[s][:, k] for s in ("motor", "tool")}, delay=0)
        for k in range(2)
    ]
    design = learning.LearningDesign(case="3", law="inverse", change=0.01, frequency_share=0.08, iterations=5)
    motion = learning.SimulatedMotion(robot, tip, path, noise)
    s = learning.study(learning.ModelledRobot(axes), path, design, noise, experiment=motion)
    assert s.status is SolveStatus.SOLVED and s.tool_error is not None and s.synthetic is not None
    tool = np.array(s.tool_error)
    fell = tool[:, 0] / tool[:, -1]
    assert np.all(fell > FALLS) and fell == pytest.approx(s.factor, rel=SAID)
