"""Where the files lie that are not Python: ``problems/`` and ``codegen/``.

In a clone (and its editable install) they stand at the top, beside the package; a wheel carries them inside
it, as ``gtmodel/_data/``. Nothing else in gtmodel should know the difference.
"""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def _shipped(name: str) -> Path:
    # `_data` exists in an installed wheel only. It is asked first: beside an installed package
    # lie other people's packages, and one of them may be called `problems`.
    inside = _PACKAGE / "_data" / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


def problems_dir() -> Path:
    """Folder of the declared problems, one TOML each, with their ``data/`` beside them."""
    return _shipped("problems")


def codegen_dir() -> Path:
    """Folder of the hand-written C99 that generated code is delivered with."""
    return _shipped("codegen")
