"""The one refusal of all libraries, and the warning about an old name that is still read."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

NEXT_RELEASE = "0.4"  # it no longer reads the old names of this one


class ArgumentError(ValueError):
    """What a caller gave cannot be used: one plain sentence, and which argument it is.

    sentence: what was found, what was expected, what to do; without the argument's name.
    argument: its name, dotted where it is an entry of an options object ("limits.force"); "" where it is none alone.

    It is a ValueError.

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
    """A block in which errors of these kinds are refused as this argument, in the same sentence.

    argument: its name. One that ends in a dot, "plants.x.", goes before the name that is refused inside; a dictionary
    has names by those inside, under "" that of all others.
    kinds: exception classes, ArgumentError if left out; all others pass. before, after: of the sentence.
    refusal: what is raised in place of them, of sentence and argument.

    Raises ArgumentError, or the refusal.

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
        said, inside = (error.message, error.argument) if isinstance(error, ArgumentError) else (str(error), "")
        if isinstance(argument, str):
            name = argument if argument[-1:] != "." else f"{argument}{inside}".removesuffix(".")
        else:
            name = argument.get(inside, argument.get("", inside))
        raise refusal(f"{before}{said}{after}", name) from error
