"""The folder of a study. gtmodel replaces only files that it wrote and that nobody changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from .as_json import result
from .disk import marked
from .folder import FolderError, Held, holding, others, refuse_impossible, unfinished
from .pictures import png
from .read_bounds import toml_of
from .refusal import ArgumentError
from .trajectory_files import TRAJECTORY, csv_bytes
from .versions import OURS, versions

if TYPE_CHECKING:
    from .study import Study

RUN = "run.toml"
RESULT = "result.json"
SCENE = ".scene.json"  # ending of the names of files with scenes, which gtmodel view shows
MOTION = "motion"  # name of a scene that needs no such file


def refuse_foreign(folder: Path) -> None:
    """Raises ArgumentError unless the folder is new, empty, or contains an unchanged earlier result."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ArgumentError(f"{folder} is a file; name a folder", "folder")
    try:
        if not others(folder):
            return
    except OSError as error:
        raise ArgumentError(f"{folder} cannot be read: {error.strerror}", "folder") from error
    written = _written(folder)
    if written is None:
        raise ArgumentError(
            f"{folder} contains files that gtmodel did not write; name a new folder or empty this one", "folder"
        )
    for name, digest in written.items():
        path = folder / name
        if path.is_file() and sha256(path.read_bytes()) != digest:
            raise ArgumentError(f"{path} was changed after gtmodel wrote it; move it away or name another folder")


@contextmanager
def held(folder: Path, notice: Callable[[str], object]) -> Iterator[Held]:
    """Lock the folder for this run, before the work; first finish what an earlier run left, and tell `notice`.

    Raises ArgumentError as `refuse_foreign` does, if the folder cannot be written, and while another run uses it.
    """
    try:
        refuse_impossible(folder)
        if not unfinished(folder):
            refuse_foreign(folder)
        with holding(folder) as locked:
            refuse_foreign(folder)
            if locked.message:
                notice(locked.message)
            yield locked
    except FolderError as error:
        shown = str(folder) if str(folder).isprintable() else repr(str(folder))
        raise ArgumentError(f"{shown} {error}", "folder") from error


