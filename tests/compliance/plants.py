"""Static tests of the KR 500-3: printed poses, loads of ours, synthetic displacements."""

from __future__ import annotations

from functools import cache

import numpy as np

from gtmodel import robots
from gtmodel.compliance import ArmPoses, StaticTests, arm_poses, complete_pose, decoupled, synthetic_tests

ROBOT = robots.kr500()
TRUTH = 1e-6 / np.array([3.93, 3.46, 2.77, 1.57, 0.24, 0.17])  # Table 1, complete pose
TOOL = [0.1, 0.05, 0.4]  # ours: none is printed
SIGMA = [2e-5] * 3 + [1e-4] * 3  # a tracker's 20 um, on a target base of 0.25 m
LOADS = np.array([[2000.0, 0, 0], [0, 2000, 0], [0, 0, -4000]])  # N, ours


@cache
def poses() -> ArmPoses:
    q = np.deg2rad(robots.kr500_tables()["static_stiffness"]["poses_deg"])
    return arm_poses(ROBOT, np.repeat(q, len(LOADS), axis=0), TOOL)


def planned(wrist_target: bool = True, **more: np.ndarray) -> StaticTests:
    p = poses()
    wrenches = np.tile(np.hstack([LOADS, np.zeros_like(LOADS)]), (len(p.q) // len(LOADS), 1))
    return p.tests(wrenches, sigma=SIGMA, wrist_sigma=2e-5 if wrist_target else None, **more)


def tilting(tests: StaticTests, rng: np.random.Generator | None) -> StaticTests:
    """Bearings that tilt by three times the compliance of their joints."""
    return synthetic_tests(tests, TRUTH, rng, tilt=3 * TRUTH, origins=poses().origins, point=poses().T)


def one(rng: np.random.Generator, k: int, method: str, wrist_target: bool = True):
    """One run of a Monte Carlo: the Estimate."""
    made = synthetic_tests(planned(wrist_target), TRUTH, rng)
    return (complete_pose if method == "complete" else decoupled)(made).estimate
