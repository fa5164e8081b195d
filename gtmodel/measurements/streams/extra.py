"""Libraries of the extra "logs": imported where a file needs one, a sentence where it is not there."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from .form import LogError


def needed(module: str, what: str) -> ModuleType:
    """A module of the extra. Raises LogError where it is not installed.

    what: the file that needs it, as "x.parquet is a Parquet file".
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise LogError(f"{what}, and {package} is not installed; pip install 'gtmodel[logs]'") from error
