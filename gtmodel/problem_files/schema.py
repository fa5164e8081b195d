"""What a kind takes and gives, as data: what ``gtmodel schema`` prints."""

from __future__ import annotations

import inspect
from typing import Any

from gtmodel.results.quantity import described
from gtmodel.results.unit_names import unit_of

from .fields import json_schema, keys_of
from .noted import DESCRIPTION, NOTES
from .registry import names, result_of, schema_of


def document(kind: str) -> dict[str, Any]:
    """The kind's JSON schema, with the flat list of its keys and the names in `values`. Raises InputError."""
    schema = schema_of(kind)
    return {
        "kind": kind,
        "description": names()[kind],
        "keys": [{**key._asdict()} for key in keys_of(schema)],
        "values": values(kind),
        "schema": json_schema(schema),
    }


def values(kind: str) -> dict[str, dict[str, str]]:
    """Name -> unit and description of what `values` will hold."""
    texts = dict(described(result_of(kind)))
    texts.setdefault(NOTES, DESCRIPTION)
    return {name: {"unit": unit_of(name), "description": inspect.cleandoc(text)} for name, text in texts.items()}
