"""From an argument that a library refused to the key of the file that holds it."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pydantic

from gtmodel.results.unit_names import split

from .fields import keys_of, tables_of

_NUMBER, _EMPTY = re.compile(r"\[\d+\]"), re.compile(r"\[\]")  # of an entry of a list; of its key
_ENTRY = re.compile(r"(.*?)((?:\[\d+\])?)")


def key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
    """The dotted key of an argument: ("map.step", {"map": "section"}) is "section.step_m" where that key exists.

    renamed: arguments, or their beginnings, that stand elsewhere in the file; the longest that fits counts. What has
    no key is said under its own name. An entry of a list keeps its number: "cases[1].length" is "cases[1].length_um",
    also where the list has another name in the file: {"poses": "pose"} stands for "poses[1]" too, {"rows[].at": ""} for
    what any row holds, and {"poses[].values": "tables[].signals"} for what the table of the same number holds.
    """
    parts = argument.split(".")
    for n in range(len(parts), 0, -1):
        head = ".".join(parts[:n])
        whole, number = _ENTRY.fullmatch(head).groups()  # pyright: ignore[reportOptionalMemberAccess]
        places = (
            renamed.get(head),
            renamed.get(_NUMBER.sub("[]", head)),
            renamed[whole] + number if whole in renamed else None,
        )
        place = next((p for p in places if p is not None), None)
        if place is not None:
            own = iter(_NUMBER.findall(head))
            place = _EMPTY.sub(lambda empty, own=own: next(own, empty[0]), place)
            parts = [p for p in (place, *parts[n:]) if p]
            break
    wanted = ".".join(parts)
    plain = _NUMBER.sub("[]", wanted)
    if plain in tables_of(schema):
        return wanted
    numbers = iter(_NUMBER.findall(wanted))
    keys = (key.key for key in keys_of(schema) if plain in (key.key, _stem(key.key)))
    return next((_EMPTY.sub(lambda _: next(numbers), key) for key in keys), wanted)


def _stem(key: str) -> str:
    return ".".join(split(part)[0] for part in key.split("."))
