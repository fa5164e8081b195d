"""Studies with independent rows: the same values in this process and in workers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinematics.accuracy import ErrorSection, LinkErrors, MonteCarloDraws
from gtmodel.kinematics.assembly_modes import draw
from gtmodel.kinematics.workspace import CrossSection, Sections, WorkspaceLimits
from gtmodel.problem_files import run
from gtmodel.problem_files.load import load
from gtmodel.results.work import Crew
from gtmodel.workers import mapped, using
from tests.workers.studies import Cart, Sine, Wells

ROBOT = gt.robots.gantry_tau("l1_tape")


@pytest.fixture(scope="module")
def crew() -> Iterator[Crew]:
    """Two processes for all tests, as one study would keep them."""
    with using(workers=2) as crew:
        pass
    crew.pool = None
    yield crew
    crew.close()


def workspace() -> Any:
    s = gt.kinematics.workspace_study(
        ROBOT, WorkspaceLimits(cone=0.7), section=CrossSection(step=0.1),
        volume=Sections(low=-0.5, high=0.5, sections=3, tolerance=0.9, most_sections=3),
    )  # fmt: skip
    return s.area, s.kinematic_area, s.volume


def accuracy() -> Any:
    cases = [LinkErrors("carts", along=[11e-6, 58e-6, 19e-6], across=[28e-6, 38e-6, 47e-6])]
    draws = MonteCarloDraws(samples=100)
    return gt.kinematics.accuracy_study(
        gt.robots.gantry_tau("d1_nominal"), cases, section=ErrorSection(step=0.3), monte_carlo=draws
    ).cases


def modes() -> Any:
    hands = draw(17, seed=2)  # one pose more than are tracked together
    found = gt.kinematics.assembly_modes.assembly_modes_batch(hands.A, hands.B, hands.L)
    return [m.T for m in found]


def table() -> Any:
    T = np.random.default_rng(1).uniform([0.5, -1.0, 0.2], [1.5, 0.3, 0.8], (4001, 3))
    s = gt.kinematics.causality_study(ROBOT, "T", "q", T)
    return s.targets["q"], s.codes


def calibrated() -> Any:
    grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[3, 3, 2])
    poses = gt.calibrate.made_poses(ROBOT, grid).measurements
    c = gt.calibrate.calibrate(ROBOT, poses)
    left = gt.calibrate.leave_out(c, gt.calibrate.folds_of(len(poses), 3))
    chosen = gt.calibrate.exchange(gt.calibrate.pose_information(gt.calibrate.prepare(ROBOT, poses)), 9, "D")
    return left.errors["T"], left.judged.ratio, chosen.indices, chosen.starts


def excitation() -> Any:
    motion = gt.identify.Family(
        period=2.0, harmonics=2, place_low=[0.9, -0.9, 0.4], place_high=[1.1, -0.7, 0.6]
    )  # fmt: skip
    limits = gt.motion.Limits(force=700.0, tcp_low=[0.5, -1.1, 0.2], tcp_high=[1.5, -0.5, 0.8])
    s = gt.identify.excitation_study(
        ROBOT, motion, limits, experiment=gt.identify.IdentificationExperiment(identified=["m_p", "m_c"]),
        random=gt.identify.RandomMotions(draws=2), search=gt.identify.ExcitationSearch(starts=2, max_iterations=5),
    )  # fmt: skip
    return s.unknowns, s.condition


def optima() -> Any:
    found = gt.multi_start(gt.transcribe(Wells(), gt.Mesh(1, 1)), 4)
    return [(o.solution.x, o.count, o.solution.message) for o in found.optima]


def motion() -> Any:
    s = gt.motion.study(
        ROBOT, [0.0, -0.9, 0.1], [0.2, -0.9, 0.2], limits=gt.motion.Limits(force=700.0),
        mesh=gt.motion.MotionMesh(elements=6), starts=gt.motion.Starts(count=2),
    )  # fmt: skip
    return s.objective, s.message, s.iterations, s.files


def gains() -> Any:
    rng = np.random.default_rng(1)
    joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (6, 2)))
    m, c, k = gt.control.delayed.true_plants(joints, gt.control.delayed.SyntheticCommands())
    field = gt.control.delayed.fit_gain_field(joints, m, c, k)
    return gt.control.delayed.limits_over(field, joints[:2], "y", cycle=0.004, delay=0.052, draws=201)


def folds() -> Any:
    poses = np.random.default_rng(6).uniform(-1, 1, (24, 4))
    inputs = gt.vibration.KernelInputs(scale=(1.0,) * 4, periodic=(False,) * 4)
    return gt.vibration.held_out(gt.vibration.fit_gaussian_processes(poses, np.sin(poses.sum(axis=1)), inputs), folds=4)


def blocks() -> Any:
    q = gt.identify.multisine(0.004 * np.arange(600), np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    log = gt.identify.LogSimulator(Cart(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    return gt.identify.leave_out_in_turn(gt.identify.study(Cart(), log, ["m", "d"]).fit, 5).errors


def drawn() -> Any:
    return gt.inference.monte_carlo(Sine(), 5, seed=3).results


@pytest.mark.parametrize(
    "study", [workspace, accuracy, modes, table, calibrated, excitation, optima, motion, gains, folds, blocks, drawn]
)  # fmt: skip
def test_workers_change_nothing(study: Callable[[], Any], crew: Crew) -> None:
    with using(workers=0):
        here = study()
    crew.used = False
    token = gt.results.work.CREW.set(crew)
    try:
        there = study()
    finally:
        gt.results.work.CREW.reset(token)
    assert crew.used
    np.testing.assert_equal(there, here)
