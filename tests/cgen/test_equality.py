"""C equals Python: values bit for bit, statuses everywhere, outputs held; and the proof fails when it should."""

import ctypes
import itertools
import re
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.points import HELD, draw, evaluate
from gtmodel.cgen.verification.comparison import call
from gtmodel.compiler import toolchain
from gtmodel.results import SolveStatus
from gtmodel.results.check import failed_of
from tests.cgen.conftest import Functions, SliderCrank, c_files, copy, run, succeed

POINTS = 1000


@pytest.fixture(scope="module")
def l1_report(l1: Functions, l1_folder: Path) -> cgen.CheckReport:
    return cgen.check(l1_folder, l1, points=POINTS, seed=1)


@pytest.fixture(scope="module")
def small_report(small: Functions, small_folder: Path) -> cgen.CheckReport:
    return cgen.check(small_folder, small, points=POINTS, seed=1)


@pytest.mark.parametrize("which", ["l1_report", "small_report"])
def test_every_function_equals_python(which: str, request: pytest.FixtureRequest) -> None:
    report: cgen.CheckReport = request.getfixturevalue(which)
    assert report.passed, str(report)
    for key, ok in report.rows_ok.items():
        # both kinds of points: enough where values are compared, enough where a status is
        assert report.rows[key] >= POINTS and ok > 0.2 * POINTS
        assert ok < 0.9 * POINTS or key in ("slider", "wobble"), key  # a crank turns through every angle


def load(folder: Path, place: Path) -> ctypes.CDLL:
    sources = [folder / f for f in c_files(folder) if not f.endswith("_main.c")]
    succeed("cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", *sources, "-lm", "-o", "library.so", cwd=place)
    return ctypes.CDLL(str(place / "library.so"))


