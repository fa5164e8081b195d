"""Kind "calibration" on what was really measured: several tables, poses known in part, nothing free, refits."""

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import gtmodel as gt
from gtmodel.calibrate import Fit, Measured, MeasuredSignal, calibration_study, read_poses, study
from gtmodel.calibrate.measured.misreadings import Witness
from gtmodel.calibrate.measured.poses import split_all
from gtmodel.kinds.calibration.keys import Schema
from gtmodel.kinds.calibration.kind import ARGUMENTS
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.from_options import key_of
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import ArgumentError
from tests.calibrate.shipped import PROBLEMS
from tests.support.pages import drawn_in, faults_of

KLIPPER = {"radius": 162.769280e-3, "angle[0]": np.radians(210.128266), "angle[1]": np.radians(329.914363),
           "arm[0]": 345.511546e-3, "arm[1]": 346.790457e-3, "arm[2]": 346.713602e-3,
           "end[0]": 418.721720e-3, "end[1]": 417.979258e-3, "end[2]": 419.036135e-3}  # fmt: skip
HEXAPOD = PROBLEMS / "data" / "hexapod"


@pytest.fixture(scope="module")
def delta():
    return gt.load(PROBLEMS / "calibrate_delta.toml")()


def refused(problem: Path, settings: list[str]) -> str:
    with pytest.raises((InputError, ArgumentError)) as error:
        gt.load(problem, *settings)()
    return str(error.value)


def test_the_printer_by_toml_alone(delta):
    assert delta.status.ok and delta.numerics_sound and delta.intervals_hold
    values = {u["name"]: u["value"] for u in delta.unknowns}
    for name, klipper in KLIPPER.items():
        bound = np.radians(0.1) if name.startswith("angle") else 1e-4
        assert abs(values[name] - klipper) < bound
    heights, distances = delta.recordings
    assert heights["name"] == "heights" and heights["errors"]["T[2]"]["fitted"]["rms"] == pytest.approx(0.018, abs=5e-4)
    assert distances["errors"]["distance"]["fitted"]["rms"] == pytest.approx(0.036, abs=5e-4)
    assert distances["errors"]["distance"]["a_priori"]["rms"] > 1.0
    low, high = delta.interval("arm[0]")
    assert 0.5e-3 < (high - low) / 4 < 0.8e-3  # Klipper's arms are determined to half a millimetre only
    said = [r.value for r in delta.rows if r.label == "identifiability"]
    assert any("arm[0]" in s and "no better than they were known" in s for s in said[1:])


@pytest.mark.parametrize(
    ("recording", "signal", "columns"),
    [(0, "q", [1, 0, 2]), pytest.param(1, "q@2", [1, 0, 2], marks=pytest.mark.proof)],  # a fit of 1,000 iterations
)
def test_errors_far_beyond_the_stated_noise_of_several_measurements_fail(delta, recording, signal, columns):
    """Towers exchanged in one table left up to 600 times the noise, all checks passed, and "intervals hold"."""
    assert delta.checks["residuals_over_noise"].passed
    robot, measured, *more = gt.load(PROBLEMS / "calibrate_delta.toml").arguments
    m = measured[recording].measurements
    values = {**m.values, signal: np.asarray(m.values[signal])[:, columns]}
    wrong = list(measured)
    wrong[recording] = replace(measured[recording], measurements=replace(m, values=values))
    s = study(robot, wrong, *more, held_out=0)
    assert s.status is gt.SolveStatus.CHECK_FAILED and not s.intervals_hold
    assert not s.checks["residuals_over_noise"].passed
    (said,) = [v for v in s.verdict if v.startswith("residuals are ")]
    assert "T[2] of heights" in said and "distance of dist" in said
    assert ("columns, signs or units" in said) == (recording == 1)