def _written(folder: Path) -> dict[str, str] | None:
    """File names and hashes of an earlier result; None if the folder has none."""
    try:
        run = toml_of((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    files = run.get("files")
    if run.get("program") != OURS or not isinstance(files, dict):
        return None
    return {name: str(digest) for name, digest in files.items() if name == Path(name).name}


def write(study: Study, folder: Path, *, plot: bool, report: bool, write_failed: bool) -> list[Path]:
    """Write a study into a folder: result.json, its files, pictures and scenes with `plot`, the page with `report`, and
    run.toml. Raises ArgumentError."""
    with held(folder, lambda _: None) as target:
        study = for_machines(study, "write_failed" if write_failed else "")
        files = files_of(study, result("", None, study))
        faults = pictured(study, files) if plot else []
        faults += reported(study, files) if report else []
        paths = put(target, files, lambda files: record({}, None, files))
    if faults:
        raise ArgumentError(faults[0], "plot" if plot else "report")
    return paths


def files_of(study: Study, data: bytes) -> dict[str, bytes]:
    """Return contents by file name: result.json, trajectory.csv if there is a trajectory (marked if it must not be
    used), and the study's own files."""
    files = {RESULT: data}
    if study.trajectory is not None and study.status.ok:
        files[TRAJECTORY] = csv_bytes(study.trajectory)
    elif study.trajectory is not None and TRAJECTORY not in study.machine_files:
        files[TRAJECTORY] = marked(TRAJECTORY, csv_bytes(study.trajectory), study.message, by="")
    for name, content in study.files.items():
        files[name] = content.encode() if isinstance(content, str) else content
    return files


def scenes_of(study: Study) -> list[str]:
    """The names of the scenes that need a file: the motion follows from the trajectory."""
    return [name for name in study.scenes if name != MOTION]


def _scene(make: Callable[[], Any]) -> bytes:
    """The data of a scene, or a sentence about why it cannot be drawn."""
    try:
        return json.dumps(make().document(), ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
    except Exception as error:
        return json.dumps({"fault": f"{type(error).__name__}: {' '.join(str(error).split())}"}).encode()


def for_machines(study: Study, asked: str, by: str = "write_failed=True") -> Study:
    """Return a failed study without its files for machines, or with marks on them if `asked` names the option that
    requests them. by: name of that option for the message."""
    if study.status.ok:
        return study
    whole = dict(study.files)
    if study.trajectory is not None and TRAJECTORY in study.machine_files:
        whole[TRAJECTORY] = csv_bytes(study.trajectory)
    machine = [name for name in study.machine_files if name in whole]
    if not machine:
        return study
    message = study.message
    files = {name: content for name, content in whole.items() if name not in machine}
    if not asked:
        names = " and ".join(sorted(machine)) if len(machine) < 3 else f"{len(machine)} files for machines"
        message += f"; {names} {'is' if len(machine) == 1 else 'are'} not written; {by} writes all, marked"
        return study.with_(files=files, message=message)
    for name in machine:
        content = whole[name]
        raw = content.encode() if isinstance(content, str) else content
        files[name] = marked(name, raw, message, f", written by {asked}")
    return study.with_(files=files)


def put(
    folder: Held, files: dict[str, bytes], run: Callable[[Mapping[str, bytes]], bytes], programs: Collection[str] = ()
) -> list[Path]:
    """Write `files` and their run.toml into a folder, delete those of an earlier run, and return the paths written.

    Raises ArgumentError as `refuse_foreign` does, if gtmodel did not write an existing file, and if the folder cannot
    be written.
    """
    place = folder.path
    refuse_foreign(place)
    earlier = _written(place) or {}
    for name in files:
        if name not in earlier and (place / name).exists():
            raise ArgumentError(f"{place / name} was not written by gtmodel; move it away or name another folder")
    whole = {**files, RUN: run(files)}
    try:
        folder.write(whole, remove=set(earlier) - set(whole), programs=programs)
    except FolderError as error:
        raise ArgumentError(f"{place} {error}", "folder") from error
    return [place / name for name in whole]


def pictured(study: Study, files: dict[str, bytes]) -> list[str]:
    """Add the pictures and the scenes, without the motion, to `files`; return a sentence about each picture that cannot
    be drawn."""
    for name in scenes_of(study):
        files[f"{name}{SCENE}"] = _scene(partial(study.view, name))
    faults = []
    warning = "" if study.status.ok else f"{_not_ok(study)}: {study.message}"
    for name, draw in study.figures.items():
        file = name if name.endswith(".png") else f"{name}.png"
        try:
            files[file] = png(draw, warning)
        except Exception as error:
            fault = " ".join(str(error).split())
            faults.append(f"{file} could not be drawn ({type(error).__name__}: {fault}); please report it")
    return faults


def reported(study: Study, files: dict[str, bytes]) -> list[str]:
    """Add report.html to `files`, and return a sentence if it cannot be written."""
    from .page.page import REPORT, page  # here: a result without a report needs no page

    try:
        files[REPORT] = page(study, None if study.about is None else study.about(), sha256(files[RESULT])).encode()
    except Exception as error:
        fault = " ".join(str(error).split())
        return [f"{REPORT} could not be written ({type(error).__name__}: {fault}); please report it"]
    return []


def _not_ok(study: Study) -> str:
    return "check failed" if study.status.converged else "not solved"


def record(
    inputs: Mapping[str, Any], wall_s: float | None, files: Mapping[str, bytes], more: Mapping[str, Any] | None = None
) -> bytes:
    """Return run.toml: the inputs of a folder, and the hashes of its `files`, which reveal later changes."""
    run = {
        "program": OURS,
        **({} if wall_s is None else {"wall_s": wall_s}),
        "input": dict(inputs),
        "versions": versions(*(["rumoca"] if "flat" in inputs else [])),
        "files": {name: sha256(content) for name, content in files.items()},
        **(more or {}),
    }
    note = "# How this folder was made. gtmodel replaces the files listed here, as long as nobody changed them.\n"
    return (note + tomli_w.dumps(run)).encode()


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Return the hash of a file of any size; "" if there is no such file."""
    if not path.is_file():
        return ""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
