"""Location of the files that are not Python: ``problems/`` and ``codegen/``.

In a clone (and its editable install) these folders are at the top, next to the package. A wheel contains them as
``gtmodel/_data/``. No other module of gtmodel should depend on the difference.
"""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def _shipped(name: str) -> Path:
    # `_data` exists in an installed wheel only. It comes first because another package, installed next to this one,
    # may be called `problems`.
    inside = _PACKAGE / "_data" / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


def problems_dir() -> Path:
    """Return the folder of the shipped problems, one TOML file each, with their ``data/``."""
    return _shipped("problems")


def codegen_dir() -> Path:
    """Return the folder of the hand-written C99 files that accompany generated code."""
    return _shipped("codegen")
