"""A refusal of a key says its line in the file; one of a value that `--set` gave says none."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from gtmodel._files import problems_dir
from gtmodel.problem_files.base import InputError
from gtmodel.problem_files.files import line_of
from gtmodel.problem_files.load import dotted, load

TEXT = b'''title = "# [no table]"  # a comment
a.b = [
  [1, 2],  # [x]
  { c = 3 },
]

text = """
[no.table]
a = 1
"""
[limits]
force_N = 3
[[rows]]
name = "one"
[rows.goal]
x_m = 1
[[rows]]
name = "two"
[rows.goal]
x_m = 2
[[rows.via]]
x_m = 3
[[rows.via]]
x_m = 4
'''  # fmt: skip


@pytest.mark.parametrize(
    ("key", "line"),
    [
        ("title", 1), ("a", 2), ("a.b", 2), ("a.b[0]", 2), ("a.b[1].c", 2), ("text", 7), ("limits", 11),
        ("limits.force_N", 12), ("limits.misspelt", 11), ("rows", 13), ("rows[0].name", 14), ("rows[0].goal.x_m", 16),
        ("rows[1]", 17), ("rows[1].name", 18), ("rows[1].goal.x_m", 20), ("rows[1].via[0].x_m", 22),
        ("rows[1].via[1].x_m", 24), ("rows.1.via.1.x_m", 24), ("nowhere", None), ("", None),
    ],
)  # fmt: skip
def test_the_line_of_a_key(key: str, line: int | None) -> None:
    assert line_of(TEXT, key) == line


def leaves(data: Any, place: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The places of all values that are no table."""
    if not isinstance(data, dict) and not (isinstance(data, list) and data and isinstance(data[0], dict)):
        return [place]
    pairs = data.items() if isinstance(data, dict) else enumerate(data)
    return [leaf for part, value in pairs for leaf in leaves(value, (*place, part))]


@pytest.mark.parametrize("name", ["calibrate_l1", "l1_controller", "fusion_3_axis"])
def test_lines_of_shipped_problems_hold_their_keys(name: str) -> None:
    content = (problems_dir() / f"{name}.toml").read_bytes()
    lines = content.decode().splitlines()
    found = 0
    for place in leaves(tomllib.loads(content.decode())):
        last = next(part for part in reversed(place) if isinstance(part, str))
        if any(isinstance(part, str) and set(part) & set(".[]") for part in place):
            continue  # a key in quotes
        line = line_of(content, dotted(place))
        assert line is not None and last in lines[line - 1], (place, line)
        found += 1
    assert found > 5


def test_a_refusal_says_the_line_unless_the_value_was_set(tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    file.write_text((problems_dir() / "l1_min_time.toml").read_text().replace("force_N", "forse_N"))
    with pytest.raises(InputError) as refused:
        load(file)
    assert refused.value.line is not None and "forse_N" in file.read_text().splitlines()[refused.value.line - 1]
    with pytest.raises(InputError) as refused:
        load("l1_min_time", ["limits.force_N=-1"])
    assert (refused.value.key, refused.value.line) == ("limits.force_N", None)
    with pytest.raises(InputError) as refused:
        load("l1_min_time", ["mesh.elements=-1"])
    assert (refused.value.key, refused.value.line) == ("mesh.elements", None)
