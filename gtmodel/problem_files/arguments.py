"""From an argument that a library refused to the key of the file that holds it."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pydantic

from gtmodel.results.unit_names import split

from .fields import keys_of, tables_of

_INDEX = re.compile(r"\[\d+\]")


def key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
    """The dotted key of an argument: ("map.step", {"map": "section"}) is "section.step_m" where that key exists.

    renamed: arguments, or their beginnings, that stand elsewhere in the file; the longest that fits counts. Any entry
    of a list is written "rows[]" there; "rows[1].name" is then at "row[1].name". What has no key is said under its own
    name.
    """
    indices = _INDEX.findall(argument)
    key = _key_of(schema, _INDEX.sub("[]", argument), renamed)
    counted = iter(indices[len(indices) - key.count("[]") :])
    return re.sub(r"\[\]", lambda _: next(counted, "[]"), key)


def _key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
    parts = argument.split(".")
    for n in range(len(parts), 0, -1):
        head = ".".join(parts[:n])
        if head in renamed:
            parts = [p for p in (renamed[head], *parts[n:]) if p]
            break
    wanted = ".".join(parts)
    plain = _NUMBER.sub("[]", wanted)
    if plain in tables_of(schema):
        return wanted
    numbers = iter(_NUMBER.findall(wanted))
    found = (key.key for key in keys_of(schema) if plain in (key.key, _stem(key.key)))
    return next((_EMPTY.sub(lambda _: next(numbers), key) for key in found), wanted)


def _stem(key: str) -> str:
    return ".".join(split(part)[0] for part in key.split("."))
