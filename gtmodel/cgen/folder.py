"""Writing a generated folder: generated files are replaced, files of the user never."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..results.folder import FolderError, Held, holding, others, unfinished
from .code_result import COSTS
from .costs_file import ours
from .manifest import FILE, changed_files, lacks, read
from .real import GenerationError


@contextmanager
def held(out: Path, overwrite: bool = False) -> Iterator[Held]:
    """Lock the folder for this process, before the work begins; first complete or undo an interrupted write.

    Raises GenerationError as `write`, and also if the folder cannot be written or another run has locked it.
    """
    if not unfinished(out):
        _earlier(out, overwrite)
    try:
        with holding(out) as locked:
            _earlier(out, overwrite)
            yield locked
    except FolderError as error:
        raise GenerationError(f"'{out}' {error}", "folder") from error


def write(out: Path | Held, files: Mapping[str, str], content: Mapping[str, Any], overwrite: bool) -> None:
    """Write `files` and the manifest `content` into `out`, and remove other files of an earlier generation: all or
    nothing.

    Raises GenerationError if gtmodel did not write the folder `out`, if it holds a file of another origin under one of
    the names in `files`, and, unless `overwrite`, if somebody changed a generated file by hand.
    """
    if isinstance(out, Path):
        with held(out, overwrite) as locked:
            return write(locked, files, content, overwrite)
    path = out.path
    earlier = _earlier(path, overwrite)
    strangers = [file for file in sorted(files) if file not in earlier and (path / file).exists()]
    if strangers:
        raise GenerationError(f"'{path / strangers[0]}' was not written by gtmodel; choose another folder", "folder")
    texts = {**files, FILE: json.dumps(content, indent=2) + "\n"}
    gone = earlier | ({COSTS} if ours(path / COSTS) else set())
    try:
        out.write({file: text.encode() for file, text in texts.items()}, remove=gone - set(texts))
    except FolderError as error:
        raise GenerationError(f"'{path}' {error}", "folder") from error


def _earlier(out: Path, overwrite: bool) -> set[str]:
    """Return the names of the files of an earlier generation; none for a new or empty folder."""
    if out.exists() and not out.is_dir():
        raise GenerationError(f"'{out}' is a file; give a folder for the generated code", "folder")
    if not out.exists() or not others(out):
        return set()
    content = read(out)
    if content is None:
        raise GenerationError(f"'{out}' is not empty and {lacks(out)}; choose a new or an empty folder", "folder")
    changed = [file for file in changed_files(out, content) if (out / file).exists()]
    if changed and not overwrite:
        raise GenerationError(
            f"'{out / changed[0]}' was changed since gtmodel wrote it; move it away, or allow overwriting", "folder"
        )
    return set(content["files"])
