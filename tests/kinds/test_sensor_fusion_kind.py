"""Kind "sensor_fusion": the shipped problems, the same by the library, refusals by key."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.filtering import SyntheticAttitude, synthetic_attitude
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.editor_schema import values as schema_values
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus
from tests.support.recordings import ABB_LOST, ABB_ROWS, write_synthetic_abb

THREE, FIVE = "problems/fusion_3_axis.toml", "problems/fusion_5_axis.toml"
ABB, SYNTHETIC = "problems/fusion_abb.toml", "problems/fusion_log_synthetic.toml"
SHORT = ["path.duration_s=0.2"]


def test_the_problem_in_three_axes_is_the_call_of_the_library() -> None:
    study = answer(load(THREE, SHORT), Context())
    assert study.status is SolveStatus.SOLVED
    F = gt.filtering
    path, sensors = F.TrackedPath(duration=0.2, feed=1e-3 * 42.33), F.FusionSensors(position_noise=1e-3 * 0.0064)
    same = F.fusion_study(path, sensors, F.FusionFilter(smooth=True), seed=1, title=study.title)
    assert str(same) == str(study) and same.trajectory == study.trajectory
    assert {"velocity_fused_mm_s", "velocity_smoothed_mm_s", "below_slope", "nis", "nis_band"} <= set(study.values)
    assert "synthetic" in study.values and study.trajectory.synthetic.startswith("SYNTHETIC")


def test_the_problem_in_five_axes_is_solved() -> None:
    study = answer(load(FIVE, SHORT), Context())
    assert study.status is SolveStatus.SOLVED and study.axes == 5
    assert set(study.figures) == {"baselines", "velocity", "innovations", "angular_acceleration"}
    for name in study.figures:
        assert study.figure(name).axes
    assert len(study.fast_share) == 2


def test_a_sweep_of_the_file() -> None:
    more = ['sweep.parameter="rate_bias"', "sweep.values=[0.0, 0.1]"]
    with pytest.raises(InputError):
        answer(load(THREE, [*SHORT, 'sweep.parameter="colour"', "sweep.values=[1.0, 2.0]"]), Context())
    study = answer(load(FIVE, [*SHORT, *more]), Context())
    assert study.sweep_parameter == "rate_bias" and len(study.sweep_fused) == 2
    assert study.figure("sweep").axes


def test_explain_says_what_the_filter_does_not_know() -> None:
    text = explain(load(FIVE), Context())
    assert "synthetic" in text and "interacting" in text and "bias of the accelerometer" in text


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (["path.duration_s=0.01"], "path.duration_s"),
        (["filter.printed=true", "filter.fast_jerk_density_m2_s5=1.0"], "filter.fast_jerk_density_m2_s5"),
        (["sensors.sample_time_ms=0"], "sensors.sample_time_ms"),
        (["sensors.arm_mm=[1, 2]"], "sensors.arm_mm"),
        (["sensors.rate_bias_deg_s=1.0"], "sensors.rate_bias_deg_s"),  # of 5 axes
        (["filter.particles=50"], "filter.particles"),  # of another kind
        (['sweep.parameter="sample_time"', "sweep.values=[1e-3, 0.0]"], "sweep.values"),
        (['filter.outliers="tukey"'], "filter.outliers"),
        (["sensors.outlier_share=0.9"], "sensors.outlier_share"),
    ],
)
def test_refusals_name_the_key(settings: list[str], key: str) -> None:
    with pytest.raises(InputError) as refused:
        answer(load(THREE, settings), Context())
    assert key in str(refused.value)


# -- a recording in place of a path -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The synthetic twin of the recording of an ABB arm, in a file of its form."""
    file = tmp_path_factory.mktemp("abb") / "twin.mat"
    write_synthetic_abb(file)
    return f"log.files=['{file}']"


def test_a_recording_is_read_row_by_row(log: str) -> None:
    """The true references alone, in spite of a lost row that is dropped before most of them."""
    made = synthetic_attitude(SyntheticAttitude(seed=3, lost=0)).recording
    recording = gt.load(ABB, log).arguments[0]
    assert len(recording.gyro) == ABB_ROWS - 1 and recording.gyro.names == ("rate", "acceleration")
    np.testing.assert_array_equal(recording.gyro["rate"][ABB_LOST:], made.gyro["rate"][ABB_LOST + 1 : ABB_ROWS])
    at = np.searchsorted(made.reference.time, recording.reference.time)
    assert 200 < len(at) <= len(made.reference)
    np.testing.assert_allclose(recording.reference["quaternion"], made.reference["quaternion"][at], atol=1e-12)
    said = explain(load(ABB, [log]), Context())
    assert "2138 rows" in said and "calibrated up to 9 s" in said


