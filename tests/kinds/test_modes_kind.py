"""Kind "modes": keys of the file, and where refusals stand in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtmodel import robots
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import check, load
from gtmodel.problem_files.registry import get
from gtmodel.problem_files.run import keyed
from tests.support.commands import Commands

ZEROS = {"A_m": [[0.0] * 3] * 6, "B_m": [[0.0] * 3] * 6, "L_m": [1.0] * 6}


def solve(context: Context | None = None, **keys: object):
    kind, problem = check({"kind": "modes", **keys})
    with keyed(type("Loaded", (), {"kind": kind, "placed": staticmethod(lambda error: error)})):  # type: ignore[arg-type]
        return kind.call(problem, context or Context())()  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["d1_modes", "random_modes"])
def test_shipped_problems_are_solved(name: str) -> None:
    loaded = load(f"problems/{name}.toml", ["draw.platforms=2"] if name == "random_modes" else [])
    found = get("modes").call(loaded.problem, Context())()  # type: ignore[attr-defined]
    assert found.status.ok and found.finite == 40 and found.rows


def test_a_robot_file_with_a_file_of_poses(tmp_path: Path) -> None:
    robot = robots.six_link_gantry_tau()
    lists = {"A_m": robot.A, "v": robot.v, "B_m": robot.B, "L_m": robot.L}
    text = "".join(f"{key} = {np.asarray(x).tolist()}\n" for key, x in lists.items())
    (tmp_path / "mine.toml").write_text(f'family = "six_link"\nhome_zyz_deg = [85.0, 100.9, -88.6]\n{text}')
    (tmp_path / "poses.csv").write_text("q1_m,q2_m,q3_m\n-0.2,0.0,-0.2\n")
    context = Context(folder=tmp_path)
    assert solve(context, robot="mine.toml", poses="poses.csv").commanded == 6
    assert context.inputs["poses"] == tmp_path / "poses.csv"


REFUSED = [
    ({}, ""),
    ({"robot": "f1", "draw": {}}, "draw"),
    ({"robot": "l1_tape"}, "robot"),
    ({"draw": {}, "pose": {"q_m": [0.0, 0.0, 0.0]}}, "pose"),
    ({"draw": {}, "parameters": {"L": 1.0}}, "parameters"),
    ({"draw": {}, "poses": "p.csv"}, "poses"),
    ({"draw": {"seed": -1}}, "draw.seed"),
    ({"robot": "f1", "poses": "p.csv"}, "poses"),
    ({"robot": "f1", "poses": "p.csv", "pose": {}}, "poses"),
    ({"robot": "f1", "pose": {"q_m": [0.0] * 3, "tcp_m": [0.0] * 3}}, "pose"),
    ({"robot": "f1", "pose": {"q_deg": [0.0] * 3}}, "pose"),
    ({"robot": "f1", "pose": {"q_m": [0.0] * 3, "q_deg": [0.0] * 3, "q_rad": [0.0] * 3}}, "pose"),
    ({"robot": "f1", "pose": {"quaternion": [1.0, 0.0, 0.0, 0.0]}}, "pose.quaternion"),
    ({"robot": "d1_six_link", "pose": {"tcp_m": [0.0] * 3, "zyz_deg": [0.0] * 3}}, "pose.zyz_deg"),
    ({"platform": ZEROS}, "platform"),
    ({"platform": ZEROS, "pose": {"q_m": [0.0] * 3}}, "pose.q_m"),
    ({"platform": ZEROS, "pose": {"tcp_m": [0.0] * 3}}, "pose"),
]


@pytest.mark.parametrize(("keys", "key"), REFUSED)
def test_wrong_inputs_name_their_key(keys: dict, key: str) -> None:
    with pytest.raises(InputError) as caught:
        solve(**keys)
    assert caught.value.key == key and caught.value.message


def test_command_line_and_explain(capsys: pytest.CaptureFixture[str]) -> None:
    done = Commands(capsys)("solve", "d1_modes", "--set", "pose.q_m=[5.0, 0.0, 0.0]", "--json")
    assert done.code == 0 and done.json["values"]["nearest_mm"] is None and done.json["values"]["real"] == 0
    explained = Commands(capsys)("explain", "problems/dietmaier_modes.toml")
    assert explained.code == 0 and "leg 6: A = (" in explained.out
