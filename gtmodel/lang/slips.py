"""Slips in a person's Python, as model errors: a wrong argument name, a fault inside equations()."""

from __future__ import annotations

import difflib
import functools
import inspect
import sysconfig
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from .source import LANG, ModelError, SourceLocation, here, of_frame

P = ParamSpec("P")
T = TypeVar("T")
_NOBODYS = (
    LANG,
    str(Path(LANG).parent / "__init__.py"),
    sysconfig.get_path("stdlib"),
    sysconfig.get_path("purelib"),
    "<frozen",
)


class CallError(ModelError, TypeError):
    """A function called with arguments that it does not take: a ModelError that is also a TypeError."""


def shortened(value: Any) -> str:
    """A value as it may stand in a sentence."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def near(name: str, known: Any) -> str:
    """ "; did you mean 'known'?" for a name that is close to a known one, else ""."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean '{close[0]}'?" if close else ""


def named(function: Callable[P, T]) -> Callable[P, T]:
    """The same function, which refuses an unknown, a missing or a surplus argument with the caller's line."""

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except TypeError as error:
            # raised by the call itself, before any line of the function ran
            if isinstance(error, ModelError) or error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise
            raise CallError(_unfit(function, error, kwargs), here()) from None

    return called


def _unfit(function: Callable[..., Any], error: TypeError, given: dict[str, Any]) -> str:
    names = [n for n, p in inspect.signature(function).parameters.items() if p.kind is not p.VAR_KEYWORD]
    shown = function.__name__.removeprefix("compile_")
    if unknown := [n for n in given if n not in names]:
        hint = near(unknown[0], names) or f"; it takes {', '.join(names)}"
        return f"{shown}() has no argument '{unknown[0]}'{hint}"
    if "missing" in str(error) and "'model'" in str(error):
        return f"{shown} is asked of a configured model; write Robot().{shown}(...), with parentheses after the class"
    return f"{shown}() {str(error).partition(') ')[2] or error}"


@contextmanager
def persons_code(what: str) -> Iterator[None]:
    """A fault in a method that a person wrote becomes a ModelError with the line where it happened."""
    try:
        yield
    except (ModelError, RecursionError, MemoryError):
        raise
    except Exception as error:
        raise ModelError(f"{what}: {_explained(error)}", _line(error)) from error


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
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(_NOBODYS)]
    return of_frame(frames[-1].filename, frames[-1].lineno or 0) if frames else None


def _explained(error: Exception) -> str:
    text = str(error)
    if isinstance(error, NotImplementedError) and "overloaded function" in text:  # CasADi, given an Expr
        name = text.partition("overloaded function '")[2].partition("'")[0]
        if name == "Function_call":
            return "a CasADi Function takes no expressions of a model; write its formula with the functions of gt"
        return f"CasADi's {name} takes no expressions of a model; use gt.{name} or write it out"
    return f"{type(error).__name__}: {text.splitlines()[0] if text else 'no reason given'}"
