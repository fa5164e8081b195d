"""A result.json that is none, whatever stands in it, is refused in a sentence, by `read` and by ``--start``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import gtmodel as gt
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import earlier_result as start_of
from gtmodel.results import ArgumentError, Study, at_most, read

DEEP = "[" * 100_000 + "]" * 100_000
# where a value stands, and one of another kind
SPOILT: list[tuple[tuple[str, ...], Any]] = [
    (("checks", "end", "value"), "small"), (("checks", "end", "bound"), "large"), (("checks", "end", "passed"), "yes"),
    (("checks", "end"), 3), (("checks",), [1]), (("message",), 7), (("objective",), "least"), (("iterations",), True),
    (("checks", "end", "bound"), 10**400), (("objective",), 10**400),
    (("iterations",), 2.5), (("values", "x"), json.loads("[" * 500 + "]" * 500)),
    (("values",), [1, 2]), (("values", "notes"), "a text"), (("values", "notes"), [1]), (("status",), ["solved"]),
    (("trajectory",), "none"), (("trajectory",), {"time_s": [0, 1], "values": {"x": ["a", "b"]}, "units": {"x": "m"}}),
]  # fmt: skip


@pytest.fixture
def written(tmp_path: Path) -> Path:
    Study(status=gt.SolveStatus.SOLVED, checks={"end": at_most(0.5, 1.0)}).write(tmp_path / "out")
    return tmp_path / "out" / "result.json"


@pytest.mark.parametrize(("path", "value"), SPOILT, ids=lambda x: str(x)[:30])
def test_a_value_of_another_kind_is_no_result(written: Path, path: tuple[str, ...], value: Any) -> None:
    data = json.loads(written.read_bytes())
    inner = data
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value
    written.write_text(json.dumps(data))
    with pytest.raises(ArgumentError) as caught:
        str(read(written))
    assert caught.value.argument == "folder"


@pytest.mark.parametrize("text", [DEEP, '{"kind": "trajectory", "checks": ' + DEEP + "}", "[1]", "3", "null", "\x00"])
def test_what_is_no_object_is_refused_by_both_doors(written: Path, text: str) -> None:
    written.write_text(text)
    with pytest.raises(ArgumentError):
        read(written)
    with pytest.raises(InputError, match="--start"):
        start_of(written, "trajectory")


READERS: dict[str, Callable[[Any], object]] = {
    "read": read, "load": gt.load, "csv": gt.Trajectory.from_csv, "npz": gt.Trajectory.from_npz,
    "inspect": gt.measurements.inspect, "log": lambda x: gt.measurements.read_log(x, {}),
    "recording": lambda x: gt.measurements.read_recording([x], {}), "urdf": gt.robots.from_urdf,
    "points": gt.motion.read_points, "bundle": gt.vision.read_bal, "modelica": gt.modelica.listing,
}  # fmt: skip


@pytest.mark.parametrize("what", READERS)
def test_no_path_is_a_sentence_to_every_reader(what: str) -> None:
    for none in (3, None, 2.5):
        with pytest.raises(ArgumentError, match="expected text or os.PathLike; found " + str(none)):
            READERS[what](none)
