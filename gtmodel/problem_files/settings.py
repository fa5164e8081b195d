"""``--set limits.force_N=500``: any key of a problem file, changed for one run."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterable
from typing import Any

from gtmodel.results.read_bounds import toml_of

from .base import InputError
from .sentences import shown


def apply(data: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """The data of a problem file with settings "key=value" put in, later ones last; `data` stays as it is.

    A key is dotted; a number in it counts the tables of a list from 0, as in ``functions.0.name``. A value is
    read as TOML, and as text where it is none. Raises InputError for a text that is no setting.
    """
    changed = copy.deepcopy(data)
    for setting in settings:
        key, equals, text = setting.partition("=")
        path = [part.strip() for part in key.split(".")]
        if not equals or not all(path):
            raise InputError(f"--set {setting}: expected key=value, such as --set limits.force_N=500")
        _put(changed, path, _value(text), key.strip())
    return changed


def refuse_twice(settings: Iterable[str]) -> None:
    """Raises InputError for a setting that takes back an earlier one: which of them a person meant cannot be known."""
    earlier: list[list[str]] = []
    for setting in settings:
        path = [part.strip() for part in setting.partition("=")[0].split(".")]
        alike = [str(int(part)) if part.isdecimal() else part for part in path]  # 0 and 00 count the same entry
        for other in earlier:
            if other[: len(alike)] == alike:
                first, again = ".".join(other), ".".join(path)
                said = "is set twice" if other == alike else f"takes back the value that is set for {first}"
                raise InputError(f"--set {again} {said}; leave one of them out")
        earlier.append(alike)


def _value(text: str) -> Any:
    try:
        read = toml_of(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text.strip()
    return read["value"] if len(read) == 1 else text.strip()


def _put(data: Any, path: list[str], value: Any, key: str) -> None:
    for n, part in enumerate(path):
        last = n == len(path) - 1
        if isinstance(data, list):
            if not part.isdecimal() or int(part) >= len(data):
                raise InputError(f"has {len(data)} entries; '{part}' is none of 0 to {len(data) - 1}", key)
            index: Any = int(part)
        elif isinstance(data, dict):
            index = part
            if not last:
                data.setdefault(part, {})
        else:
            raise InputError(f"cannot be set: '{'.'.join(path[:n])}' is {shown(data)}, not a table", key)
        if last:
            data[index] = value
        else:
            data = data[index]
