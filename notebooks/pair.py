"""Write NAME.ipynb beside each percent script NAME.py here, without outputs: `python notebooks/pair.py`.

Edit the scripts only. The same script always gives the same bytes: the id of a cell is a hash of its text.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import jupytext
import nbformat

HERE = Path(__file__).resolve().parent


def scripts() -> list[Path]:
    """The percent scripts, in reading order."""
    return sorted(HERE.glob("[0-9][0-9]_*.py"))


def notebook(script: Path) -> nbformat.NotebookNode:
    """The notebook of a script: without outputs, with ids that are hashes of the cells."""
    node = jupytext.read(script, fmt="py:percent")
    node.nbformat, node.nbformat_minor = 4, 5  # the first version with ids
    counts: dict[str, int] = {}
    for cell in node.cells:
        digest = hashlib.sha256(f"{cell.cell_type}\n{cell.source}".encode()).hexdigest()[:12]
        counts[digest] = counts.get(digest, 0) + 1
        cell.id = digest if counts[digest] == 1 else f"{digest}-{counts[digest]}"
    nbformat.validate(node)
    return node


def text(script: Path) -> str:
    """The .ipynb file of a script."""
    return nbformat.writes(notebook(script), version=nbformat.NO_CONVERT) + "\n"


def main() -> None:
    """Write all notebooks."""
    for script in scripts():
        script.with_suffix(".ipynb").write_text(text(script), encoding="utf-8", newline="\n")
        print(script.with_suffix(".ipynb").name)


if __name__ == "__main__":
    main()
