"""Write NAME.ipynb beside each percent script NAME.py here, without outputs: `python notebooks/pair.py`.

The scripts are what is edited. The same script always gives the same bytes: an id of a cell is made from its text.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import jupytext
import nbformat

HERE = Path(__file__).resolve().parent


def scripts() -> list[Path]:
    """The percent scripts, in the order in which they are to be read."""
    return sorted(HERE.glob("[0-9][0-9]_*.py"))


def notebook(script: Path) -> nbformat.NotebookNode:
    """The notebook of a script: no outputs, ids from the cells' texts."""
    made = jupytext.read(script, fmt="py:percent")
    made.nbformat, made.nbformat_minor = 4, 5  # the first version with ids
    seen: dict[str, int] = {}
    for cell in made.cells:
        digest = hashlib.sha256(f"{cell.cell_type}\n{cell.source}".encode()).hexdigest()[:12]
        seen[digest] = seen.get(digest, 0) + 1
        cell.id = digest if seen[digest] == 1 else f"{digest}-{seen[digest]}"
    nbformat.validate(made)
    return made


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
