"""Element functions as machine code: the same bits, a library that is kept, and sentences where it cannot be made."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.cgen import toolchain
from gtmodel.optimize import CompilerMissing, Mesh, SolverOptions, solve, solve_phases, transcribe
from tests.optimize import features, problems

MACHINE = SolverOptions(compile=True)
needs_compiler = pytest.mark.skipif(isinstance(toolchain.find(), str), reason="needs a C compiler")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


@needs_compiler
class TestMachineCode:
    def test_same_bits_and_a_library_that_is_kept(self, folder):
        """Compiled without contraction: every iterate is that of the virtual machine."""
        plain = solve(features.Tank(), Mesh(6, 2))
        first, again = (solve(features.Tank(), Mesh(6, 2), solver=MACHINE) for _ in range(2))
        for run in (first, again):
            assert np.array_equal(run.x, plain.x) and run.iterations == plain.iterations
            assert run.objective == plain.objective
        assert first.seconds["compile"] > 0.0 and again.seconds["compile"] == 0.0 and "compile" not in plain.seconds
        assert len(list(folder.iterdir())) == 1  # the library, nothing that was on the way to it

    def test_one_library_for_all_meshes_of_equal_elements(self, folder):
        """The mesh's size is no part of the element; what else differs has its own library."""
        solve(features.Tank(), Mesh(4, 2), solver=MACHINE)
        assert solve(features.Tank(), Mesh(7, 2), solver=MACHINE).seconds["compile"] == 0.0
        assert solve(features.Tank(rate=2.0), Mesh(4, 2), solver=MACHINE).status.converged
        solve(features.Tank(), Mesh(4, 3), solver=MACHINE)
        assert len(list(folder.iterdir())) == 2

    def test_parametric_and_linked_problems(self):
        road = transcribe(features.Tank(), Mesh(4, 2), solver=MACHINE)
        plain = transcribe(features.Tank(), Mesh(4, 2))
        assert road.solve({"rate": 2.0}).objective == plain.solve({"rate": 2.0}).objective
        linked = [solve_phases(problems.two_phases(), Mesh(6, 2), solver=SolverOptions(compile=c)) for c in (0, 1)]
        assert linked[0].objective == linked[1].objective

    def test_a_folder_that_cannot_be_written(self, tmp_path, monkeypatch):
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "file" / "below"))
        with pytest.raises(CompilerMissing, match=r"cannot write to .* set GTMODEL_CACHE to another folder"):
            solve(features.Tank(), Mesh(2, 1), solver=MACHINE)

    def test_a_compiler_that_fails(self, monkeypatch):
        monkeypatch.setenv("CC", "false")
        with pytest.raises(CompilerMissing, match=r"the C compiler .*false failed on the element functions"):
            solve(features.Tank(), Mesh(2, 1), solver=MACHINE)


def test_no_compiler(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(CompilerMissing, match=r"no C compiler 'no-such-compiler' .* compile=False gives the same"):
        solve(features.Tank(), Mesh(2, 1), solver=MACHINE)
    assert solve(features.Tank(), Mesh(2, 1)).status.converged
