"""costs.json: what a generated folder costs on one machine, beside the manifest that is the same everywhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from .errors import GenerationError
from .manifest import read
from .measurement import Costs
from .toolchain import STANDARD

COSTS = "costs.json"
_FORMAT = "gtmodel-c-costs-1"


def write_costs(folder: Path, costs: Costs) -> Path:
    """Write code size, stack and instructions by C name into the generated `folder`; the file.

    They depend on compiler and machine, so that they stand beside the manifest, named by its hash of the bodies;
    generating again takes them away. Raises GenerationError for a folder that is not generated, and for a file of
    another origin.
    """
    content, path = read(folder), folder / COSTS
    if content is None or (path.exists() and not _ours(path)):
        raise GenerationError(f"'{path}' was not written by gtmodel; move it away")
    found: dict[str, Any] = {
        "format": _FORMAT,
        "body_sha256": content["body_sha256"],
        "flags": list(STANDARD),
        "missing": costs.missing,
        "text_bytes": costs.text_bytes,
        "newton_bytes": costs.newton_bytes,
        "stack_bytes": costs.stack_bytes,
        "instructions": costs.instructions,
    }
    try:
        path.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8", newline="\n")
    except OSError as error:
        raise GenerationError(f"'{path}' cannot be written: {error.strerror}") from None
    return path


def discard(folder: Path) -> None:
    """Take away costs of an earlier generation; another file of that name stays."""
    if _ours(folder / COSTS):
        (folder / COSTS).unlink()


def _ours(path: Path) -> bool:
    try:
        return json.loads(path.read_text(encoding="utf-8")).get("format") == _FORMAT
    except (OSError, ValueError, AttributeError):
        return False
