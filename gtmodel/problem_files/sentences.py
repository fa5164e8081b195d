"""What pydantic found wrong, as one plain sentence with the key."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import pydantic

from gtmodel.results.unit_names import split

from .base import InputError
from .fields import Key, keys_of, tables_of

_EXPECTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
    "list_type": "a list",
}
_LISTS = {"list_type", "tuple_type", "too_short", "too_long"}
_FIRST = {"extra_forbidden": 0, "missing": 2}  # a missing key is often the misspelt one


def sentence_for(
    error: pydantic.ValidationError, schema: type[pydantic.BaseModel], data: Mapping[str, Any]
) -> InputError:
    """The first fault as a sentence; faults of other keys are named behind it."""
    faults: dict[tuple[str | int, ...], list[Any]] = {}
    for one in error.errors(include_url=False):
        faults.setdefault(_place(one["loc"], data, one["type"]), []).append(one)
    ordered = sorted(faults, key=lambda place: _FIRST.get(faults[place][0]["type"], 1))
    guessed: set[str] = set()
    sentences: list[tuple[str, str]] = []
    for place in ordered:
        key = dotted(place)
        if faults[place][0]["type"] == "missing" and key in guessed:
            continue
        sentence, meant = _sentence(place, faults[place], schema, data)
        guessed |= {meant}
        sentences.append((key, sentence))
    key, sentence = sentences[0]
    if len(sentences) > 1:
        sentence += f"; wrong too: {', '.join(k for k, _ in sentences[1:])}"
    return InputError(sentence, key)


def dotted(place: Sequence[str | int]) -> str:
    """`("goal", "tcp_m", 1)` as `goal.tcp_m[1]`."""
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else (f".{part}" if text else part)
    return text


def _place(loc: tuple[str | int, ...], data: Any, kind: str) -> tuple[str | int, ...]:
    """The part of an error's location that is a key of the file, without the names of union members."""
    place: list[str | int] = []
    for n, part in enumerate(loc):
        if _holds(data, part):
            data = data[part]
        elif kind != "missing" or n < len(loc) - 1:
            continue
        place.append(part)
    return tuple(place)


def _holds(data: Any, part: str | int) -> bool:
    return part in data if isinstance(data, dict) else isinstance(data, list) and isinstance(part, int)


def _sentence(
    place: tuple[str | int, ...], faults: list[Any], schema: type[pydantic.BaseModel], data: Mapping[str, Any]
) -> tuple[str, str]:
    """The sentence, and the key that a person seems to have meant."""
    kind = faults[0]["type"]
    if kind == "extra_forbidden":
        return _unknown(place, schema)
    known = _known(place, schema)
    about = f" ({known.description})" if known and known.description else ""
    if kind == "missing":
        wanted = _of(known, [a(known.type)]) if known else "a value"
        return f"is missing; expected {wanted}{about}", ""
    if kind == "too_short" and isinstance(_value_at(place, data), dict):
        return f"is empty; expected an entry or more{about}", ""
    value = f"found {shown(_value_at(place, data))}"
    expected = [_EXPECTED[f["type"]] for f in faults if f["type"] in _EXPECTED]
    entry = _entry(known.type, place) if known and kind in _LISTS else ""
    if known and len(faults) > 1 and not isinstance(place[-1], int):
        expected = [a(known.type)]
    elif entry:
        expected = [a(entry)]
    elif len(expected) != len(faults):
        return f"{_bound(next(f for f in faults if f['type'] not in _EXPECTED), known)}; {value}", ""
    return f"expected {_of(known, list(dict.fromkeys(expected)))}; {value}", ""


def _of(known: Key | None, texts: list[str]) -> str:
    return " or ".join(texts) + (f" in {known.unit}" if known and known.unit else "")


def _entry(text: str, place: Sequence[str | int]) -> str:
    """The type at a place within a list of lists: "list of 3 numbers" at A_m[0]; "" where the schema's is not one."""
    for _ in range(len(place) - 1 - max(k for k, part in enumerate(place) if isinstance(part, str))):
        inner = re.fullmatch(r"list of (?:\d+ )?(list)s( of .*)", text)
        if inner is None or " or " in text:
            return ""
        text = inner[1] + inner[2]
    return text


