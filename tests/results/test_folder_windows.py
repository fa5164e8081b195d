"""Folders without file locks, as on Windows: the import holds, writes are whole, and no mark stays behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gtmodel.results import folder as module
from gtmodel.results.folder import MARK, holding, others, unfinished


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """No fcntl, no pwrite, and a file that is open cannot be taken away."""
    unlink, opened, close = os.unlink, os.open, os.close
    held: dict[int, str] = {}

    def open_(path: object, flags: int, mode: int = 0o777) -> int:
        number = opened(path, flags, mode)
        held[number] = str(path)
        return number

    def close_(number: int) -> None:
        held.pop(number, None)
        close(number)

    def unlink_(path: object) -> None:
        if str(path) in held.values():
            raise PermissionError(13, "The process cannot access the file because it is being used", str(path))
        unlink(path)

    monkeypatch.setattr(module, "fcntl", None)
    monkeypatch.delattr(os, "pwrite", raising=False)
    for name, made in (("open", open_), ("close", close_), ("unlink", unlink_)):
        monkeypatch.setattr(module.os, name, made)


def test_the_import_needs_no_locks() -> None:
    code = "import sys; sys.modules['fcntl'] = None; import gtmodel.problem_files.run; import gtmodel.results.folder"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures("windows")
def test_folders_are_written_and_left_without_a_mark(tmp_path: Path) -> None:
    for n in range(2):
        with holding(tmp_path / "a") as held:
            assert held.message == ""
            held.write({"x.txt": b"%d" % n})
        assert not unfinished(tmp_path / "a") and not (tmp_path / "a" / MARK).exists()
    assert others(tmp_path / "a") == ["x.txt"]
    assert (tmp_path / "a" / "x.txt").read_bytes() == b"1"


@pytest.mark.usefixtures("windows")
def test_a_folder_made_for_nothing_goes_again(tmp_path: Path) -> None:
    with holding(tmp_path / "a" / "b"):
        pass
    assert not (tmp_path / "a").exists()
