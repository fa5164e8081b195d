"""Check of values against annotations: type, allowed words, length, bounds; and their names in error messages."""

from __future__ import annotations

import difflib
import math
import numbers
import sys
import types
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np

from .._pickling import PortableError
from .quantity import marks_of
from .refusal import ArgumentError

# singular and plural
_WORDS: dict[Any, tuple[str, str]] = {
    float: ("a number", "numbers"),
    int: ("a whole number", "whole numbers"),
    str: ("text", "texts"),
    bool: ("True or False", "True or False"),
    Path: ("a path", "paths"),
    np.ndarray: ("an array of numbers", "arrays of numbers"),
    Any: ("anything", "anything"),
    type(None): ("None", "None"),
}
_LONGEST = 60  # characters of a value in a message


def expected(hint: Any, several: bool = False) -> str:
    """Return the type of an annotation in words: "a list of numbers", "gtmodel.motion.Limits or None"."""
    kind, inside = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        return expected(inside[0], several)
    if kind in _WORDS:
        return _WORDS[kind][several]
    if kind in (Union, types.UnionType):
        return " or ".join(expected(member, several) for member in inside)
    if kind is Literal:
        return f"{'' if len(inside) == 1 else 'one of '}{', '.join(map(str, inside))}"
    if kind is Callable or is_function_protocol(kind):
        return "functions" if several else "a function"
    if isinstance(kind, type) and inside and issubclass(kind, Mapping):
        return f"{'dicts' if several else 'a dict'} of {expected(inside[1], True)} by name"
    if isinstance(kind, type) and inside and issubclass(kind, Iterable):
        return f"{'lists' if several else 'a list'} of {expected(inside[0], True)}"
    return class_name(kind) if isinstance(kind, type) else str(kind)


def is_function_protocol(kind: Any) -> bool:
    """Return True for a protocol of functions; a `runtime_checkable` protocol describes objects."""
    return getattr(kind, "_is_protocol", False) and not getattr(kind, "_is_runtime_protocol", False)


