"""Facts of a robot stand on its model: by whatever road a robot is named, they go with it."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel
from gtmodel import robots
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer
from gtmodel.robots.entries import FAMILIES
from tests.support.commands import Commands

PACKAGE = Path(gtmodel.__file__).parent
ARM = """
import gtmodel as gt


class Bare(gt.robots.SphericalWristArm):
    "The same geometry, of which nobody told the limits."


def bare():
    arm = gt.robots.kr500()
    return Bare(origins=arm.origins, axes=arm.axes)
"""


def test_nothing_outside_robots_compares_a_robot_by_its_name() -> None:
    names = set(robots.names()) - set(FAMILIES)
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        if "robots" in path.relative_to(PACKAGE).parts[:-1]:
            continue
        text = path.read_text(encoding="utf-8")
        if not any(name in text for name in names):
            continue
        for node in ast.walk(ast.parse(text)):
            inside = list(ast.walk(node)) if isinstance(node, (ast.Compare, ast.match_case)) else []
            found += [
                f"{path.name}:{c.lineno}: {c.value}"
                for c in inside
                if isinstance(c, ast.Constant) and isinstance(c.value, str) and c.value in names
            ]
    assert not found


@pytest.fixture(scope="module")
def reached(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the compliance of the KR 500 says, for each road to the robot."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.py").write_text(ARM)
    (folder / "own.toml").write_text('robot = "gtmodel.robots:kr500"\n')
    roads = {
        "name": "kr500",
        "reference": "gtmodel.robots:kr500",
        "file": str(folder / "own.toml"),
        "bare": f"{folder / 'arm.py'}:bare",
    }
    outcomes = {}
    for road, robot in roads.items():
        loaded = load("compliance_kr500", [f"robot={json.dumps(robot)}", "section.step_m=0.3"])
        context = Context(folder=loaded.path.parent)
        outcomes[road] = answer(loaded, context)
    return outcomes


@pytest.mark.parametrize("road", ["reference", "file"])
def test_the_limits_go_with_the_robot(reached: dict[str, Any], road: str) -> None:
    wanted, found = (json.dumps(reached[r].values, default=str) for r in ("name", road))
    assert found == wanted


def test_a_robot_without_limits_says_so(reached: dict[str, Any]) -> None:
    said = {road: "joint limits" in json.dumps(outcome.values, default=str) for road, outcome in reached.items()}
    assert said == {"name": False, "reference": False, "file": False, "bare": True}
    assert reached["bare"].values["map"]["points"] > reached["name"].values["map"]["points"]


def test_milling_takes_the_limits_from_the_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                 capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    (tmp_path / "arm.py").write_text(ARM)
    monkeypatch.chdir(tmp_path)
    loaded = load("milling_pose", ["robot=gtmodel.robots:kr500"])
    problem: Any = loaded.problem
    np.testing.assert_array_equal(loaded.kind.call(problem, Context()).arguments[0].joint_limits, robots.kr500_limits())
    refused = Commands(capsys)("solve", "milling_pose", "--set", f"robot={tmp_path / 'arm.py'}:bare")
    assert refused.code == 2 and "limits_deg" in refused.err
