"""The one refusal of all libraries."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class ArgumentError(ValueError):
    """What a caller gave cannot be used: one plain sentence, and which argument it is.

    sentence: what was found, what was expected, what to do; without the argument's name.
    argument: its name, dotted where it is an entry of an options object ("limits.force"); "" where it is none alone.
    """

    def __init__(self, sentence: str, argument: str = "") -> None:
        super().__init__(sentence, argument)
        self.sentence = sentence
        self.argument = argument

    def __str__(self) -> str:
        return f"{self.argument}: {self.sentence}" if self.argument else self.sentence


@contextmanager
def refused(argument: str) -> Iterator[None]:
    """A ValueError of what runs inside is a refusal of this argument; one that names its argument stays as it is."""
    try:
        yield
    except ArgumentError as error:
        raise ArgumentError(error.sentence, error.argument or argument) from error
    except ValueError as error:
        raise ArgumentError(str(error), argument) from error
