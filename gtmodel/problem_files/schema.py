"""What a kind takes and gives, as data: what ``gtmodel schema`` prints."""

from __future__ import annotations

import inspect
from typing import Any

from gtmodel.results.quantity import described
from gtmodel.results.unit_names import unit_of

from .fields import keys_of
from .noted import DESCRIPTION, NOTES
from .registry import get, names


def document(kind: str) -> dict[str, Any]:
    """The kind's JSON schema, with the flat list of its keys and the names in `values`. Raises InputError."""
    module = get(kind)
    return {
        "kind": kind,
        "description": names()[kind],
        "keys": [{**key._asdict()} for key in keys_of(module.Schema)],
        "values": values(kind),
        "schema": module.Schema.model_json_schema(),
    }


def values(kind: str) -> dict[str, dict[str, str]]:
    """Name -> unit and description of what `values` will hold."""
    texts = dict(described(get(kind).RESULT))
    texts.setdefault(NOTES, DESCRIPTION)
    return {name: {"unit": unit_of(name), "description": inspect.cleandoc(text)} for name, text in texts.items()}
