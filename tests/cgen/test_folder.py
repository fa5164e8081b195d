"""A person's files are never touched; ours are replaced."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest

from gtmodel import Status, cgen
from gtmodel._files import codegen_dir
from gtmodel.cgen import manifest as manifests
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.manifest import changed_entries
from gtmodel.cgen.real import DOUBLE, FLOAT, FLOAT_TOLERANCE
from gtmodel.results.check import failed_of
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
    assert caught.value.argument == "folder" and caught.value.message == (
        f"'{tmp_path}' is not empty and was not written by gtmodel: it holds no manifest.json; "
        "choose a new or an empty folder"
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


def test_the_contract_is_one_page_and_in_every_readme(small_folder: Path) -> None:
    page = (codegen_dir() / "contract.md").read_text()
    docs = Path(__file__).parents[2] / "docs" / "c_contract.md"
    assert docs.read_text().endswith(page) and len(docs.read_text().splitlines()) < 66
    assert page in (small_folder / "README.md").read_text()
    for status in Status:
        assert f"`{status.c_name}`" in page
    for number in (DOUBLE.pivot, FLOAT.pivot, DOUBLE.residual, FLOAT.residual, FLOAT_TOLERANCE):
        assert re.search(rf"\b{re.escape(f'{number:.0e}'.replace('e-0', 'e-'))}\b", page), number


def test_measured_costs_stand_beside_the_manifest(small: Functions, tmp_path: Path) -> None:
    folder = cgen.generate(small, tmp_path / "s", name="s").folder
    manifest = (folder / "manifest.json").read_bytes()
    costs = cgen.Costs({"gt_s_slider": 100}, {}, {"gt_s_slider": 64}, {"gt_s_slider": 50})
    assert json.loads(cgen.write_costs(folder, costs).read_text())["instructions"] == {"gt_s_slider": 50}
    cgen.generate(small, folder, name="s")
    assert (folder / "manifest.json").read_bytes() == manifest and not (folder / "costs.json").exists()
    (folder / "costs.json").write_text("[mine]")
    with pytest.raises(cgen.GenerationError, match="was not written by gtmodel"):
        cgen.write_costs(folder, costs)
    cgen.generate(small, folder, name="s")
    assert (folder / "costs.json").read_text() == "[mine]"


def test_a_box_is_checked(small: Functions, tmp_path: Path) -> None:
    pendulum = {"pendulum": small["pendulum"]}
    good = {"x[1]": [[-0.9, 0.9]], "der(x[1])": [[-1.0, 1.0]]}
    reach = good | {"x[1]": [[-0.9, 1.1]]}
    for box, lost in ((good, False), (reach, True)):
        folder = cgen.generate(pendulum, tmp_path / "p", name="p", box=box).folder
        assert json.loads((folder / "manifest.json").read_text())["functions"][0]["box"] == box
        failed = list(failed_of(cgen.check(folder, pendulum, points=20).checks))
        assert failed == (["pendulum_box_without_answer"] if lost else [])
    for box, message in (
        ({"y": [[0.0, 1.0]]}, "the box holds 'y', not an input"),
        (good | {"x[1]": [[0.0, 1.0]] * 2}, r"gives 2 intervals for 'x\[1\]'; give 1"),
        (good | {"x[1]": [[1.0, 0.0]]}, r"gives \[1.0, 0.0\] for 'x\[1\]'; give \[least, greatest\]"),
    ):
        with pytest.raises(cgen.GenerationError, match=message):
            cgen.generate(pendulum, tmp_path / "q", name="q", box=box)


@pytest.mark.parametrize("tampered", ["GT_PIVOT_TOLERANCE (1e-07)", "total <= "])
def test_a_changed_guard_is_seen_even_where_its_hash_was_mended(
    tampered: str, small: Functions, small_folder: Path, tmp_path: Path
) -> None:
    """No random point lies between a limit and a limit that was moved."""
    folder = copy(small_folder, tmp_path)
    wrapper, manifest = folder / "gt_small.c", folder / "manifest.json"
    changed = {"GT_PIVOT_TOLERANCE (1e-07)": "GT_PIVOT_TOLERANCE (2e-07)", "total <= ": "total <= 1e3 * "}[tampered]
    text = wrapper.read_text()
    assert tampered in text
    wrapper.write_text(text.replace(tampered, changed, 1))
    content = json.loads(manifest.read_text())
    content["files"]["gt_small.c"] = hashlib.sha256(wrapper.read_bytes()).hexdigest()
    manifest.write_text(json.dumps(content))
    report = cgen.check(folder, small, points=20)
    assert list(failed_of(report.checks)) == ["files_not_as_generated"]


def test_a_manifest_of_other_numbers_loads_nothing(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    """Code in double that is called as float would write beyond its places."""
    folder = copy(small_folder, tmp_path)
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"real": "double"', '"real": "float"'))
    report = cgen.check(folder, small, points=20)
    assert not report.passed and report.rows == {}


def leaves(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Paths to all that is neither list nor dictionary."""
    if isinstance(value, dict):
        return [p for key, inner in value.items() for p in leaves(inner, (*path, key))]
    if isinstance(value, list):
        return [p for n, inner in enumerate(value) for p in leaves(inner, (*path, n))]
    return [path]