def described(value: Any) -> str:
    """Return a short description of a value: the value itself if it is short, otherwise its class."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    if value is None or isinstance(value, (str, bool, int, float, complex, np.generic, list, tuple, dict, Path)):
        text = str(value) if isinstance(value, np.generic) else repr(value)
        return text if len(text) <= _LONGEST else f"{type(value).__name__} {text[:_LONGEST]}..."
    if isinstance(value, type):
        return f"the class {class_name(value)} itself"
    if callable(value) and hasattr(value, "__name__"):
        return f"the function {value.__name__}"
    return class_name(type(value))


def near(value: Any, hint: Any) -> str:
    """Return "; did you mean ...?" with a similar word of the annotation, or an empty string."""
    words = _words(hint) if isinstance(value, str) else []
    close = difflib.get_close_matches(str(value), words, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def class_name(cls: type) -> str:
    """Return the full name of a class, with the outermost package that exports it."""
    parts = cls.__module__.split(".")
    for n in range(1, len(parts) + 1):
        package = ".".join(parts[:n])
        if getattr(sys.modules.get(package), cls.__name__, None) is cls:
            return cls.__name__ if package == "builtins" else f"{package}.{cls.__name__}"
    return f"{cls.__module__}.{cls.__qualname__}"


def _words(hint: Any) -> list[str]:
    if get_origin(hint) is Literal:
        return [word for word in get_args(hint) if isinstance(word, str)]
    return [word for member in get_args(hint) for word in _words(member)]


Marks = tuple[Any, ...]
UNEQUAL = "expected rows of equal length"
_SHOWN = 12  # names in a message
_NUMBERS: dict[Any, Any] = {float: numbers.Real, int: numbers.Integral}


@dataclass(frozen=True)
class Within:
    """Bounds of a number, or of each number of a list: > above, >= least, <= most, < below.

    >>> print(gt.results.Within(above=0.0, most=1.0))
    more than 0 and at most 1
    """

    above: float | None = None
    least: float | None = None
    most: float | None = None
    below: float | None = None
    advice: str = ""  # added to the message if a bound is violated

    def holds(self, x: float) -> bool:
        """Return True if a number is within all bounds."""
        return (
            (self.above is None or x > self.above)
            and (self.least is None or x >= self.least)
            and (self.most is None or x <= self.most)
            and (self.below is None or x < self.below)
        )

    def __str__(self) -> str:
        words = (("more than", self.above), ("at least", self.least), ("at most", self.most), ("less than", self.below))
        return " and ".join(f"{word} {x:g}" for word, x in words if x is not None)


@dataclass(frozen=True)
class Long:
    """Number of entries of a list, or of each list in a list. A single number instead of a list is refused."""

    count: int


@dataclass(frozen=True)
class AnyNumber:
    """Numbers may be infinite or NaN, for data of many evaluations with a status each."""


class WrongKind(PortableError, ArgumentError):
    """A value with another type than the annotation, or a word that is not allowed."""

    def __init__(self, value: Any, hint: Any, argument: str) -> None:
        super().__init__(f"expected {expected(hint)}; found {described(value)}{near(value, hint)}", argument)
        self.value = value


def agree(value: Any, hint: Any, argument: str, marks: Marks = ()) -> None:
    """Raises ArgumentError unless a value agrees with an annotation; numbers must be finite, except with `AnyNumber`.

    marks: Within, Long and AnyNumber of the enclosing Annotated. A tuple or an array is accepted as a list. Errors
    about an object in a list name its place, "cases[1]"; errors about numbers and words name the list.
    """
    hint, further = _plain(hint)
    marks = (*marks, *further)
    origin, inside = get_origin(hint), get_args(hint)
    kind = origin or hint
    if kind in (Union, types.UnionType):
        _one_of(value, inside, argument, marks)
    elif kind is Literal:
        if not any(type(value) is type(word) and value == word for word in inside):
            raise WrongKind(value, hint, argument)
    elif kind in _NUMBERS:
        if not isinstance(value, _NUMBERS[kind]) or isinstance(value, bool):
            raise WrongKind(value, hint, argument)
        _bounded([_as_float(value)], argument, marks)
    elif kind is np.ndarray:
        _array(value, hint, argument, marks)
    elif kind is Callable or is_function_protocol(kind):
        if not callable(value) or isinstance(value, type):
            raise WrongKind(value, hint, argument)
    elif kind is Any or not isinstance(kind, type):  # a type variable
        return
    elif issubclass(kind, Mapping):
        if not isinstance(value, Mapping):
            raise WrongKind(value, hint, argument)
        for key, item in value.items():
            agree(key, inside[0], argument)
            agree(item, inside[1], _place(argument, f".{key}", inside[1]), marks)
    elif inside and issubclass(kind, Iterable):
        _listed(value, hint, argument, marks)
    elif not isinstance(value, kind):
        raise WrongKind(value, hint, argument)


def numbers_of(names: Sequence[str], values: Sequence[float] | np.ndarray, argument: str) -> np.ndarray:
    """Return values as an array, one per name; they may be infinite or NaN. Raises ArgumentError for anything else.

    >>> from gtmodel.results.agreement import numbers_of
    >>> numbers_of(["x", "y"], [1.0], "values")
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: values: expected a list of 2 numbers, for x, y; found 1: [1.0]
    """
    try:
        numbers = np.asarray(values)
    except ValueError:  # rows of different lengths
        numbers = np.array(None)
    if numbers.shape != (len(names),) or numbers.dtype.kind not in "fiu":
        count = "one number" if len(names) == 1 else f"{len(names)} numbers"
        shown = ", ".join(names[:_SHOWN]) + (", ..." if names[_SHOWN:] else "")
        number = f"{len(numbers)}: " if numbers.ndim == 1 and len(numbers) != len(names) else ""
        raise ArgumentError(f"expected a list of {count}, for {shown}; found {number}{described(values)}", argument)
    return numbers.astype(float)


def _listed(value: Any, hint: Any, argument: str, marks: Marks) -> None:
    inside, several = get_args(hint), Sequence if issubclass(get_origin(hint) or hint, Sequence) else Collection
    no_list = isinstance(value, (str, bytes, Mapping)) or (isinstance(value, np.ndarray) and not value.ndim)
    if no_list or not isinstance(value, (several, np.ndarray)):
        raise WrongKind(value, hint, argument)
    if get_origin(hint) is tuple and Ellipsis not in inside:
        _long(len(value), len(inside), argument)
        for k, item in enumerate(value):
            agree(item, inside[k], _place(argument, f"[{k}]", inside[k]), marks)
        return
    if not _holds_lists(inside[0]):
        if isinstance(value, np.ndarray) and value.ndim > 1:
            raise WrongKind(value, hint, argument)
        for mark in marks:
            if isinstance(mark, Long):
                _long(len(value), mark.count, argument)
    for k, item in enumerate(value):
        agree(item, inside[0], _place(argument, f"[{k}]", inside[0]), marks)
    if hint == list[list[float]] and len(set(map(len, value))) > 1:  # type: ignore[arg-type]
        raise ArgumentError(f"{UNEQUAL}; found {described(value)}", argument)


def _array(value: Any, hint: Any, argument: str, marks: Marks) -> None:
    """Check an array, or lists that form one."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise ArgumentError(f"{UNEQUAL}; found {described(value)}", argument) from None
    if array.dtype.kind not in "fiu" or not array.ndim:
        raise WrongKind(value, hint, argument)
    for mark in marks:
        if isinstance(mark, Long):
            _long(array.shape[-1], mark.count, argument)
    if array.size:
        _bounded([float(array.min()), float(array.max())], argument, marks)


