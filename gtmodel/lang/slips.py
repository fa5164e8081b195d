"""Slips in a person's Python, as model errors: a wrong argument name, a fault inside equations()."""

from __future__ import annotations

import functools
import inspect
import os
import re
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from .._near import near
from .source import LANG, ModelError, SourceLocation, here, of_frame

P = ParamSpec("P")
T = TypeVar("T")
# with the separator: a person's folder may be called gtmodel_robots
_PACKAGE = str(Path(LANG).parent) + os.sep
_OWN = (LANG, *(_PACKAGE + name for name in ("compiler", "optimize", "simulation")))
_FOLDERS = (*_OWN, *map(sysconfig.get_path, ("stdlib", "purelib")))
_NOBODYS = (*(folder + os.sep for folder in _FOLDERS), _PACKAGE + "_lazy.py", "<frozen")


class CallError(ModelError, TypeError):
    """A function called with arguments that it does not take: a ModelError that is also a TypeError."""


def shortened(value: Any) -> str:
    """A value as it may stand in a sentence."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def named(function: Callable[P, T]) -> Callable[P, T]:
    """The same function, which refuses an unknown, a missing or a surplus argument with the caller's line.

    An error of a model that says no place gets the caller's line too, where the caller is a person.
    """

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except ModelError as error:
            error.placed(_line_of_text(args) or _persons_line())
            raise
        except TypeError as error:
            # raised by the call itself, before any line of the function ran
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise
            raise CallError(_unfit(function, error, args, kwargs), here()) from None

    return called


def _line_of_text(args: tuple[Any, ...]) -> SourceLocation | None:
    """Where a model's class begins in a Modelica text; None for a model of anything else."""
    where = getattr(args[0], "__dict__", {}).get("where") if args else None
    return where if isinstance(where, SourceLocation) and where.file.endswith((".mo", ".mop")) else None


def floats(value: Any) -> np.ndarray:
    """Numbers as an array of floats. Raises TypeError for a text, also one that looks like a number, and for none."""
    if isinstance(value, float):
        return np.asarray(value)
    array = np.asarray(value)
    if array.dtype.kind in "USMm" or (array.dtype.kind == "O" and any(isinstance(x, str) for x in array.flat)):
        raise TypeError("a text is no number")
    try:
        return np.asarray(value, dtype=float)
    except OverflowError:
        raise TypeError("a number is larger than any float") from None


def _persons_line() -> SourceLocation | None:
    """Line of the innermost call from outside the package; None where a library or the command line called."""
    frame: Any = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame = frame.f_back
    if frame is None or frame.f_code.co_filename.startswith(_NOBODYS):
        return None
    return of_frame(frame.f_code.co_filename, frame.f_lineno)


def _unfit(function: Callable[..., Any], error: TypeError, args: tuple[Any, ...], given: dict[str, Any]) -> str:
    parameters = inspect.signature(function).parameters.values()
    names = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD]
    shown = function.__name__.removeprefix("compile_")
    if unknown := [n for n in given if n not in names]:
        hint = near(unknown[0], names) or f"; it takes {', '.join(names)}"
        return f"{shown}() has no argument '{unknown[0]}'{hint}"
    if "missing" in str(error) and names[0] == "model" and not hasattr(args[0] if args else None, "equations"):
        return f"{shown} is asked of a configured model; write Robot().{shown}(...), with parentheses after the class"
    places = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    if "positional" in str(error) and len(args) > len(places) and "missing" not in str(error):
        count = f"{len(places) or 'no'} argument{'s' if len(places) != 1 else ''}"
        said = f"{shown}() takes {count} without a name; found {len(args)}"
        named_only = [p.name for p in parameters if p.kind is p.KEYWORD_ONLY]
        if not named_only:  # nothing that a name could stand before
            return said
        meant = "unit" if "unit" in names and isinstance(args[len(places)], str) else named_only[0]
        return f"{said}: write {meant}={shortened(args[len(places)])}"
    return f"{shown}() {str(error).partition(') ')[2] or error}"


@contextmanager
def persons_code(what: str, method: Callable[..., Any] | None = None) -> Iterator[None]:
    """A fault in a method that a person wrote becomes a ModelError with the line where it happened.

    method: the one that is called; its first line where no line of it ran.
    """
    try:
        yield
    except (ModelError, MemoryError):
        raise
    except RecursionError as error:
        frames = _persons_frames(error)
        names = [f.name for f in frames]
        if not names or names.count(names[-1]) < 50:  # too deep an expression
            raise
        raise ModelError(f"{what}: {names[-1]}() calls itself without an end", _line(error)) from None
    except Exception as error:
        raise ModelError(f"{what}: {_explained(error)}", _line(error) or line_of(method)) from error


def line_of(method: Any) -> SourceLocation | None:
    """The line on which a function or method begins; None for anything else."""
    code = getattr(method, "__code__", None)
    return None if code is None else of_frame(code.co_filename, code.co_firstlineno)


def each_of(source: Iterable[Any], what: str) -> Iterator[Any]:
    """The items that a person's generator yields; see `persons_code`."""
    items = iter(source)
    while True:
        with persons_code(what):
            try:
                item = next(items)
            except StopIteration:
                return
        yield item


def _line(error: BaseException) -> SourceLocation | None:
    frames = _persons_frames(error)
    return of_frame(frames[-1].filename, frames[-1].lineno or 0) if frames else None


def _persons_frames(error: BaseException) -> list[traceback.FrameSummary]:
    return [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(_NOBODYS)]


def _of_self(error: BaseException) -> dict[str, Any]:
    """What the model declares in whose method the fault is."""
    declared: dict[str, Any] = {}
    for frame, _ in traceback.walk_tb(error.__traceback__):
        declared = getattr(type(frame.f_locals.get("self")), "_declared", declared)
    return declared


def _explained(error: Exception) -> str:
    text = str(error)
    if isinstance(error, NameError) and error.name in _of_self(error):
        return f"there is no '{error.name}' by itself; write self.{error.name}"
    if isinstance(error, TypeError) and (bare := re.search(r"(\w+)\(\) takes 0 positional arguments but 1 was", text)):
        return f"it lacks its first argument; write def {bare[1]}(self)"
    if isinstance(error, TypeError) and "'method'" in text:
        return f"{text}; call the method, with parentheses behind its name"
    if isinstance(error, TypeError) and text == "'Expr' object is not callable":
        return "a variable is no function; its value at an instant is written x.at(instant), as x.at(self.final_time)"
    if isinstance(error, NotImplementedError) and "overloaded function" in text:  # CasADi, given an Expr
        name = text.partition("overloaded function '")[2].partition("'")[0]
        if name == "Function_call":
            return "a CasADi Function takes no expressions of a model; write its formula with the functions of gt"
        return f"CasADi's {name} takes no expressions of a model; use gt.{name} or write it out"
    return f"{type(error).__name__}: {text.splitlines()[0] if text else 'no reason given'}"
