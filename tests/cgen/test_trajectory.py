"""A function along a sampled reference: rows of an optimised motion in, the very numbers of the plain function out."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

from gtmodel import Status, cgen
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.points import HELD, draw, evaluate
from gtmodel.cgen.verification.comparison import call
from tests.cgen.calls import shared_library
from tests.cgen.conftest import Functions, run


class Reference(ctypes.Structure):
    """gt_traj."""

    _fields_ = (
        ("rows", ctypes.c_void_p),
        ("count", ctypes.c_uint32),
        ("columns", ctypes.c_uint32),
        ("step_ms", ctypes.c_uint32),
    )


@pytest.fixture(scope="module")
def folder(l1: Functions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    functions = {"inverse_dynamics": l1["inverse_dynamics"]}
    place = tmp_path_factory.mktemp("along") / "a"
    return cgen.generate(functions, place, name="a", along=["inverse_dynamics"]).folder


def test_along_a_reference(l1: Functions, folder: Path, tmp_path: Path) -> None:
    library = shared_library(folder, tmp_path)
    (face,) = interfaces({"inverse_dynamics": l1["inverse_dynamics"]}, "a")
    drawn = draw(face, 40, seed=3)
    rows = np.ascontiguousarray(drawn[evaluate(face, drawn)[1] == Status.OK][:9])
    at = library.gt_a_inverse_dynamics_at
    at.argtypes = [ctypes.POINTER(Reference), ctypes.c_uint64, ctypes.c_void_p]

    def forces(time_ms: int, columns: int = 9, count: int = len(rows)) -> tuple[np.ndarray, int]:
        out = np.full(3, HELD)
        reference = Reference(rows.ctypes.data, count, columns, 4)
        return out, at(ctypes.byref(reference), time_ms, out.ctypes.data)

    middle = rows[2] + 0.5 * (rows[3] - rows[2])
    plain, status = call(library, face, np.array([rows[0], middle, rows[-1]]))
    assert not status.any()
    for time_ms, expected in ((0, plain[0]), (10, plain[1]), (32, plain[2]), (10**12, plain[2])):
        out, code = forces(time_ms)
        assert code == Status.OK and np.array_equal(out, expected)
    for out, code in (forces(0, columns=8), forces(0, count=0)):
        assert code == Status.OUT_OF_RANGE and np.all(out == HELD)
    rows[0, 4] = np.nan
    out, code = forces(1)
    assert code == Status.NOT_FINITE and np.all(out == HELD)


def test_compiles_strictly_in_c_and_cpp(folder: Path, l1: Functions, tmp_path: Path) -> None:
    strict = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror", "-c", folder / "gt_a.c")
    done = run("g++", "-x", "c++", "-std=c++17", *strict, "-o", "x.o", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert cgen.check(folder, {"inverse_dynamics": l1["inverse_dynamics"]}, points=50).passed


def test_what_cannot_follow_a_reference_is_refused(l1: Functions, small: Functions, tmp_path: Path) -> None:
    with pytest.raises(cgen.GenerationError, match="there is no function 'forces' to offer along a reference"):
        cgen.generate(l1, tmp_path / "x", name="x", along=["forces"])
    with pytest.raises(cgen.GenerationError, match="'wobble' cannot be offered along a reference"):
        cgen.generate(small, tmp_path / "x", name="x", along=["wobble"])