def _bound(fault: Any, known: Key | None) -> str:
    kind, context = fault["type"], fault.get("ctx", {})
    if kind in ("literal_error", "enum"):
        return f"expected {context['expected']}"
    if kind in ("too_short", "too_long"):
        bound = f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
        return f"expected {bound} entries"
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
    if message.startswith("Input should be "):
        unit = f" {known.unit}" if known and known.unit and context else ""
        return f"must be {message.removeprefix('Input should be ')}{unit}"
    return message[:1].lower() + message[1:] if message[1:2].islower() else message


def _known(place: Sequence[str | int], schema: type[pydantic.BaseModel]) -> Key | None:
    wanted = _pattern(place, schema)
    return next((k for k in keys_of(schema) if k.key == wanted or k.key == wanted.removesuffix("[]")), None)


def _pattern(place: Sequence[str | int], schema: type[pydantic.BaseModel]) -> str:
    """`("functions", 0, "name")` as the schema writes it, `functions[].name`; an index at the end falls off, and that
    of tables of which there may be one or several."""
    keys = [k.key for k in keys_of(schema)]
    parts = list(place)
    while parts and isinstance(parts[-1], int):
        parts.pop()
    text = ""
    for part in parts:
        if isinstance(part, str):
            text += f".{part}" if text else part
        elif any(k.startswith(f"{text}[]") for k in keys) or not any(k.startswith(f"{text}.") for k in keys):
            text += "[]"
    return text


def _unknown(place: tuple[str | int, ...], schema: type[pydantic.BaseModel]) -> tuple[str, str]:
    name, parent = str(place[-1]), _pattern(place[:-1], schema)
    if place[:-1] and isinstance(place[-2], int) and not any(k.parent == parent for k in keys_of(schema)):
        parent += "[]"
    siblings = {k.name: k for k in keys_of(schema) if k.parent == parent}
    prefix = f"{parent}." if parent else ""
    tables = [t.removeprefix(prefix).removesuffix("[]") for t in tables_of(schema) if t.startswith(prefix)]
    tables = [t for t in tables if t and "." not in t]
    stem, unit = split(name)
    same_stem = [k for k in siblings if unit and split(k)[0] == stem]
    longer = [k for k in siblings if len(name) > 2 and k.startswith(name)]
    close = same_stem or longer or difflib.get_close_matches(name, [*siblings, *tables], n=1)
    if close:
        known = siblings.get(close[0])
        meant = f"{dotted(place[:-1])}.{close[0]}" if len(place) > 1 else close[0]
        hint = f"did you mean '{close[0]}'{f' ({known.unit})' if known and known.unit else ''}?"
        return f"unknown key; {hint}", meant
    elsewhere = [k for k in keys_of(schema) if k.name == name]
    if elsewhere:
        return f"unknown key here; did you mean '{elsewhere[0].key}'?", elsewhere[0].key
    there = f"; there are {', '.join([*siblings, *tables])}" if siblings or tables else ""
    return f"unknown key{there}", ""


def _value_at(place: Sequence[str | int], data: Any) -> Any:
    for part in place:
        data = data[part]
    return data


def a(text: str) -> str:
    """A type as the schema names it, with its article."""
    return f"a {text}" if text.startswith(("number", "whole number", "text", "list", "table")) else text


def shown(value: Any) -> str:
    """A value of a TOML file in words."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a sentence stays one line, whatever the text holds
        text = f"'{value}'" if value.isprintable() else repr(value)
        return f"the text {text}" if len(value) <= 60 else f"a text of {len(value)} characters"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
        return f"a list of {len(value)} table{'s' if len(value) > 1 else ''}"
    if isinstance(value, list):
        return f"a list of {len(value)}" if len(repr(value)) > 60 else f"{value!r}"
    return f"{value}"
