"""`gtmodel loop` with a unit as its plant: the problem's table, its file or --plant, and what is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from gtmodel.cli import main
from gtmodel.compiler.toolchain import find
from tests.loop import units
from tests.loop.smooth import smooth

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
    assert "give it by --plant" in json.loads(capsys.readouterr().out)["message"]


@pytest.mark.parametrize(
    ("settings", "words", "sentence"),
    [
        ([], [], "--plant is missing"),
        ([], ["--plant", "none.fmu"], "--plant none.fmu: there is no such file"),
        (['plant.position=["q[1]", "q[2]", "q_3"]'], ["--plant", "robot.fmu"], "plant.position "),
        (['plant.units={position="mm"}'], ["--plant", "robot.fmu"], "plant.units "),
        (None, ["--plant", "robot.fmu"], "no table [plant]"),
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
