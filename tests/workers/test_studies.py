"""Studies with independent rows: the same values in this process and in workers."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinematics.accuracy import ErrorCase, map_errors
from gtmodel.kinematics.workspace import Bodies, CrossSection, Sections, WorkspaceLimits, limited_mechanism
from gtmodel.problem_files import run
from gtmodel.problem_files.load import load
from gtmodel.results.work import CREW, Crew
from gtmodel.workers import using
from tests.support.commands import environment
from tests.workers.studies import Cart, Sine, Wells

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
ROBOT = gt.robots.gantry_tau("l1_tape")


@contextmanager
def in_crew(crew: Crew) -> Iterator[None]:
    before = CREW.set(crew)
    try:
        yield
    finally:
        CREW.reset(before)


def workspace() -> Any:
    s = gt.kinematics.workspace_study(
        ROBOT, WorkspaceLimits(cone=0.7), section=CrossSection(step=0.1),
        volume=Sections(low=-0.5, high=0.5, sections=3, tolerance=0.9, most_sections=3),
    )  # fmt: skip
    return s.area, s.kinematic_area, s.volume


def accuracy() -> Any:
    robot = limited_mechanism(ROBOT, None, Bodies())
    case = ErrorCase(lengths=robot.lengths, radius=np.full(3, 1e-4))
    T = np.random.default_rng(2).uniform([0.5, -1.0, 0.2], [1.5, 0.3, 0.8], (40, 3))
    errors = map_errors(case, lambda T: (robot.inverse(T).a, robot.inverse(T).status), T, chunk=20)
    return errors.error, errors.faces, errors.status


def table() -> Any:
    T = np.random.default_rng(1).uniform([0.5, -1.0, 0.2], [1.5, 0.3, 0.8], (4001, 3))
    s = gt.kinematics.causality_study(ROBOT, "T", "q", T)
    return s.targets["q"], s.codes


def calibrated() -> Any:
    grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[3, 3, 2])
    poses = gt.calibrate.made_poses(ROBOT, grid).measurements
    c = gt.calibrate.calibrate(ROBOT, poses)
    left = gt.calibrate.leave_out(c, gt.calibrate.folds_of(len(poses), 3))
    T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    possible = gt.calibrate.Measurements({"q": ROBOT.causal("T", "q")(T)[0], "T": T}, noise={"T": 2e-5})
    chosen = gt.calibrate.exchange(gt.calibrate.pose_information(gt.calibrate.prepare(ROBOT, possible)), 9, "D")
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
        mesh=gt.motion.MotionMesh(elements=4), starts=gt.motion.Starts(count=2),
    )  # fmt: skip
    return s.objective, s.message, s.iterations, s.files


def motions() -> Any:
    ends = {"start": gt.motion.End([0.0, -0.9, 0.1]), "goal": gt.motion.End([0.2, -0.9, 0.2])}
    limits, mesh = gt.motion.Limits(force=700.0), gt.motion.MotionMesh(elements=4)
    problems = [
        gt.motion.MotionProblem(robot=ROBOT, **ends, limits=limits, mesh=mesh, cost=gt.motion.Cost(energy=w))
        for w in (0.0, 1e-5)
    ]
    s = gt.motion.table_study([gt.motion.TableRow(f"row {n}", p) for n, p in enumerate(problems)])
    return s.entries, s.message, s.files


def fused() -> Any:
    values = gt.filtering.FusionSweep("acceleration_bias", (0.0, 1.0))
    s = gt.filtering.fusion_study(gt.filtering.TrackedPath(duration=0.1), sweep=values)
    return s.sweep_values, s.sweep_fused, s.sweep_slope, s.sweep_consistent


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


MAPS = [
    workspace, accuracy, table, calibrated, excitation, optima, motion, motions, fused, gains, folds, blocks, drawn
]  # fmt: skip


@pytest.mark.parametrize("study", MAPS)
def test_workers_change_nothing(study: Callable[[], Any], crew: Crew) -> None:
    with using(workers=0):
        here = study()
    crew.used = False
    with in_crew(crew):
        there = study()
    assert crew.used
    np.testing.assert_equal(there, here)


def test_a_problem_gives_the_same_bytes_with_workers(crew: Crew, tmp_path: Path) -> None:
    def bytes_of(name: str) -> dict[str, bytes]:
        loaded = load(PROBLEMS / "random_modes.toml", ["draw.platforms=17"])  # one more than are tracked together
        run.solve(loaded, run.context_of(loaded), out=tmp_path / name)
        return {p.name: p.read_bytes() for p in (tmp_path / name).iterdir() if p.name != "run.toml"}

    crew.used = False
    with in_crew(crew):
        there = bytes_of("there")
    assert crew.used and there == bytes_of("here")


def test_a_study_writes_the_same_bytes_with_one_and_four_workers_of_its_own() -> None:
    T = np.random.default_rng(1).uniform([0.5, -1.0, 0.2], [1.5, 0.3, 0.8], (6001, 3))  # in four parts
    here, one, four = (gt.kinematics.causality_study(ROBOT, "T", "q", T, workers=n).files for n in (0, 1, 4))
    assert here and here == one == four
    with pytest.raises(gt.results.ArgumentError) as caught:
        gt.kinematics.causality_study(ROBOT, "T", "q", T, workers=-1)
    assert caught.value.argument == "workers"


def test_rows_of_a_study_may_run_in_threads() -> None:
    with ThreadPoolExecutor(2) as executor:
        s = gt.kinematics.causality_study(ROBOT, "T", "q", np.tile([1.4, -0.9, 0.3], (2001, 1)), executor=executor)
    assert s.words == ["ok"] * 2001


def test_the_command_solves_with_workers(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "gtmodel", "solve", str(PROBLEMS / "van_der_pol.toml"), "--json", "--quiet"]
    done = subprocess.run([*words, "--workers", "2"], env=environment(), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and json.loads(done.stdout)["status"] == "solved"
    assert "no independent rows" in done.stderr
