"""`gtmodel loop` with a unit as its plant: the problem's table, its file or --plant, and what is refused."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gtmodel.cli import main
from gtmodel.compiler.toolchain import find
from tests.loop import units
from tests.loop.smooth import smooth
from tests.support.wild_units import COMMANDS, POSITIONS, How, starts, wild

pytest.importorskip("fmpy")
if isinstance(find(), str):
    pytest.skip("no C compiler: no unit", allow_module_level=True)

PROBLEM = "l1_loop_fmu.toml"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unit, a motion, and problems/l1_loop_fmu.toml as a generated folder, which names no file."""
    place = tmp_path_factory.mktemp("unit")
    (place / "robot.fmu").write_bytes(units.rigid().data)
    smooth().to_csv(place / "motion.csv")
    assert main(["codegen", PROBLEM, "-o", str(place / "code"), "--json"]) == 0
    return place


def _loop(place: Path, folder: str, *words: str) -> int:
    given = ["--law", "dynamics", "--peer", "egm", "--seconds", "0.8", "--lockstep", "--json"]
    return main(["loop", str(place / folder), "--reference", str(place / "motion.csv"), *given, *words])


def test_the_unit_of_the_option_and_that_of_the_file_do_the_same(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unit = str(place / "robot.fmu")
    capsys.readouterr()
    assert _loop(place, "code", "--plant", unit, "--out", str(place / "out")) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["values"]["plant"] == "unit 'rigid' (FMI 3.0) under a servo"
    assert printed["values"]["plant_stopped_s"] is None
    log = (place / "out" / "loop_on.csv").read_bytes()
    assert (place / "out" / "tracking.png").is_file()

    assert main(["codegen", PROBLEM, "-o", str(place / "named"), "--set", f'plant.file="{unit}"', "--json"]) == 0
    manifest = json.loads((place / "named" / "manifest.json").read_text())
    assert manifest["problem"]["plant"]["file"] == "../robot.fmu", "from the folder in which the manifest is"
    moved = place / "elsewhere"
    moved.mkdir()
    shutil.copytree(place / "named", moved / "named")
    shutil.copy(unit, moved / "robot.fmu")
    shutil.copy(place / "motion.csv", moved / "motion.csv")
    assert _loop(moved, "named", "--out", str(place / "out")) == 0
    assert (place / "out" / "loop_on.csv").read_bytes() == log
    (moved / "robot.fmu").unlink()
    capsys.readouterr()
    assert _loop(moved, "named") == 2
    assert "name it with --plant" in json.loads(capsys.readouterr().out)["message"]


@pytest.mark.parametrize(
    ("settings", "words", "sentence"),
    [
        ([], [], "--plant is missing"),
        ([], ["--plant", "none.fmu"], "--plant none.fmu: there is no such file"),
        (['plant.position=["q[1]", "q[2]", "q_3"]'], ["--plant", "robot.fmu"], "plant.position"),
        (['plant.units={position="mm"}'], ["--plant", "robot.fmu"], "plant.units"),
        (None, ["--plant", "robot.fmu"], "no table [plant]"),
        (None, ["--plant-timeout", "5"], "--plant-timeout 5.0: the folder's problem has no table [plant]"),
        ([], ["--plant", "robot.fmu", "--plant-timeout", "-1"], "--plant-timeout "),
    ],
)
def test_what_is_wrong_is_said_by_its_key(
    place: Path, settings: list[str] | None, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(place)
    folder = "code"
    if settings or settings is None:
        folder = str(tmp_path / "code")
        words_of = [w for s in settings or () for w in ("--set", s)]
        problem = PROBLEM if settings else "l1_controller.toml"
        assert main(["codegen", problem, "-o", folder, *words_of, "--json"]) == 0
    capsys.readouterr()
    assert _loop(place, folder, *words, "--out", str(tmp_path / "out")) == 2
    message = json.loads(capsys.readouterr().out)["message"]
    assert sentence in message and "\n" not in message


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ('plant.file="no.fmu"', "plant.file"),
        ("plant.force=[]", "plant.command"),
        ("plant.steps=0", "plant.steps"),
        ("plant.stifness=1.0", "stiffness"),
    ],
)
def test_what_is_wrong_without_the_unit_is_refused_where_the_code_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], setting: str, key: str
) -> None:
    assert main(["codegen", PROBLEM, "-o", str(tmp_path / "code"), "--set", setting, "--json"]) == 2
    message = json.loads(capsys.readouterr().out)["message"]
    assert key in message and not (tmp_path / "code").exists()


@pytest.fixture(scope="module")
def wild_folder(place: Path) -> Path:
    """The generated folder, whose plant is a unit of another maker that misbehaves in its 0.1 s; all is synthetic."""
    (place / "wild.fmu").write_bytes(wild(3))
    shutil.copytree(place / "code", place / "wild")
    return place / "wild"


def _behaves(folder: Path, how: How) -> list[str]:
    """The words of a command that has the unit of the folder behave so."""
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["problem"]["plant"] = {
        "position": POSITIONS, "command": COMMANDS, "start": starts(how, when=0.1, carts=units.start()),
    }  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return ["--plant", str(folder.parent / "wild.fmu"), "--law", "trajectory", "--plant-timeout", "20"]


@pytest.mark.parametrize("how", [How.EXITS, How.PRINTS])
def test_a_unit_that_ends_or_prints_leaves_an_answer(
    place: Path, wild_folder: Path, how: How, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """exit(0) in a unit ended the command with code 0 and without a word; what it prints is no part of the JSON."""
    words = _behaves(wild_folder, how)
    capfd.readouterr()
    code = _loop(place, "wild", *words, "--out", str(tmp_path / "out"))
    printed = capfd.readouterr()
    said = json.loads(printed.out)
    assert code == 1 and (tmp_path / "out" / "loop_off.csv").is_file()
    if how is How.EXITS:
        assert said["status"] == "failed" and said["values"]["plant_stopped_s"] == pytest.approx(0.1)
        assert "ended its process in fmi3DoStep, with exit code 0" in said["message"]
    else:
        assert said["values"]["plant_stopped_s"] is None and "no JSON" in printed.err


def test_a_stop_reaches_a_loop_whose_unit_hangs(place: Path, wild_folder: Path, tmp_path: Path) -> None:
    words = ["loop", str(wild_folder), "--reference", str(place / "motion.csv"), *_behaves(wild_folder, How.HANGS)]
    more = ["--peer", "egm", "--seconds", "0.8", "--lockstep", "--json", "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        [sys.executable, "-m", "gtmodel", *words, *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as command:
        deadline = time.monotonic() + 60.0
        while not (hanging := _in_its_step(command.pid)) and command.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.2)  # 25 steps of the unit take less
        command.send_signal(signal.SIGTERM)
        out, err = command.communicate(timeout=15.0)  # shorter than the limit of a call
    assert json.loads(out)["status"] == "interrupted", err
    assert hanging and not any(os.path.exists(f"/proc/{n}") for n in hanging)


def _in_its_step(parent: int) -> list[int]:
    """Units of that process that make a step."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.with_name("cmdline").read_bytes().split(b"\0")
            if stat.read_text().rsplit(")")[-1].split()[1] == str(parent) and any(
                w.endswith(b"caller.py") for w in words
            ):
                found += [int(stat.parent.name)] if b"DoStep" in Path(words[-2].decode()).read_bytes() else []
        except OSError:
            continue
    return found