def test_the_recording_is_calibrated_and_judged(log: str) -> None:
    study = answer(load(ABB, [log, "judging.gaps_s=[0.5]"]), Context())
    assert study.status is SolveStatus.SOLVED, study.message
    assert study.convention == "gyro in deg/s, quaternion w x y z, world to body"
    assert {"error_deg", "exchanged_deg", "first_interval", "timing_s", "below_slerp"} <= set(study.values)
    assert set(study.values) <= {*schema_values("sensor_fusion"), "notes"}
    assert np.shape(study.values["error_deg"]) == (1, 5) and study.error[0][1] < study.error[0][0]
    assert "SYNTHETIC" not in str(study)  # a file that does not say so is taken for measured


def test_references_are_read_in_any_representation(tmp_path) -> None:
    made = synthetic_attitude(SyntheticAttitude(seed=3, duration=8.0)).recording
    turns = scipy.spatial.transform.Rotation.from_quat(made.reference["quaternion"], scalar_first=True)
    gyro = np.column_stack([made.gyro.time, made.gyro["rate"]])
    np.savetxt(tmp_path / "gyro.txt", gyro, fmt="%.15g")
    np.savetxt(
        tmp_path / "robot.txt", np.column_stack([made.reference.time, turns.as_euler("ZYX", degrees=True)]), fmt="%.15g"
    )
    columns = {"rate": (["2", "3", "4"], "rad/s"), "reference.quaternion": (["2", "3", "4"], "deg")}
    tables = "".join(
        f'[log.{name}]\ncolumn = {column}\nunit = "{unit}"\nfile = "{file}"\ntime = {{ column = "1", unit = "s" }}\n'
        for (name, (column, unit)), file in zip(columns.items(), ("gyro.txt", "robot.txt"), strict=True)
    )
    text = 'kind = "sensor_fusion"\n[log]\nfiles = ["gyro.txt", "robot.txt"]\nheader = 0\n' + tables
    (tmp_path / "p.toml").write_text(text + '[log.reference]\nrepresentation = "KUKA A B C"\n')
    reference = gt.load(tmp_path / "p.toml").arguments[0].reference["quaternion"]
    np.testing.assert_allclose(np.abs(np.sum(reference * made.reference["quaternion"], axis=1)), 1.0, atol=1e-6)
    (tmp_path / "p.toml").write_text(text + '[log.reference]\nrepresentation = "matrix"\n')
    with pytest.raises(InputError) as caught:
        gt.load(tmp_path / "p.toml")
    assert "log.reference.representation" in str(caught.value)


def test_the_synthetic_recording_is_the_call_of_the_library() -> None:
    call = gt.load(SYNTHETIC, "synthetic_log.duration_s=8.0", "judging.gaps_s=[0.3]")
    made, judging = call.arguments
    assert made == SyntheticAttitude(seed=3, duration=8.0) and tuple(judging.gaps) == (0.3,)
    assert "synthetic recording of 8 s" in explain(load(SYNTHETIC, ["synthetic_log.duration_s=8.0"]), Context())


@pytest.mark.parametrize(
    ("problem", "settings", "key"),
    [
        (SYNTHETIC, ["seed=2"], "seed"),
        (SYNTHETIC, ["path.duration_s=1.0"], "path"),
        (SYNTHETIC, ["judging.gaps_s=[30.0]"], "judging.gaps_s"),
        (SYNTHETIC, ["judging.calibrate_until_s=0.5"], "judging.calibrate_until_s"),
        (THREE, ["judging.gaps_s=[0.3]"], "judging"),
        (ABB, ["log.files=['nowhere.mat']"], "log.files[0]"),
        (ABB, ["LOG", "synthetic_log.seed=1"], "log"),
        (ABB, ["LOG", "log.rate.column=SENSgyr"], "log"),
        (ABB, ["LOG", "log.rate.column=ABBquaternion"], "log.rate"),
        (ABB, ["LOG", "log.acceleration.time={column='ABBtime',unit='s'}"], "log"),
        (ABB, ["LOG", "log.reference.first_row=3000"], "log.reference.row"),
        (ABB, ["LOG", "log.sample_time_s=0.01"], "log.sample_time_s"),  # it has a column of time
        (SYNTHETIC, ["judging.gaps_s=[]"], "judging.gaps_s"),
    ],
)
def test_recordings_are_refused_by_key(problem: str, settings: list[str], key: str, log: str) -> None:
    with pytest.raises(InputError) as refused:
        answer(load(problem, [log if s == "LOG" else s for s in settings]), Context())
    assert refused.value.key == key, refused.value
