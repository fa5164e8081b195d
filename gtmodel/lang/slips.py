"""Errors in a user's Python code as model errors: a wrong argument name, an exception inside equations()."""

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
# with the separator: a user's folder may be called gtmodel_robots
_PACKAGE = str(Path(LANG).parent) + os.sep
_ENGINES = (LANG, *(_PACKAGE + name for name in ("compiler", "optimize", "simulation")))
_FOLDERS = (*_ENGINES, *map(sysconfig.get_path, ("stdlib", "purelib")))
# prefixes of files that are not a user's code
_LIBRARIES = (*(folder + os.sep for folder in _FOLDERS), _PACKAGE + "_lazy.py", "<frozen")


# CasADi's message about a function without derivatives
_UNDIFFERENTIABLE = re.compile(r"Derivatives cannot be calculated for (\w+)")


class CallError(ModelError, TypeError):
    """A call with wrong arguments: a ModelError that is also a TypeError."""


def shortened(value: Any) -> str:
    """Return the text of a value, shortened for a message."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def named(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that an unknown, missing or surplus argument raises CallError with the caller's line.

    A ModelError without a line also gets the caller's line, if the caller is a user's code. CasADi's error about a
    function without derivatives becomes a ModelError.
    """

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except ModelError as error:
            error.placed(_line_of_text(args) or _users_line())
            raise
        except RuntimeError as error:
            missing = _UNDIFFERENTIABLE.search(str(error))
            if missing is None:
                raise
            raise ModelError(
                f"the external function '{missing[1]}' has no derivatives, but this model needs them, of its values or "
                "of its Jacobian; give its ca.Function one more order of derivatives",
                _users_line(),
            ) from None
        except TypeError as error:
            # only errors of the call itself, not of the function's body
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise
            raise CallError(_call_fault(function, error, args, kwargs), here()) from None

    return called


def _line_of_text(args: tuple[Any, ...]) -> SourceLocation | None:
    """Return the line where a model's class begins in a Modelica text; None if the model is not from Modelica."""
    where = getattr(args[0], "__dict__", {}).get("where") if args else None
    return where if isinstance(where, SourceLocation) and where.file.endswith((".mo", ".mop")) else None


def floats(value: Any) -> np.ndarray:
    """Return numbers as a float array. Raises TypeError for a string, even one with digits, and for other objects."""
    if isinstance(value, float):
        return np.asarray(value)
    array = np.asarray(value)
    if array.dtype.kind in "USMm" or (array.dtype.kind == "O" and any(isinstance(x, str) for x in array.flat)):
        raise TypeError("a string is not a number")
    try:
        return np.asarray(value, dtype=float)
    except OverflowError:
        raise TypeError("a number exceeds the range of float") from None


def _users_line() -> SourceLocation | None:
    """Return the line of the innermost call from outside the package; None if it is a library or the command line."""
    frame: Any = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame = frame.f_back
    if frame is None or frame.f_code.co_filename.startswith(_LIBRARIES):
        return None
    return of_frame(frame.f_code.co_filename, frame.f_lineno)


def _call_fault(function: Callable[..., Any], error: TypeError, args: tuple[Any, ...], kwargs: dict[str, Any]) -> str:
    """Return the sentence about the wrong arguments of a call."""
    parameters = inspect.signature(function).parameters.values()
    names = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD]
    name = function.__name__.removeprefix("compile_")
    if unknown := [n for n in kwargs if n not in names]:
        hint = near(unknown[0], names) or f"; it takes {', '.join(names)}"
        return f"{name}() has no argument '{unknown[0]}'{hint}"
    if "missing" in str(error) and names[0] == "model" and not hasattr(args[0] if args else None, "equations"):
        return f"{name}() needs a model instance; write Robot().{name}(...), with parentheses after the class"
    positional = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    if "positional" in str(error) and len(args) > len(positional) and "missing" not in str(error):
        count = f"{len(positional) or 'no'} positional argument{'s' if len(positional) != 1 else ''}"
        sentence = f"{name}() takes {count}; found {len(args)}"
        keyword_only = [p.name for p in parameters if p.kind is p.KEYWORD_ONLY]
        if not keyword_only:
            return sentence
        surplus = args[len(positional)]
        keyword = "unit" if "unit" in names and isinstance(surplus, str) else keyword_only[0]
        return f"{sentence}: write {keyword}={shortened(surplus)}"
    return f"{name}() {str(error).partition(') ')[2] or error}"


@contextmanager
def persons_code(what: str, method: Callable[..., Any] | None = None) -> Iterator[None]:
    """Turn an exception in a method of a user's class into a ModelError with the line where it happened.

    method: the called method; its first line is used if none of its lines ran.
    """
    try:
        yield
    except (ModelError, MemoryError):
        raise
    except RecursionError as error:
        frames = _users_frames(error)
        names = [f.name for f in frames]
        if not names or names.count(names[-1]) < 50:  # not the user's recursion: an expression is nested too deeply
            raise
        raise ModelError(f"{what}: {names[-1]}() calls itself endlessly", _line(error)) from None
    except Exception as error:
        raise ModelError(f"{what}: {_explained(error)}", _line(error) or line_of(method)) from error


def line_of(method: Any) -> SourceLocation | None:
    """Return the line on which a function or method begins; None for any other object."""
    code = getattr(method, "__code__", None)
    return None if code is None else of_frame(code.co_filename, code.co_firstlineno)


def each_of(source: Iterable[Any], what: str) -> Iterator[Any]:
    """Yield the items of a user's generator, with errors as in `persons_code`."""
    items = iter(source)
    while True:
        with persons_code(what):
            try:
                item = next(items)
            except StopIteration:
                return
        yield item


def _line(error: BaseException) -> SourceLocation | None:
    frames = _users_frames(error)
    return of_frame(frames[-1].filename, frames[-1].lineno or 0) if frames else None


def _users_frames(error: BaseException) -> list[traceback.FrameSummary]:
    return [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(_LIBRARIES)]


def _declarations(error: BaseException) -> dict[str, Any]:
    """Return the declarations of the model whose method raised the error."""
    declared: dict[str, Any] = {}
    for frame, _ in traceback.walk_tb(error.__traceback__):
        declared = getattr(type(frame.f_locals.get("self")), "_declared", declared)
    return declared


def _explained(error: Exception) -> str:
    text = str(error)
    if isinstance(error, NameError) and error.name in _declarations(error):
        return f"the name '{error.name}' is not defined; write self.{error.name}"
    if isinstance(error, TypeError) and (
        method := re.search(r"(\w+)\(\) takes 0 positional arguments but 1 was", text)
    ):
        return f"the method lacks the argument self; write def {method[1]}(self)"
    if isinstance(error, TypeError) and "'method'" in text:
        return f"{text}; call the method, with parentheses after its name"
    if isinstance(error, TypeError) and text == "'Expr' object is not callable":
        return "a variable is not a function; for its value at an instant write x.at(instant), as x.at(self.final_time)"
    if isinstance(error, NotImplementedError) and "overloaded function" in text:  # CasADi called with an Expr
        name = text.partition("overloaded function '")[2].partition("'")[0]
        if name == "Function_call":
            return "a CasADi Function does not accept expressions of a model; write its formula with functions of gt"
        return f"CasADi's {name} does not accept expressions of a model; use gt.{name} or write out the formula"
    return f"{type(error).__name__}: {text.splitlines()[0] if text else 'no message'}"
