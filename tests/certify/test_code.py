"""Certificates in folders of C: the independent checker accepts what was proved and refuses what was tampered with."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import gtmodel as gt
from gtmodel import cgen
from gtmodel._files import codegen_dir
from gtmodel.certify.code import CHECKER, FILE, IN_WORDS, statements
from gtmodel.cgen.manifest import read
from gtmodel.results import Work

BOX = {"T": [[0.0, 0.8], [-1.1, -0.7], [0.05, 0.55]], "q": [[-1.2, -1.0], [-1.3, -1.1], [-1.25, -1.05]]}
BODY, MANIFEST = "gt_l1_body.c", "manifest.json"


@pytest.fixture(scope="module")
def checker() -> ModuleType:
    pytest.importorskip("flint", reason="python-flint checks the certificates; pip install 'gtmodel[certify]'")
    spec = importlib.util.spec_from_file_location("check_certificate", codegen_dir() / "verify" / CHECKER)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = gt.robots.gantry_tau("l1_tape")
    functions = {"ik": robot.causal(known="T", targets="q"), "fk": robot.causal(known="q", targets="T")}
    proved = statements(functions, BOX, "l1", "double", Work())
    assert all(c.passed for c in proved.checks.values()) and not proved.left_out
    place = tmp_path_factory.mktemp("code") / "l1"
    cgen.generate(functions, place, name="l1", box=BOX, beside=proved.beside)
    return place


def test_the_folder_holds_certificate_and_checker(folder):
    content = read(folder)
    assert content is not None and {FILE, CHECKER, IN_WORDS} <= set(content["files"])
    assert "`gt_l1_ik` returns GT_OK" in (folder / IN_WORDS).read_text()
    certificate = json.loads((folder / FILE).read_text())
    assert certificate["functions"]["gt_l1_ik"]["errors"][0] < 1e-14
    assert len((codegen_dir() / "verify" / CHECKER).read_text().splitlines()) <= 300


def test_the_checker_accepts_what_was_proved(checker, folder, capsys):
    checker.main(folder)
    assert "gt_l1_ik: proved in 1 boxes" in capsys.readouterr().out


def changed(file: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    """Change a text, or the content of a JSON file."""

    def tamper(folder: Path) -> None:
        path = folder / file
        text = path.read_text()
        new = json.dumps(change(json.loads(text))) if file.endswith(".json") else change(text)
        assert new != text
        path.write_text(new)

    return tamper


def of(path: str, change: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Change one entry of nested JSON, by its keys."""

    def apply(data: Any) -> Any:
        *inner, last = [int(k) if k.isdigit() else k for k in path.split("/")]
        at = data
        for key in inner:
            at = at[key]
        at[last] = change(at[last])
        return data

    return apply


IK = "functions/gt_l1_ik"
FK = "functions/gt_l1_fk"
TAMPERED: dict[str, Callable[[Path], None]] = {
    "a link is shorter": changed(BODY, lambda t: _in_body(t, "ik", r"=4\.2024999999999997e\+00;", "=1e-01;")),
    "a square is missing": changed(BODY, lambda t: _in_body(t, "ik", r"=casadi_sq\((\w+)\);", r"=\1;")),
    "a root is a sine": changed(BODY, lambda t: _in_body(t, "ik", r"=sqrt\(", "=sinh(")),
    "a subtraction is an addition": changed(BODY, lambda t: _in_body(t, "fk", r"=\((\w+)-(\w+)\);", r"=(\1+\2);")),
    "a square is a cube": changed(BODY, lambda t: t.replace("return x*x;", "return x*x*x;")),
    "a root is another function": changed(BODY, lambda t: t.replace("#include <math.h>", "#define sqrt sin")),
    "the arithmetic of the manifest is another": changed(MANIFEST, of("real", lambda r: "float")),
    "an error bound is too small": changed(FILE, of(f"{IK}/errors/1", lambda e: e / 50)),
    "a range is too narrow": changed(FILE, of(f"{FK}/ranges/0", lambda r: [0.9 * r[0] + 0.1 * r[1], 0.5 * sum(r)])),
    "a box is left out": changed(FILE, of(f"{FK}/boxes", lambda b: b[1:])),
    "a box is shorter": changed(FILE, of(f"{IK}/boxes/0/1/0", lambda x: x - 1e-3)),
    "the box of the manifest reaches further": changed(MANIFEST, of("functions/0/box/T/2/1", lambda x: x + 2.0)),
    "a pivot must be larger": changed(MANIFEST, of("functions/1/margins/1/scale", lambda s: 1e10 * s)),
    "the manifest lacks a margin": changed(MANIFEST, of("functions/0/margins", lambda m: m[:-1])),
    "an input must be smaller": changed(MANIFEST, of("functions/0/limits/T", lambda s: 0.1)),
    "an output has no bound": changed(FILE, of(f"{IK}/errors", lambda e: e[1:])),
    "nothing is stated": changed(FILE, of("functions", lambda f: {})),
}  # fmt: skip


def _in_body(text: str, function: str, pattern: str, new: str) -> str:
    """Change the first place in a body."""
    head, begin, rest = text.partition(f"/* gt_l1_{function}_body:(")
    return head + begin + re.sub(pattern, new, rest, count=1)


@pytest.mark.parametrize("what", TAMPERED)
def test_the_checker_refuses_tampered_files(checker, folder, tmp_path, what, monkeypatch):
    """Also if all hashes are those of the tampered files."""
    monkeypatch.setattr(checker, "MOST", 2000)
    copy = tmp_path / "l1"
    shutil.copytree(folder, copy)
    TAMPERED[what](copy)
    if "manifest" not in what and "must be" not in what:
        with pytest.raises(checker.Refused, match=r"was changed since|not one of this"):
            checker.main(copy)
    _sign(copy)
    with pytest.raises(checker.Refused):
        checker.main(copy)


def _sign(folder: Path) -> None:
    """Write the hashes of the files as they are."""
    certificate = json.loads((folder / FILE).read_text())
    certificate["body_sha256"] = hashlib.sha256((folder / BODY).read_bytes()).hexdigest()
    (folder / FILE).write_text(json.dumps(certificate))
    manifest = json.loads((folder / MANIFEST).read_text())
    for file in manifest["files"]:
        manifest["files"][file] = hashlib.sha256((folder / file).read_bytes()).hexdigest()
    (folder / MANIFEST).write_text(json.dumps(manifest))


def test_what_is_not_proved_is_a_failed_check_or_left_out_with_the_reason():
    robot = gt.robots.gantry_tau("l1_tape")
    six = gt.robots.six_link_gantry_tau("d1_six_link")
    functions = {"ik": robot.causal(known="T", targets="q"), "six": six.causal(known="T", targets="q"),
                 "tau": robot.causal(known="T", targets="tau")}  # fmt: skip
    made = statements(functions, {"T": [[0.0, 0.1], [-1.0, -0.9], [0.1, 6.0]]}, "l1", "double", Work())
    assert not made.checks["certified_ik"].passed and not made.functions
    assert "Newton" in made.left_out["six"] and "box" in made.left_out["tau"]
