"""`cgen.study`: code that was compared with Python before it is written, on objects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gtmodel import cgen
from gtmodel.cgen import CodeStudy, Verification
from gtmodel.cgen.folder import held
from gtmodel.cgen.verification import against_python
from gtmodel.compiler.causal import CausalFunction
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import call_of, context_of, generate
from gtmodel.results import ArgumentError, SolveStatus, at_most
from tests.support.own_models import FILES

Functions = dict[str, CausalFunction]
FEW = Verification(points=20)


@pytest.fixture(scope="module")
def one(small: Functions) -> Functions:
    return {"slider": small["slider"]}


@pytest.fixture(scope="module")
def verified(one: Functions, tmp_path_factory: pytest.TempPathFactory) -> tuple[CodeStudy, Path]:
    place = tmp_path_factory.mktemp("study") / "code"
    return cgen.study(one, place, name="own", check=FEW, costs=True, box={"phi": [[0.1, 1.0]]}), place


def test_code_that_passed_is_written_with_its_costs(verified: tuple[CodeStudy, Path], one: Functions) -> None:
    s, place = verified
    assert s.status.ok and s.checks and all(c.passed for c in s.checks.values()), s.message
    assert s.folder == str(place) and s.written == sorted(p.name for p in place.iterdir())
    signature = {"inputs": ["phi [rad]", "der(phi) [rad/s]"], "outputs": ["x [m]", "der(x) [m/s]"]}
    assert s.functions == {"gt_own_slider": signature}
    assert s.points == FEW.points and (s.text_bytes or {})["gt_own_slider"] > 0
    assert cgen.check(place, one, points=5).passed
    labels = [row.label for row in s.rows]
    assert labels[:5] == ["folder", "files", "numbers", "gt_own_slider", "gt_own_slider costs"]


def test_without_a_check_the_same_code_is_written_and_nothing_counted(
    verified: tuple[CodeStudy, Path], one: Functions, tmp_path: Path
) -> None:
    s = cgen.study(one, tmp_path / "code", name="own", check=None, box={"phi": [[0.1, 1.0]]})
    assert s.status.ok and list(s.values) == ["folder", "functions", "files", "operations"]
    for path in (tmp_path / "code").iterdir():
        assert path.read_bytes() == (verified[1] / path.name).read_bytes()


@pytest.mark.parametrize("check", [FEW, None])
def test_code_that_fails_is_not_written_unless_marked(
    one: Functions, tmp_path: Path, check: Verification | None
) -> None:
    doubt = {"inputs_not_to_be_used": at_most(1.0, 0.0, "make robot.toml anew")}
    for write_failed in (False, True):
        place = tmp_path / str(write_failed)
        s = cgen.study(one, place, name="own", check=check, also=doubt, write_failed=write_failed)
        assert s.status is SolveStatus.CHECK_FAILED and "make robot.toml anew" in s.message
        assert (place / "manifest.json").exists() == write_failed
    sources = [p for p in place.iterdir() if p.suffix in (".c", ".h")]
    assert sources and all("NOT TO BE USED" in p.read_text().splitlines()[0] for p in sources)


def test_an_earlier_folder_stays_where_the_new_code_fails(
    one: Functions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cgen.study(one, tmp_path / "code", name="own", check=None)
    before = {p.name: p.read_bytes() for p in (tmp_path / "code").iterdir()}
    compare = against_python.check

    def spoilt(folder: Path, functions: Any, **settings: Any) -> Any:
        (folder / "gt_own_body.c").write_text((folder / "gt_own_body.c").read_text() + "/* changed */\n")
        return compare(folder, functions, **settings)

    monkeypatch.setattr(against_python, "check", spoilt)
    s = cgen.study(one, tmp_path / "code", name="own", check=FEW)
    assert s.status is SolveStatus.CHECK_FAILED and "files_changed" in s.message
    assert "the files of an earlier run are kept" in s.message
    assert {p.name: p.read_bytes() for p in (tmp_path / "code").iterdir()} == before


@pytest.mark.parametrize("looks", [0, 1, 2])
def test_stopped_it_writes_nothing_and_says_what_was_done(one: Functions, tmp_path: Path, looks: int) -> None:
    left = looks

    def stop() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    s = cgen.study(one, tmp_path / "code", name="own", check=FEW, costs=True, stop=stop)
    assert s.status is SolveStatus.INTERRUPTED and not (tmp_path / "code").exists()
    done = ("stopped before the code was generated", "but not checked", "but costs were not counted")
    assert done[looks] in s.message


def test_what_a_caller_gave_wrong_is_refused_before_the_folder_is_made(one: Functions, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError) as caught:
        Verification(points=0)
    assert caught.value.argument == "points"
    wrong: list[dict[str, Any]] = [
        {"name": "1x"}, {"real": "half"}, {"box": {"psi": [[0.0, 1.0]]}}, {"along": ["none"]}, {"functions": {}},
        {"folder": __file__},
    ]  # fmt: skip
    for keys in wrong:
        given: dict[str, Any] = {"functions": one, "folder": tmp_path / "code", "name": "own", "check": None} | keys
        with pytest.raises(ArgumentError) as caught:
            cgen.study(**given)
        assert caught.value.argument == next(iter(keys))
        assert not (tmp_path / "code").exists()


def test_a_folder_that_is_held_may_be_given(one: Functions, tmp_path: Path) -> None:
    with held(tmp_path / "code") as mine:
        assert cgen.study(one, mine, name="own", check=None).status.ok
    assert (tmp_path / "code" / "manifest.json").exists()


def test_the_file_of_a_problem_and_the_call_on_objects_give_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    call = call_of("pendulum_code.toml", ["check.points=20"])
    assert call.options["check"] == FEW
    s = call(folder=tmp_path / "called")
    loaded = load("pendulum_code.toml", ["check.points=20"])
    by_file = generate(loaded, context_of(loaded), tmp_path / "generated", verify=True).outcome
    named = {k: v for k, v in s.values.items() if k != "folder"}
    assert named == {k: v for k, v in by_file.values.items() if k != "folder"}
    for path in (tmp_path / "called").iterdir():
        one, other = path.read_text(), (tmp_path / "generated" / path.name).read_text()
        if path.name == "manifest.json":  # the command knows the folder, and names the robot's file from there
            before, *after = one.rpartition('"pendulum.py:')
            one = before + '"../pendulum.py:' + after[1]
        assert one == other
