"""costs.json: costs of a generated folder on one machine. The manifest, in contrast, is the same on every machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..compiler.toolchain import STANDARD
from ..results.folder import FolderError, Held, holding
from ..results.read_bounds import json_of
from .code_result import COSTS
from .manifest import read
from .measurement import Costs
from .real import GenerationError

_FORMAT = "gtmodel-c-costs-1"


def write_costs(out: Path | Held, costs: Costs) -> Path:
    """Write code size, stack and instructions by C name into the generated folder `out`; return the file's path.

    They depend on compiler and machine, so they are not in the manifest but in a file of their own, costs.json, which
    holds the hash of the bodies that were measured. Generating again deletes the file. Raises GenerationError if
    gtmodel did not generate the folder, or if it holds a costs.json of another origin.

    >>> import tempfile
    >>> from pathlib import Path
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> with tempfile.TemporaryDirectory() as place:
    ...     made = gt.cgen.generate({"fk": robot.causal(known="q", targets="T")}, place, name="l1")
    ...     file = gt.cgen.write_costs(Path(place), gt.cgen.Costs(stack_bytes={"gt_l1_fk": 480}))
    >>> file.suffix
    '.json'
    """
    path = (out if isinstance(out, Path) else out.path) / COSTS
    content = read(path.parent)
    if content is None or (path.exists() and not ours(path)):
        raise GenerationError(f"'{path}' was not written by gtmodel; move it away")
    if isinstance(out, Path):
        try:
            with holding(out) as locked:
                return write_costs(locked, costs)
        except FolderError as error:
            raise GenerationError(f"'{out}' {error}") from error
    measured: dict[str, Any] = {
        "format": _FORMAT,
        "body_sha256": content["body_sha256"],
        "flags": list(STANDARD),
        **{
            key: getattr(costs, key) for key in ("missing", "text_bytes", "newton_bytes", "stack_bytes", "instructions")
        },
    }
    out.write({COSTS: (json.dumps(measured, indent=2) + "\n").encode()})
    return path


def ours(path: Path) -> bool:
    """True if gtmodel wrote the file; another file with this name belongs to the user."""
    try:
        return json_of(path.read_text(encoding="utf-8")).get("format") == _FORMAT
    except (OSError, ValueError, AttributeError):
        return False
