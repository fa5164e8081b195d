"""What annotations and values are called in a refusal."""

from __future__ import annotations

import difflib
import sys
import types
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np

# of one; of several
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
_LONGEST = 60  # characters of a value that are shown


def expected(hint: Any, several: bool = False) -> str:
    """What an annotation asks for: "a list of numbers", "gtmodel.motion.Limits or None"."""
    kind, inside = get_origin(hint) or hint, get_args(hint)
    if kind is Annotated:
        return expected(inside[0], several)
    if kind in _WORDS:
        return _WORDS[kind][several]
    if kind in (Union, types.UnionType):
        return " or ".join(expected(one, several) for one in inside)
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
    """Whether a protocol stands for functions; one that is `runtime_checkable` stands for objects."""
    return getattr(kind, "_is_protocol", False) and not getattr(kind, "_is_runtime_protocol", False)


def described(value: Any) -> str:
    """A value in a few words: itself where it is short, else its class."""
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
    """Which of the annotation's words was meant, as the end of a sentence."""
    words = _words(hint) if isinstance(value, str) else []
    close = difflib.get_close_matches(str(value), words, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def class_name(cls: type) -> str:
    """A class as it is imported: from the outermost package that has it."""
    parts = cls.__module__.split(".")
    for n in range(1, len(parts) + 1):
        package = ".".join(parts[:n])
        if getattr(sys.modules.get(package), cls.__name__, None) is cls:
            return cls.__name__ if package == "builtins" else f"{package}.{cls.__name__}"
    return f"{cls.__module__}.{cls.__qualname__}"


def _words(hint: Any) -> list[str]:
    if get_origin(hint) is Literal:
        return [word for word in get_args(hint) if isinstance(word, str)]
    return [word for one in get_args(hint) for word in _words(one)]
