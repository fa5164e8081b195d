"""Options of a study: dataclasses whose fields state unit, bounds and meaning; the keys of files derive from them.

    @dataclass(frozen=True)
    class Limits(Options):
        force: Annotated[float | None, Unit("N"), Within(above=0.0), "largest motor force"] = None

In a problem file this field is the key ``force_N``.
"""

from __future__ import annotations

import builtins
import dataclasses
import inspect
import sys
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any, get_type_hints

from .agreement import Long as Long, Within as Within, agree
from .quantity import marks_of, named


@dataclass(frozen=True)
class Unit:
    """SI unit of a field of `Options`, and the name of its key in a file.

    written: unit of the key, if it differs, such as "deg" for rad. key: the whole key, if it is not the field's name
    with the unit.
    """

    text: str
    written: str = ""
    key: str = ""


class Options:
    """Base of the options of studies: frozen dataclasses that check their fields at construction.

    The annotation of a field states its type, `Unit`, `Within`, `Long` and a description. Raises ArgumentError, which
    names the field.

    >>> from dataclasses import dataclass
    >>> from typing import Annotated
    >>> from gtmodel.results import Unit, Within
    >>> @dataclass(frozen=True)
    ... class Limits(gt.results.Options):
    ...     force: Annotated[float, Unit("N"), Within(above=0.0), "largest motor force"] = 700.0
    >>> Limits(force=-5.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: force: ...
    """

    def __post_init__(self) -> None:
        for name, hint in hints(type(self)).items():
            agree(getattr(self, name), hint, name)


@cache
def hints(cls: type, *left_out: str) -> dict[str, Any]:
    """Return the annotations of the fields of an options class, with metadata. Annotations of `left_out` fields are not
    evaluated, so that the types they name, such as a Model, are not imported."""
    names = [f.name for f in dataclasses.fields(cls) if f.name not in left_out]
    evaluated: dict[str, Any] = {}
    for c in reversed(cls.__mro__):
        annotations = {name: hint for name, hint in inspect.get_annotations(c).items() if name in names}
        namespace = vars(sys.modules.get(c.__module__, builtins))
        evaluated |= get_type_hints(SimpleNamespace(__annotations__=annotations), namespace, include_extras=True)
    return {name: evaluated[name] for name in names}


@cache
def declared(cls: type, *left_out: str) -> dict[str, tuple[Any, ...]]:
    """Return the metadata of the fields of an options class: Unit, Within, Long and a description."""
    return {name: marks_of(hint) for name, hint in hints(cls, *left_out).items()}


def written_name(field: str, marks: tuple[Any, ...]) -> str:
    """Return the name of a field in a file, with its unit there; without the underscore after a Python keyword, as in
    `from_`."""
    field, unit = field.rstrip("_"), next((m for m in marks if isinstance(m, Unit)), None)
    return field if unit is None else unit.key or named(field, unit.written or unit.text)
