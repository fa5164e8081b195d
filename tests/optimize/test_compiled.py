"""Element functions as machine code: the same bits, a library that is kept, and sentences where it cannot be made."""

from __future__ import annotations

import gc
import hashlib
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from gtmodel.compiler import toolchain
from gtmodel.compiler.columns import kernel
from gtmodel.compiler.tape.machine import Interpreted, interpreter
from gtmodel.compiler.toolchain import cache_folder
from gtmodel.optimize import CompilerMissing, Mesh, SolverOptions, solve, solve_phases, transcribe
from tests.optimize import features, problems

MACHINE = SolverOptions(compile=True)
needs_compiler = pytest.mark.skipif(isinstance(toolchain.find(), str), reason="needs a C compiler")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def exchange(library, content: bytes) -> None:
    """Another file of that name: this process has mapped the first one."""
    library.unlink()
    library.write_bytes(content)
    library.chmod(0o700)


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
        # the library and its hash, nothing that was on the way to it
        assert sorted(p.suffix for p in folder.iterdir()) == [".sha256", ".so"]

    def test_same_bits_by_the_interpreter(self, monkeypatch):
        """Where a machine has no compiler the virtual machine takes the same iterates."""
        assert interpreter(True) is not None
        taken: list[str] = []
        own = Interpreted.of_function
        monkeypatch.setattr(Interpreted, "of_function", lambda library, f: taken.append(f.name()) or own(library, f))
        monkeypatch.setattr(kernel, "USED", 0.0)
        by_interpreter = solve(features.Tank(), Mesh(20, 2))
        assert {"point_j", "point_h"} <= set(taken)
        monkeypatch.setattr(kernel, "interpreter", lambda build: None)
        plain = solve(features.Tank(), Mesh(20, 2))
        assert np.array_equal(by_interpreter.x, plain.x) and by_interpreter.iterations == plain.iterations
        assert np.array_equal(by_interpreter.multipliers, plain.multipliers)

    def test_one_library_for_all_meshes_of_equal_elements(self, folder):
        """Neither the mesh's size nor the points of its elements are part of what is compiled: one point is."""
        solve(features.Tank(), Mesh(4, 2), solver=MACHINE)
        assert solve(features.Tank(), Mesh(7, 2), solver=MACHINE).seconds["compile"] == 0.0
        assert solve(features.Tank(rate=2.0), Mesh(4, 2), solver=MACHINE).status.converged
        assert solve(features.Tank(), Mesh(4, 3), solver=MACHINE).seconds["compile"] == 0.0
        assert len(list(folder.glob("*.so"))) == 1

    def test_parametric_and_linked_problems(self):
        road = transcribe(features.Tank(), Mesh(4, 2), solver=MACHINE)
        plain = transcribe(features.Tank(), Mesh(4, 2))
        assert road.solve({"rate": 2.0}).objective == plain.solve({"rate": 2.0}).objective
        linked = [solve_phases(problems.two_phases(), Mesh(6, 2), solver=SolverOptions(compile=c)) for c in (0, 1)]
        assert linked[0].objective == linked[1].objective

    @pytest.mark.parametrize(
        "spoil",
        [
            pytest.param(lambda whole: b"", marks=pytest.mark.proof),
            pytest.param(lambda whole: whole[: len(whole) // 2], marks=pytest.mark.proof),
            lambda whole: whole[:-1] + bytes([whole[-1] ^ 1]),
            lambda whole: b"\x7fELF" + bytes(200),
            pytest.param(lambda whole: b"no library", marks=pytest.mark.proof),
        ],
    )
    def test_a_spoilt_library_is_built_anew(self, folder, spoil):
        plain = solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
        (library,) = folder.glob("*.so")
        exchange(library, spoil(library.read_bytes()))
        for compiled in (True, False):
            again = solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
            assert again.objective == plain.objective and (again.seconds["compile"] > 0.0) == compiled

    def test_a_library_that_does_not_load_is_built_anew(self, folder):
        """Whole, by its own hash, but for another machine."""
        objective = solve(features.Tank(), Mesh(3, 2), solver=MACHINE).objective
        gc.collect()  # what is loaded answers to its path, whatever stands there by now
        (library,) = folder.glob("*.so")
        exchange(library, b"of another machine")
        library.with_suffix(".sha256").write_text(hashlib.sha256(b"of another machine").hexdigest())
        again = solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
        assert again.objective == objective and again.seconds["compile"] > 0.0

    @pytest.mark.skipif(not hasattr(os, "getuid"), reason="no such rights on Windows")
    @pytest.mark.parametrize(
        "mode", [*(pytest.param(m, marks=pytest.mark.proof) for m in (0o770, 0o707, 0o1777)), 0o720, 0o702]
    )
    def test_what_others_may_write_is_not_executed(self, folder, mode):
        """Neither from a folder of theirs, nor from one below it."""
        solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
        folder.chmod(mode)
        with pytest.raises(CompilerMissing, match="can be written by other users"):
            solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
        folder.chmod(0o700)
        if not mode & stat.S_ISVTX:
            folder.parent.chmod(mode)
            with pytest.raises(CompilerMissing, match="can be written by other users"):
                solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
            folder.parent.chmod(0o700)
        (library,) = folder.glob("*.so")
        library.chmod(mode & 0o777)
        assert solve(features.Tank(), Mesh(3, 2), solver=MACHINE).seconds["compile"] > 0.0
        assert library.stat().st_mode & 0o777 == 0o700

    @pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away")
    def test_what_belongs_to_others_is_not_executed(self, folder):
        solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
        (library,) = folder.glob("*.so")
        os.chown(library, 12345, 12345)
        assert solve(features.Tank(), Mesh(3, 2), solver=MACHINE).seconds["compile"] > 0.0
        assert library.stat().st_uid == 0
        os.chown(folder, 12345, 12345)
        with pytest.raises(CompilerMissing, match="belongs to another user"):
            solve(features.Tank(), Mesh(3, 2), solver=MACHINE)

    def test_a_folder_is_made_for_its_owner_alone(self, folder):
        before = os.umask(0o002)
        try:
            solve(features.Tank(), Mesh(3, 2), solver=MACHINE)
        finally:
            os.umask(before)
        assert folder.stat().st_mode & 0o022 == 0

    def test_a_folder_that_cannot_be_written(self, tmp_path, monkeypatch):
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "file" / "below"))
        with pytest.raises(CompilerMissing, match=r"cannot write to .* set GTMODEL_CACHE to another folder"):
            solve(features.Tank(), Mesh(2, 1), solver=MACHINE)

    @pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows does not ask for HOME")
    def test_an_empty_home_counts_as_one_that_is_not_set(self, monkeypatch):
        for name in ("GTMODEL_CACHE", "XDG_CACHE_HOME"):
            monkeypatch.setenv(name, "")
        monkeypatch.delenv("HOME", raising=False)
        without = cache_folder()
        monkeypatch.setenv("HOME", "")
        assert cache_folder() == without != Path("/.cache/gtmodel")

        def nobody(uid):
            raise KeyError(uid)

        monkeypatch.setattr("pwd.getpwuid", nobody)
        with pytest.raises(CompilerMissing, match=r"there is no home folder .* set GTMODEL_CACHE"):
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
