"""A person's files are never touched; ours are replaced."""

import json
import shutil
from pathlib import Path

import pytest

from gtmodel import cgen
from tests.cgen.conftest import Functions, copy


@pytest.fixture
def pendulum(small: Functions) -> Functions:
    return {"pendulum": small["pendulum"]}


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_a_users_folder_is_refused(pendulum: Functions, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("ten years of work")
    with pytest.raises(cgen.GenerationError) as caught:
        cgen.generate(pendulum, tmp_path, name="p", overwrite=True)
    assert str(caught.value) == (
        f"'{tmp_path}' is not empty and was not written by gtmodel; choose a new or an empty folder"
    )
    assert bytes_of(tmp_path) == {"thesis.tex": b"ten years of work"}


@pytest.mark.parametrize("text", ["", "[]", '{"name": "of another tool"}', '{"format": "gtmodel-c-1"}', "\x00"])
def test_a_foreign_manifest_is_refused(text: str, pendulum: Functions, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(cgen.GenerationError, match="was not written by gtmodel"):
        cgen.generate(pendulum, tmp_path, name="p")
    assert (tmp_path / "manifest.json").read_text() == text


def test_a_manifest_that_points_outside_is_refused(pendulum: Functions, tmp_path: Path) -> None:
    out = cgen.generate(pendulum, tmp_path / "out", name="p").folder
    precious = tmp_path / "precious.txt"
    precious.write_text("keep")
    content = json.loads((out / "manifest.json").read_text())
    content["files"]["../precious.txt"] = "0" * 64
    (out / "manifest.json").write_text(json.dumps(content))
    with pytest.raises(cgen.GenerationError, match="was not written by gtmodel"):
        cgen.generate(pendulum, out, name="p", overwrite=True)
    assert precious.read_text() == "keep"


def test_a_file_in_the_way_is_refused(pendulum: Functions, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(cgen.GenerationError, match="is a file; give a folder"):
        cgen.generate(pendulum, tmp_path / "out", name="p")
    with pytest.raises(cgen.GenerationError, match="cannot be written"):
        cgen.generate(pendulum, tmp_path / "out" / "deeper", name="p")


def test_empty_and_new_folders_are_filled(pendulum: Functions, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    a = cgen.generate(pendulum, tmp_path / "empty", name="p")
    b = cgen.generate(pendulum, tmp_path / "new" / "deep", name="p")
    assert bytes_of(a.folder) == bytes_of(b.folder)
    assert set(a.files) == set(bytes_of(a.folder)) and a.header.is_file()
    assert a.functions == {"pendulum": "gt_p_pendulum"}


def test_ours_is_replaced_and_the_users_files_stay(pendulum: Functions, small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    (folder / "notes.txt").write_text("mine")
    cgen.generate(pendulum, folder, name="p")
    assert not list(folder.glob("gt_small*")) and (folder / "gt_p.h").is_file()
    assert (folder / "notes.txt").read_text() == "mine"


def test_a_users_file_under_our_name_is_refused(pendulum: Functions, small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    (folder / "gt_p.h").write_text("mine")
    with pytest.raises(cgen.GenerationError, match=r"gt_p\.h' was not written by gtmodel"):
        cgen.generate(pendulum, folder, name="p", overwrite=True)
    assert (folder / "gt_p.h").read_text() == "mine"


def test_edited_files_need_permission(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    (folder / "gt_small.c").write_text("/* mended by hand */\n")
    with pytest.raises(cgen.GenerationError, match=r"gt_small\.c' was changed since gtmodel wrote it"):
        cgen.generate(small, folder, name="small")
    cgen.generate(small, folder, name="small", overwrite=True)
    assert bytes_of(folder) == bytes_of(small_folder)
    (folder / "gt_small.c").unlink()  # a file that is gone holds nobody's work
    cgen.generate(small, folder, name="small")
    assert bytes_of(folder) == bytes_of(small_folder)
    shutil.rmtree(folder)
