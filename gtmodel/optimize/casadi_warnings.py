"""CasADi writes warnings to stderr that the sentences of a solution say better: they are left out there."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from typing import Any

BEGIN, END = "CasADi - ", "]\n"  # CasADi writes a warning piece by piece: date, text, [file:line]


class _Sieve:
    """A stream without the warnings that one thread writes; all else passes."""

    def __init__(self, stream: Any) -> None:
        self._stream, self._thread, self._within = stream, threading.get_ident(), False

    def write(self, text: str) -> int:
        if threading.get_ident() == self._thread:
            self._within = self._within or text.startswith(BEGIN)
            if self._within:
                self._within = not text.endswith(END)
                return len(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def without_warnings() -> Iterator[None]:
    """Leaves out what CasADi warns of meanwhile; what others write to stderr passes."""
    with redirect_stderr(_Sieve(sys.stderr)):  # type: ignore[type-var]
        yield
