"""The door of every study and of every options object: what is none of what the annotation says is refused by name.

Both lists are read from the package, so a new study and a new options class are covered without a line here.
"""

from __future__ import annotations

import importlib
import inspect
import math
import pkgutil
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import gtmodel
import gtmodel as gt
from gtmodel.problem_files import InputError
from gtmodel.results import ArgumentError, Long, Options, Study, Within
from gtmodel.results.work import ended

CLOCK: dict[str, Iterable[Any]] = {  # what every study takes, and what it refuses
    "max_seconds": (math.nan, math.inf, -1.0, 0, "5", True),
    "stop": (1, None, "x"),
    "progress": (1, None, "x"),
}
STRANGE = object()


def libraries() -> Iterator[types.ModuleType]:
    """The modules of the libraries; no door of files."""
    for found in pkgutil.walk_packages(gtmodel.__path__, "gtmodel."):
        if found.name.split(".")[1] not in ("kinds", "problem_files", "cli", "plot", "__main__"):
            yield importlib.import_module(found.name)


MODULES = list(libraries())


def is_study(thing: Any) -> bool:
    """A function that takes what every study takes and gives a Study."""
    return (
        inspect.isfunction(thing)
        and set(CLOCK) <= set(inspect.signature(thing).parameters)
        and issubclass(get_type_hints(thing)["return"], Study)
    )


STUDIES = {
    f"{f.__module__.removeprefix('gtmodel.')}.{name}": f
    for module in MODULES
    for name, f in vars(module).items()
    if getattr(f, "__module__", "") == module.__name__ and not name.startswith("_") and is_study(f)
}
OPTIONS = {
    f"{cls.__module__.removeprefix('gtmodel.')}.{cls.__name__}": cls
    for module in MODULES
    for cls in vars(module).values()
    if isinstance(cls, type) and issubclass(cls, Options) and cls is not Options and cls.__module__ == module.__name__
}


def a_good(hint: Any, marks: tuple[Any, ...] = ()) -> Any:
    """Something that an annotation allows; of a class an object without anything in it, which no study reaches."""
    origin, inside = get_origin(hint), get_args(hint)
    kind = origin or hint
    if origin is Annotated:
        return a_good(inside[0], inside[1:])
    if origin in (Union, types.UnionType):
        return a_good(inside[0], marks)
    if origin is Literal:
        return inside[0]
    if kind in (float, int):
        within = next((m for m in marks if isinstance(m, Within)), Within())
        few = [within.least, within.most, within.above and within.above * 1.5, 1, 2, 0.5]
        return next(kind(x) for x in few if x is not None and within.holds(kind(x)))
    if kind is str:
        return "x"
    if kind is bool:
        return True
    if kind is Any:
        return None
    if kind is np.ndarray:
        return np.ones((2, next((m.count for m in marks if isinstance(m, Long)), 2)))
    if origin is Callable or getattr(kind, "_is_protocol", False):
        return lambda *given, **named: False
    if issubclass(kind, Mapping):
        return {}
    if origin is tuple and Ellipsis not in inside:
        return tuple(a_good(one, marks) for one in inside)
    if inside and issubclass(kind, Iterable):
        count = next((m.count for m in marks if isinstance(m, Long)), 1)
        return [a_good(inside[0], marks)] * (1 if get_origin(inside[0]) else count)
    return tuple.__new__(kind) if issubclass(kind, tuple) else object.__new__(kind)


def bad_ones(hint: Any, marks: tuple[Any, ...] = ()) -> Iterator[Any]:
    """Several things that an annotation does not allow."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Annotated:
        yield from bad_ones(inside[0], inside[1:])
        return
    if hint is Any:
        return
    kinds = inside if origin in (Union, types.UnionType) else (hint,)
    origins = [get_origin(kind) or kind for kind in kinds]
    yield STRANGE
    if not any(kind is Any for kind in kinds):
        yield type(None) if type(None) in kinds else None
    if not any(o in (str, Path, Literal) or o is Any for o in origins):
        yield "2e7"
    if Literal in origins and str not in origins:
        yield "foo"
    if float in origins or int in origins:
        yield from (math.nan, math.inf, True)
        for mark in marks:
            if isinstance(mark, Within) and (mark.above is not None or mark.least is not None):
                yield -1e9
    if bool not in origins and int not in origins and float not in origins:
        yield 7 if 7 not in inside else 8
    for kind in kinds:
        within = get_args(kind)
        if within and within[0] is float and get_origin(kind) is not tuple:
            yield from ([math.nan] * 3, ["a", "b", "c"], {"a": 1.0})
            for mark in marks:
                if isinstance(mark, Long):
                    yield [1.0] * (mark.count + 1)


def declared(call: Callable[..., Any]) -> dict[str, Any]:
    """The annotations of what is given to a study or to options."""
    hints = get_type_hints(call, include_extras=True)
    return {name: hints[name] for name in inspect.signature(call).parameters}


def blamed(call: Callable[..., Any], argument: str, bad: Any) -> str:
    """The argument that is blamed for a bad one among good ones."""
    needed = inspect.signature(call).parameters
    given = {n: a_good(h) for n, h in declared(call).items() if needed[n].default is inspect.Parameter.empty}
    try:
        call(**(given | {argument: bad}))
    except ArgumentError as error:
        return error.argument.split("[")[0]
    except Exception as error:  # told with the others
        return repr(error)
    return "nothing"


def wrongly_blamed(call: Callable[..., Any], bad: Mapping[str, Iterable[Any]]) -> list[str]:
    """What is not refused under its own name, in words."""
    found = ((name, one, blamed(call, name, one)) for name, several in bad.items() for one in several)
    return [f"{name}={one!r} blames {said}" for name, one, said in found if said != name]


def test_all_studies_are_found() -> None:
    assert len(STUDIES) >= 24 and len(OPTIONS) >= 80


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_refuses_what_its_annotations_do_not_say(name: str) -> None:
    study = STUDIES[name]
    bad: dict[str, Iterable[Any]] = {a: bad_ones(hint) for a, hint in declared(study).items() if a not in CLOCK}
    assert wrongly_blamed(study, bad | CLOCK) == []


@pytest.mark.parametrize("name", OPTIONS)
def test_options_refuse_what_their_annotations_do_not_say(name: str) -> None:
    options = OPTIONS[name]
    assert wrongly_blamed(options, {a: bad_ones(hint) for a, hint in declared(options).items()}) == []


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_that_was_ended_before_it_had_values_is_shown(name: str) -> None:
    """Some classes cannot be without their numbers, and a stop within their first step ended in a TypeError."""
    s = ended(get_type_hints(STUDIES[name])["return"], "stopped before it began", "a title")
    assert s.status is gt.SolveStatus.INTERRUPTED and s.title == "a title" and str(s) is not None


def test_a_study_still_shows_its_signature() -> None:
    shown = inspect.signature(gt.compliance.study)
    assert list(shown.parameters)[:3] == ["robot", "springs", "load"] and shown.parameters["frequencies"].default == 3
    with pytest.raises(TypeError, match="lod"):
        gt.compliance.study(None, None, lod=3)  # type: ignore[call-arg, arg-type]


def test_a_file_with_unequal_rows_is_refused_at_its_key() -> None:
    with pytest.raises(InputError) as caught:
        gt.load("vibration_table_6_15", "matrices.M_kg=[[1.0], [1.0, 2.0]]")
    assert caught.value.key == "matrices.M_kg"
