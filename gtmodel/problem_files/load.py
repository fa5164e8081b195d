"""Read a TOML file, apply `--set`, and check the problem. Every error is one sentence with the file and the key."""

from __future__ import annotations

import copy
import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from gtmodel.modelica.reference import is_reference, problem_of as of_text
from gtmodel.results.quantity import split
from gtmodel.results.read_bounds import TooDeepError, not_deep, toml_of

from .base import InputError, Kind, Problem
from .files import find, parse, parts_of, read
from .from_options import REQUIRED, Key, keys_of, tables_of
from .registry import get, schema_of

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
_WORD = {"extra_forbidden": "unknown", "missing": "missing"}
_FIRST = {"extra_forbidden": 0, "missing": 2}  # an unknown key is often the misspelt missing one


def sentence_for(
    error: pydantic.ValidationError, schema: type[pydantic.BaseModel], data: Mapping[str, Any]
) -> InputError:
    """Return the first fault as a sentence, followed by the keys of the other faults."""
    faults: dict[tuple[str | int, ...], list[Any]] = {}
    for fault in error.errors(include_url=False):
        faults.setdefault(_place(fault["loc"], data, fault["type"]), []).append(fault)
    ordered = sorted(faults, key=lambda place: _FIRST.get(faults[place][0]["type"], 1))
    guessed: set[str] = set()
    sentences: list[tuple[str, str, str]] = []
    for place in ordered:
        key = dotted(place)
        kind = faults[place][0]["type"]
        if kind == "missing" and key in guessed:
            continue
        sentence, meant = _sentence(place, faults[place], schema, data)
        guessed |= {meant}
        sentences.append((key, sentence, _WORD.get(kind, "wrong")))
    key, sentence, _ = sentences[0]
    for word in ("unknown", "missing", "wrong"):
        if others := [k for k, _, its in sentences[1:] if its == word]:
            sentence += f"; also {word}: {', '.join(others)}"
    return InputError(sentence, key)


def dotted(place: Sequence[str | int]) -> str:
    """Return `("goal", "tcp_m", 1)` as `goal.tcp_m[1]`."""
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
    """The sentence, and the key that was probably meant."""
    kind = faults[0]["type"]
    if kind == "extra_forbidden":
        return _unknown(place, schema)
    known = _known(place, schema)
    about = f" ({known.description})" if known and known.description else ""
    if kind == "missing":
        needed = [k.name for k in keys_of(schema) if k.parent == dotted(place) and k.default.startswith(REQUIRED)]
        table = f"a table with {', '.join(needed)}" if needed else "a table"
        value = _of(known, [a(known.type)]) if known else table
        return f"is missing; expected {value}{about}", ""
    if kind == "too_short" and isinstance(_value_at(place, data), dict):
        return f"is empty; expected at least one entry{about}", ""
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
    """The type of an entry in a list of lists: "list of 3 numbers" for A_m[0]; "" for any other type."""
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
    pattern = _pattern(place, schema)
    return next((k for k in keys_of(schema) if k.key == pattern or k.key == pattern.removesuffix("[]")), None)


def _pattern(place: Sequence[str | int], schema: type[pydantic.BaseModel]) -> str:
    """`("functions", 0, "name")` as in the schema: `functions[].name`, or `signals.*.unit` for a free name.

    An index at the end is dropped, and the index of a table that may be a list of tables.
    """
    keys = [k.key for k in keys_of(schema)]
    parts = list(place)
    while parts and isinstance(parts[-1], int):
        parts.pop()
    text = ""
    for part in parts:
        if isinstance(part, str):
            part = "*" if any(k.startswith(f"{text}.*.") for k in keys) else part
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
    known_keys = f"; there are {', '.join(dict.fromkeys([*siblings, *tables]))}" if siblings or tables else ""
    return f"unknown key{known_keys}", ""


def _value_at(place: Sequence[str | int], data: Any) -> Any:
    for part in place:
        data = data[part]
    return data


def a(text: str) -> str:
    """Return a type of the schema with its article."""
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


