"""Progress of a command on stderr: one changing line on a terminal, otherwise a plain line every ten seconds."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import timedelta
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.status import Status

EVERY_S = 10.0


class _Stage:
    """The last report: stage, share done, numbers."""

    def __init__(self) -> None:
        self._stage = "working"
        self.text = self._stage

    def __call__(
        self,
        stage: str | None = None,
        fraction: float | None = None,
        numbers: Mapping[str, float] | None = None,
    ) -> None:
        from gtmodel.results.table import number

        self._stage = stage or self._stage
        parts = [self._stage if fraction is None else f"{self._stage} {fraction:.0%}"]
        parts += [f"{name} {number(value)}" for name, value in (numbers or {}).items()]
        self.text = ", ".join(parts)
        self._show()

    def _show(self) -> None:
        """Called after each report."""


class LiveLine(_Stage):
    """Progress as one changing line of a terminal."""

    def __init__(self, status: Status) -> None:
        super().__init__()
        self._status = status

    def _show(self) -> None:
        from rich.text import Text

        self._status.update(Text(self.text))


class PlainLines(_Stage):
    """Progress as plain lines, one every `every` seconds: the elapsed time, the stage and the share done.

    write prints one line; clock returns seconds. Work that ends before the first line is due prints nothing.
    """

    def __init__(
        self, write: Callable[[str], object], every: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__()
        self._write, self._clock, self._every = write, clock, every
        self._began, self._next = clock(), every

    def tick(self) -> float:
        """Write a line if one is due, and return the time [s] until the next one."""
        elapsed = self._clock() - self._began
        if elapsed >= self._next:
            with suppress(OSError, ValueError):  # stderr is closed
                self._write(f"{timedelta(seconds=int(elapsed))} {self.text}")
            self._next = (elapsed // self._every + 1) * self._every
        return self._next - elapsed

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """Print lines while the block runs, also in a step that reports nothing."""
        done = threading.Event()

        def watch() -> None:
            while not done.wait(self.tick()):
                pass

        thread = threading.Thread(target=watch, name="progress", daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
