"""The keys of a schema as flat rows: dotted key, type, unit, default, description."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import cache
from types import NoneType
from typing import Any, NamedTuple

import pydantic
from pydantic.json_schema import GenerateJsonSchema

from gtmodel.results.unit_names import unit_of

_TYPES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "object": "table",
    "array": "list",
    "null": "nothing",
}
_BOUNDS = (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
_NUMERIC = {"number", "integer"}

REQUIRED = "required"


class Key(NamedTuple):
    """One key of a problem file; lists of tables are written ``functions[].name``."""

    key: str
    type: str
    unit: str
    default: str
    description: str

    @property
    def name(self) -> str:
        return self.key.rpartition(".")[2]

    @property
    def parent(self) -> str:
        return self.key.rpartition(".")[0]


class _Generator(GenerateJsonSchema):
    """pydantic's own, without a serializer for each default that is JSON already, or a table of such."""

    def encode_default(self, dft: Any) -> Any:
        if type(dft) in (NoneType, bool, int, float, str):
            return dft
        if isinstance(dft, pydantic.BaseModel):
            return {name: self.encode_default(value) for name, value in dft}
        return [self.encode_default(one) for one in dft] if type(dft) is list else super().encode_default(dft)


@cache
def json_schema(schema: type[pydantic.BaseModel]) -> dict[str, Any]:
    """The JSON schema; made once, so leave it as it is."""
    return schema.model_json_schema(schema_generator=_Generator)


@cache
def keys_of(schema: type[pydantic.BaseModel]) -> tuple[Key, ...]:
    """All keys of a schema, tables opened, in the order of the schema."""
    document = json_schema(schema)
    return tuple(_keys(document, document, "", True))


def tables_of(schema: type[pydantic.BaseModel]) -> list[str]:
    """Names of all tables of a schema, also empty ones: "limits", "functions[]"."""
    parents = {key.parent for key in keys_of(schema)}
    whole = {parent[: i if i >= 0 else None] for parent in parents for i in (parent.find("."), -1)}
    return sorted(whole - {""})


def _keys(node: Mapping[str, Any], document: Mapping[str, Any], prefix: str, needed: bool) -> Iterator[Key]:
    required = node.get("required", [])
    for name, field in node.get("properties", {}).items():
        opened = [resolve(choice, document) for choice in _choices(field)]
        inner = [(c, "") for c in opened if "properties" in c]
        lists = [i for c in opened if "properties" in (i := resolve(c.get("items", {}), document))]
        inner += [(i, "[]") for i in lists if (i, "") not in inner]  # one table or several: listed once
        must = name in required
        for table, suffix in inner:
            yield from _keys(table, document, f"{prefix}{name}{suffix}.", needed and must)
        if not inner:
            default = _default(field, must, prefix, needed)
            text = _type_text(field, document)
            unit = field.get("unit") or (unit_of(name) if is_numeric(field, document) else "")
            yield Key(prefix + name, text, unit, default, field.get("description", ""))


def _default(field: Mapping[str, Any], must: bool, prefix: str, needed: bool) -> str:
    if must:
        table = f"[{prefix.removesuffix('.').replace('[]', '')}]"
        table = f"[{table}]" if prefix.endswith("[].") else table
        return REQUIRED if needed else f"{REQUIRED} in {table}"
    value = field.get("default")
    return "" if value is None else json.dumps(value, ensure_ascii=False)


def _choices(field: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    choices = field.get("anyOf") or field.get("oneOf")
    if choices is None:
        return [field] if field.get("type") != "null" else []
    return [one for c in choices for one in _choices(c)]


def resolve(node: Mapping[str, Any], document: Mapping[str, Any]) -> Mapping[str, Any]:
    """A part of a schema, or the definition that it refers to."""
    reference = node.get("$ref")
    return document["$defs"][reference.rpartition("/")[2]] if reference else node


def _items(node: Mapping[str, Any], document: Mapping[str, Any]) -> Mapping[str, Any]:
    """What a list holds; a fixed-length list is taken to hold one type."""
    return resolve(node.get("items") or (node.get("prefixItems") or [{}])[0], document)


def is_numeric(node: Mapping[str, Any], document: Mapping[str, Any]) -> bool:
    """True for numbers, lists of them, and a choice that holds one of these."""
    return any(_holds_numbers(resolve(choice, document), document) for choice in _choices(node))


def _holds_numbers(node: Mapping[str, Any], document: Mapping[str, Any]) -> bool:
    if node.get("type") == "array":
        return is_numeric(_items(node, document), document)
    return node.get("type") in _NUMERIC


def _type_text(field: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    texts = [_one_type(resolve(c, document), document) for c in _choices(field)]
    return " or ".join(dict.fromkeys(texts))


def _several(text: str) -> str:
    """The type of a list's entries in the plural."""
    for noun in ("whole number", "number", "text", "table", "list"):
        if text.startswith(noun):
            return f"{noun}s{text.removeprefix(noun)}"
    return text


def _one_type(node: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    if "enum" in node or "const" in node:
        return " or ".join(f'"{v}"' for v in node.get("enum", [node.get("const")]))
    kind = node.get("type")
    if kind == "array":
        low, high = node.get("minItems"), node.get("maxItems")
        count = f"{low} " if low is not None and low == high else ""
        return f"list of {count}{_several(_type_text(_items(node, document), document))}"
    bounds = ", ".join(f"{sign} {node[key]:g}" for key, sign in _BOUNDS if key in node)
    text = _TYPES.get(kind or "", "anything")
    return f"{text} {bounds}" if bounds else text
