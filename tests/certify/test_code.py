"""Certificates in folders of C: the independent checker accepts what was proved and refuses what was tampered with."""

from __future__ import annotations

import hashlib
import importlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import cgen
from gtmodel._files import codegen_dir
from gtmodel.certify import InputSpeed
from gtmodel.certify.code import CHECKER, FILE, PARTS, statements
from gtmodel.certify.newton_form import _shrinking
from gtmodel.cgen.manifest import read
from gtmodel.results import Work
from problems.models import mechanisms

BOX = {"T": [[0.0, 0.8], [-1.1, -0.7], [0.05, 0.55]], "q": [[-1.2, -1.0], [-1.3, -1.1], [-1.25, -1.05]]}
BODY, ROUND, MANIFEST = "gt_l1_body.c", "gt_l1.c", "manifest.json"


MIDDLE = (-1.46, -4.49, 0.02)  # m, of the box of problems/d1_controller.toml
SIX = {"T": [[c - 0.05, c + 0.05] for c in MIDDLE]}


@pytest.fixture(scope="module")
def checker() -> Iterator[ModuleType]:
    pytest.importorskip("flint", reason="python-flint checks the certificates; pip install 'gtmodel[certify]'")
    place, names = str(codegen_dir() / "verify"), [Path(f).stem for f in (CHECKER, *PARTS)]
    sys.path.insert(0, place)
    yield importlib.import_module("check_certificate")
    sys.path.remove(place)
    for name in names:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = gt.robots.gantry_tau("l1_tape")
    functions = {"ik": robot.causal(known="T", targets="q"), "fk": robot.causal(known="q", targets="T")}
    proved = statements(functions, BOX, "l1", "double", Work(), regular=["ik"])
    assert all(c.passed for c in proved.checks.values()) and not proved.left_out
    place = tmp_path_factory.mktemp("code") / "l1"
    cgen.generate(functions, place, name="l1", box=BOX, beside=proved.beside)
    return place


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with Newton's method, while the tool centre point moves by up to 1 m/s."""
    functions = {"ik": gt.robots.six_link_gantry_tau("d1_six_link").causal(known="T", targets="q")}
    moving = InputSpeed(speed={"T": 1.0}, period=0.004)
    proved = statements(functions, SIX, "d1", "double", Work(), moving, ["ik"])
    assert all(c.passed for c in proved.checks.values()) and not proved.left_out
    place = tmp_path_factory.mktemp("code") / "d1"
    cgen.generate(functions, place, name="d1", box=SIX, beside=proved.beside)
    return place


def test_the_folder_holds_certificate_and_checker(folder, six):
    content = read(folder)
    assert content is not None and {FILE, CHECKER, *PARTS} <= set(content["files"])
    proved = content["certificate"]["proved"]["gt_l1_ik"]
    assert proved["errors"][0] < 1e-14 and proved["least_singular_value"] > 0.05
    assert "`gt_l1_ik` returns GT_OK" in (folder / "README.md").read_text()
    assert "in a second by at most T by 1" in (six / "README.md").read_text()
    for file in (CHECKER, *PARTS):
        assert len((codegen_dir() / "verify" / file).read_text().splitlines()) <= 300


def test_the_checker_accepts_what_was_proved(checker, folder, six, capsys):
    checker.main(folder)
    assert "gt_l1_ik: proved in " in capsys.readouterr().out
    checker.main(six)
    assert "gt_d1_ik: proved in " in capsys.readouterr().out