def test_files_and_pictures_of_several_measurements(delta, tmp_path):
    written = delta.write(tmp_path, report=True)
    assert {"poses.csv", "poses_dist.csv", "parameters.toml", "report.html"} <= {p.name for p in written}
    lines = (tmp_path / "poses_dist.csv").read_text().splitlines()
    assert lines[:2] == ["# SI units", "line,part,distance,error of distance"] and len(lines) == 14
    page = (tmp_path / "report.html").read_text()
    assert "<td>heights</td><td>T[2]</td><td>fitted</td>" in page
    assert len(drawn_in(page)) == len(delta.figures) > 1 and faults_of(page) == []


def test_the_call_of_the_file_is_the_study_of_objects(delta):
    call = gt.load(PROBLEMS / "calibrate_delta.toml")
    again = study(*call.arguments, held_out=0)
    assert [u["value"] for u in again.unknowns] == [u["value"] for u in delta.unknowns]


def test_heights_alone_are_said_to_determine_seven_of_nine():
    heights = Measured({"q": MeasuredSignal(["a", "b", "c"], "mm"), "T[2]": MeasuredSignal("height", "mm")})
    poses = read_poses(PROBLEMS / "data" / "klipper_v400" / "heights.csv", heights)
    robot = gt.load(PROBLEMS / "calibrate_delta.toml").arguments[0]
    alone = study(robot, poses, Fit(fixed=["angle[2]"]), held_out=0)
    assert alone.status.ok and alone.identifiability_after["rank"] == 7 and not alone.intervals_hold
    assert any("7 of 9 parameters or combinations are determined, 2 not at all" in s for s in alone.verdict)
    notes = alone.identifiability_after["notes"]
    assert sum("moves with" in s for s in notes) == 2
    assert "T was not fully measured" in alone.notes[0]


def test_explain_counts_all_measurements():
    said = explain(load(PROBLEMS / "calibrate_delta.toml"), Context(folder=PROBLEMS))
    assert "19 poses fitted, 0 held out; 9 unknowns" in said and "7 of 9 parameters or combinations" in said


def test_one_table_in_an_array_is_that_table():
    path = PROBLEMS / "calibrate_l1.toml"
    plain = gt.load(path)
    text = path.read_text().replace("[measurements]", "[[measurements]]")
    other = path.with_name("calibrate_l1_array.toml")
    try:
        other.write_text(text)
        array = gt.load(other)
    finally:
        other.unlink()
    (poses,) = array.arguments[1]
    np.testing.assert_array_equal(poses.measurements.values["T"], plain.arguments[1].measurements.values["T"])


def test_what_is_wrong_in_one_of_several_is_named_there():
    delta = PROBLEMS / "calibrate_delta.toml"
    assert refused(delta, ["measurements=[]"]) == "poses: there are no measurements; give poses"
    one = '{file="data/klipper_v400/heights.csv", signals={q={column=["a","b","c"],unit="mm"},%s}}'
    good = one % '"T[2]"={column="height",unit="mm",deviation=0.01}'
    bad = one % '"T[2]"={column="hight",unit="mm"}'
    assert "measurements[1].signals.T[2].column" in refused(delta, [f"measurements=[{good},{bad}]"])
    wide = "{name='b'," + (one % '"T[2]"={column=["a","b"],unit="mm",deviation=0.01}').removeprefix("{")
    argument = "poses[1].values.T[2].column"
    assert argument in refused(delta, [f"measurements=[{good},{wide}]"])
    assert key_of(Schema, argument, ARGUMENTS) == "measurements[1].signals.T[2].column"
    assert "2 measurements are named 'heights'" in refused(delta, [f"measurements=[{good},{good}]"])
    bare = "{name='b'," + (one % '"T[2]"={column="height",unit="mm"}').removeprefix("{")
    assert "state that of T[2] of b" in refused(delta, [f"measurements=[{good},{bare}]"])


def test_a_pose_out_of_reach_is_named_with_its_line(tmp_path):
    rows = (PROBLEMS / "data" / "klipper_v400" / "heights.csv").read_text().splitlines()
    rows[3] = "1396.3,526.0375,396.5375,16.0"
    (tmp_path / "far.csv").write_text("\n".join(rows) + "\n")
    heights = Measured({"q": MeasuredSignal(["a", "b", "c"], "mm"), "T[2]": MeasuredSignal("height", "mm")})
    robot = gt.load(PROBLEMS / "calibrate_delta.toml").arguments[0]
    lost = study(robot, read_poses(tmp_path / "far.csv", heights), Fit(fixed=["angle[2]"]), held_out=0)
    assert not lost.status.ok and lost.message.startswith("the pose of far.csv, line 4 cannot be closed")


