"""Cache of syntax trees: the same tree, from a folder that only this user can write, complete or not at all."""

from __future__ import annotations

import gc
import os
import shutil
import threading
import time
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel.modelica import reader, trees as kept
from gtmodel.modelica.trees import packed
from tests.modelica import texts

pytest.importorskip("lark")
MODELS = Path(__file__).parents[2] / "problems" / "models"
TEXTS = {
    **{f.name: f.read_text() for f in (*MODELS.glob("*.mo"), *MODELS.glob("*.mop"))},
    "standard.mo": (Path(reader.__file__).with_name("standard.mo")).read_text(),
    "tank.mop": texts.TANK, "marine.mop": texts.MARINE,
}  # fmt: skip


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("GTMODEL_CACHE", str(folder))
    monkeypatch.setattr(kept, "SHORTEST", 0)
    return folder / "modelica"


def trees(cache: Path) -> list[Path]:
    return sorted(cache.glob("*.tree"))


@pytest.mark.parametrize("name", TEXTS)
def test_a_cached_tree_equals_the_original(cache: Path, name: str) -> None:
    parsed = reader.parse(TEXTS[name], name)
    assert reader.known(TEXTS[name], name) is not parsed and len(trees(cache)) == 1
    source = reader.Source("elsewhere", TEXTS[name])
    back = kept.tree(source)
    assert back is not None and packed(back) == packed(parsed)
    walked = [c for top in back for c in top.walk()]
    assert [c.full_name for c in walked] == [c.full_name for top in parsed for c in top.walk()]
    assert all(c.at.source is source for c in walked)


def test_a_text_is_parsed_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader.known(texts.TANK, "a.mop")
    monkeypatch.setattr(reader, "parse", lambda *_: pytest.fail("parsed again"))
    with pytest.raises(gt.modelica.ModelicaError, match=r"no class 'Hodl'.*Hold"):
        (cache / "b.mop").write_text(texts.TANK)
        monkeypatch.setattr("gtmodel.modelica.scopes._BUILT_IN", cache / "b.mop")
        gt.modelica.load(f"{cache / 'b.mop'}:Hodl")


def test_another_text_grammar_or_version_is_another_tree(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader.known(texts.TANK, "a.mop")
    reader.known(texts.TANK + "\n", "a.mop")
    monkeypatch.setattr(kept, "version", lambda: "another")
    reader.known(texts.TANK, "a.mop")
    assert len(trees(cache)) == 3


@pytest.mark.parametrize("damage", [b"", b"{}", b"0" * 64 + b"\nnothing", None], ids=["empty", "short", "hash", "cut"])
def test_a_damaged_tree_is_replaced(cache: Path, damage: bytes | None) -> None:
    reader.known(texts.TANK, "a.mop")
    (file,) = trees(cache)
    whole = file.read_bytes()
    file.write_bytes(whole[:-7] if damage is None else damage)
    assert kept.tree(reader.Source("a.mop", texts.TANK)) is None
    reader.known(texts.TANK, "a.mop")
    assert file.read_bytes() == whole


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="this system has no owners of files")
def test_a_folder_that_others_can_write_is_not_used(cache: Path) -> None:
    reader.known(texts.TANK, "a.mop")
    source = reader.Source("a.mop", texts.TANK)
    (file,) = trees(cache)
    file.chmod(0o666)
    assert kept.tree(source) is None
    file.chmod(0o600)
    assert kept.tree(source) is not None
    cache.chmod(0o777)
    assert kept.folder() is None and kept.tree(source) is None
    reader.known(texts.TANK + " ", "a.mop")
    assert len(trees(cache)) == 1


def test_texts_are_read_without_a_writable_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GTMODEL_CACHE", str(tmp_path / "file"))
    assert kept.folder() is None and reader.known(texts.TANK, "a.mop")


def test_all_trees_together_are_bounded(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for n in range(4):
        reader.known(texts.TANK + " " * n, "a.mop")
        (newest,) = [f for f in trees(cache) if time.time() - f.stat().st_mtime < 50]
        os.utime(newest, (time.time() - 1000 + n, time.time() - 1000 + n))
    files = sorted(trees(cache), key=lambda f: f.stat().st_mtime)
    monkeypatch.setattr(kept, "LARGEST", 3 * files[0].stat().st_size)
    reader.known(texts.TANK + "\n", "a.mop")
    assert len(trees(cache)) == 3 and files[3].exists() and not files[0].exists() and not files[1].exists()


def test_concurrent_reads_and_writes(cache: Path) -> None:
    """Every reader sees a whole tree or none, and nothing is left over."""
    source, wrong = reader.Source("a.mop", texts.TANK), []
    parsed = reader.parse(texts.TANK, "a.mop")
    plain = packed(parsed)
    cache.mkdir(parents=True, mode=0o700)

    def work() -> None:
        for _ in range(20):
            kept.keep(source, parsed)
            back = kept.tree(source)
            if back is not None and packed(back) != plain:
                wrong.append(back)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert not wrong and len(list(cache.iterdir())) == 1
    gc.collect()


def test_only_files_with_a_class_of_the_name_are_parsed(cache: Path, tmp_path: Path) -> None:
    """A folder of files without package.mo: one that is broken does no harm to who needs others."""
    folder = tmp_path / "library"
    folder.mkdir()
    (folder / "Broken.mo").write_text("model Broken this is no Modelica end")
    several = "model Rate Real x(start = 1, fixed = true); end Rate; /* model */ model Other end Other;"
    (folder / "two.mo").write_text(several)
    inside = "// of a package\nwithin Parts;\nmodel Inside extends Rate; equation der(x) = -x; end Inside;"
    (folder / "Inside.mo").write_text(inside)
    file = tmp_path / "m.mo"
    file.write_text("model M Parts.Inside p; end M; model N Broken b; end N;")
    assert gt.modelica.load(f"{file}:M", library=[folder])().simulate(1.0).trajectory["p.x"][-1] == pytest.approx(
        0.3679, abs=1e-4
    )
    with pytest.raises(gt.modelica.ModelicaError, match=r"Broken\.mo:1"):
        gt.modelica.load(f"{file}:N", library=[folder])


def test_a_package_in_folders_is_read_class_by_class(cache: Path, tmp_path: Path) -> None:
    package = tmp_path / "Plant"
    package.mkdir()
    (package / "package.mo").write_text("package Plant end Plant;")
    (package / "Tank.mo").write_text("within Plant; model Tank Real h = 2*time; end Tank;")
    (package / "Broken.mo").write_text("within Plant; model Broken")
    file = tmp_path / "m.mo"
    file.write_text("model M Plant.Tank t; end M;")
    gt.modelica.load(file, library=[package])
    assert len(trees(cache)) == 4  # standard.mo, package.mo, Tank.mo and the text
    shutil.rmtree(package)
    with pytest.raises(gt.modelica.ModelicaError, match="there is no library"):
        gt.modelica.load(file, library=[package])