def test_every_changed_entry_of_a_manifest_is_seen(
    small: Functions, small_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Limits, pivot tolerance and parameter values stand there for other tools; no C code reads them. All numbers and
    texts but the name, by which files are called, and what a folder can only say of itself."""
    faces = interfaces(small, "small", (), DOUBLE, None)
    content = json.loads((small_folder / "manifest.json").read_text())
    assert changed_entries(content, faces) == []
    # what this gtmodel writes does not depend on the entries that are changed below: it is made once
    here = manifests.manifest(content["name"], faces, content["provenance"], {}, {}, {})
    monkeypatch.setattr(manifests, "manifest", lambda *given: json.loads(json.dumps(here)))
    ours = {
        key: content[key] for key in ("format", "real", "compile", "pivot_tolerance", "statuses", "functions", "models")
    }
    paths = leaves(ours)
    assert {path[-1] for path in paths} >= {"pivot_tolerance", "value", "scale", "sentence"}
    assert any("limits" in path for path in paths)
    for path in paths:
        changed = json.loads(json.dumps(content))
        place = changed
        for key in path[:-1]:
            place = place[key]  # type: ignore[index]
        old = place[path[-1]]  # type: ignore[index]
        number = isinstance(old, int | float) and not isinstance(old, bool)
        place[path[-1]] = old * (1 + 1e-12) + 1e-300 if number else f"{old}?"  # type: ignore[index]
        named = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)[1:]
        assert changed_entries(changed, faces) == [named]


@pytest.mark.parametrize("key", ["limits", "pivot_tolerance", "parameters", "body_sha256"])
def test_a_check_names_the_changed_entry(key: str, small: Functions, small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    manifest = folder / "manifest.json"
    content = json.loads(manifest.read_text())
    if key == "limits":
        limits = content["functions"][0]["limits"]
        limits[next(iter(limits))] *= 2
    elif key == "parameters":
        next(m for m in content["models"] if m["parameters"])["parameters"][0]["value"] *= 2
    elif key == "body_sha256":
        content[key] = "0" * 64
    else:
        content[key] *= 2
    manifest.write_text(json.dumps(content))
    failed = failed_of(cgen.check(folder, small, points=20).checks)
    assert list(failed) == ["manifest_not_as_generated"] and key in failed["manifest_not_as_generated"].advice


@pytest.mark.parametrize(
    "path", [("name",), ("provenance",), ("files",), ("functions",), ("functions", 0), ("functions", 0, "box"),
             ("functions", 0, "name"), ("functions", 0, "symbol"), ("functions", 0, "inputs")]
)  # fmt: skip
@pytest.mark.parametrize("spoilt", [5, "x", [1]])
def test_a_manifest_of_another_form_is_refused(
    path: tuple[str | int, ...], spoilt: object, small: Functions, small_folder: Path, tmp_path: Path
) -> None:
    folder = copy(small_folder, tmp_path)
    content = place = json.loads((folder / "manifest.json").read_text())
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = spoilt
    (folder / "manifest.json").write_text(json.dumps(content))
    with pytest.raises(cgen.GenerationError):
        cgen.check(folder, small, points=20)
