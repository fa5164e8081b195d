"""The call of a study that a problem file means, as Python objects."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from gtmodel.results import ArgumentError, Study


class Call:
    """A study with its arguments; calling it runs it, with progress=, max_seconds= and stop= as the study takes them.

    study: the function of the library. arguments, options: its positional and named arguments, which may be looked at
    and changed before the call. finish: what the file adds to the study, such as a report that names its inputs.
    """

    def __init__(self, study: Callable[..., Study], *arguments: Any, **options: Any) -> None:
        self.study = study
        self.arguments = list(arguments)
        self.options = options
        self.finish: Callable[[Any], Study] | None = None

    def then(self, finish: Callable[[Any], Study]) -> Call:
        """The same call, its study finished by a function."""
        self.finish = finish
        return self

    def __call__(self, **work: Any) -> Any:
        """Run it. Raises ArgumentError where an argument is missing that the file does not hold, such as a folder."""
        try:
            inspect.signature(self.study).bind(*self.arguments, **self.options, **work)
        except TypeError as error:
            name = str(error).rpartition("'")[0].rpartition("'")[2]
            raise ArgumentError(f"{self.study.__name__}(): {error}", name) from None
        study = self.study(*self.arguments, **self.options, **work)
        # what was ended before it had values is a plain study, to which a file has nothing to add
        return study if self.finish is None or type(study) is Study else self.finish(study)

    def __repr__(self) -> str:
        name = f"{self.study.__module__}.{self.study.__qualname__}"
        given = [*map(_short, self.arguments), *(f"{k}={_short(v)}" for k, v in self.options.items())]
        return f"{name}({', '.join(given)})"


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 200 else f"<{type(value).__name__}>"
