"""The error of all libraries about a wrong argument, and the warning about an old name."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

NEXT_RELEASE = "0.4"  # it no longer reads the old names of this one


class ArgumentError(ValueError):
    """A wrong argument: one sentence, and the name of the argument.

    sentence: what was found, what was expected, what to do; without the argument's name.
    argument: its name, dotted for a field of an options object ("limits.force"); "" if the error concerns several.

    A subclass of ValueError.

    >>> print(gt.results.ArgumentError("expected at least 1; found 0", "map.step"))
    map.step: expected at least 1; found 0
    """

    def __init__(self, sentence: str, argument: str = "") -> None:
        super().__init__(sentence, argument)
        self.message = sentence
        self.argument = argument

    def __str__(self) -> str:
        return f"{self.argument}: {self.message}" if self.argument else self.message


def renamed(old: str, new: str) -> None:
    """Warn that an old key or argument is read for one more release: a FutureWarning, which Python always shows."""
    warnings.warn(f"{old} is called {new} now; version {NEXT_RELEASE} will not read the old name", FutureWarning, 4)


@contextmanager
def naming(
    argument: str | Mapping[str, str], *kinds: type[Exception], before: str = "", after: str = "",
    refusal: Callable[[str, str], Exception] = ArgumentError,
) -> Iterator[None]:  # fmt: skip
    """Raise errors of the block again as errors about this argument, with the same sentence.

    argument: its name. A name that ends in a dot, "plants.x.", becomes a prefix of the inner name. A dictionary maps
    inner names to outer names, and "" to the name for all others.
    kinds: exception classes, ArgumentError if left out; others pass. before, after: additions to the sentence.
    refusal: makes the new exception from sentence and argument.

    Raises ArgumentError, or what `refusal` makes.

    >>> with gt.results.naming("guess", KeyError, ValueError):
    ...     float("fast")
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: guess: could not convert string to float: 'fast'
    >>> with gt.results.naming("plants.x."):
    ...     raise gt.results.ArgumentError("must be above 0", "mass")
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: plants.x.mass: must be above 0
    """
    caught = kinds or (ArgumentError,)
    try:
        yield
    except caught as error:
        sentence, inside = (error.message, error.argument) if isinstance(error, ArgumentError) else (str(error), "")
        if isinstance(argument, str):
            name = argument if argument[-1:] != "." else f"{argument}{inside}".removesuffix(".")
        else:
            name = argument.get(inside, argument.get("", inside))
        raise refusal(f"{before}{sentence}{after}", name) from error
