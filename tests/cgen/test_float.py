"""C in float: bit for bit what Python computes in float, within 1e-5 of the range of double, and float throughout."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from gtmodel import Status, cgen
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.newton_steps import run as run_in_float
from gtmodel.cgen.points import draw, evaluate
from gtmodel.cgen.proof import prove
from gtmodel.cgen.real import DOUBLE, FLOAT, single
from gtmodel.cgen.verification.comparison import call
from tests.bench.callgrind import FLAGS
from tests.cgen.calls import shared_library
from tests.cgen.conftest import Functions, c_files, copy, run, succeed

POINTS = 500
BOX = {"q": [[-0.52, 0.08], [-0.33, 0.27], [-0.52, 0.08]]}  # m, of both robots: far from singular poses
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
# SSE: arithmetic in double, conversions to and from it
IN_DOUBLE = re.compile(r"\b(cvtss2sd|cvtsd2ss|(add|sub|mul|div|sqrt|min|max|ucomi|comi)sd)\b")


@pytest.fixture(scope="session")
def functions(l1: Functions, newton_functions: Functions, small: Functions) -> Functions:
    chosen = {key: l1[key] for key in ("fk", "velocity", "inverse_dynamics")}
    return chosen | {"newton": newton_functions["six_link_fk"], "slider": small["slider"]}


@pytest.fixture(scope="session")
def folder(functions: Functions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("float") / "s"
    return cgen.generate(functions, place, name="s", real="float", along=["inverse_dynamics"], box=BOX).folder


def test_equal_to_python_in_float_and_near_to_double(functions: Functions, folder: Path) -> None:
    report = cgen.check(folder, functions, points=POINTS, seed=1)
    assert report.passed, str(report)
    errors = {
        name.removesuffix("_float_error"): c for name, c in report.checks.items() if name.endswith("_float_error")
    }
    assert set(errors) == set(functions)
    for key, c in errors.items():
        assert c.bound == 1e-5 and 1e-9 < c.value < c.bound, key  # of float it is, and near
        assert report.rows_ok[key] > 0.2 * POINTS


def test_compiles_in_c99_and_cpp17_and_tests_itself(folder: Path, tmp_path: Path) -> None:
    here = copy(folder, tmp_path)
    own = [f for f in c_files(here) if "_body" not in f]
    for command in (("cc", "-std=c99"), ("g++", "-x", "c++", "-std=c++17")):
        succeed(*command, *STRICT, "-c", *own, cwd=here)
        succeed(*command, *STRICT, "-c", "gt_s_body.c", cwd=here)
    succeed("sh", "-c", "cc -ffp-contract=off *.c -lm", cwd=here)
    assert "every vector is reproduced bit for bit" in succeed("./a.out", cwd=here)
    (example,) = re.findall(r"```c\n(.*?)```", (here / "README.md").read_text(), re.S)
    (here / "app.c").write_text(example)
    succeed("cc", "-std=c99", *STRICT, "-c", "app.c", cwd=here)


def test_nothing_is_computed_in_double(folder: Path, tmp_path: Path) -> None:
    if shutil.which("objdump") is None or "x86_64" not in run("cc", "-dumpmachine", cwd=tmp_path).stdout:
        pytest.skip("this machine has no objdump, or another processor than x86-64")
    succeed("cc", *FLAGS, "-c", folder / "gt_s.c", folder / "gt_s_body.c", cwd=tmp_path)
    code = succeed("objdump", "-d", "gt_s_body.o", "gt_s.o", cwd=tmp_path)
    along = code.index("<gt_s_inverse_dynamics_at>:")
    code = code[:along] + code[code.index("\n\n", along) :]  # times in milliseconds may be converted there
    assert "sqrtss" in code and IN_DOUBLE.findall(code) == []


def test_folders_in_double_and_in_float_live_in_one_program(l1_folder: Path, folder: Path, tmp_path: Path) -> None:
    sources = [folder / f for f in c_files(folder)] + [l1_folder / f for f in c_files(l1_folder)]
    app = '#include "gt_l1.h"\n#include "gt_s.h"\nint main(void) { return gt_l1_selftest() + gt_s_selftest(); }\n'
    (tmp_path / "app.c").write_text(app)
    succeed("cc", "-ffp-contract=off", f"-I{folder}", f"-I{l1_folder}", "app.c", *sources, "-lm", cwd=tmp_path)
    assert run("./a.out", cwd=tmp_path).returncode == 0


def test_one_changed_constant_fails_the_self_test(l1: Functions, tmp_path: Path) -> None:
    folder = cgen.generate({"fk": l1["fk"]}, tmp_path / "one", name="one", real="float").folder
    body = folder / "gt_one_body.c"
    text = body.read_text()
    succeed("cc", *FLAGS, "-c", *[f for f in c_files(folder) if f != body.name], cwd=folder)
    constants = list(re.finditer(r"(?<==)(-?\d\.\d+)f(?=;)", text))
    assert len(constants) > 8
    for constant in constants:
        body.write_text(f"{text[: constant.start()]}{float(constant[1]) * (1 + 1e-5)!r}f{text[constant.end() :]}")
        succeed("sh", "-c", "cc -O0 -ffp-contract=off -c gt_one_body.c && cc *.o -lm", cwd=folder)
        assert run("./a.out", cwd=folder).returncode == 1, constant[0]


def test_singular_and_far_poses_have_their_status(l1: Functions, folder: Path, tmp_path: Path) -> None:
    library = shared_library(folder, tmp_path)
    (face,) = interfaces({"velocity": l1["velocity"]}, "s", real=FLOAT)
    good = draw(face, 50, seed=3, farthest=0.02)[0]
    rows = np.tile(good, (4, 1))
    rows[1, 1], rows[2, 0], rows[3, 3:] = 9.0, np.nan, 3e38
    outputs, status = call(library, face, rows)
    assert status.tolist() == [Status.OK, Status.OUT_OF_RANGE, Status.NOT_FINITE, Status.OUT_OF_RANGE]
    assert np.all(outputs[1:] == FLOAT.array(FLOAT.held)) and outputs.dtype == np.float32


def test_python_in_float_is_numpy_in_float() -> None:
    """The evaluation that C must equal, beside NumPy's own float of the same formulas."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    f = ca.Function("f", [x, y], [ca.sqrt(x * x + y / 3), ca.fmax(x, y) - ca.fabs(y), ca.vertcat(ca.tanh(x), 2 * x)])
    a, b = np.random.default_rng(2).uniform(0.1, 2.0, (2, 1, 40)).astype(np.float32)
    root, larger, both = run_in_float(f, [a, b])
    np.testing.assert_array_equal(root, np.sqrt(a * a + b / np.float32(3)))
    np.testing.assert_array_equal(larger, np.maximum(a, b) - b)
    np.testing.assert_allclose(both[0], np.tanh(a[0].astype(float)), rtol=2e-7)
    np.testing.assert_array_equal(both[1], a[0] + a[0])
    assert {r.dtype for r in (root, larger, both)} == {np.dtype(np.float32)}
    with pytest.raises(cgen.GenerationError, match="cannot evaluate the operation number"):
        run_in_float(ca.Function("g", [x], [ca.erf(x)]), [a])


