"""Tables of a problem file derived from options classes, their keys as flat rows, and the key of the file that
corresponds to a refused argument."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from types import NoneType
from typing import Annotated, Any, ClassVar, Generic, NamedTuple, TypeVar, Union, get_args, get_origin

import numpy as np
import pydantic
from pydantic.json_schema import GenerateJsonSchema

from gtmodel.results.agreement import UNEQUAL
from gtmodel.results.options import Long, Options, Unit, Within, declared, hints, written_name
from gtmodel.results.quantity import converted, split, unit_of
from gtmodel.results.refusal import naming

from .base import FileSection

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
    """One key of a problem file; ``functions[].name`` is in a list of tables, ``signals.*.unit`` in tables by name."""

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
    """pydantic's generator, without a serializer for defaults that are JSON already, or tables of them."""

    def encode_default(self, dft: Any) -> Any:
        if type(dft) in (NoneType, bool, int, float, str):
            return dft
        if isinstance(dft, pydantic.BaseModel):
            return {name: self.encode_default(value) for name, value in dft}
        return [self.encode_default(entry) for entry in dft] if type(dft) is list else super().encode_default(dft)


@cache
def json_schema(schema: type[pydantic.BaseModel]) -> dict[str, Any]:
    """Return the JSON schema. It is cached: do not change it."""
    return schema.model_json_schema(schema_generator=_Generator)


@cache
def keys_of(schema: type[pydantic.BaseModel]) -> tuple[Key, ...]:
    """Return all keys of a schema, with those of nested tables, in the order of the schema."""
    document = json_schema(schema)
    return tuple(_keys(document, document, "", True))


def tables_of(schema: type[pydantic.BaseModel]) -> list[str]:
    """Return the names of all tables of a schema: "limits", "functions[]"."""
    parents = {key.parent for key in keys_of(schema)}
    whole = {parent[: i if i >= 0 else None] for parent in parents for i in (parent.find("."), -1)}
    return sorted(whole - {""})


def _keys(node: Mapping[str, Any], document: Mapping[str, Any], prefix: str, needed: bool) -> Iterator[Key]:
    required = node.get("required", [])
    for name, field in node.get("properties", {}).items():
        choices = [resolve(choice, document) for choice in _choices(field)]
        inner = [(c, "") for c in choices if "properties" in c]
        lists = [i for c in choices if "properties" in (i := resolve(c.get("items", {}), document))]
        inner += [(i, "[]") for i in lists if (i, "") not in inner]  # one table or several: listed once
        must = name in required
        if not inner:
            default = _default(field, must, prefix, needed)
            text = _type_text(field, document)
            unit = field.get("unit") or (unit_of(name) if is_numeric(field, document) else "")
            yield Key(prefix + name, text, unit, default, field.get("description", ""))
            named = [resolve(v, document) for c in choices for v in _choices(_values(c))]
            inner = [(v, ".*") for v in named if "properties" in v]
        for table, suffix in inner:
            yield from _keys(table, document, f"{prefix}{name}{suffix}.", needed and must)


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
    return [choice for c in choices for choice in _choices(c)]


