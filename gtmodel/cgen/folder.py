"""Writing a generated folder: ours is replaced, a person's never."""

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
    """The folder for this process alone, tried before the work; a write that broke off is settled first.

    Raises GenerationError as `write` does for the folder, where it cannot be written, and while another run has it.
    """
    if not unfinished(out):
        _earlier(out, overwrite)
    try:
        with holding(out) as mine:
            _earlier(out, overwrite)
            yield mine
    except FolderError as error:
        raise GenerationError(f"'{out}' {error}", "folder") from error


def write(out: Path | Held, files: Mapping[str, str], content: Mapping[str, Any], overwrite: bool) -> None:
    """Write `files` and the manifest `content` into `out`, and remove what only an earlier generation wrote: all or
    nothing.

    Raises GenerationError if `out` is somebody else's folder or holds a file of another origin under one of our
    names, and, unless `overwrite`, if a file of ours was changed by hand.
    """
    if isinstance(out, Path):
        with held(out, overwrite) as mine:
            return write(mine, files, content, overwrite)
    place = out.path
    earlier = _earlier(place, overwrite)
    strangers = [file for file in sorted(files) if file not in earlier and (place / file).exists()]
    if strangers:
        raise GenerationError(f"'{place / strangers[0]}' was not written by gtmodel; choose another folder", "folder")
    texts = {**files, FILE: json.dumps(content, indent=2) + "\n"}
    gone = earlier | ({COSTS} if ours(place / COSTS) else set())
    try:
        out.write({file: text.encode() for file, text in texts.items()}, remove=gone - set(texts))
    except FolderError as error:
        raise GenerationError(f"'{place}' {error}", "folder") from error


def _earlier(out: Path, overwrite: bool) -> set[str]:
    """Names of the files that an earlier generation wrote; none for a new or empty folder."""
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
