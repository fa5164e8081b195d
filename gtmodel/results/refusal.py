"""The one refusal of all libraries."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


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


@contextmanager
def naming(argument: str, *kinds: type[Exception]) -> Iterator[None]:
    """A block in which errors of these kinds are refused as this argument, in the same sentence.

    kinds: exception classes; all others pass. Raises ArgumentError in place of them.

    >>> with gt.results.naming("guess", KeyError, ValueError):
    ...     float("fast")
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: guess: could not convert string to float: 'fast'
    """
    try:
        yield
    except kinds as error:
        raise ArgumentError(error.message if isinstance(error, ArgumentError) else str(error), argument) from error
