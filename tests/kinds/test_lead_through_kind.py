"""Kinds "lead_through" and "wrench_calibration": shipped problems, the same by the library, refusals by key."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus

PLATE, PEG, WRENCH = (
    f"problems/{name}.toml" for name in ("lead_through_plate", "lead_through_peg", "wrench_calibration")
)
L = gt.control.lead_through


@pytest.fixture(scope="module")
def plate():
    return answer(load(PLATE, ["hands.draws=50"]), Context())


def test_the_plate_holds_two_newtons_within_its_checks(plate) -> None:
    assert plate.status is SolveStatus.SOLVED and plate.contact_losses == 0
    assert abs(plate.mean_force - 2) < 0.02 and plate.loop_gain == pytest.approx(0.4 * plate.limit)
    assert set(plate.figures) == {"force", "path", "energy", "stability", "cones"}
    assert any("energy at the handle" in note for note in plate.notes)
    assert any("stable with all of them" in note for note in plate.notes)
    assert all(plate.figure(name).axes for name in plate.figures)


@pytest.fixture(scope="module")
def peg():
    return answer(load(PEG, ["hands.draws=20"]), Context())


def test_the_peg_is_aligned_and_its_free_rotation_reported(peg) -> None:
    assert peg.status is SolveStatus.SOLVED and peg.undetermined == [0.0, 0.0, 1.0]
    assert peg.last_torque < 0.05 * peg.largest_torque and peg.misalignment[1] < 0.1 * peg.misalignment[0]
    assert peg.expected_about > 0 and any("lock or hold it" in note for note in peg.notes)
    assert peg.figure("peg").axes


@pytest.mark.parametrize("about", ["lock", "hold"])
def test_the_peg_does_not_turn_about_its_axis_where_it_may_not(about: str) -> None:
    study = answer(load(PEG, [f"turning.about_axis={about!r}", "hands.draws=5"]), Context())
    assert study.status is SolveStatus.SOLVED and study.expected_about == 0 and abs(study.turned_about) < 1e-4


def test_the_calibration_recovers_what_was_declared() -> None:
    study = answer(load(WRENCH), Context())
    assert study.status is SolveStatus.SOLVED and study.usable == "OK"
    assert study.mass == pytest.approx(0.9, abs=study.half_widths["mass"])
    assert study.centre == pytest.approx([0.01, -0.02, 0.12], abs=2 * study.half_widths["centre_x"])
    assert len(study.coverage) == 13 and study.figure("residuals").axes


def test_measured_readings_stand_in_a_file(tmp_path) -> None:
    sensor = L.SyntheticSensor(mass=0.7, centre=(0.0, 0.01, 0.08), force_noise=0.02, moment_noise=0.001)
    rng = np.random.default_rng(3)
    turns = scipy.spatial.transform.Rotation.random(12, rng=rng)
    f, m = sensor.readings_at_rest(turns.as_matrix(), rng)
    values = {"turn": turns.as_rotvec(), "force": f, "moment": m}
    record = gt.Trajectory(
        np.arange(12.0), values, {"turn": "rad", "force": "N", "moment": "N.m"}, synthetic="seed 3, 0.02 N, 0.001 N m"
    )
    record.to_csv(tmp_path / "poses.csv")
    (tmp_path / "wrench.toml").write_text('kind = "wrench_calibration"\n[readings]\nfile = "poses.csv"\n')
    study = answer(load(tmp_path / "wrench.toml"), Context(folder=tmp_path))
    assert study.mass == pytest.approx(0.7, abs=0.01) and study.coverage is None
    assert study.mass == L.wrench_study(record).mass


def test_what_is_asked_is_explained() -> None:
    assert "500 to 5000 N/m" in explain(load(PLATE), Context())
    assert "0.25 mm" in explain(load(PEG), Context())
    assert "24 poses" in explain(load(WRENCH), Context())


@pytest.mark.parametrize(
    ("problem", "changes", "key"),
    [
        (PLATE, ["gains.force_gain_m_s_N=0.01"], "gains.force_gain_m_s_N"),
        (PLATE, ["gains.enter_force_N=5.0"], "gains.enter_force_N"),
        (PLATE, ["gains.any_direction=true"], "gains.any_direction"),
        (PLATE, ["stiffness.softest_N_m=1e6"], "stiffness.softest_N_m"),
        (PLATE, ["hole.depth_mm=3.0"], "surface"),
        (PEG, ["gains.any_direction=false", "gains.force_reference_N=2.0"], "gains.any_direction"),
    ],
)
def test_refusals_name_the_key(problem: str, changes: list[str], key: str) -> None:
    with pytest.raises(InputError) as caught:
        answer(load(problem, changes), Context())
    assert key in str(caught.value)
