"""Keys and result values of a kind as data, and its keys as a JSON Schema, with which TOML editors complete keys and
mark errors."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gtmodel.results.quantity import Quantity, described, split

from .from_options import is_numeric, json_schema, keys_of, resolve
from .noted import DESCRIPTION, NOTES
from .registry import names, results_of, schema_of


def document(kind: str) -> dict[str, Any]:
    """Return the JSON schema of a kind, the flat list of its keys, and the names in `values`. Raises InputError."""
    schema = schema_of(kind)
    return {
        "kind": kind,
        "description": names()[kind],
        "keys": [{**key._asdict()} for key in keys_of(schema)],
        "values": values(kind),
        "schema": json_schema(schema),
    }


def values(kind: str) -> dict[str, dict[str, str]]:
    """Return name -> unit and description of everything in `values`."""
    quantities = {name: quantity for study in results_of(kind) for name, quantity in described(study).items()}
    quantities.setdefault(NOTES, Quantity(description=DESCRIPTION))
    return {
        name: {"unit": q.file_unit, "description": inspect.cleandoc(q.description)} for name, q in quantities.items()
    }


ROBOT = "robot"  # in place of a kind: the schema of robot files
DRAFT = "http://json-schema.org/draft-07/schema#"
_BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "minItems", "maxItems", "minLength", "pattern")


def editor_schema(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of the problem files of a kind. Raises InputError if there is no such kind."""
    document = json_schema(schema_of(kind))
    schema = _node(document, document)
    schema["properties"]["kind"] |= {"const": kind}
    return {"$schema": DRAFT, "title": f"gtmodel problem of kind {kind}", "description": names()[kind], **schema}


def robot_schema() -> dict[str, Any]:
    """Return the JSON Schema of robot files: a family, or another robot with parameters, as calibrations write it."""
    from .robot_file import FAMILIES, PYTHON_KEYS  # here: the keys of a kind need no robot

    families = []
    for file in FAMILIES.values():
        document = json_schema(file)
        families.append(_node(document, document))
    texts = {"title": "name of the robot", "source": "origin of the numbers", "note": "frame and remarks",
             "robot": "Python class, URDF or robot file to which the parameters apply"}  # fmt: skip
    properties: dict[str, Any] = {k: {"title": k, "description": v, "type": "string"} for k, v in texts.items()}
    properties["parameters"] = {"title": "parameters", "description": "values by name, in SI", "type": "object"}
    assert set(properties) == PYTHON_KEYS
    another = {"description": "Another robot with parameters.", "type": "object", "properties": properties,
               "required": ["robot"], "additionalProperties": False}  # fmt: skip
    about = {"title": "gtmodel robot file", "description": "geometry of a robot, for robot = in a problem file"}
    return {"$schema": DRAFT, **about, "anyOf": [*families, another]}


def text_of(kind: str) -> str:
    """Return the schema of a kind, or of robot files, as text; non-ASCII characters are escaped, so that the encoding
    of the shell does not matter."""
    return json.dumps(robot_schema() if kind == ROBOT else editor_schema(kind), indent=1) + "\n"


def write_all(folder: str | Path) -> list[Path]:
    """Write KIND.schema.json of every kind, and robot.schema.json, into a folder, and return the paths."""
    kinds = [*names(), ROBOT]
    paths = [Path(folder) / f"{kind}.schema.json" for kind in kinds]
    for kind, path in zip(kinds, paths, strict=True):
        path.write_text(text_of(kind), encoding="utf-8", newline="\n")
    return paths


def _node(node: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """A part of pydantic's schema with references resolved, without titles and defaults."""
    node = resolve(node, document)
    choices = [_node(c, document) for c in node.get("anyOf") or node.get("oneOf") or () if c.get("type") != "null"]
    if len(choices) == 1:
        return choices[0]
    tables = [c for c in choices if "properties" in c]
    if len(choices) == 2 and len(tables) == 1 and [c.get("items") for c in choices if c not in tables] == tables:
        return {**tables[0], "type": ["object", "array"], "items": tables[0]}  # so that editors mark the wrong key
    if choices:
        return {"anyOf": choices}
    result: dict[str, Any] = {k: node[k] for k in ("type", "enum", "const", *_BOUNDS) if k in node}
    if "items" in node:
        result["items"] = _node(node["items"], document)
    if "properties" in node:
        if "description" in node:
            result["description"] = inspect.cleandoc(node["description"])
        result["properties"] = {name: _key(name, field, document) for name, field in node["properties"].items()}
        result |= {k: node[k] for k in ("required", "additionalProperties") if k in node}
    elif isinstance(node.get("additionalProperties"), Mapping):
        result["additionalProperties"] = _node(node["additionalProperties"], document)
    return result


def _key(name: str, field: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """A key of a table: name and unit as title, its description, and its default unless it is a table."""
    node = _node(field, document)
    stem, unit = split(name) if is_numeric(field, document) else (name, "")
    unit = field.get("unit", unit)
    text = field.get("description", node.get("description", ""))
    about = {"title": f"{stem} [{unit}]" if unit else name, "description": f"[{unit}] {text}" if unit else text}
    if "properties" in node:
        _fill(node, field.get("default") or {})
    elif (default := _without_nothing(field.get("default"))) is not None:
        about["default"] = default
    return {**about, **{k: v for k, v in node.items() if k != "description"}}


def _fill(table: dict[str, Any], default: Mapping[str, Any]) -> None:
    """Move the default of a table to its keys, where editors look for it."""
    for name, value in default.items():
        key = table["properties"][name]
        if isinstance(value, Mapping) and "properties" in key:
            _fill(key, value)
        elif (plain := _without_nothing(value)) is not None:
            key["default"] = plain
        else:
            key.pop("default", None)


def _without_nothing(value: Any) -> Any:
    """Drop entries that are None, and tables of nothing but None, from a default value."""
    if isinstance(value, Mapping):
        items = {k: v for k, item in value.items() if (v := _without_nothing(item)) is not None}
        return items if items or not value else None
    if isinstance(value, list):
        return [v for item in value if (v := _without_nothing(item)) is not None]
    return value
