"""A new suspicion is one function: calibration, force sensors, identification, cameras, filters, friction, tables and
load tests make it without a line of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.measurements.inspection import data_tests
from gtmodel.measurements.inspection.data_tests import Data
from gtmodel.results import ArgumentError
from gtmodel.results.suspicion import FIRST, Suspicion
from tests.identify.plants import simulator

ROBOT = gt.robots.gantry_tau("l1_tape")


def calibration() -> Any:
    grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[4, 4, 3])
    return gt.calibrate.study(ROBOT, gt.calibrate.made_poses(ROBOT, grid), gt.calibrate.Fit(sensitivity_step=0.0))


def wrench() -> Any:
    L = gt.control.lead_through
    sensor = L.SyntheticSensor(mass=0.9, centre=(0.01, 0.0, 0.1), point=(0.0, 0.0, 0.2))
    return L.wrench_study(L.SyntheticReadings(sensor, repetitions=0))


def identification() -> Any:
    t = simulator(16.0).truth
    links = gt.robots.inertia_variant("links")
    noise = np.random.default_rng(3).normal(size=t["tau"].shape)  # synthetic: seed 3
    log = gt.Trajectory(t.time, {"q": t["q"], "tau": t["tau"] + 30.0 * noise}, {"q": "m", "tau": "N"})
    return gt.identify.study(links.robot, log, links.free)


def stereo() -> Any:
    board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6, square=0.03)
    made = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(pictures=8), board)[0]
    return gt.vision.stereo_study(made, board)


def fusion() -> Any:
    return gt.filtering.fusion_study(gt.filtering.TrackedPath(duration=0.2), seed=2)


def friction() -> Any:
    same = [150.0] * 3, [140.0] * 3, [190.0] * 3, [180.0] * 3
    known = gt.identify.SyntheticRuns(*same, mass=22.0, velocities=[0.2, 0.5, 1.0])
    return gt.identify.friction_study(ROBOT, known, [gt.identify.HeldPose(tcp=[0.5, -0.9, 0.3])])


def resampling() -> Any:
    first, _ = gt.measurements.made_pair(gt.measurements.SyntheticDelay(delay=0.5, jitter=0.3))
    return gt.measurements.resampling_study(first, gt.measurements.EvenGrid(sample_time=0.01))


def load_tests() -> Any:
    poses = [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1], [1.0, -0.2, 1.8, 0.7, -2.0, 0.0], [0.4, -1.0, 2.3, 3.0, 1.2, -3.1]]
    loads = [gt.compliance.Load([2e3, 0, 0]), gt.compliance.Load([0, 0, -4e3])]
    truth, setup = gt.compliance.SyntheticTests(stiffness=[2e6] * 6, seed=1), gt.compliance.Setup(tool=[0.1, 0.05, 0.4])
    arm = gt.robots.kr500()
    return gt.compliance.stiffness_study(arm, gt.compliance.made_load_tests(arm, truth, poses, loads, setup), setup)


RUNS = (calibration, wrench, identification, stereo, fusion, friction, resampling, load_tests)
RESIDUALS = tuple(run for run in RUNS if run is not resampling)


def in_columns(data: Data) -> Iterator[Suspicion]:
    """As the function of a new suspicion is written."""
    if data.columns:
        yield Suspicion("planted", "the columns look planted", 1e-9, "look")


def in_residuals(data: Data) -> Iterator[Suspicion]:
    if data.residuals is not None:
        yield Suspicion("planted", f"the residuals of {len(data.residuals)} rows look planted", 1e-9, "look")


@pytest.mark.parametrize(("test", "run"), [(in_columns, r) for r in RUNS] + [(in_residuals, r) for r in RESIDUALS])
def test_a_new_suspicion_is_seen_by_every_run(
    test: data_tests.Test, run: Callable[[], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_tests, "EVERY_RUN", [*data_tests.EVERY_RUN, test])
    try:
        study = run()
    except ArgumentError as refused:  # before the fit
        assert "look planted; look" in str(refused) and 'accept = ["planted"]' in str(refused)
    else:
        assert not study.checks["planted"].passed and any("look planted; look" in note for note in study.notes)


def test_what_takes_a_level_is_refused_at_the_first_step_of_holm(monkeypatch: pytest.MonkeyPatch) -> None:
    weak = replace(next(in_columns(Data({"q": np.zeros(1)}))), p=2 * FIRST)
    monkeypatch.setattr(data_tests, "EVERY_RUN", [lambda data: [weak] if data.columns else []])
    assert friction().status.ok
