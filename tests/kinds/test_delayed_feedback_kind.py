"""Kind "delayed_feedback": the shipped problems, the same by the library, refusals by key."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import ArgumentError, SolveStatus

POSE_19, MAP, L1 = (f"problems/feedback_{name}.toml" for name in ("pose_19", "map_kr500", "l1"))
D = gt.control.delayed


@pytest.fixture(scope="module")
def pose_19():
    return answer(load(POSE_19, ["box.draws=30", "cut.shares=[0.0, 0.9]", "cut.steps=10"]), Context())


def test_pose_19_answers_what_the_thesis_printed(pose_19) -> None:
    assert pose_19.status is SolveStatus.SOLVED
    # Table 14: x stable at 0.2; y predicted stable at 0.01, not at 0.02
    assert 0.2 < pose_19.limit["x"] < 0.3 and 0.01 < pose_19.limit["y"] < 0.02
    ((low, high),) = pose_19.meeting_limits
    assert 0.01 < low < pose_19.limit["y"] < high < 0.02
    below, above = pose_19.meeting_predictions["30"]
    assert below < pose_19.off_axis_limit["30"] < above
    assert set(pose_19.readings["x"]) == {f"{c} ms, {a}adding up" for c in (4, 12) for a in ("", "not ")}
    assert pose_19.worst_limit["y"] < pose_19.limit["y"]
    depths = list(pose_19.chatter_depth.values())
    assert all(abs(a / b - 1) < 0.02 for a, b in zip(depths, pose_19.chatter_depth_finer.values(), strict=True))
    assert pose_19.tooth_in_cycles == "39/10" and abs(pose_19.spindle_speed_error) < 0.01
    assert set(pose_19.figures) == {"limits", "box", "runs", "directions", "chatter"}


def test_the_numbers_of_the_documentation(pose_19) -> None:
    """docs/kinds/delayed_feedback.md and docs/theses.toml, row "off-axis", as they are printed there."""
    ((low, high),) = pose_19.meeting_limits
    below, above = pose_19.meeting_predictions["30"]
    rigid = D.gain_limit(D.DelayedLoop(D.rigid_plant(0.004), 0.004, 0.052)).gain
    page = Path("docs/kinds/delayed_feedback.md").read_text(encoding="utf-8").replace("\n", " ")
    rows = Path("docs/theses.toml").read_text(encoding="utf-8")
    assert f"limits along y of {low:.4f} to {high:.4f}" in page
    assert f"limits along y of {low:.4f} to {high:.4f} meet both" in rows
    assert f"predicts {below:.4f} to {above:.4f}" in page and f"{rigid:.3f}" in page


@pytest.mark.proof
def test_the_map_is_of_synthetic_commands_and_says_so() -> None:
    study = answer(load(MAP, ["map.points=3", "map.draws=50"]), Context())
    assert study.status is SolveStatus.SOLVED and study.poses == 16 and len(study.recommended["y"]) == 6
    assert any("synthetic" in note for note in study.notes)
    rows = study.files["table.csv"].splitlines()
    assert len(rows) == 7 and rows[0].startswith("joint_2_deg,joint_3_deg,median_x")
    np.testing.assert_allclose(float(rows[1].split(",")[0]), -38.53)
    assert study.figure("map").axes


def test_the_l1_is_the_call_of_the_library() -> None:
    study = answer(load(L1, ["path.duration_s=2.0", "box.draws=20"]), Context())
    robot = gt.robots.gantry_tau("l1_tape", "model_2")
    at = {"T": [0.5, -0.9, 0.3], "der(T)": 0.0}
    plant = D.servo_plant(robot, gt.control.Feedback(4e4, 2e3), at, [0.0, 1.0, 0.0])
    assert study.limit["y"] == D.gain_limit(D.DelayedLoop(plant, 0.004, 0.02)).gain
    assert set(study.limit) == {"x", "y", "z"} and study.readings == {}


def test_measured_plants_stand_in_the_file(tmp_path) -> None:
    joints = [[-33.96, 113.53], [-31.26, 98.33], [-46.14, 115.56], [-59.08, 95.65], [-50.15, 78.59]]
    m, c, k = D.true_plants(np.deg2rad(joints), D.SyntheticCommands())
    text = 'kind = "delayed_feedback"\n[map]\npoints = 3\ndraws = 50\n'
    text += "table_deg = [[-40.0, 100.0]]\ngain_step = { y = 0.01 }\n"
    for row, values in zip(joints, zip(m[:, 1], c[:, 1], k[:, 1], strict=True), strict=True):
        given = "\n".join(f"{n} = {{ y = {v!r} }}" for n, v in zip("mck", map(float, values), strict=True))
        text += f"[[map.plant]]\njoints_deg = {row}\n{given}\n"
    (tmp_path / "p.toml").write_text(text)
    study = answer(load(str(tmp_path / "p.toml")), Context())
    assert study.poses == 5 and study.true_limit is None and study.median["y"][0] > 0


def test_it_explains_itself() -> None:
    assert "y: 12 Hz" in explain(load(POSE_19), Context())
    assert "synthetic" in explain(load(MAP), Context())
    assert "corrected along x, y, z" in explain(load(L1), Context())


@pytest.mark.parametrize(
    ("problem", "changes", "key"),
    [
        (POSE_19, ["axes.y.mass=1.0"], "axes.y.mass"),
        (POSE_19, ["axes.y.gain=0.02"], "axes.y.gain"),
        (POSE_19, ["axes.y.damping_ratio=1.0"], "axes.y.damping_ratio"),
        (POSE_19, ["timing.accumulate=true"], "axes.x.limit"),
        (POSE_19, ["robot=l1_tape"], "robot"),
        (POSE_19, ["cut.axis=z"], "cut.axis"),
        (POSE_19, ["cut.steps=2"], "cut.steps"),
        (POSE_19, ["cut.speed_rpm=60000", "box.draws=20"], "cut.steps"),
        (POSE_19, ["cut.feed_direction=[0.0, 0.0, 1.0]"], "cut.feed_direction"),
        (POSE_19, ["cut.shares=[]"], "cut.shares"),
        (POSE_19, ["cut.engagement.radial_depth_m=-1.0"], "cut.engagement.radial_depth_m"),
        (POSE_19, ["timing.delay_ms=9000"], "timing.delay_ms"),
        (POSE_19, ["box.delay_ms=9000"], "box.delay_ms"),
        (POSE_19, ["path.noise_um=-1.0"], "path.noise_um"),
        (POSE_19, ["box.delay_ms=-1.0"], "box.delay_ms"),
        (POSE_19, ["off_axis=[{ angle_deg = 30.0, stable = 0.1 }]"], "off_axis[0].stable"),
        (MAP, ["map.synthetic.noise_um=0.0"], "map.synthetic.noise_um"),
        (MAP, ["map.poses_deg=[[0.0, 1.0]]"], "map.poses_deg"),
        (MAP, ["map.gain_step={ x = 0.1 }"], "map.synthetic.frequency_Hz"),
        (MAP, ["timing.accumulate=true"], "timing.accumulate"),
        (MAP, ["box.draws=100"], "box"),
        (L1, ["servo.directions={ x = [1.0, 1.0, 0.0] }"], "servo.directions.x"),
        (L1, ["servo.tool_m=[9.0, 9.0, 9.0]"], "servo.tool_m"),
        (L1, ["law.stiffness=-1.0"], "law"),
        (L1, ["axes={ x = { frequency_Hz = 17.0, damping_ratio = 0.1, mass = 1.0 } }"], "axes"),
    ],
)
def test_what_is_refused(problem: str, changes: list[str], key: str) -> None:
    with pytest.raises((InputError, ArgumentError)) as fault:
        answer(load(problem, changes), Context())
    assert (fault.value.key if isinstance(fault.value, InputError) else fault.value.argument) == key
