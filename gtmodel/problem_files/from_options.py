"""Tables of a problem file made from the options of a study: keys, units, bounds and texts are declared there once."""

from __future__ import annotations

import dataclasses
import inspect
import types
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, Generic, TypeVar, Union, get_args, get_origin

import numpy as np
import pydantic

from gtmodel.results.agreement import UNEQUAL
from gtmodel.results.options import Long, Options, Unit, Within, declared, hints, written_name
from gtmodel.results.quantity import converted
from gtmodel.results.refusal import ArgumentError

from .base import FileSection

S = TypeVar("S", bound="Made[Any]")
O = TypeVar("O")


class Made(FileSection, Generic[O]):
    """A table whose keys are the fields of an options class, as `Made[Limits]`; `options` gives the object back.

    A table with keys of its own besides is a subclass, decorated with `made_from`.
    """

    made_of: ClassVar[type]
    attributes: ClassVar[dict[str, str]]  # key -> field

    def __class_getitem__(cls, options: Any) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        return section_of(options)

    def options(self) -> O:
        """The options that the table says, in SI. Raises ArgumentError where they contradict each other."""
        return self.made_of(**self.given())

    def given(self) -> dict[str, Any]:
        """The fields of these options, in SI."""
        return {self.attributes[key]: _given(self, key) for key in self.attributes}


def options_of(problem: FileSection, *names: str) -> dict[str, Any]:
    """The options that tables of a problem say, by the names of these; all of its tables where none are named. Raises
    ArgumentError, with the table before the name of a field."""
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
    """Tables as the options that they say, also in lists and by name; what they refuse is said with their place."""
    if isinstance(value, Made):
        try:
            return value.options()
        except ArgumentError as error:
            raise ArgumentError(error.message, f"{name}.{error.argument}" if error.argument else name) from error
    if isinstance(value, dict):
        return {key: _objects(one, f"{name}.{key}") for key, one in value.items()}
    if isinstance(value, list):
        return [_objects(one, f"{name}[{k}]") for k, one in enumerate(value)]
    return value


def made_from(options: type[Options], *left_out: str) -> Callable[[type[S]], type[S]]:
    """Give a table the keys of an options class, except the fields that are left out; its own keys come behind."""

    def made(cls: type[S]) -> type[S]:
        return _table(options, left_out, cls, cls.__name__, cls.__module__, cls.__doc__ or options.__doc__)

    return made


def _table(
    options: type[Any], left_out: Sequence[str], base: type[S], name: str, module: str, doc: str | None
) -> type[S]:
    """A table below `base` with the fields of an options class as keys."""
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
    """A docstring up to its example in Python, which helps nobody who writes a file."""
    return inspect.cleandoc(doc).partition(">>>")[0].rstrip()


def _field(f: dataclasses.Field[Any], marks: tuple[Any, ...]) -> Any:
    more: dict[str, Any] = {"description": next((m for m in marks if isinstance(m, str)), None)}
    if f.default is not dataclasses.MISSING:
        more["default"] = _plain(f.default, marks)
    elif f.default_factory is not dataclasses.MISSING:
        more["default"] = _plain(f.default_factory(), marks)
    return pydantic.Field(**more)


def _plain(value: Any, marks: tuple[Any, ...]) -> Any:
    """A default as the file writes it."""
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
    """The table of an options class, with all its fields."""
    if options not in _SECTIONS:
        _SECTIONS[options] = _table(options, (), Made, options.__name__, options.__module__, options.__doc__)
    return _SECTIONS[options]


def _hint(hint: Any, marks: tuple[Any, ...]) -> Any:
    """The type of a key: bounds on each number of it, a count on each list."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _hint(inside[0], tuple(dict.fromkeys((*marks, *inside[1:]))))
    if origin in (Union, types.UnionType):
        return Union[tuple(_hint(one, marks) for one in inside)]  # noqa: UP007
    if origin in (list, tuple):
        if get_origin(inside[0]) in (list, tuple):  # its rows have the length
            return Annotated[list[_hint(inside[0], marks)], pydantic.AfterValidator(_of_one_length)]
        long = next((m for m in marks if isinstance(m, Long)), None)
        listed = list[_hint(inside[0], tuple(m for m in marks if not isinstance(m, Long)))]
        if long is None:
            return listed
        return Annotated[listed, pydantic.Field(min_length=long.count, max_length=long.count)]
    if origin is dict:
        return dict[inside[0], _hint(inside[1], marks)]
    if hint in (float, int):
        within = [m for m in marks if isinstance(m, Within)]
        if not within:
            return hint
        (w,) = within
        unit = next((m for m in marks if isinstance(m, Unit) and m.written), None)
        bounds = {"gt": w.above, "ge": w.least, "le": w.most, "lt": w.below}
        kept: dict[str, Any] = {k: _written(x, unit) for k, x in bounds.items() if x is not None}
        return Annotated[hint, pydantic.Field(**kept)]
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
    """A number, or lists of them, as people write it: pi / 3 is 60 degrees, not 59.99999999999999."""
    return [_short(one) for one in x] if isinstance(x, list) else float(f"{x:.12g}")
