"""Writing a generated folder: ours is replaced, a person's never."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .costs_file import discard
from .errors import GenerationError
from .manifest import FILE, changed_files, lacks, read


def write(out: Path, files: Mapping[str, str], content: Mapping[str, Any], overwrite: bool) -> None:
    """Write `files` and the manifest `content` into `out`, and remove what only an earlier generation wrote.

    Raises GenerationError if `out` is somebody else's folder or holds a file of another origin under one of our
    names, and, unless `overwrite`, if a file of ours was changed by hand.
    """
    ours = _earlier(out, overwrite)
    strangers = [file for file in sorted(files) if file not in ours and (out / file).exists()]
    if strangers:
        raise GenerationError(f"'{out / strangers[0]}' was not written by gtmodel; choose another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
        discard(out)
        for file in sorted(ours - set(files)):
            (out / file).unlink(missing_ok=True)
        for file, text in files.items():
            (out / file).write_text(text, encoding="utf-8", newline="\n")
        (out / FILE).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8", newline="\n")
    except OSError as error:
        raise GenerationError(f"'{out}' cannot be written: {error.strerror}") from None


def _earlier(out: Path, overwrite: bool) -> set[str]:
    """Names of the files that an earlier generation wrote; none for a new or empty folder."""
    if out.exists() and not out.is_dir():
        raise GenerationError(f"'{out}' is a file; give a folder for the generated code")
    if not out.exists() or not any(out.iterdir()):
        return set()
    content = read(out)
    if content is None:
        raise GenerationError(f"'{out}' is not empty and {lacks(out)}; choose a new or an empty folder")
    changed = [file for file in changed_files(out, content) if (out / file).exists()]
    if changed and not overwrite:
        raise GenerationError(
            f"'{out / changed[0]}' was changed since gtmodel wrote it; move it away, or allow overwriting"
        )
    return set(content["files"])
