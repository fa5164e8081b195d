"""The identification study, called on objects: numbers, intervals, checks and pictures; and what is refused."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import Fitting, Processing, SyntheticLog, study, synthetic_study
from gtmodel.measurements import ESTIMATE, Session, Signal
from gtmodel.mechanics import ForceMotor, Mass, SignFriction
from gtmodel.results import ArgumentError, SolveStatus
from tests.identify.plants import NOISE, SAMPLE_TIME, plant, simulator

LINKS = gt.robots.inertia_variant("links")
SHORT = SyntheticLog(duration=12.0)


def made_up(synthetic: SyntheticLog = SHORT, free: Any = LINKS.free, **options: Any):
    return synthetic_study(LINKS.robot, synthetic, free, plant=plant(), **options)


@pytest.fixture(scope="module")
def found():
    return made_up(replace(SHORT, seed=2012, duration=16.0), title="the L1")


def test_thirteen_parameters_of_a_log_that_is_made_up(found):
    assert found.status is SolveStatus.SOLVED
    assert all(check.passed for check in found.checks.values()), found.checks
    assert len(found.parameters) == 13 and found.synthetic.startswith("seed 2012, effort noise 30")
    for name, truth in found.truth.items():
        low, high = found.intervals.get(name, (-np.inf, np.inf))
        assert low - (high - low) < truth < high + (high - low)
    assert len(found.rows) > 2 * 13 and found.fit.rows.names == tuple(found.parameters)


def test_what_is_written_and_drawn_says_that_it_is_synthetic(found):
    table = tomllib.loads(str(found.files["parameters.toml"]))
    assert table["m_p"]["unit"] == "kg" and table["synthetic"] == found.synthetic
    assert found.trajectory is not None and found.trajectory.synthetic == found.synthetic
    drawn = {name: found.figure(name) for name in found.figures}
    assert sorted(drawn) == ["efforts", "friction", "held_out", "residuals"]
    # measured beside modelled and their difference, of three motors
    assert {name: len(figure.axes) for name, figure in drawn.items()} == {
        "efforts": 6,
        "friction": 3,
        "held_out": 6,
        "residuals": 12,
    }
    assert all("(synthetic)" in figure.get_suptitle() for figure in drawn.values())


def test_left_out_links_are_reported():
    variant = gt.robots.inertia_variant("model_2")
    how = Fitting(watch=["m_a"])
    s = synthetic_study(variant.robot, SyntheticLog(duration=30.0), variant.free, plant=plant(), fitting=how)
    assert not s.checks["nothing_left_out"].passed
    assert "error_in_standard_deviations" not in s.checks  # the truth of another model
    assert any("show an effect of" in sentence for sentence in s.notes)
    assert 9.13 + 0.75 < s.parameters["m_p"] < 9.13 + 1.5


def test_repeated_runs():
    s = made_up(replace(SHORT, runs=3, processes=0, duration=8.0))
    assert s.coverage["runs"] == 3 and s.coverage["band"][1] == 3
    assert any(row.label == "pooled coverage" for row in s.rows)


@pytest.fixture(scope="module")
def log() -> gt.Trajectory:
    """In metres and newtons; forces 8 N off on every cart."""
    t = simulator(16.0).truth
    tau = t["tau"] + 8.0 + NOISE * np.random.default_rng(6).normal(size=t["tau"].shape)
    return gt.Trajectory(t.time, {"q": np.round(t["q"], 6), "tau": tau}, {"q": "m", "tau": "N"}, synthetic="seed 6")


OFFSET = {"q": Signal("q", "m"), "tau": Signal("tau", "N", offset=ESTIMATE, per_session=())}


def test_a_log_in_memory_with_offsets_of_its_own(log):
    s = study(LINKS.robot, log, LINKS.free, held_out=Session("again", log, SAMPLE_TIME), signals=OFFSET)
    assert s.status is SolveStatus.SOLVED and s.truth is None and s.synthetic == "seed 6"  # carried over
    assert sorted(s.corrections) == [f"tau.offset[{i}]" for i in range(3)]
    for name, value in s.corrections.items():
        low, high = s.intervals[name]
        assert abs(value - 8.0) < high - low < 40.0  # four standard deviations; parameters like the others
    assert s.parameters["m_p"] == pytest.approx(9.13, abs=0.6)
    assert s.held_out_rms == pytest.approx(s.noise, rel=0.1)  # the same log


def test_wrong_logs_are_named(log):
    free, names, units = LINKS.free, {"q": log["q"], "tau": log["tau"]}, {"q": "m", "tau": "N"}
    uneven = gt.Trajectory(np.where(log.time > 1, log.time + 0.01, log.time), names, units)
    narrow = gt.Trajectory(log.time, {**names, "q": log["q"][:, 0]}, units)
    scale = {**OFFSET, "tau": Signal("tau", "N", scale=ESTIMATE)}
    by_session = {**OFFSET, "tau": replace(OFFSET["tau"], per_session=("offset",))}
    for given, options, argument in (
        (uneven, {}, "log"),
        (log, {"held_out": uneven}, "held_out"),
        (narrow, {}, "log.known"),
        (gt.Trajectory(log.time, {**names, "tau": log["tau"][:, :2]}, units), {}, "log.targets"),
        (gt.Trajectory(log.time, {"q": log["q"]}, {"q": "m"}), {}, "log"),
        ([], {}, "log"),
        (log, {"signals": scale}, "log"),
        ([log, log], {"signals": by_session, "held_out": log}, "held_out"),
        (log, {"published": {"mass": 1.0}}, "published.mass"),
    ):
        with pytest.raises(ArgumentError) as caught:
            study(LINKS.robot, given, free, **options)
        assert caught.value.argument == argument, caught.value


@pytest.mark.parametrize(
    ("free", "how", "argument"),
    [
        (["m_q"], Fitting(), "free"),
        (["L"], Fitting(), "free"),
        (["m_p"], Fitting(watch=["m_p"]), "fitting.watch"),
        (["m_q"], Fitting(watch=["m_p"]), "free"),  # its sentence proposes m_p
        (["m_p"], Fitting(known="p"), "fitting.known"),
        (["m_p"], Fitting(targets="p"), "fitting.targets"),
        (["m_p"], Fitting(nonnegative=["m_q"]), "fitting.nonnegative"),
    ],
)
def test_wrong_names_are_named(free, how, argument):
    with pytest.raises(ArgumentError) as caught:
        made_up(free=free, fitting=how)
    assert caught.value.argument == argument


class Drive(gt.Model):
    """A carriage, the simplest robot."""

    m = gt.parameter(100.0, unit="kg", positive=True)
    coulomb = gt.parameter(20.0, unit="N")
    viscous = gt.parameter(200.0, unit="kg/s")
    x = gt.variable(unit="m")
    F = gt.variable(unit="N", nominal=100.0)
    carriage = gt.part(Mass, m=m)
    motor = gt.part(ForceMotor)
    friction = gt.part(SignFriction, coulomb=coulomb, viscous=viscous)

    def equations(self):
        yield gt.connect(self.carriage.flange, self.motor.flange)
        yield gt.connect(self.carriage.flange, self.friction.flange)
        yield self.x == self.motor.flange.s
        yield self.F == self.motor.force


WAY = SyntheticLog(reference="x", centre=[0.0], half_range=0.1, tracking="exact", duration=12.0)
OF_DRIVE, FREE = Fitting(known="x", targets="F"), ["m", "coulomb", "viscous"]


def test_any_model():
    way = replace(WAY, effort_noise=5.0)
    s = synthetic_study(Drive(), way, FREE, plant=Drive(m=95.0), fitting=OF_DRIVE)
    assert s.parameters["m"] == pytest.approx(95.0, abs=1.0)
    assert all(check.passed for check in s.checks.values())


@pytest.mark.parametrize(
    ("way", "cutoff", "argument"),
    [
        ({"duration": 1.0}, None, "synthetic.ramp"),
        ({"effort_noise": [1.0, 2.0]}, None, "synthetic.effort_noise"),
        ({"centre": [0.0, 1.0]}, None, "synthetic.centre"),
        ({"half_range": [1.0, 1.0]}, None, "synthetic.half_range"),
        ({"frequencies": []}, None, "synthetic.frequencies"),
        ({"tracking": "dressler_2012"}, None, "synthetic.tracking"),
        ({"reference": "y"}, None, "synthetic.reference"),
        ({}, 200.0, "synthetic"),
        ({"duration": 2.5}, 0.5, "synthetic"),
    ],
)
def test_wrong_motions_are_named(way: dict[str, Any], cutoff: float | None, argument: str):
    with pytest.raises(ArgumentError) as caught:
        synthetic_study(Drive(), replace(WAY, **way), FREE, fitting=OF_DRIVE, processing=Processing(cutoff))
    assert caught.value.argument == argument


@pytest.mark.parametrize(
    ("way", "argument"),
    [({"half_range": 3.0}, "synthetic.half_range"), ({"duration": 3.0, "sample_time": 0.002}, "synthetic")],
)
def test_motions_that_the_robot_cannot_follow_are_named(way: dict[str, Any], argument: str):
    with pytest.raises(ArgumentError) as caught:
        made_up(replace(SHORT, **way))
    assert caught.value.argument == argument


def test_interrupted_it_has_no_numbers(log):
    for s in (made_up(stop=lambda: True), study(LINKS.robot, log, LINKS.free, stop=lambda: True)):
        assert s.status is SolveStatus.INTERRUPTED and s.parameters is None and not s.rows and not s.files


def test_the_robot_of_a_variant_is_the_catalogues():
    assert np.array_equal(np.asarray(LINKS.robot.A), np.asarray(gt.robots.gantry_tau("l1_tape").A))
