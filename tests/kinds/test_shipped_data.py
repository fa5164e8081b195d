"""Data of shipped problems are there, or the problem says in its first line and in its error where to get them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import check, load
from gtmodel.problem_files.run import answer

CLONE = Path(__file__).resolve().parents[2]
PROBLEMS = CLONE / "problems"
SHIPPED = sorted(PROBLEMS.glob("*.toml"))
DATA = {".csv", ".mat", ".npz", ".txt"}


def named(data: Any, key: str = "") -> Iterator[tuple[str, str, str]]:
    """Files of data in the tables of a problem: key, name, and the `source` beside it."""
    if isinstance(data, dict):
        for name, value in data.items():
            place = f"{key}.{name}" if key else name
            names = value if isinstance(value, list) else [value]
            if all(isinstance(n, str) and Path(n).suffix in DATA for n in names):
                yield from ((place, n, data.get("source", "")) for n in names)
            else:
                yield from named(value, place)
    elif isinstance(data, list):
        for n, value in enumerate(data):
            yield from named(value, f"{key}[{n}]")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_data_are_there_or_the_problem_says_where(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for key, name, source in named(tomllib.loads(text)):
        assert not name.startswith(("/", "..")), f"{key} leaves the folder of the problems"
        if not source:
            assert (PROBLEMS / name).is_file(), f"{key} names {name}, which is not there, and no source"
            continue
        first = text.partition("\n")[0]
        assert first.startswith("#") and Path(name).name in first and "https://" in first and "https://" in source


def test_a_recording_that_is_not_there_says_where_to_get_it() -> None:
    loaded = load(PROBLEMS / "emps.toml", ['log.files=["nowhere.mat"]'])
    with pytest.raises(InputError) as caught:
        answer(loaded, Context(folder=PROBLEMS))
    assert caught.value.key == "log.files[0]" and "\n" not in caught.value.message
    beginning = f"there is no file 'nowhere.mat' in {PROBLEMS} or here; get it from the EMPS benchmark, https://"
    assert caught.value.message.startswith(beginning)
    assert "examples/EMPS/data/DATA_EMPS.mat" in caught.value.message
    assert caught.value.message.endswith("and put it there")


def test_any_table_that_names_a_recording_takes_a_source() -> None:
    wanted = {"measurements.file=nowhere.csv", "held_out.file=nowhere.csv"}
    for setting in wanted:
        table = setting.partition(".")[0]
        loaded = load(PROBLEMS / "calibrate_hexapod.toml", [setting, f"{table}.source=a shelf"])
        with pytest.raises(InputError, match=r"or here; get it from a shelf and put it there"):
            answer(loaded, Context(folder=PROBLEMS))
    kind, problem = check({"kind": "dynamic_stiffness", "measured": {"index": "nowhere.csv", "source": "a shelf"}})
    with pytest.raises(InputError, match="get it from a shelf"):
        kind.call(problem, Context(folder=PROBLEMS))


def test_recordings_of_others_carry_their_licence_and_source() -> None:
    folder = PROBLEMS / "data" / "hexapod"
    assert "CC0 1.0 Universal" in (PROBLEMS / "data" / "klipper_v400" / "LICENSE").read_text()
    assert "MIT License" in (folder / "LICENSE").read_text() and "Jugleer" in (folder / "LICENSE").read_text()
    assert "https://github.com/Project-DeepBlue-Juggling/Jugglebot" in (folder / "README.md").read_text()


def test_nothing_shipped_names_a_folder_beside_the_clone() -> None:
    for folder in ("problems", "docs", "notebooks", "gtmodel", "codegen"):
        for path in sorted((CLONE / folder).rglob("*")):
            if path.is_relative_to(CLONE / "docs" / "project"):  # made by `make docs` from the texts at the top
                continue
            if path.suffix in {".md", ".py", ".toml", ".ipynb", ".c", ".h"}:
                assert "shared/realdata" not in path.read_text(encoding="utf-8"), path
    assert "shared/realdata" not in (CLONE / "README.md").read_text(encoding="utf-8")