def test_texts_in_float() -> None:
    text = 'double x = 0.1 + 2. * 1e-10; /* double 0.1 */ int k = 10; (void)printf("0.1 %d", fabs(-0x1.8p+1));'
    expected = 'float x = 0.1f + 2.0f * 1e-10f; /* double 0.1 */ int k = 10; (void)printf("0.1 %d", fabsf(-0x1.8p+1f));'
    assert single(text).replace("0x1.8000000000000p+1f", "0x1.8p+1f") == expected
    assert single('#include "gt_newton.h"\n#define GT_NEWTON_H\ngt_newton_marks a1;') == (
        '#include "gt_newtonf.h"\n#define GT_NEWTONF_H\ngt_newton_marksf a1;'
    )
    for beyond in ("1e300", "1e-300"):
        with pytest.raises(cgen.GenerationError, match=f"the constant {beyond} is beyond the range of float"):
            single(f"x = {beyond};")


def test_what_float_cannot_do_is_said(l1: Functions, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(cgen.GenerationError, match="'half' is no kind of number"):
        cgen.generate({"fk": l1["fk"]}, tmp_path / "x", name="x", real="half")
    with pytest.raises(cgen.GenerationError, match=r"gt_newtonf\.h belongs to the runtime"):
        cgen.generate({"fk": l1["fk"]}, tmp_path / "x", name="newtonf", real="float")
    if shutil.which("frama-c"):
        with pytest.raises(cgen.GenerationError, match="holds code in float"):
            prove(folder, "fk", l1["fk"], [(0.0, 1.0)] * 3)


def test_statuses_are_decided_in_float(l1: Functions) -> None:
    """Near a root of zero float and double may part; each C equals its own Python, which decides in its precision."""
    (narrow,), (wide,) = (interfaces({"f": l1["velocity"]}, "f", real=r) for r in (FLOAT, DOUBLE))
    rows = draw(narrow, 400, seed=6)
    a, b = evaluate(narrow, rows)[1], evaluate(wide, rows.astype(float))[1]
    assert np.mean(a == b) > 0.98 and set(a.tolist()) <= {int(s) for s in Status}