def apply(data: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Return a copy of the data of a problem file with settings "key=value" applied in order.

    A key is dotted; a number in it is the index of a table in a list, from 0, as in ``functions.0.name``. A value is
    read as TOML, or as text if it is not TOML. Raises InputError for a text that is not a setting.
    """
    changed = copy.deepcopy(data)
    for setting in settings:
        key, equals, text = setting.partition("=")
        path = [part.strip() for part in key.split(".")]
        if not equals or not all(path):
            raise InputError(f"--set {setting}: expected key=value, such as --set limits.force_N=500")
        _put(changed, path, _value(text), key.strip())
    return changed


def refuse_twice(settings: Iterable[str]) -> None:
    """Raises InputError for a setting that overrides an earlier one: it is unknown which of the two is meant."""
    earlier: list[list[str]] = []
    for setting in settings:
        path = [part.strip() for part in setting.partition("=")[0].split(".")]
        alike = [str(int(part)) if part.isdecimal() else part for part in path]  # 0 and 00 are the same index
        for other in earlier:
            if other[: len(alike)] == alike:
                first, again = ".".join(other), ".".join(path)
                fault = "is set twice" if other == alike else f"overrides the value set for {first}"
                raise InputError(f"--set {again} {fault}; leave one of them out")
        earlier.append(alike)


def _value(text: str) -> Any:
    try:
        data = toml_of(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text.strip()
    return data["value"] if len(data) == 1 else text.strip()


def _put(data: Any, path: list[str], value: Any, key: str) -> None:
    for n, part in enumerate(path):
        last = n == len(path) - 1
        if isinstance(data, list):
            if not part.isdecimal() or int(part) >= len(data):
                raise InputError(f"has {len(data)} entries; '{part}' is not a number from 0 to {len(data) - 1}", key)
            index: Any = int(part)
        elif isinstance(data, dict):
            index = part
            if not last:
                data.setdefault(part, {})
        else:
            raise InputError(f"cannot be set: '{'.'.join(path[:n])}' is {shown(data)}, not a table", key)
        if last:
            data[index] = value  # pyrefly: ignore[unsupported-operation]
        else:
            data = data[index]  # pyrefly: ignore[bad-index]


_KINDS = 'write kind = "trajectory", or another kind that gtmodel schema lists'
S = TypeVar("S", bound=pydantic.BaseModel)


@dataclass(frozen=True)
class Loaded:
    """A problem read from a file, with its path, its bytes and the `--set` settings."""

    path: Path
    content: bytes
    settings: tuple[str, ...]
    kind: Kind
    problem: Problem
    shipped: bool

    @property
    def name(self) -> str:
        """Return the file name without its folder."""
        return self.path.name

    def placed(self, error: InputError) -> InputError:
        """Return the error with its line in the file."""
        if self.path.suffix in (".mo", ".mop") and error.key in ("model", "robot"):  # nobody wrote this key
            return InputError(error.message, file=error.file, line=error.line)
        return error.within("", content=_unchanged(self.content, self.settings, error.key))


def load(path: str | Path, settings: Iterable[str] = ()) -> Loaded:
    """Read and check a problem file, or a shipped one if there is no file of that name.

    settings: texts "key=value" as for `--set`. Raises InputError, which names the file and the key.
    """
    settings = tuple(settings)
    modelica_text = of_text(str(path)) if is_reference(str(path)) else None
    file, shipped = (modelica_text[0], False) if modelica_text else find(path)
    content = None
    try:
        content = read(file)
        data = not_deep(apply(modelica_text[1] if modelica_text else parse(content), settings))
        kind, problem = check(data)
    except InputError as error:
        raise error.within(str(path), content=_unchanged(content, settings, error.key)) from None
    except TooDeepError as error:
        raise InputError(str(error), file=str(path)) from None
    return Loaded(file, content, settings, kind, problem, shipped)


def _unchanged(content: bytes | None, settings: Iterable[str], key: str) -> bytes | None:
    """The content of the file; None if the value of this key comes from `--set` and so has no line."""
    parts = parts_of(key)
    changed = (parts_of(setting.partition("=")[0]) for setting in settings)
    return None if any(parts[: len(path)] == path for path in changed) else content


def check(data: Mapping[str, Any]) -> tuple[Kind, Problem]:
    """Return the kind that the data name, and the checked problem. Raises InputError for the first fault."""
    if "kind" not in data:
        raise InputError(f"is missing; {_KINDS}", "kind")
    if not isinstance(data["kind"], str):
        raise InputError(f"expected a text; found {shown(data['kind'])}; {_KINDS}", "kind")
    try:
        kind = get(data["kind"])
    except InputError as error:
        raise error.within("", "kind") from None
    return kind, validate(schema_of(data["kind"]), data)


def validate(schema: type[S], data: Mapping[str, Any]) -> S:
    """Return the data as an instance of the schema. Raises InputError for the first fault."""
    try:
        # through JSON: its strict mode takes lists for tuples, but no text for a number
        return schema.model_validate_json(json.dumps(data, default=str))
    except pydantic.ValidationError as error:
        raise sentence_for(error, schema, data) from None
