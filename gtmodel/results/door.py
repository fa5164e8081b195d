"""The door of a study: every argument is what the signature says, or it is refused before any work."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar, get_type_hints

from .agreement import agree
from .status import SolveStatus
from .study import Study
from .work import KEPT, Interrupted, Work

P = ParamSpec("P")
R = TypeVar("R")


def ended(kind: type[R], message: str, title: str = "") -> R:
    """An interrupted study without values: of its own class, or a plain one where that class cannot be without them."""
    needed = [f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]  # type: ignore[arg-type]
    made: Any = kind if needed == ["status"] else Study
    return made(status=SolveStatus.INTERRUPTED, message=message, title=title)


def study_function(function: Callable[P, R]) -> Callable[P, R]:
    """A study whose arguments are checked against their annotations: kinds, words, `Long`, `Within`.

    `progress`, `max_seconds` and `stop` are what `Work` says. The annotations are read at the first call. What does not
    agree is an ArgumentError with the argument's name. A study that is ended at a `Work.step`, or within one that asks
    too late, is what was kept by `Work.keep`, or that status alone.
    """

    @cache
    def declared() -> tuple[inspect.Signature, dict[str, Any]]:
        hints = get_type_hints(function, include_extras=True)
        of_work = get_type_hints(Work, include_extras=True)
        return inspect.signature(function), {name: of_work.get(name, hint) for name, hint in hints.items()}

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        signature, hints = declared()
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # Python's own words on names that are missing or not there
        for name, value in given.items():
            agree(value, hints[name], name)
        kept: list[Callable[[], R]] = []
        opened = KEPT.set(kept)
        try:
            return function(*args, **kwargs)
        except Interrupted as stopped:
            if kept:
                return kept[-1]()
            return ended(hints["return"], str(stopped), given.get("title", ""))
        finally:
            KEPT.reset(opened)

    return checked
