"""Kind "postures": shipped problems, pose forms of the file, and where refusals stand in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import check, load
from gtmodel.problem_files.run import context_of, keyed, solve as run

ARM = str(Path(__file__).parents[2] / "problems" / "models" / "arm.urdf")
DOWN = {"position_m": [0.4, 0.1, 0.3], "orientation": [0.0, 0.0, 180.0], "representation": "KUKA A B C"}
TWO = """family = "serial"
a_m = [0.4, 0.3]
alpha_deg = [0.0, 0.0]
d_m = [0.0, 0.0]
"""


def solve(context: Context | None = None, **keys: object):
    kind, problem = check({"kind": "postures", "robot": ARM, **keys})
    with keyed(type("Loaded", (), {"kind": kind, "problem": problem, "placed": staticmethod(lambda error: error)})):  # type: ignore[arg-type]
        return kind.call(problem, context or Context())()  # type: ignore[attr-defined]


def test_shipped_pose_has_eight_postures_and_names_the_nearest() -> None:
    loaded = load("problems/postures_ur_like.toml")
    study = run(loaded, context_of(loaded)).outcome
    assert study.status.ok and study.counts == {"8": 1} and len(study.names) == 8
    table = {row.label: row.value for row in study.rows}
    assert table.keys() > set(study.names) and table["nearest"] == "right, up, flip"  # near_deg has the elbow at -90
    assert "axes 2 3 4 parallel" in loaded.kind.explain(loaded.problem, context_of(loaded))


def test_shipped_seam_is_a_path_that_the_nearest_posture_does_not_follow(tmp_path: Path) -> None:
    loaded = load("problems/postures_seam.toml")
    study = run(loaded, context_of(loaded)).outcome
    assert study.status.ok and not study.jumps
    distance = np.where(np.isfinite(study.q[0]).all(axis=1), np.linalg.norm(study.q[0], axis=1), np.inf)
    assert np.linalg.norm(study.chosen[0]) > distance.min() + 0.1
    study.write(tmp_path / "out", plot=True)
    assert {"path.csv", "postures.csv", "path.png"} <= {p.name for p in (tmp_path / "out").iterdir()}
    coarse = load("problems/postures_seam.toml", ["table.largest_step_deg=2"])
    failed = run(coarse, context_of(coarse)).outcome
    assert (
        not failed.status.ok
        and len(failed.jumps) == 60
        and "before row 2 (line 4): flange would move" in failed.message
    )
    failed.write(tmp_path / "failed")
    assert not (tmp_path / "failed" / "path.csv").exists()


def test_a_pose_without_orientation_is_for_up_to_three_joints(tmp_path: Path) -> None:
    (tmp_path / "two.toml").write_text(TWO)
    study = solve(Context(folder=tmp_path), robot="two.toml", pose={"position_m": [0.5, 0.2, 0.0]}, near=[0.0, 1.0])
    assert study.names == ("left", "right") and study.chosen[0, 1] > 0


REFUSED = [
    ({}, "pose"),
    ({"pose": DOWN, "table": {"file": "x.csv"}}, "pose"),
    ({"pose": DOWN, "near": [0.0], "near_deg": [0.0]}, "near_deg"),
    ({"pose": DOWN, "near": [0.0]}, "near"),
    ({"pose": DOWN, "near_deg": [0.0]}, "near_deg"),
    ({"pose": DOWN, "elbow": {"angle_deg": 0.0}, "locked": {"joint": 0, "value": 0.0}}, "locked"),
    ({"pose": DOWN, "elbow": {"angle_deg": 0.0}}, "elbow"),
    ({"pose": {**DOWN, "orientation": [1.0, 2.0]}}, "pose.orientation"),
    ({"pose": {**DOWN, "representation": "euler"}}, "pose.representation"),
    ({"pose": {**DOWN, "position_m": [1.0]}}, "pose.position_m"),
    ({"table": {"file": "missing.csv"}}, "table.file"),
    ({"robot": "l1_tape", "pose": DOWN}, "robot"),
    ({"robot": "f1", "pose": DOWN}, "robot"),
]


@pytest.mark.parametrize(("keys", "key"), REFUSED)
def test_refusals_name_their_key(keys: dict, key: str) -> None:
    with pytest.raises(InputError) as error:
        solve(**keys)
    assert error.value.key == key