def resolve(node: Mapping[str, Any], document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a part of a schema, or the definition that it refers to."""
    reference = node.get("$ref")
    return document["$defs"][reference.rpartition("/")[2]] if reference else node


def _items(node: Mapping[str, Any], document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Schema of a list's entries; in a fixed-length list all entries have the type of the first."""
    return resolve(node.get("items") or (node.get("prefixItems") or [{}])[0], document)


def _values(node: Mapping[str, Any]) -> Mapping[str, Any]:
    """Schema of the values of a table with free names; empty if the values may be anything."""
    values = node.get("additionalProperties")
    return values if isinstance(values, Mapping) else {}


def is_numeric(node: Mapping[str, Any], document: Mapping[str, Any]) -> bool:
    """True for numbers, lists of numbers, and choices that include one of these."""
    return any(_holds_numbers(resolve(choice, document), document) for choice in _choices(node))


def _holds_numbers(node: Mapping[str, Any], document: Mapping[str, Any]) -> bool:
    if node.get("type") == "array":
        return is_numeric(_items(node, document), document)
    return node.get("type") in _NUMERIC


def _type_text(field: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    texts = [_one_type(resolve(c, document), document) for c in _choices(field)]
    return " or ".join(dict.fromkeys(texts))


def _several(text: str) -> str:
    """A type in the plural, each of its alternatives."""
    return re.sub(r"(?:(?<=^)|(?<= or ))(whole number|number|text|table|list)\b", r"\1s", text)


def _one_type(node: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    if "enum" in node or "const" in node:
        return " or ".join(json.dumps(v, ensure_ascii=False) for v in node.get("enum", [node.get("const")]))
    kind = node.get("type")
    if kind == "array":
        low, high = node.get("minItems"), node.get("maxItems")
        count = f"{low} " if low is not None and low == high else ""
        return f"list of {count}{_several(_type_text(_items(node, document), document))}"
    if kind == "object" and (values := _values(node)):
        return f"table of {_several(_type_text(values, document))}"
    bounds = ", ".join(f"{sign} {node[key]:g}" for key, sign in _BOUNDS if key in node)
    text = _TYPES.get(kind or "", "anything")
    return f"{text} {bounds}" if bounds else text


_NUMBER, _EMPTY = re.compile(r"\[\d+\]"), re.compile(r"\[\]")  # index of an entry in an argument; in a key
_ENTRY = re.compile(r"(.*?)((?:\[\d+\])?)")


def key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
    """Return the dotted key of an argument; an argument without a key keeps its own name.

    renamed: arguments, or the first parts of them, that have another name in the file, "" for none; the longest match
    counts.

        argument            renamed                              key, if the schema has it
        "force"             {}                                   "force_N"
        "map.step"          {"map": "section"}                   "section.step_m"
        "springs.links"     {"springs": ""}                      "links"
        "cases[1].length"   {}                                   "cases[1].length_um"
        "poses[1]"          {"poses": "pose"}                    "pose[1]"
        "rows[2].at"        {"rows[].at": ""}                    ""
        "poses[1].values"   {"poses[].values": "tables[].data"}  "tables[1].data"
    """
    parts = argument.split(".")
    for n in range(len(parts), 0, -1):
        head = ".".join(parts[:n])
        whole, index = _ENTRY.fullmatch(head).groups()  # pyrefly: ignore[missing-attribute]
        places = (
            renamed.get(head),
            renamed.get(_NUMBER.sub("[]", head)),
            renamed[whole] + index if whole in renamed else None,
        )
        path = next((p for p in places if p is not None), None)
        if path is not None:
            indices = iter(_NUMBER.findall(head))
            path = _EMPTY.sub(lambda empty, indices=indices: next(indices, empty[0]), path)
            parts = [p for p in (path, *parts[n:]) if p]
            break
    key = ".".join(parts)
    plain = _NUMBER.sub("[]", key)
    if plain in tables_of(schema):
        return key
    remaining = iter(_NUMBER.findall(key))
    keys = (key.key for key in keys_of(schema) if plain in (key.key, _stem(key.key)))
    return next((_EMPTY.sub(lambda _: next(remaining), key) for key in keys), key)


def _stem(key: str) -> str:
    return ".".join(split(part)[0] for part in key.split("."))


S = TypeVar("S", bound="Made[Any]")
O = TypeVar("O")


class Made(FileSection, Generic[O]):
    """A table whose keys are the fields of an options class, as `Made[Limits]`; `options` returns that object.

    A table with further keys is a subclass, decorated with `made_from`.
    """

    made_of: ClassVar[type]
    attributes: ClassVar[dict[str, str]]  # key -> field

    def __class_getitem__(cls, options: Any) -> Any:  # pyrefly: ignore[bad-override-param-name]
        return section_of(options)

    def options(self) -> O:
        """Return the options, in SI. Raises ArgumentError if they contradict each other."""
        return self.made_of(**self.given())

    def given(self) -> dict[str, Any]:
        """Return the fields of these options, in SI."""
        return {self.attributes[key]: _given(self, key) for key in self.attributes}


def options_of(problem: FileSection, *names: str) -> dict[str, Any]:
    """Return the options in tables of a problem, by table name; in all its tables if no names are given. Raises
    ArgumentError about `table.field`."""
    tables = {name: getattr(problem, name) for name in names or type(problem).model_fields}
    return {name: _objects(value, name) for name, value in tables.items() if names or isinstance(value, Made)}


def _given(table: Made, key: str) -> Any:
    value = _objects(getattr(table, key), table.attributes[key])
    unit = next((m for m in declared(table.made_of)[table.attributes[key]] if isinstance(m, Unit)), None)
    if value is None or unit is None or not unit.written:
        return value
    si = converted(value, unit.written, unit.text)
    return si.tolist() if np.ndim(si) else si


def _objects(value: Any, name: str) -> Any:
    """Convert tables to options, also those in lists and tables; errors name the table."""
    if isinstance(value, Made):
        with naming(f"{name}."):
            return value.options()
    if isinstance(value, dict):
        return {key: _objects(item, f"{name}.{key}") for key, item in value.items()}
    if isinstance(value, list):
        return [_objects(item, f"{name}[{k}]") for k, item in enumerate(value)]
    return value


def made_from(options: type[Options], *left_out: str) -> Callable[[type[S]], type[S]]:
    """Return a decorator that puts the fields of an options class, except `left_out`, before a table's own keys."""

    def decorated(cls: type[S]) -> type[S]:
        return _table(options, left_out, cls, cls.__name__, cls.__module__, cls.__doc__ or options.__doc__)

    return decorated


def _table(
    options: type[Any], left_out: Sequence[str], base: type[S], name: str, module: str, doc: str | None
) -> type[S]:
    """A subclass of `base` with the fields of an options class as keys."""
    hinted, marked = hints(options, *left_out), declared(options, *left_out)
    fields: dict[str, Any] = {}
    attributes: dict[str, str] = {}
    for f in dataclasses.fields(options):
        if f.name not in hinted:
            continue
        key = written_name(f.name, marked[f.name])
        attributes[key] = f.name
        fields[key] = (_hint(hinted[f.name], marked[f.name]), _field(f, marked[f.name]))
    table = pydantic.create_model(
        name, __base__=base, __module__=module, __doc__=_without_example(doc or ""), **fields
    )  # fmt: skip
    table.made_of, table.attributes = options, attributes
    return table


def _without_example(doc: str) -> str:
    """A docstring up to its Python example, which is of no use in a problem file."""
    return inspect.cleandoc(doc).partition(">>>")[0].rstrip()


def _field(f: dataclasses.Field[Any], marks: tuple[Any, ...]) -> Any:
    more: dict[str, Any] = {"description": next((m for m in marks if isinstance(m, str)), None)}
    if f.default is not dataclasses.MISSING:
        more["default"] = _plain(f.default, marks)
    elif f.default_factory is not dataclasses.MISSING:
        more["default"] = _plain(f.default_factory(), marks)
    return pydantic.Field(**more)


def _plain(value: Any, marks: tuple[Any, ...]) -> Any:
    """A default as written in a file, in its unit there."""
    if dataclasses.is_dataclass(value):
        inside = declared(type(value))
        plain = {written_name(name, inner): _plain(getattr(value, name), inner) for name, inner in inside.items()}
        return section_of(type(value)).model_construct(**plain)
    unit = next((m for m in marks if isinstance(m, Unit)), None)
    if value is not None and unit is not None and unit.written:
        value = _short(np.asarray(converted(value, unit.text, unit.written)).tolist())
    return list(value) if isinstance(value, tuple) else value


_SECTIONS: dict[type, type[Made]] = {}


def section_of(options: type) -> type[Made]:
    """Return the table of an options class, with all its fields."""
    if options not in _SECTIONS:
        _SECTIONS[options] = _table(options, (), Made, options.__name__, options.__module__, options.__doc__)
    return _SECTIONS[options]


def _hint(hint: Any, marks: tuple[Any, ...]) -> Any:
    """The type of a key, with bounds on each number and a length on each list."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _hint(inside[0], tuple(dict.fromkeys((*marks, *inside[1:]))))
    if origin in (Union, types.UnionType):
        return Union[tuple(_hint(member, marks) for member in inside)]  # noqa: UP007  # pyrefly: ignore
    if origin in (list, tuple):
        if get_origin(inside[0]) in (list, tuple):  # the length applies to the rows
            return Annotated[list[_hint(inside[0], marks)], pydantic.AfterValidator(_of_one_length)]  # pyrefly: ignore
        long = next((m for m in marks if isinstance(m, Long)), None)
        listed = list[_hint(inside[0], tuple(m for m in marks if not isinstance(m, Long)))]  # pyrefly: ignore
        if long is None:
            return listed
        return Annotated[listed, pydantic.Field(min_length=long.count, max_length=long.count)]
    if origin is dict:
        return dict[inside[0], _hint(inside[1], marks)]  # pyrefly: ignore[invalid-annotation]
    if hint in (float, int):
        within = [m for m in marks if isinstance(m, Within)]
        if not within:
            return hint
        (w,) = within
        unit = next((m for m in marks if isinstance(m, Unit) and m.written), None)
        bounds = {"gt": w.above, "ge": w.least, "le": w.most, "lt": w.below}
        constraints: dict[str, Any] = {k: _written(x, unit) for k, x in bounds.items() if x is not None}
        return Annotated[hint, pydantic.Field(**constraints)]
    if isinstance(hint, type) and issubclass(hint, Options):
        return section_of(hint)
    return hint


def _of_one_length(rows: list[Any]) -> list[Any]:
    if len(set(map(len, rows))) > 1:
        raise ValueError(UNEQUAL)
    return rows


def _written(x: float, unit: Unit | None) -> float:
    return x if unit is None else _short(converted(x, unit.text, unit.written))


def _short(x: Any) -> Any:
    """Round a number, or lists of numbers: pi / 3 is 60 degrees, not 59.99999999999999."""
    return [_short(item) for item in x] if isinstance(x, list) else float(f"{x:.12g}")
