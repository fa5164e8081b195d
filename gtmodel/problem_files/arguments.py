"""From an argument that a library refused to the key of the file that holds it."""

from __future__ import annotations

from collections.abc import Mapping

import pydantic

from gtmodel.results.unit_names import split

from .fields import keys_of, tables_of


def key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
    """The dotted key of an argument: ("map.step", {"map": "section"}) is "section.step_m" where that key exists.

    renamed: arguments, or their beginnings, that stand elsewhere in the file; the longest that fits counts. What has
    no key is said under its own name.
    """
    parts = argument.split(".")
    for n in range(len(parts), 0, -1):
        head = ".".join(parts[:n])
        if head in renamed:
            parts = [p for p in (renamed[head], *parts[n:]) if p]
            break
    wanted = ".".join(parts)
    if wanted in tables_of(schema):
        return wanted
    return next((key.key for key in keys_of(schema) if wanted in (key.key, _stem(key.key))), wanted)


def _stem(key: str) -> str:
    return ".".join(split(part)[0] for part in key.split("."))
