"""`gtmodel codegen --fmu`: units of a problem file, checked before they are written; the folder is a person's."""

from __future__ import annotations

import json
import sys
import zipfile

import pytest

import gtmodel as gt
from gtmodel.cli import main

PROBLEM = "problems/l1_fmu.toml"
FEW = ["--set", "check.points=20"]


@pytest.fixture
def quick(tmp_path):
    """The forward kinematics alone."""
    path = tmp_path / "one.toml"
    path.write_text(
        'kind = "codegen"\nrobot = "l1_tape"\nname = "one"\n[[functions]]\nname = "fk"\nknown = ["q"]\n'
        'targets = ["T"]\n[check]\npoints = 20\n'
    )
    return path


def test_units_of_both_versions(quick, tmp_path, capsys):
    assert main(["codegen", str(quick), "-o", str(tmp_path / "out"), "--fmu", "both", "--check", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    names = ["one_fk_fmi2.fmu", "one_fk_fmi3.fmu"]
    assert answer["values"]["files"] == names and sorted(p.name for p in (tmp_path / "out").iterdir()) == names
    assert answer["values"]["units"]["one_fk_fmi3.fmu"]["outputs"] == ["T[1] [m]", "T[2] [m]", "T[3] [m]"]
    assert all(c["passed"] for c in answer["checks"].values())
    again = (tmp_path / "out" / names[0]).read_bytes()
    assert main(["codegen", str(quick), "-o", str(tmp_path / "out"), "--fmu", "2", "--quiet"]) == 0
    assert (tmp_path / "out" / names[0]).read_bytes() == again


@pytest.mark.parametrize("word", ["4", "two", ""])
def test_another_version_is_refused(quick, tmp_path, word):
    code = main(["codegen", str(quick), "-o", str(tmp_path / "out"), "--fmu", word, "--quiet"])
    assert code == 2 and not (tmp_path / "out").exists()


def test_a_box_belongs_to_the_functions_that_have_its_inputs(tmp_path):
    robot = gt.robots.gantry_tau("l1_tape")
    functions = {"fk": robot.causal(known="q", targets="T"), "ik": robot.causal(known="T", targets="q")}
    box = {"q": [[-0.9, -0.6]], "T": [[0.2, 0.4], [-1.0, -0.8], [0.2, 0.4]]}
    s = gt.fmu.study(functions, tmp_path, name="l1", box=box, check=None)
    for name, theirs in (("fk", "-0.9"), ("ik", "0.2")):
        with zipfile.ZipFile(tmp_path / f"l1_{name}_fmi3.fmu") as unit:
            assert theirs in unit.read("documentation/index.html").decode()
    assert s.status.ok
    with pytest.raises(gt.results.ArgumentError) as error:
        gt.fmu.study(functions, tmp_path, name="l1", box={"z": [[0.0, 1.0]]}, check=None)
    assert error.value.argument == "box"


def test_a_file_of_somebody_else_is_not_replaced(quick, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "one_fk_fmi3.fmu").write_text("mine")
    (out / "notes.txt").write_text("mine too")
    assert main(["codegen", str(quick), "-o", str(out), "--fmu", "3", "--quiet"]) == 2
    assert (out / "one_fk_fmi3.fmu").read_text() == "mine"
    (out / "one_fk_fmi3.fmu").unlink()
    assert main(["codegen", str(quick), "-o", str(out), "--fmu", "3", "--quiet"]) == 0
    assert (out / "notes.txt").read_text() == "mine too" and zipfile.is_zipfile(out / "one_fk_fmi3.fmu")


def test_what_failed_a_check_is_not_written(tmp_path):
    fk = gt.robots.gantry_tau("l1_tape").causal(known="q", targets="T")
    bad = {"doubt": gt.results.at_most(1.0, 0.0, "measure again")}
    study = gt.fmu.study({"fk": fk}, tmp_path / "out", name="l1", check=None, also=bad)
    assert study.status is gt.SolveStatus.CHECK_FAILED and study.written is None
    assert not list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else True
    study = gt.fmu.study({"fk": fk}, tmp_path / "out", name="l1", check=None, also=bad, write_failed=True)
    assert study.written == ["l1_fk_fmi3.failed.fmu"]


@pytest.mark.parametrize(
    "setting, key",
    [
        ("real=float", "real"),
        ("functions.0.start={q=[1.0]}", "functions[0].start"),
        ("functions.0.start={T=[1.0, 1.0, 1.0]}", "functions[0].start"),
        ("functions.0.tunable=['T']", "functions[0].tunable"),
        ("functions.0.parameters=['m_x']", "functions[0].parameters"),
        ("functions.0.known=['nothing']", "functions[0]"),
        ("functions.0.name=two words", "functions[0].name"),
        ("fmu.step_s=0.05", "fmu.step_s"),
        ("fmu.on_fault=hold", "fmu.on_fault"),
        ("functions=[]", "functions"),
        ("fmu.tolerance=0", "fmu.tolerance"),
    ],
)
def test_what_makes_no_unit_is_refused(quick, tmp_path, capsys, setting, key):
    out = tmp_path / "out"
    if setting.startswith("fmu."):  # of what has states
        states = 'name = "forward"\nknown = ["tau"]\ntargets = ["q"]\nprefer = ["T"]\n'
        quick.write_text(quick.read_text().replace("[check]", f"[[functions]]\n{states}[fmu]\nstop_s = 0.1\n[check]"))
    assert main(["codegen", str(quick), "-o", str(out), "--fmu", "3", "--quiet", "--set", setting]) == 2
    said = capsys.readouterr().err
    assert f"one.toml: {key}: " in said and not out.exists()
    named = key.startswith(("functions[", "fmu.s", "fmu.o"))
    assert ("(function '" in said) == named


def test_without_a_compiler_there_is_a_sentence_and_no_folder(quick, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    assert main(["codegen", str(quick), "-o", str(tmp_path / "out"), "--fmu", "3", "--quiet"]) == 2
    assert "gcc" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_without_fmpy_the_check_says_what_was_left_out(quick, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    assert main(["codegen", str(quick), "-o", str(tmp_path / "out"), "--fmu", "3", "--check", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert any("gtmodel[fmi]" in note for note in answer["values"]["notes"])


@pytest.mark.parametrize("name", ["out", "out/deeper"])
def test_a_file_in_place_of_the_folder_stays(quick, tmp_path, name):
    (tmp_path / "out").write_text("mine")
    assert main(["codegen", str(quick), "-o", str(tmp_path / name), "--fmu", "3", "--quiet"]) == 2
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize(
    "name", ["l1_inverse_fmu", *[pytest.param(n, marks=pytest.mark.proof) for n in ("l1_fmu", "f1_fmu")]]
)
def test_the_shipped_problems(as_delivered, name, tmp_path):
    arguments = ["codegen", f"problems/{name}.toml", "-o", str(tmp_path), "--fmu", "both", "--check", *FEW, "--quiet"]
    assert main(arguments) == 0
    archives = list(tmp_path.glob("*.fmu"))
    assert len(archives) % 2 == 0
    most = 60_000 if name.startswith("l1") else 150_000
    assert all(path.stat().st_size <= most for path in archives), [(p.name, p.stat().st_size) for p in archives]
