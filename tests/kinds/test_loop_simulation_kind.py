"""Kind "loop_simulation": the shipped problem, the same by the library, refusals by key."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus

PROBLEM = "problems/loop_simulation.toml"
SHORT = ["move.duration_s=0.3", "move.rest_s=0.1", "move.goal_m=[0.55, -0.9, 0.3]"]


@pytest.fixture(scope="module")
def shipped():
    return answer(load(PROBLEM), Context())


def test_the_shipped_problem_is_solved(shipped) -> None:
    assert shipped.status is SolveStatus.SOLVED, shipped.message
    assert shipped.samples == 276 and shipped.end_time == pytest.approx(1.1)
    assert {"rms_error_mm", "largest_error_mm", "largest_force_N", "period_ms", "samples"} <= set(shipped.values)
    assert shipped.values["delay_ms"] == 8.0


def test_its_numbers_are_those_of_its_samples(shipped) -> None:
    rows = shipped.files["samples.csv"].splitlines()
    assert len(rows) == 277
    table = np.array([[float(x) for x in row.split(",")] for row in rows[1:]])
    names = rows[0].split(",")
    forces = table[:, [n for n, name in enumerate(names) if name.startswith("forces_")]]
    assert forces.tobytes() == shipped.law_samples["forces"].tobytes()
    np.testing.assert_array_equal(np.max(np.abs(forces), axis=0), shipped.largest_force)
    assert np.all(np.asarray(shipped.rms_error) <= shipped.largest_error)


def test_the_file_is_the_call_of_the_library() -> None:
    study = answer(load(PROBLEM, SHORT), Context())
    model = gt.robots.gantry_tau("l1_tape", "model_2")
    plant = load(PROBLEM, SHORT).problem.plant
    assert plant.payload_kg == 3.0
    law = gt.control.ComputedTorque(model, 900.0, 60.0)
    move = gt.control.Move(start=[0.5, -0.9, 0.3], goal=[0.55, -0.9, 0.3], duration=0.3, rest=0.1)
    sampling = gt.control.LoopSampling(period=0.004, delay=0.008, resolution=1e-6)
    heavier = gt.robots.gantry_tau("l1_tape", "model_2", payload=3.0)
    same = gt.control.loop_simulation(heavier, law, move, sampling=sampling)
    np.testing.assert_array_equal(same.rms_error, study.rms_error)
    # the law's own model is followed better
    exact = answer(load(PROBLEM, [*SHORT, "plant.payload_kg=0.0"]), Context())
    assert max(exact.rms_error) < 0.9 * max(study.rms_error)


def test_a_plant_whose_friction_sticks() -> None:
    """The law knows smooth friction; the plant does not move until its motors exceed what holds it."""
    free = ["limits.error_mm=20", "limits.force_N=2000"]
    study = answer(load(PROBLEM, [*SHORT, *free, "plant.friction.smoothing=stiction"]), Context())
    assert study.status is SolveStatus.SOLVED and "events" in study.message, study.message
    plant = gt.robots.gantry_tau("l1_tape", "model_2", smoothing="stiction", payload=3.0)
    law = gt.control.ComputedTorque(gt.robots.gantry_tau("l1_tape", "model_2"), 900.0, 60.0)
    move = gt.control.Move(start=[0.5, -0.9, 0.3], goal=[0.55, -0.9, 0.3], duration=0.3, rest=0.1)
    sampling = gt.control.LoopSampling(period=0.004, delay=0.008, resolution=1e-6)
    same = gt.control.loop_simulation(plant, law, move, sampling=sampling)
    np.testing.assert_array_equal(same.rms_error, study.rms_error)
    positions = study.trajectory["position"]
    assert np.ptp(positions[:3], axis=0).max() == 0.0
    assert np.ptp(positions, axis=0).max() > 0.02
    with pytest.raises(InputError, match=r"friction\.smoothing: expected 'tanh' or 'piecewise_linear'"):
        load(PROBLEM, ["friction.smoothing=stiction"])


def test_a_motion_from_a_file(tmp_path: Path) -> None:
    t = 0.004 * np.arange(51)
    rows = np.array([0.5, -0.9, 0.3]) + 0.01 * (1 - np.cos(np.pi * t / t[-1]))[:, None]
    gt.Trajectory(t, {"T": rows}, {"T": "m"}).to_csv(tmp_path / "motion.csv")
    text = Path(PROBLEM).read_text().partition("[move]")
    rest = text[2].partition("[plant]")[2]
    (tmp_path / "p.toml").write_text(f'{text[0]}[reference]\nfile = "motion.csv"\n[plant]{rest}')
    loaded = load(tmp_path / "p.toml")
    study = answer(loaded, Context(folder=tmp_path))
    assert study.samples == 51 and study.status is SolveStatus.SOLVED


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("sampling.period_ms=0", "sampling.period_ms"),
        ("sampling.period_ms=1e-3", "sampling.period_ms"),
        ("sampling.delay_ms=-1", "sampling.delay_ms"),
        ("sampling.velocity='filtered'", "sampling.velocity"),
        ("law.stiffness=-1.0", "law"),
        ("law.stiffness=[1.0, 2.0]", "law"),
        ("law.name='pid'", "law.name"),
        ("move.goal_m=[0.5, -0.9, 9.0]", "move"),
        ("move.goal_m=[0.5, -0.9]", "move.goal_m"),
        ("reference.file='motion.csv'", "move"),
        ('robot="kr500"', "robot"),
    ],
)
def test_what_cannot_be_simulated_names_its_key(change: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        answer(load(PROBLEM, [change]), Context())
    assert caught.value.key == key


def test_explain_says_what_acts_when() -> None:
    text = explain(load(PROBLEM), Context())
    assert "forces act 8 ms after their sample" in text and "differs from the law's model in payload_kg" in text
