"""`gtmodel loop`: from a generated folder's manifest to the study, and the folder that is written whole."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gtmodel import _loop_command
from gtmodel.cli import main
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import Finished, context_of, generate
from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.results.disk import marked
from gtmodel.results.folder import holding
from tests.loop.smooth import smooth


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """problems/l1_controller.toml as a generated folder."""
    place = tmp_path_factory.mktemp("generated") / "l1"
    loaded = load("l1_controller.toml")
    generate(loaded, context_of(loaded), place, verify=False)
    return place


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("motion") / "reference.csv"
    smooth().to_csv(path)
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the loop is built, once; every run writes its results there."""
    return tmp_path_factory.mktemp("place") / "loop"


def run(folder: Path, place: Path, motion: Path, peer: str = "rsi", job: Context | None = None) -> Finished:
    """A run of rest only."""
    return _loop_command.run(
        folder, place, job or Context(), reference=motion, peer=peer, seconds=0.2, law="trajectory", in_lockstep=True
    )


def test_command_prints_one_object(folder: Path, motion: Path, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["loop", str(folder), "--peer", "rsi", "--seconds", "0.2", "--reference", str(motion), "--lockstep"]
    code = main([*words, "--out", str(place), "--json"])
    printed = json.loads(capsys.readouterr().out)
    # 0.2 s are rest only: nothing to gain, so that the command says it was not better
    assert (code, printed["status"], printed["kind"]) == (1, "check_failed", "loop")
    assert "rms_error_ratio" in printed["message"] and printed["values"]["cycles"] == 50
    written = {path.name for path in place.iterdir()}
    assert {"tracking.png", "loop_on.csv", "loop_off.csv", "gt_loop", "gt_loop_model.c", "loop.json"} <= written
    assert "rsi_configuration.xml" in written


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--peer", "abb"], "--peer expected one of egm, rsi; found 'abb'"),
        (["--seconds", "0"], "--seconds must be more than 0 and at most 3600; found 0"),
        (["--elastic", "nan"], "--elastic expected finite numbers; found nan"),
        (
            ["--law", "guess"],
            "--law expected one of trajectory, dynamics, replay, path, lead_through, predictive; found 'guess'",
        ),
        (["--reference", "none.csv"], "--reference none.csv: there is no such file"),
        (["--out", str(Path(__file__).parent)], "contains files that gtmodel did not write"),
        (["--out", __file__], "is a file; name a folder"),
        (["--out", "/proc/loop"], "--out /proc/loop cannot be written: No such file or directory"),
    ],
)
def test_a_wrong_option_is_one_sentence(
    folder: Path, motion: Path, place: Path, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = {"--peer": "egm", "--seconds": "1", "--reference": str(motion), "--out": str(place)}
    given |= dict(zip(words[::2], words[1::2], strict=True))
    assert main(["loop", str(folder), *(word for pair in given.items() for word in pair), "--lockstep"]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(sentence.partition(" ")[0]) == sentence.startswith("--") and sentence in said


@pytest.mark.parametrize(("option", "value"), [("peer", "abb"), ("seconds", 0.0), ("elastic", float("nan"))])
def test_options_are_refused_before_any_folder(motion: Path, tmp_path: Path, option: str, value: object) -> None:
    asked = {"peer": "egm", "seconds": 1.0, "law": "trajectory", "in_lockstep": True} | {option: value}
    with pytest.raises(InputError, match=f"^--{option} "):
        _loop_command.run(Path("nothing"), tmp_path / "out", Context(), reference=motion, **asked)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_not_generated_is_refused(motion: Path, place: Path) -> None:
    with pytest.raises(InputError, match=r"holds no manifest\.json"):
        run(Path("nothing"), place, motion)


def test_an_error_about_the_plant_names_the_key_of_the_file(
    folder: Path, motion: Path, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*arguments: object, **options: object) -> None:
        raise ArgumentError("another one", "plant.stiffness")

    monkeypatch.setattr(_loop_command, "study", refused)
    with pytest.raises(InputError, match=r"^plant\.stiffness_N_m: another one"):
        run(folder, place, motion)


def test_an_interrupted_run_writes_nothing(folder: Path, motion: Path, place: Path) -> None:
    job = Context()
    job.request_stop()
    finished = run(folder, place, motion, job=job)
    assert finished.outcome.status is SolveStatus.INTERRUPTED and not finished.files


def _content(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir()}


def test_the_folder_is_held_and_written_whole_or_not_at_all(folder: Path, motion: Path, place: Path) -> None:
    """Two runs do not mix, a run that breaks off or stops leaves what was there, and nobody's files are taken."""
    run(folder, place, motion, "egm")
    before = _content(place)
    assert (place / "gt_loop").stat().st_mode & 0o122 == 0o100
    with holding(place), pytest.raises(InputError, match="is in use by another run"):
        run(folder, place, motion)
    job = Context()
    job.request_stop()
    run(folder, place, motion, job=job)
    with pytest.raises(InputError, match="has no unit"):
        run(folder, place, folder / "manifest.json")
    assert _content(place) == before
    (place / "rsi_configuration.xml").write_text("a person's own")
    finished = run(folder, place, motion)
    assert "rsi_configuration.xml was not written by gtmodel" in finished.unwritten
    (place / "rsi_configuration.xml").unlink()
    assert _content(place) == before
    (place / "reference.table").write_bytes(b"changed")
    with pytest.raises(InputError, match=r"reference\.table was changed"):
        run(folder, place, motion)
    (place / "reference.table").write_bytes(before["reference.table"])


def test_what_is_marked_is_not_taken_without_a_word(folder: Path, motion: Path, place: Path, tmp_path: Path) -> None:
    said: list[str] = []
    path = tmp_path / "reference.csv"
    path.write_bytes(marked("reference.csv", motion.read_bytes(), "a check failed"))
    finished = run(folder, place, path, "egm", Context(notice=said.append))
    assert len(said) == 1 and "reference.csv" in said[0]
    assert finished.outcome.values["notes"] == said


def test_a_folder_made_for_nothing_goes_again(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no unit"):
        run(folder, tmp_path / "a" / "b", folder / "manifest.json")
    assert not list(tmp_path.iterdir())
