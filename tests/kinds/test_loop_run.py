"""`gtmodel loop`: both protocols and all laws against the simulated controllers, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gtmodel.cli import main
from gtmodel.kinds import loop_run
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, generate
from gtmodel.results import SolveStatus, Trajectory, TrajectoryError
from gtmodel.results.folder import holding
from gtmodel.results.marks import marked

SECONDS = 2.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """problems/l1_controller.toml as a generated folder."""
    place = tmp_path_factory.mktemp("generated") / "l1"
    loaded = load("l1_controller.toml")
    generate(loaded, context_of(loaded), place, verify=False)
    return place


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A smooth motion from rest to rest in 0.8 s, as gtmodel solve --out writes its reference."""
    s = np.arange(201) / 200
    by, duration = np.array([0.3, -0.1, 0.15]), 0.8
    place = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * by + [0.0, -0.9, 0.1]
    rate = (30 * s**2 - 60 * s**3 + 30 * s**4)[:, None] * by / duration
    second = (60 * s - 180 * s**2 + 120 * s**3)[:, None] * by / duration**2
    units = {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2"}
    path = tmp_path_factory.mktemp("motion") / "reference.csv"
    Trajectory(0.004 * np.arange(201), {"T": place, "der(T)": rate, "der(T,2)": second}, units).to_csv(path)
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the loop is built, once; every run writes its results there."""
    return tmp_path_factory.mktemp("place") / "loop"


@pytest.mark.parametrize(("peer", "law"), [("egm", "dynamics"), ("rsi", "replay"), ("egm", "path")])
def test_law_tracks_better_than_the_reference_alone(
    folder: Path, motion: Path, place: Path, peer: str, law: str
) -> None:
    finished = loop_run.run(folder, peer, SECONDS, law=law, reference=motion, in_lockstep=True, out=place)
    outcome = finished.outcome
    assert outcome.status.ok, outcome.message
    off, on = outcome.values["runs"]
    assert on["tcp_rms_mm"] < loop_run.GAINS[law] * off["tcp_rms_mm"]
    assert off["tcp_rms_mm"] > 1.0, "there is something to gain"
    assert all(run["late"] == run["lost"] == run["garbage"] == 0 for run in (off, on))
    assert "simulators only" in outcome.message
    written = {path.name for path in place.iterdir()}
    assert {"tracking.png", "loop_on.csv", "loop_off.csv", "gt_loop", "gt_loop_model.c"} <= written
    assert peer == "egm" or "rsi_configuration.xml" in written
    log = Trajectory.from_csv(place / "loop_on.csv")
    assert len(log) == SECONDS / 0.004 and log["state"][-1] == 1


def test_command_prints_one_object(folder: Path, motion: Path, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["loop", str(folder), "--peer", "rsi", "--seconds", "0.2", "--reference", str(motion), "--lockstep"]
    code = main([*words, "--out", str(place), "--json"])
    printed = json.loads(capsys.readouterr().out)
    # 0.2 s are rest only: nothing to gain, so that the command says it was not better
    assert (code, printed["status"], printed["kind"]) == (1, "check_failed", "loop")
    assert "rms_error_ratio" in printed["message"] and printed["values"]["cycles"] == 50


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"peer": "abb"}, "--peer abb: expected egm or rsi"),
        ({"seconds": 0.0}, "--seconds 0: expected a time above 0"),
        ({"seconds": float("nan")}, "--seconds nan: expected a time above 0"),
        ({"elastic_Hz": 0.0}, "--elastic 0: expected a frequency from 0.5 to 1000 Hz"),
        ({"elastic_Hz": float("nan")}, "--elastic nan: expected a frequency"),
        ({"law": "guess"}, "--law guess: expected trajectory, dynamics, replay, path"),
        ({"reference": Path("none.csv")}, "--reference none.csv: there is no such file"),
        ({"folder": Path("nothing")}, "holds no manifest.json"),
        ({"out": Path(__file__).parent}, "holds files that gtmodel did not write"),
        ({"out": Path(__file__)}, "is a file; name a folder"),
        ({"out": Path("/proc/loop")}, "--out /proc/loop cannot be written: No such file or directory"),
    ],
)
def test_wrong_input_is_one_sentence(folder: Path, motion: Path, place: Path, keys: dict, sentence: str) -> None:
    given = {"folder": folder, "peer": "egm", "seconds": 1.0, "reference": motion, "out": place} | keys
    with pytest.raises(InputError) as caught:
        loop_run.run(given.pop("folder"), given.pop("peer"), given.pop("seconds"), in_lockstep=True, **given)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_reference_of_another_step_is_refused(folder: Path, motion: Path, place: Path, tmp_path: Path) -> None:
    slow = Trajectory.from_csv(motion)
    names = ("T", "der(T)", "der(T,2)")
    path = tmp_path / "slow.csv"
    Trajectory(2 * slow.time, {n: slow[n] for n in names}, {n: slow.unit(n) for n in names}).to_csv(path)
    with pytest.raises(InputError, match=r"a row every 0\.004 s"):
        loop_run.run(folder, "egm", 1.0, reference=path, in_lockstep=True, out=place, context=Context())


def test_an_arm_on_springs_is_off_where_its_motors_are_not(folder: Path, motion: Path, place: Path) -> None:
    finished = loop_run.run(
        folder, "egm", SECONDS, reference=motion, in_lockstep=True, elastic_Hz=12.0, out=place
    )  # fmt: skip
    off, on = finished.outcome.values["runs"]
    assert finished.outcome.status.ok and finished.outcome.values["elastic_Hz"] == 12.0
    assert on["cart_largest_mm"] < 1e-3 < 0.1 < on["tcp_largest_mm"] < off["tcp_largest_mm"]


def test_a_loop_that_stopped_says_why(folder: Path, motion: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_run, "STEP_LIMIT_M", 1e-6)
    finished = loop_run.run(folder, "rsi", 0.8, reference=motion, in_lockstep=True, out=place)
    message = finished.outcome.message
    assert finished.outcome.status is SolveStatus.CHECK_FAILED and "off_running_at_the_end" in message
    assert "the reference alone: stopped, the input lies outside the range where a solution exists" in message


@pytest.mark.parametrize("in_lockstep", [True, False])
def test_interrupted_run_says_so(folder: Path, motion: Path, place: Path, in_lockstep: bool) -> None:
    job = Context()
    job.request_stop()
    finished = loop_run.run(folder, "egm", 60.0, reference=motion, in_lockstep=in_lockstep, out=place, context=job)
    assert finished.outcome.status is SolveStatus.INTERRUPTED and not finished.files


def _content(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir()}


def test_the_folder_is_held_and_written_whole_or_not_at_all(folder: Path, motion: Path, place: Path) -> None:
    """Two runs do not mix, a run that breaks off or stops leaves what was there, and nobody's files are taken."""
    keys = {"reference": motion, "in_lockstep": True, "out": place}
    loop_run.run(folder, "egm", 0.2, **keys)
    before = _content(place)
    assert (place / "gt_loop").stat().st_mode & 0o122 == 0o100
    with holding(place), pytest.raises(InputError, match="is in use by another run"):
        loop_run.run(folder, "rsi", 0.2, **keys)
    job = Context()
    job.request_stop()
    loop_run.run(folder, "rsi", 0.2, **keys, context=job)
    with pytest.raises(TrajectoryError):
        loop_run.run(folder, "rsi", 0.2, **(keys | {"reference": folder / "manifest.json"}))
    assert _content(place) == before
    (place / "rsi_configuration.xml").write_text("a person's own")
    finished = loop_run.run(folder, "rsi", 0.2, **keys)
    assert "rsi_configuration.xml was not written by gtmodel" in finished.unwritten
    (place / "rsi_configuration.xml").unlink()
    assert _content(place) == before
    (place / "reference.table").write_bytes(b"changed")
    with pytest.raises(InputError, match=r"reference\.table was changed"):
        loop_run.run(folder, "rsi", 0.2, **keys)
    (place / "reference.table").write_bytes(before["reference.table"])


def test_what_is_marked_is_not_taken_without_a_word(folder: Path, motion: Path, place: Path, tmp_path: Path) -> None:
    said: list[str] = []
    path = tmp_path / "reference.csv"
    path.write_bytes(marked("reference.csv", motion.read_bytes(), "a check failed"))
    loop_run.run(folder, "egm", 0.2, reference=path, in_lockstep=True, out=place, context=Context(notice=said.append))
    assert len(said) == 1 and "reference.csv" in said[0]


def test_a_folder_made_for_nothing_goes_again(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError):
        loop_run.run(folder, "egm", 1.0, reference=folder / "manifest.json", in_lockstep=True, out=tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())
