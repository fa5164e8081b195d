"""[[filters]] of kind codegen: the shipped problem, refusals by key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel.kinds.codegen.kind import functions_of, write
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load
from tests.support.commands import CLONE

PROBLEM = "problems/fusion_controller.toml"


def test_the_shipped_filter_is_the_one_of_the_thesis(tmp_path: Path) -> None:
    problem = load(PROBLEM).problem
    (made,) = functions_of(problem, Context()).values()
    assert (made.plan.errors, sum(s.jacobian.shape[0] for s in made.plan.sensors)) == (18, 12)
    study = write(problem, Context(), tmp_path / "out")
    assert study.status.ok
    header = (tmp_path / "out" / "gt_fusion.h").read_text()
    assert "gt_status gt_fusion_pose_step(" in header and "double specific_force" not in header


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("filters=[]", "functions"),
        ("filters.0.sensors.0.delay_s=0.0005", "filters[0].period_s"),
        ("filters.0.states=['p']", "filters[0].states"),
        ("filters.0.start.deviation.p=0.0", "filters[0].start.deviation"),
        ("filters.0.noise.jerk=-1.0", "filters[0].noise.jerk"),
        ("filters.0.noise.jrk=1.0", "filters[0]"),
        ("filters.0.sensors.0.signal='zz'", "filters[0]"),
        ("filters.0.sensors.0.deviation=-1.0", "filters[0].sensors[0].deviation"),
        ("filters.0.sensors.0.density=1.0", "filters[0].sensors[0].deviation"),
        ("filters.0.sensors.1.kind='vector'", "filters[0].sensors[1].kind"),
    ],
)
def test_what_is_wrong_is_refused_at_its_key(setting: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        functions_of(load(PROBLEM, [setting]).problem, Context())
    assert caught.value.key == key


ESTIMATED = """
kind = "codegen"
robot = "{models}/belt_drive.py:BeltDrive"
name = "belt"
[[filters]]
name = "drive"
period_s = 0.002
from_result = "result"
states = ["motor", "load", "motor_rate", "load_rate"]
inputs = ["torque"]
noise = {{ push = "estimate" }}
[[filters.sensors]]
name = "encoder"
signal = "motor"
deviation = "estimate"
[[filters.sensors]]
name = "scale"
signal = "load"
deviation = "estimate"
"""
NUMBERS = {
    "noise": {"push.density": [2e-3], "encoder.deviation": [1e-3], "scale.deviation": [5e-4]},
    "noise_undetermined": ["push.density"],
    "start": {"motor": [0.3], "load": [0.3], "motor_rate": [0.0], "load_rate": [0.0]},
    "start_deviation": {"motor": [1e-3], "load": [1e-3], "motor_rate": [0.1], "load_rate": [0.1]},
}


@pytest.fixture
def estimated(tmp_path: Path) -> Path:
    (tmp_path / "result").mkdir()
    data = {"kind": "filtering", "status": "solved", "values": NUMBERS}
    (tmp_path / "result" / "result.json").write_text(json.dumps(data))
    path = tmp_path / "p.toml"
    path.write_text(ESTIMATED.format(models=CLONE / "problems" / "models"))
    return path


def test_noise_and_start_come_from_a_result(estimated: Path) -> None:
    context = Context(folder=estimated.parent)
    (made,) = functions_of(load(estimated).problem, context).values()
    assert made.system.process.noise == {"push": 2e-3}
    assert made.system.deviations["scale"].tolist() == [5e-4]
    assert made.defaults["motor"] == 0.3 and made.defaults["load_rate.deviation"] == 0.1
    assert any("did not determine push.density" in note for note in context.notes)
    assert context.inputs["filters[0].from_result"].name == "result.json"


def test_code_from_a_failed_result_is_not_written(estimated: Path) -> None:
    path = estimated.parent / "result" / "result.json"
    path.write_text(path.read_text().replace('"solved"', '"not_finite"'))
    with pytest.raises(InputError, match=r"result\.json"):
        write(load(estimated).problem, Context(folder=estimated.parent), estimated.parent / "out")
    assert not (estimated.parent / "out" / "gt_belt.c").exists()


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("filters.0.from_result=''", "filters[0].noise.push"),
        ("filters.0.from_result='none'", "filters[0].from_result"),
        ("filters.0.from_result='p.toml'", "filters[0].from_result"),
        ("filters.0.sensors.0.name='other'", "filters[0].sensors[0].deviation"),
    ],
)
def test_a_missing_estimate_names_its_key(estimated: Path, setting: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        functions_of(load(estimated, [setting]).problem, Context(folder=estimated.parent))
    assert caught.value.key == key


def test_a_filter_without_a_start_names_its_key(estimated: Path) -> None:
    settings = ["filters.0.from_result=''", "filters.0.noise.push=1.0"]
    settings += [f"filters.0.sensors.{n}.deviation=1.0" for n in (0, 1)]
    with pytest.raises(InputError) as caught:
        functions_of(load(estimated, settings).problem, Context(folder=estimated.parent))
    assert caught.value.key == "filters[0].start"


def test_a_solved_problem_becomes_c(estimated: Path) -> None:
    from tests.support.belt_drive import PROBLEMS

    log = (PROBLEMS / "data" / "belt_drive_synthetic.csv").read_text().splitlines(keepends=True)
    (estimated.parent / "log.csv").write_text("".join(log[:350]))  # at rest, and the first turns: enough for a filter
    short = f'log.files=["{estimated.parent / "log.csv"}"]'
    gt.load(PROBLEMS / "filter_belt_drive.toml", "faults={}", short)().write(estimated.parent / "solved")
    problem = load(estimated, ["filters.0.from_result='solved'", "check.points=100"]).problem
    study = write(problem, Context(folder=estimated.parent), estimated.parent / "out", verify=True)
    assert study.status.ok and study.checks["drive_steps_different"].value == 0
