"""From a TOML file to a checked problem. Every fault is one plain sentence with the file and the key."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from gtmodel.modelica.reference import is_reference, problem_of as of_text
from gtmodel.results.read_bounds import TooDeepError, not_deep

from .base import InputError, Kind, Problem
from .files import find, parse, read
from .registry import get
from .sentences import sentence_for, shown
from .settings import apply

_KINDS = 'write kind = "trajectory", or another that gtmodel schema lists'
S = TypeVar("S", bound=pydantic.BaseModel)


@dataclass(frozen=True)
class Loaded:
    """A problem read from a file: where it lies, its bytes, and what `--set` changed."""

    path: Path
    content: bytes
    settings: tuple[str, ...]
    kind: Kind
    problem: Problem
    shipped: bool

    @property
    def name(self) -> str:
        """File name; the same wherever the folder stands."""
        return self.path.name


def load(path: str | Path, settings: Iterable[str] = ()) -> Loaded:
    """Read and check a problem file, or one shipped with gtmodel where there is no such file.

    settings: texts "key=value" as in `--set`. Raises InputError; its sentence names the file and the key.
    """
    settings = tuple(settings)
    written = of_text(str(path)) if is_reference(str(path)) else None
    file, shipped = (written[0], False) if written else find(path)
    try:
        content = read(file)
        data = not_deep(apply(written[1] if written else parse(content), settings))
        kind, problem = check(data)
    except InputError as error:
        raise error.within(str(path)) from None
    except TooDeepError as error:
        raise InputError(str(error), file=str(path)) from None
    return Loaded(file, content, settings, kind, problem, shipped)


def check(data: Mapping[str, Any]) -> tuple[Kind, Problem]:
    """The kind that the data name and the checked problem. Raises InputError for the first fault."""
    if "kind" not in data:
        raise InputError(f"is missing; {_KINDS}", "kind")
    if not isinstance(data["kind"], str):
        raise InputError(f"expected a text; found {shown(data['kind'])}; {_KINDS}", "kind")
    try:
        kind = get(data["kind"])
    except InputError as error:
        raise error.within("", "kind") from None
    return kind, validate(kind.Schema, data)


def validate(schema: type[S], data: Mapping[str, Any]) -> S:
    """The data as an instance of the schema. Raises InputError for the first fault."""
    try:
        # through JSON: its strict mode takes lists for tuples, but no text for a number
        return schema.model_validate_json(json.dumps(data, default=str))
    except pydantic.ValidationError as error:
        raise sentence_for(error, schema, data) from None
