"""The folder of a result: what may be replaced, what may not, and what it holds."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gtmodel.problem_files import Check, Context, InputError, run
from gtmodel.problem_files.base import earlier_result
from gtmodel.problem_files.load import load
from gtmodel.results import ArgumentError, SolveStatus, Stored, Trajectory, as_json, written
from tests.support.own_models import FILES

TRAJECTORY = Trajectory([0.0, 0.1, 0.3], {"x": [1.0, 2.0, 0.1]}, {"x": "m"})


def outcome(**more: object) -> Stored:
    return Stored(status=SolveStatus.SOLVED, message="done", trajectory=TRAJECTORY, **more)  # type: ignore[arg-type]


def write(folder: Path, **more: object) -> list[str]:
    (folder.parent / "swing.toml").write_text(FILES["swing.toml"])
    loaded = load(folder.parent / "swing.toml", ["mesh.elements=3"])
    return [p.name for p in run.write(folder, loaded, Context(), outcome(**more), wall_s=1.0, plot=False)]


def test_a_new_folder_is_made(tmp_path: Path) -> None:
    assert write(tmp_path / "a", files={"extra.toml": "x = 1\n"}) == [
        "result.json",
        "trajectory.csv",
        "extra.toml",
        "run.toml",
    ]
    assert Trajectory.from_csv(tmp_path / "a" / "trajectory.csv")["x"].tolist() == [1.0, 2.0, 0.1]


def test_an_earlier_result_is_replaced_and_what_is_not_made_any_more_goes(tmp_path: Path) -> None:
    write(tmp_path / "a", files={"extra.toml": "x = 1\n"})
    (tmp_path / "a" / "notes.txt").write_text("mine")
    write(tmp_path / "a")
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"result.json", "trajectory.csv", "run.toml", "notes.txt"}


def test_foreign_files_stay(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="contains files that gtmodel did not write"):
        write(tmp_path / "a")
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["notes.txt"]


def test_a_file_changed_by_hand_stays(tmp_path: Path) -> None:
    write(tmp_path / "a", files={"parameters.toml": "x = 1\n"})
    (tmp_path / "a" / "parameters.toml").write_text("x = 2\n")
    with pytest.raises(InputError, match=r"parameters\.toml was changed after gtmodel wrote it"):
        write(tmp_path / "a", files={"parameters.toml": "x = 1\n"})
    assert (tmp_path / "a" / "parameters.toml").read_text() == "x = 2\n"


def test_a_foreign_file_of_a_new_name_stays(tmp_path: Path) -> None:
    write(tmp_path / "a")
    (tmp_path / "a" / "extra.toml").write_text("mine")
    with pytest.raises(InputError, match=r"extra\.toml was not written by gtmodel"):
        write(tmp_path / "a", files={"extra.toml": "x = 1\n"})


@pytest.mark.parametrize("run", ["", "program = 'other'\n", "program = 'gtmodel'\n", "= broken", "\xff"])
def test_somebody_elses_run_toml_makes_no_result_of_ours(tmp_path: Path, run: str) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "run.toml").write_text(run, encoding="latin-1")
    with pytest.raises(ArgumentError, match="contains files that gtmodel did not write"):
        written.refuse_foreign(tmp_path / "a")


def test_run_toml_cannot_point_outside_its_folder(tmp_path: Path) -> None:
    write(tmp_path / "a")
    (tmp_path / "b.txt").write_text("mine")
    run = tmp_path / "a" / "run.toml"
    run.write_text(run.read_text().replace('"result.json" =', '"../b.txt" ='))
    with pytest.raises(InputError, match=r"result\.json was not written by gtmodel"):
        write(tmp_path / "a")
    assert (tmp_path / "b.txt").read_text() == "mine"


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    with pytest.raises(ArgumentError, match="is a file; name a folder"):
        written.refuse_foreign(tmp_path / "a")


def test_numbers_that_are_not_finite_become_null() -> None:
    values = {"a": math.nan, "b": np.array([1.0, math.inf]), "c": np.float64(2.5), "d": {"e": (np.int64(3), None)}}
    checks = {"f": Check(math.nan)}
    bad = Stored(status=SolveStatus.NOT_FINITE, objective=math.nan, stored=values, checks=checks)
    read = json.loads(as_json.line(as_json.summary("p.toml", "test", bad, 0.5)), parse_constant=pytest.fail)
    assert read["values"] == {"a": None, "b": [1.0, None], "c": 2.5, "d": {"e": [3, None]}}
    assert read["objective"] is None and read["status"] == "not_finite" and read["message"]
    assert read["checks"] == {"f": {"value": None, "bound": None, "passed": False}}


def test_a_result_is_read_back_to_start_from(tmp_path: Path) -> None:
    write(tmp_path / "a", stored={"final_time_s": 0.3})
    for path in (tmp_path / "a", tmp_path / "a" / "result.json"):
        context = Context(start=earlier_result(path, "optimization"))
        guess = context.guess()
        assert guess is not None and guess.unit("x") == "m"
        assert np.array_equal(guess.time, TRAJECTORY.time) and np.array_equal(guess["x"], TRAJECTORY["x"])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("no JSON", "is not a result.json of gtmodel"),
        ("[1]", "is not a result.json of gtmodel"),
        ('{"kind": "trajectory"}', "is a result of kind 'trajectory'; this problem is of kind 'optimization'"),
        ('{"kind": "optimization", "trajectory": {"time_s": [0, 0]}}', "its trajectory cannot be read"),
        ('{"kind": "optimization", "trajectory": 3}', "its trajectory cannot be read"),
    ],
)
def test_what_is_no_result_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(InputError, match=sentence):
        earlier_result(tmp_path / "result.json", "optimization")
