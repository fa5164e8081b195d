"""The refusal of what a person wrote in a file or on the command line."""

from __future__ import annotations


class InputError(ValueError):
    """What a person gave is wrong: one plain sentence, with the file and its key where they are known."""

    def __init__(self, sentence: str, key: str = "", file: str = "") -> None:
        super().__init__(sentence, key, file)
        self.message = sentence
        self.key = key
        self.file = file

    def __str__(self) -> str:
        return ": ".join(part for part in (self.file, self.key, self.message) if part)

    def within(self, file: str, key: str = "") -> InputError:
        """The same fault seen from outside: in this file, at this key, unless it says so itself."""
        return InputError(self.message, self.key or key, self.file or file)