def test_each_cause_has_its_status(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    face = interfaces({"pendulum": small["pendulum"]}, "small")[0]
    #          ok          beyond L    bottom, x[0] = 0  too large        NaN            infinite
    inputs = [[-0.6, 0.3], [-1.2, 0.3], [-1.0, 0.3], [-0.6, 1e300], [np.nan, 0.3], [-0.6, -np.inf]]
    outputs, status = call(load(small_folder, tmp_path), face, np.array(inputs))
    expected = [Status.OK, Status.OUT_OF_RANGE, Status.SINGULAR, Status.OUT_OF_RANGE] + [Status.NOT_FINITE] * 2
    assert status.tolist() == expected
    np.testing.assert_array_equal(status, evaluate(face, np.array(inputs))[1])
    assert np.all(outputs[1:] == HELD)
    # T = m (v^2 / L^2 - g y / L^2) in closed form
    speed2 = 0.3**2 / (1 - 0.6**2)
    assert outputs[0, 0] == pytest.approx(2.0 * (speed2 + 9.81 * 0.6), rel=1e-14)


def test_same_result_however_calls_are_mixed(l1: Functions, l1_folder: Path, tmp_path: Path) -> None:
    """No state: two functions called alternately give what each gives alone."""
    library = load(l1_folder, tmp_path)
    fk, ik = interfaces({k: l1[k] for k in ("fk", "ik")}, "l1")
    q, T = draw(fk, 20, seed=3), draw(ik, 20, seed=4)
    apart = call(library, fk, q)[0], call(library, ik, T)[0]
    mixed = [(call(library, fk, q[n : n + 1])[0], call(library, ik, T[n : n + 1])[0]) for n in range(20)]
    np.testing.assert_array_equal(apart[0], np.concatenate([m[0] for m in mixed]))
    np.testing.assert_array_equal(apart[1], np.concatenate([m[1] for m in mixed]))


class Smaller(gt.Model):
    """Smaller and larger of two numbers, and of one number and a constant on either side."""

    x = gt.input()
    y = gt.input()
    z = gt.variable(6)

    def equations(self):
        for n, pick in ((0, gt.minimum), (3, gt.maximum)):
            yield self.z[n] == pick(self.x, self.y)
            yield self.z[n + 1] == pick(self.x, 0.0)
            yield self.z[n + 2] == pick(1.0, self.y)


def test_smaller_and_larger_of_nan_infinities_and_both_zeros(tmp_path: Path) -> None:
    f = Smaller().causal(["x", "y"], "z")
    folder = cgen.generate({"f": f}, tmp_path / "small", name="small").folder
    body = load(folder, tmp_path).gt_small_f_body
    special = [np.nan, -np.inf, np.inf, 0.0, -0.0, 5e-324, 1.0, -1.0, 1.0 + 2**-52]
    for x, y in itertools.product(special, special):
        # the body: the guards round it let no NaN in
        z, columns = np.full(6, HELD), [np.array([x]), np.array([y])]
        pointers = [c.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for c in (*columns, z)]
        arguments = (ctypes.POINTER(ctypes.c_double) * 2)(*pointers[:2])
        results = (ctypes.POINTER(ctypes.c_double) * 2)(pointers[2])
        scratch = (ctypes.c_longlong * 64)(), (ctypes.c_double * 64)()
        assert body(arguments, results, *scratch, 0) == 0
        expected = np.array(f.casadi(x, y)[0].full()).reshape(-1)
        np.testing.assert_array_equal(z, expected, err_msg=f"{x} {y}")
        known = ~np.isnan(expected)
        np.testing.assert_array_equal(np.signbit(z[known]), np.signbit(expected[known]), err_msg=f"{x} {y}")


def test_self_test_sees_any_changed_constant(l1: Functions, tmp_path: Path) -> None:
    folder = cgen.generate({"fk": l1["fk"]}, tmp_path / "one", name="one").folder
    body = folder / "gt_one_body.c"
    text = body.read_text()
    others = [f for f in c_files(folder) if f != body.name]
    succeed("cc", "-O0", "-ffp-contract=off", "-c", *others, cwd=folder)
    constants = list(re.finditer(r"(?<==)-?\d\.\d+(e[+-]\d+)?(?=;)", text))
    assert len(constants) > 10
    for constant in constants:
        value = float(constant[0]) * (1 + 1e-9)
        body.write_text(f"{text[: constant.start()]}{value!r}{text[constant.end() :]}")
        succeed("sh", "-c", "cc -O0 -ffp-contract=off -c gt_one_body.c && cc *.o -lm", cwd=folder)
        assert run("./a.out", cwd=folder).returncode == 1, constant[0]


def test_check_sees_changed_code_and_other_parameters(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    body = folder / "gt_small_body.c"
    body.write_text(body.read_text().replace("9.8100000000000005e+00", "9.8200000000000003e+00"))
    report = cgen.check(folder, small, points=50)
    failed = set(failed_of(report.checks))
    assert failed == {"files_changed", "selftest_failures", "pendulum_values_different"}
    assert not report.passed and "files_changed" in report.message

    other = dict(small)
    other["wobble"] = SliderCrank(r=0.11).causal(known="phi", targets="wobble")
    failed = set(failed_of(cgen.check(small_folder, other, points=50).checks))
    assert {"parameters_different", "wobble_values_different"} <= failed


def test_check_sees_foreign_calls_and_warnings(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    source = folder / "gt_small.c"
    source.write_text(
        source.read_text() + "void *gt_small_more(void);\nvoid *gt_small_more(void) { return gt_other(); }\n"
    )
    source.write_text(
        source.read_text().replace("void *gt_small_more", "void *gt_other(void);\nvoid *gt_small_more", 1)
    )
    checks = cgen.check(folder, small, points=10).checks
    assert not checks["foreign_symbols"].passed and "gt_other" in checks["foreign_symbols"].advice
    source.write_text(source.read_text() + "int gt_small_warn(double x);\nint gt_small_warn(double x) { return x; }\n")
    checks = cgen.check(folder, small, points=10).checks
    assert not checks["files_not_compiled"].passed and "conversion" in checks["files_not_compiled"].advice


def test_missing_compiler_is_one_sentence(
    small: Functions, small_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    assert cgen.generate(small, tmp_path / "x", name="x").header.is_file()
    report = cgen.check(small_folder, small)
    assert not report.passed
    assert report.message.startswith("there is no C compiler 'no-such-compiler' on this machine")
    study = cgen.study(small, tmp_path / "y", name="small", check=cgen.Verification(points=10))
    assert study.status is SolveStatus.CHECK_FAILED and "no-such-compiler" in study.message
    monkeypatch.setattr(toolchain.shutil, "which", lambda name: None if name == "nm" else name)
    assert "binutils" in cgen.check(small_folder, small).message


def test_check_refuses_folders_of_other_functions(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(cgen.GenerationError, match=r"holds no manifest\.json"):
        cgen.check(tmp_path, small)
    with pytest.raises(cgen.GenerationError, match="also holds 'pendulum'"):
        cgen.check(small_folder, {k: small[k] for k in ("slider", "wobble")})
    with pytest.raises(cgen.GenerationError, match="generated from another 'wobble'"):
        cgen.check(small_folder, {**small, "wobble": small["slider"]})