def test_nothing_free_judges_a_file():
    as_it_is = gt.load(PROBLEMS / "calibrate_l1.toml", "free=[]", "accuracy_mm=20.0")()
    assert as_it_is.status.ok and not as_it_is.unknowns and as_it_is.iterations == 0
    assert as_it_is.held_out == pytest.approx(as_it_is.a_priori)
    assert as_it_is.verdict[0] == "nothing was fitted: the robot is evaluated as it is" and as_it_is.prediction_proven
    wanted = gt.load(PROBLEMS / "calibrate_l1.toml", "free=[]", "accuracy_mm=1.0")()
    assert not wanted.checks["mean_error_mm"].passed and wanted.prediction_proven is False


def test_nothing_free_leaves_frames_and_offsets_to_be_found():
    """As every parameter of the robot fixed by name."""
    free = judged_hexapod()
    fixed = gt.load(PROBLEMS / "judge_hexapod.toml", "free=['A']", "fixed=['A','B','L0','c']")()
    assert [u["name"] for u in free.unknowns] == [u["name"] for u in fixed.unknowns] and len(free.unknowns) == 18
    assert free.held_out == fixed.held_out


@cache
def judged_hexapod():
    return gt.load(PROBLEMS / "judge_hexapod.toml")()


@cache
def hexapod(*settings):
    other = f'held_out.file="{HEXAPOD / "rosbag_108_offset_origins.csv"}"'
    return gt.load(PROBLEMS / "calibrate_hexapod.toml", other, "sensitivity_step=0.0", *settings)()


def test_another_recording_is_judged_with_what_it_has_of_its_own():
    """Its homing, and where its device and markers have their origins, from half of its poses: as judge_hexapod does
    it with copied parameters."""
    own = hexapod('held_out.refit=["offset","device","target"]')
    assert own.poses == {"fitted": 108, "held_out": 54, "repeated": 0, "refitting": 54}
    judged = judged_hexapod()
    assert own.held_out["mean"] == pytest.approx(judged.held_out["mean"], rel=0.1)  # that fits on half of the first
    assert own.prediction_proven and own.held_out["mean"] < 0.8e-3
    offsets = [own.measurement[f"n.offset[{k}] of the held-out recording"] for k in range(6)]
    assert max(abs(x) for x in offsets) > 1e-3
    assert any(n.startswith("18 parameters of the held-out recording") for n in own.notes)


@pytest.mark.proof
def test_another_recording_without_its_frames_misses_and_a_quarter_of_its_poses_does():
    """Frames as in the first recording are none."""
    own = hexapod('held_out.refit=["offset","device","target"]')
    assert hexapod('held_out.refit=["offset"]').held_out["mean"] > 3 * own.held_out["mean"]
    few = hexapod('held_out.refit=["offset","device","target"]', "held_out.refit_every=4")
    assert few.poses["refitting"] == 27 and few.held_out["mean"] < 1.0e-3


def test_a_refit_that_cannot_be_is_said():
    l1 = PROBLEMS / "calibrate_l1.toml"
    assert "no parameter of kind 'device' to refit" in refused(l1, ['held_out.refit=["device"]'])
    assert "no held-out poses to refit on" in refused(l1, ['held_out.refit=["offset"]', "held_out.every=0"])
    delta = PROBLEMS / "calibrate_delta.toml"
    assert "no held-out poses to refit on" in refused(delta, ['held_out.refit=["offset"]', "held_out.every=0"])


