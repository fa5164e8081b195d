"""What a kind takes and gives, as data: what ``gtmodel schema`` prints."""

from __future__ import annotations

import inspect
from typing import Any

from gtmodel.results.quantity import Quantity, described

from .fields import json_schema, keys_of
from .noted import DESCRIPTION, NOTES
from .registry import names, results_of, schema_of


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
    held = {name: quantity for study in results_of(kind) for name, quantity in described(study).items()}
    held.setdefault(NOTES, Quantity(description=DESCRIPTION))
    return {name: {"unit": q.file_unit, "description": inspect.cleandoc(q.description)} for name, q in held.items()}