def test_the_checker_runs_as_a_program(checker, six, tmp_path):
    result = subprocess.run([sys.executable, str(six / CHECKER)], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0 and "proved in" in result.stdout
    copy = shutil.copytree(six, tmp_path / "copy")
    (copy / "gt_d1.h").write_text("")
    result = subprocess.run([sys.executable, str(copy / CHECKER)], capture_output=True, text=True)
    assert result.returncode == 1 and "gt_d1.h was changed" in result.stderr


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


IK, FK, D1 = (f"certificate/proved/gt_{name}" for name in ("l1_ik", "l1_fk", "d1_ik"))
IN_FK = "functions/gt_l1_fk"
TAMPERED: dict[str, Callable[[Path], object]] = {
    "a link is shorter": changed(BODY, lambda t: _in_body(t, "ik", r"=4\.2024999999999997e\+00;", "=1e-01;")),
    "a square is missing": changed(BODY, lambda t: _in_body(t, "ik", r"=casadi_sq\((\w+)\);", r"=\1;")),
    "a root is a sine": changed(BODY, lambda t: _in_body(t, "ik", r"=sqrt\(", "=sinh(")),
    "a subtraction is an addition": changed(BODY, lambda t: _in_body(t, "fk", r"=\((\w+)-(\w+)\);", r"=(\1+\2);")),
    "a square is a cube": changed(BODY, lambda t: t.replace("return x*x;", "return x*x*x;")),
    "a root is another function": changed(BODY, lambda t: t.replace("#include <math.h>", "#define sqrt sin")),
    "the arithmetic of the manifest is another": changed(MANIFEST, of("real", lambda r: "float")),
    "an error bound is too small": changed(MANIFEST, of(f"{IK}/errors/1", lambda e: e / 50)),
    "a range is too narrow": changed(MANIFEST, of(f"{FK}/ranges/0", lambda r: [0.9 * r[0] + 0.1 * r[1], sum(r) / 2])),
    "a singular value is too large": changed(MANIFEST, of(f"{IK}/least_singular_value", lambda s: 5 * s)),
    "a box is left out": changed(FILE, of(f"{IN_FK}/boxes", lambda b: b[1:])),
    "a box is shorter": changed(FILE, of("functions/gt_l1_ik/boxes/0/1/0", lambda x: x - 1e-3)),
    "the box of the manifest reaches further": changed(MANIFEST, of("functions/0/box/T/2/1", lambda x: x + 2.0)),
    "a pivot must be larger": changed(MANIFEST, of("functions/1/margins/1/scale", lambda s: 1e10 * s)),
    "the manifest lacks a margin": changed(MANIFEST, of("functions/0/margins", lambda m: m[:-1])),
    "an input must be smaller": changed(MANIFEST, of("functions/0/limits/T", lambda s: 0.1)),
    "pivots may be smaller": changed(MANIFEST, of("pivot_tolerance", lambda x: 0.0)),
    "a pivot may be zero": changed(MANIFEST, of("functions/1/margins/1/scale", lambda s: 0.0)),
    "two bodies change places": changed(BODY, lambda t: _swapped(t, "int gt_l1_ik_body(", "int gt_l1_fk_body(")),
    "a macro takes the place of a square": changed(
        BODY, lambda t: t.replace("/* gt_l1_ik_body", "#define casadi_sq(x) (x)\n/* gt_l1_ik_body")
    ),
    "a square of another type": changed(BODY, lambda t: t.replace(SQUARE, "double casadi_sq(double x) { return x;}")),
    "a root of another library": changed(
        BODY, lambda t: t.replace("/* gt_l1_ik_body", "double sqrt(double x) { return x;}\n/* gt_l1_ik_body")
    ),
    "a header is another": changed(BODY, lambda t: t.replace("<math.h>", '"gt_other.h"')),
    "contraction is on": changed("gt_float.h", lambda t: t.replace("FP_CONTRACT OFF", "FP_CONTRACT ON")),
    "a pivot is tested as a root": changed(MANIFEST, of("functions/1/margins/1/kind", lambda _: "discriminant")),
    "a test in the code is stricter": changed(ROUND, lambda t: t.replace("margins[0] >= 0.0", "margins[0] >= 1.0")),
    "a limit in the code is smaller": changed(ROUND, lambda t: t.replace("total <= 4194304.0", "total <= 1.5")),
    "a result is changed": changed(ROUND, lambda t: t.replace("    *out = y;", "    y.q_m[0] += 1e-3;\n    *out = y;")),
    "a result is another": changed(ROUND, lambda t: t.replace("res[0] = y.q_m;", "res[0] = y.q_m + 1;")),
    "a result is copied": changed(
        ROUND, lambda t: t.replace("    *out = y;", "    gt_copy(y.q_m, in->T_m, 3);\n    *out = y;")
    ),
    "boxes overlap": changed(FILE, of(f"{IN_FK}/boxes", lambda b: [*b, b[0]])),
    "a box is not a number": changed(FILE, of(f"{IN_FK}/boxes/0/0/0", lambda x: float("nan"))),
    "a bound is not a number": changed(MANIFEST, of(f"{IK}/errors/0", lambda e: float("nan"))),
    "the certificate claims less than the manifest": lambda folder: [
        changed(MANIFEST, of(f"{IK}/errors", lambda e: [0.0] * 3))(folder),
        changed(FILE, of("functions/gt_l1_ik", lambda f: f | {"errors": [1.0] * 3}))(folder),
    ],
    "an output has no bound": changed(MANIFEST, of(f"{IK}/errors", lambda e: e[1:])),
    "nothing is stated": changed(MANIFEST, of("certificate/proved", lambda f: {})),
}  # fmt: skip
SQUARE = "static inline casadi_real casadi_sq(casadi_real x) { return x*x;}"
WRAPPER, SIX_BODY = "gt_d1.c", "gt_d1_body.c"


def edited(file: str, pattern: str, new: str, count: int = 0) -> Callable[[Path], None]:
    return changed(file, lambda t: re.sub(pattern, new, t, count=count, flags=re.S))


STOP = r"  if \(res\[1\] == 0\) \{ return 0; \}\n"
ENTRY = r"  res\[1\]\[2\]=(\w+);"
TAMPERED_SIX: dict[str, Callable[[Path], None]] = {
    "a link is shorter": edited(SIX_BODY, r"=3\.1309999999999998e\+00;", "=3.1309999999999998e-01;"),
    "a wrong sign in the Jacobian": edited(SIX_BODY, ENTRY, r"  \1=(-\1);\n  res[1][2]=\1;", 1),
    "an entry of the Jacobian doubled": edited(SIX_BODY, ENTRY, r"  \1=(2.*\1);\n  res[1][2]=\1;", 1),
    "the residual is left early": edited(
        SIX_BODY, f"(  res\\[0\\]\\[5\\]=\\w+;\n)((?:(?!res).)*?){STOP}", r"  if (res[1] == 0) { return 0; }\n\1\2"
    ),
    "a nominal is smaller": edited(WRAPPER, r"nominal\[6\] = \{1\.0,", "nominal[6] = {1e9,"),
    "residuals must be smaller": edited(WRAPPER, r"(largest\[6\] = \{)([\d.]+)", r"\g<1>\g<2>e6"),
    "pivots must be larger": edited(WRAPPER, "1.27e-07", "1.27e+07"),
    "a branch ends earlier": edited(WRAPPER, r"(margins\[1\] > \(GT_PIVOT_TOLERANCE \* )[\d.]+", r"\g<1>1e9"),
    "a test is another": edited(WRAPPER, r"\(margins\[0\] >= 0\.0\)", "(margins[0] <= 0.0)"),
    "a step goes the other way": edited("gt_newton.h", r"z\[i\] -= x", "z[i] += x"),
    "three steps": edited("gt_newton.h", "GT_NEWTON_STEPS 4", "GT_NEWTON_STEPS 3"),
    "the inputs move faster": changed(MANIFEST, of(f"{D1}/speed/T", lambda v: 60.0)),
    "the calls are rarer": changed(MANIFEST, of(f"{D1}/period", lambda v: 60 * v)),
    "an error bound is too small": changed(MANIFEST, of(f"{D1}/errors/0", lambda e: e / 100)),
    "a singular value is too large": changed(MANIFEST, of(f"{D1}/least_singular_value", lambda s: 5 * s)),
    "a range is too narrow": changed(MANIFEST, of(f"{D1}/ranges/1", lambda r: [r[0], sum(r) / 2])),
}  # fmt: skip


def _in_body(text: str, function: str, pattern: str, new: str) -> str:
    """Change the first place in a body."""
    head, begin, rest = text.partition(f"/* gt_l1_{function}_body:(")
    return head + begin + re.sub(pattern, new, rest, count=1)


def _swapped(text: str, a: str, b: str) -> str:
    return text.replace(a, "@").replace(b, a).replace("@", b)


class TwoSolutions(gt.Model):
    a = gt.variable(start=1.5)
    z = gt.variable(start=1.2)

    def equations(self):
        yield self.z**2 + 0.1 * gt.sin(self.z) == self.a


def test_boxes_with_different_solutions_are_refused(checker, tmp_path):
    """Each half of the box has one solution near its start, but they are not one solution."""
    box = {"a": [[1.0, 2.0]]}
    functions = {"f": TwoSolutions().causal(known="a", targets="z")}
    cgen.generate(
        functions, tmp_path, name="two", box=box, beside=statements(functions, box, "two", "double", Work()).beside
    )
    changed(MANIFEST, of("certificate/proved/gt_two_f/ranges", lambda _: [[-2.0, 2.0]]))(tmp_path)
    halves = [[[1.0], [1.5]], [[1.5], [2.0]]]
    for starts, good in (([[1.07], [1.28]], True), ([[-1.16], [-1.36]], True), ([[1.07], [-1.36]], False)):
        changed(FILE, of("functions/gt_two_f", lambda f, z=starts: {"boxes": halves, "starts": z}))(tmp_path)
        _sign(tmp_path)
        if good:
            checker.main(tmp_path)
        else:
            with pytest.raises(checker.Refused, match="different solutions"):
                checker.main(tmp_path)


@pytest.mark.parametrize("what", TAMPERED_SIX)
def test_the_checker_refuses_tampered_files_of_newtons_method(checker, six, tmp_path, what, monkeypatch):
    monkeypatch.setattr(importlib.import_module("check_newton"), "MOST", 6)
    copy = shutil.copytree(six, tmp_path / "d1")
    TAMPERED_SIX[what](copy)
    _sign(copy)
    with pytest.raises(checker.Refused):
        checker.main(copy)


@pytest.mark.parametrize("what", TAMPERED)
def test_the_checker_refuses_tampered_files(checker, folder, tmp_path, what, monkeypatch):
    """Also if all hashes are those of the tampered files."""
    monkeypatch.setattr(checker, "MOST", 2000)
    copy = tmp_path / "l1"
    shutil.copytree(folder, copy)
    TAMPERED[what](copy)
    if (copy / MANIFEST).read_text() == (folder / MANIFEST).read_text():
        with pytest.raises(checker.Refused, match=r"was changed since|not one of this"):
            checker.main(copy)
    _sign(copy)
    with pytest.raises(checker.Refused):
        checker.main(copy)


def _sign(folder: Path) -> None:
    """Write the hashes of the files as they are."""
    certificate = json.loads((folder / FILE).read_text())
    certificate["body_sha256"] = hashlib.sha256((folder / certificate["body"]).read_bytes()).hexdigest()
    (folder / FILE).write_text(json.dumps(certificate))
    manifest = json.loads((folder / MANIFEST).read_text())
    for file in manifest["files"]:
        manifest["files"][file] = hashlib.sha256((folder / file).read_bytes()).hexdigest()
    (folder / MANIFEST).write_text(json.dumps(manifest))


def test_what_is_not_proved_is_a_failed_check_or_left_out_with_the_reason():
    robot = gt.robots.gantry_tau("l1_tape")
    six = gt.robots.six_link_gantry_tau("d1_six_link").causal(known="T", targets="q")
    functions = {"ik": robot.causal(known="T", targets="q"), "tau": robot.causal(known="T", targets="tau")}
    made = statements(functions, {"T": [[0.0, 0.1], [-1.0, -0.9], [0.1, 6.0]]}, "l1", "double", Work())
    assert not made.checks["certified_ik"].passed and not made.functions
    assert "box" in made.left_out["tau"]
    single = statements({"six": six}, SIX, "l1", "float", Work())
    assert "double" in single.left_out["six"] and not single.checks
    fast = InputSpeed(speed={"T": 99.0})
    made = statements({"six": six}, {"T": [[c, c] for c in MIDDLE]}, "d1", "double", Work(), fast)
    assert not made.checks["certified_six"].passed and not made.functions


def test_checker_and_proof_agree_on_steps_that_shrink(checker):
    n = importlib.import_module("check_newton")
    for left in (0.0, 0.1, 0.15, 0.17, 0.175, 0.176, 0.3):
        for quiet in (1e-16, 1e-12, 5e-12, 2e-11, 1e-10):
            assert n.shrinks(n.arb(left), n.arb(quiet)) == bool(_shrinking(np.array(left), np.array(quiet)))


def test_angles_that_are_brought_into_a_turn_are_checked(checker, tmp_path, capsys):
    """The five-bar's angles, and a function with an operation that the checker cannot read, which is left out."""

    class Decay(gt.Model):
        a = gt.variable(start=0.5)
        y = gt.variable()

        def equations(self):
            yield self.y == gt.exp(-self.a)

    robot = mechanisms.FiveBar()
    functions = {"ik": robot.causal(known="x", targets="q"), "decay": Decay().causal(known="a", targets="y")}
    box = {"x": [[0.05, 0.35], [0.55, 0.75]], "a": [[0.0, 1.0]]}
    made = statements(functions, box, "bar", "double", Work(), regular=["ik"])
    assert all(c.passed for c in made.checks.values()) and "OP_EXP" in made.left_out["decay"]
    cgen.generate(functions, tmp_path / "bar", name="bar", box=box, beside=made.beside)
    assert "=floor(" in (tmp_path / "bar" / "gt_bar_body.c").read_text()
    checker.main(tmp_path / "bar")
    assert "gt_bar_ik: proved in " in capsys.readouterr().out


UNARY = ["neg", "twice", "sq", "inverse", "sqrt", "sin", "cos", "tanh", "atan", "asin", "acos", "fabs", "floor"]


@pytest.mark.parametrize("op", [*UNARY, "+", "-", "*", "/", "atan2", "fmin", "fmax"])
def test_derivatives_of_the_checker_are_those_of_differences(checker, op):
    """Of op(x y, x - 0.3 y) or op(x y), by differences of 1e-9 with a hundred bits; third derivatives reach 1e4."""
    d = importlib.import_module("check_derivatives")
    steps = [("in", "x", 0, 0), ("in", "y", 0, 1), ("const", "c", "0.3"), ("*", "p", "x", "y"), ("*", "s", "c", "y"),
             ("-", "q", "x", "s"), (op, "r", "p", *([] if op in UNARY else ["q"])), ("out", "r", 0, 0)]  # fmt: skip
    body, arb = d.Derivatives(steps, True), d.arb
    step = arb("1e-9")

    def at(x, y):
        return body.run([[d.Jet(x, {0: arb(1)}, {}), d.Jet(y, {1: arb(1)}, {})]], 2)[0, 0]

    for x, y in ((arb("0.4"), arb("0.9")), (arb("0.7"), arb("0.2"))):
        here, right, up = at(x, y), at(x + step, y), at(x, y + step)
        none = arb(0)
        for k, there in ((0, right), (1, up)):
            assert abs((there.x - here.x) / step - here.g.get(k, none)) < 1e-4
            for j in range(2):
                change = (there.g.get(j, none) - here.g.get(j, none)) / step
                assert abs(change - here.h.get((min(j, k), max(j, k)), none)) < 1e-4