def _as_float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:  # an integer larger than any float
        return math.inf


def _bounded(numbers: Sequence[float], argument: str, marks: Marks) -> None:
    for x in numbers:
        if not math.isfinite(x):
            if any(isinstance(mark, AnyNumber) for mark in marks):
                continue
            raise ArgumentError(f"expected finite numbers; found {x:g}", argument)
        for mark in marks:
            if isinstance(mark, Within) and not mark.holds(x):
                advice = f"; {mark.advice}" if mark.advice else ""
                raise ArgumentError(f"must be {mark}; found {x:g}{advice}", argument)


def _one_of(value: Any, hints: Sequence[Any], argument: str, marks: Marks) -> None:
    """Check against several types; if the value has one of them, report the error of that type."""
    inner = None
    for hint in hints:
        try:
            return agree(value, hint, argument, marks)
        except ArgumentError as error:
            if not isinstance(error, WrongKind) or error.value is not value:
                inner = inner or error
    if inner is not None:
        raise inner
    raise WrongKind(value, Union[tuple(hints)], argument)  # noqa: UP007  # pyrefly: ignore[invalid-annotation]


def _long(count: int, expected: int, argument: str) -> None:
    if count != expected:
        raise ArgumentError(f"expected {expected} numbers; found {count}", argument)


def _plain(hint: Any) -> tuple[Any, Marks]:
    """A hint without its Annotated, and the metadata of the Annotated."""
    return (get_args(hint)[0], marks_of(hint)) if get_origin(hint) is Annotated else (hint, ())


@cache
def _holds_lists(hint: Any) -> bool:
    kind = get_origin(_plain(hint)[0])
    return isinstance(kind, type) and issubclass(kind, (Sequence, np.ndarray))


def _place(argument: str, entry: str, hint: Any) -> str:
    """The name of an entry for messages: the list's name for numbers and words."""
    return argument + entry if isinstance(hint, type) and hint not in (float, int, str, bool) else argument
