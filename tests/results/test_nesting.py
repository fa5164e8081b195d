"""JSON and TOML that go deep: one bound, before anything is slow or raises RecursionError."""

from __future__ import annotations

import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.results.read_bounds import MOST_NESTED, TooDeepError, json_of, toml_of

N = MOST_NESTED


def dotted(parts: int) -> str:
    return ".".join(["a"] * parts) + " = 1"


TEXTS = {
    "lists": lambda n: f"a = {'[' * n}{']' * n}",
    "inline tables": lambda n: f"a = {'{a = ' * n}1{'}' * n}",
    "a dotted key": lambda n: dotted(n + 1),
    "a quoted key": lambda n: dotted(n + 1).replace("a.", '"a#" . '),
    "a header": lambda n: f"[{dotted(n)[:-4]}]",
    "a key behind texts": lambda n: f"b = '''\n\" '''\nc = \"\\\"\" # '\n{dotted(n + 1)}",
}


@pytest.mark.parametrize("text", TEXTS)
def test_toml_goes_as_deep_as_the_bound_and_no_deeper(text: str) -> None:
    written = TEXTS[text](N - 1)
    assert toml_of(written) == tomllib.loads(written)
    for depth in (N + 1, 3 * N, 90_000):
        with pytest.raises(TooDeepError):
            toml_of(TEXTS[text](depth))


def test_dots_in_texts_and_comments_are_no_key() -> None:
    dots = "a." * 1000
    text = f"# {dots}\na = \"{dots}\"\nb = '{dots}'\nc = \"\"\"\n{dots}\n\"\"\"\nd = '''\n{dots}'''\n"
    assert toml_of(text)["d"] == dots


@pytest.mark.parametrize(
    "text", ['a = "' + '\\"' * 200_000, '"""' + "a." * 200_000, "a." * 99 + "\n" + "b" * 400_000 + "." * 100]
)
def test_a_text_that_is_no_toml_is_looked_through_once(text: str) -> None:
    began = time.process_time()
    json_of("[" + "1," * 200_000 + "1]")
    once = time.process_time() - began
    began = time.process_time()
    with pytest.raises(ValueError):
        toml_of(text)
    assert time.process_time() - began < 200 * max(once, 0.01)  # a square of the length would take minutes


def test_json_goes_as_deep_as_the_bound_and_no_deeper() -> None:
    assert json_of("[" * N + "]" * N)
    for depth in (N + 1, 5 * N, 100_000):
        with pytest.raises(TooDeepError):
            json_of("[" * depth + "]" * depth)


@pytest.mark.parametrize("depth", [150, 300, 900, 90_000])
@pytest.mark.parametrize("how", ["file", "key", "value", "value of dots"])
def test_a_deep_problem_is_refused_as_what_it_is(tmp_path: Path, depth: int, how: str) -> None:
    path, head = tmp_path / "x.toml", 'kind = "friction"\n'
    path.write_text(head + (dotted(depth) if how == "file" else ""))
    settings = {
        "key": [dotted(depth)], "value": [f"a={'[' * depth}{']' * depth}"], "value of dots": [f"a={{{dotted(depth)}}}"]
    }  # fmt: skip
    with pytest.raises(InputError, match=f"more than {N} deep") as caught:
        load(path, settings.get(how, []))
    assert "JSON" not in str(caught.value)


def test_a_provenance_is_as_deep_as_can_be_read_again(tmp_path: Path) -> None:
    deep: list[object] = []
    for _ in range(2 * N):
        deep = [deep]
    with pytest.raises(gt.results.TrajectoryError, match="deep"):
        gt.Trajectory([0, 1], {"x": np.zeros(2)}, {"x": "m"}, provenance={"of": deep})
    path = tmp_path / "t.csv"
    path.write_text(f"# provenance: {'[' * 100_000}\ntime [s],x [m]\n0,1\n1,2\n")
    with pytest.raises(gt.results.TrajectoryError, match="provenance"):
        gt.Trajectory.from_csv(path)