def two_hexapods(folder, *, exchanged=False, **of_second):
    """The first recording's odd and even poses as two tables, each with frames and homing of its own; of the second
    the other recording is held out."""
    text = (HEXAPOD / "108_calibration_poses.csv").read_text().splitlines()
    for name, rows in (("a", text[1::2]), ("b", text[2::2])):
        (folder / f"{name}.csv").write_text("\n".join([text[0], *rows]) + "\n")
    problem = tomllib.loads((PROBLEMS / "calibrate_hexapod.toml").read_text())
    problem |= {"robot": str(PROBLEMS / "models" / "hexapod.py:Hexapod"), "sensitivity_step": 0.0}
    first = problem["measurements"] | {"file": "a.csv"}
    second = first | {"file": "b.csv"} | of_second
    if exchanged:
        columns = list(second["signals"]["n"]["column"])
        columns[:2] = reversed(columns[:2])
        second["signals"] = second["signals"] | {"n": second["signals"]["n"] | {"column": columns}}
    problem["measurements"] = [first, second]
    problem["held_out"] = {"every": 0, "refit": ["offset", "device", "target"]}
    (folder / "p.toml").write_text(tomli_w.dumps(problem))
    return folder / "p.toml"


OTHER_DAY = {"held_out_file": str(HEXAPOD / "rosbag_108_offset_origins.csv")}


def test_one_of_several_tables_has_a_held_out_recording_with_homing_and_frames_of_its_own(tmp_path):
    s = gt.load(two_hexapods(tmp_path, **OTHER_DAY))()
    assert s.status.ok and s.prediction_proven
    by_name = {r["name"]: r["errors"]["T"] for r in s.recordings}
    assert by_name["b"]["held_out"]["mean"] < 0.8e0 and "held_out" not in {k for k, v in by_name["a"].items() if v}
    assert any(n.startswith("18 parameters of the held-out recording of b") for n in s.notes)
    offsets = [s.measurement[f"n.offset[{k}] of the held-out recording of b"] for k in range(6)]
    assert max(abs(x) for x in offsets) > 1e-3


def test_an_array_of_one_table_holds_out_as_one_table_does():
    path = PROBLEMS / "calibrate_hexapod.toml"
    kept = ["sensitivity_step=0.0", 'held_out.refit=["offset","device","target"]']
    by_table = gt.load(path, f'measurements.held_out_file="{OTHER_DAY["held_out_file"]}"', *kept)()
    assert by_table.held_out == hexapod('held_out.refit=["offset","device","target"]').held_out
    file = OTHER_DAY["held_out_file"]
    both = [f'held_out.file="{file}"', f'measurements.held_out_file="{file}"']
    assert "measurements.held_out_file: is set besides held_out.file" in refused(path, both)


def test_a_held_out_file_that_is_wrong_is_named_at_its_table(tmp_path):
    problem = two_hexapods(tmp_path, held_out_file="none.csv")
    assert refused(problem, []).startswith("measurements[1].held_out_file: there is no file")
    (tmp_path / "none.csv").write_text("")
    assert refused(problem, []).startswith("measurements[1].held_out_file: none.csv")


# by the lengths of links in one table: tests/calibrate/test_misread.py
@pytest.mark.parametrize("by_lengths", [False, pytest.param(True, marks=pytest.mark.proof)])
def test_exchanged_columns_of_one_of_several_tables_are_named_there(tmp_path, monkeypatch, by_lengths):
    problem = two_hexapods(tmp_path, exchanged=True, **OTHER_DAY)
    if by_lengths:  # after the fit, where a robot has no forward kinematics
        size = calibration_study.witness_of(*_of_first(problem)).size
        monkeypatch.setattr(calibration_study, "witness_of", lambda *_: Witness(None, size))
    columns = ".*" if by_lengths else "leg_length_2, leg_length_1"
    with pytest.raises(InputError, match=f"b: the columns {columns} look exchanged") as caught:
        run(problem)
    assert caught.value.key == "measurements[1].signals.n"


def run(problem):
    return answer(load(problem), Context(folder=problem.parent))


def _of_first(problem):
    call = gt.load(problem)
    return call.arguments[0], split_all(call.arguments[1], call.arguments[0], 0)[0]
