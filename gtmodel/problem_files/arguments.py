"""From an argument that a library refused to the key of the file that holds it."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pydantic

from gtmodel.results.unit_names import split

from .fields import keys_of, tables_of

_ENTRY = re.compile(r"\[\d+\]")  # of a list of tables


def key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
    """The dotted key of an argument: ("map.step", {"map": "section"}) is "section.step_m" where that key exists,
    "obstacles[1].high" is "obstacles[1].high_m".

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
    listed = _ENTRY.sub("[]", wanted)
    found = next((key.key for key in keys_of(schema) if listed in (key.key, _stem(key.key))), None)
    if found is None:
        return wanted
    entries = iter(_ENTRY.findall(wanted))
    return re.sub(r"\[\]", lambda _: next(entries), found)


def _stem(key: str) -> str:
    return ".".join(split(part)[0] for part in key.split("."))
