"""A unit in a process of its own: it may crash, end itself, hang or print, and only that process is lost."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..results.work import parents_signals
from . import caller
from .caller import LOADING, SHOWN, look, message, received

FREE_S = 2.0  # in which a unit lets its memory go
END_S = 5.0  # between the end of the channel and that of the process, which may write its memory to a disk
_KEPT = 64  # last sentences of its log
_FAULTS = {"SIGABRT": ", as abort() does", "SIGKILL": ", as the system does where memory is short"}
_RETURNS = "a unit has to return a status from every call; ask its maker for one that does"


class UnitEnded(RuntimeError):
    """The process of a unit is no more, or was ended; one sentence without its subject, and the function it was in."""

    def __init__(self, sentence: str, function: str) -> None:
        super().__init__(sentence)
        self.function = function


class UnitProcess:
    """A process that calls a unit.

    folder: where it may write. timeout: of a call [s].

    What the unit prints goes to the standard error stream. Signals that ask to stop reach this process only; the other
    one ends with it. Raises OSError where no process can be started.
    """

    def __init__(self, folder: Path, timeout: float) -> None:
        self._timeout, self._shown, self._rest = timeout, folder / "running-call", bytearray()
        self._shown.write_bytes(LOADING.encode().ljust(SHOWN))
        self.said: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self._ended: UnitEnded | None = None
        self._socket, far = socket.socketpair()
        self._waiting = select.poll()
        self._waiting.register(self._socket, select.POLLIN)
        program = [sys.executable, "-I", "-S", "-B", caller.__file__, str(far.fileno()), str(self._shown)]
        try:
            with far, parents_signals():
                printed = 2 if _is_open(2) else subprocess.DEVNULL
                self._process = subprocess.Popen(
                    program, stdin=subprocess.DEVNULL, stdout=printed, stderr=printed, pass_fds=[far.fileno()],
                    start_new_session=True,
                )  # fmt: skip
        except OSError:
            self._socket.close()
            raise

    def ask(self, calls: Sequence[tuple[Any, ...]], timeout: float | None = None) -> tuple[list[Any], Any]:
        """Results of calls up to the first that went wrong, and of that one the function and the status, or a sentence
        alone. Raises UnitEnded where the process ends, or has ended, or a call takes too long."""
        if self._ended is not None:
            raise self._ended
        limit = self._timeout if timeout is None else timeout
        end = time.monotonic() + limit

        def read(size: int) -> bytes:
            look(self._waiting)
            self._socket.settimeout(max(end - time.monotonic(), 1e-3))
            return self._socket.recv(size)

        try:
            self._socket.settimeout(limit)
            self._socket.sendall(message(calls))
            while True:
                came = received(read, self._rest)
                if came is None:
                    raise ConnectionResetError
                if len(came) == 3:  # an answer; a sentence of the log has two parts
                    return came[0], came[1]
                self.said.append(came)
                if time.monotonic() > end:
                    raise TimeoutError
        except TimeoutError:
            ended = self._end() if self._process.poll() is not None else self._hangs(limit)
        except OSError:  # the other end is closed
            ended = self._end()
        except (ValueError, EOFError, TypeError):  # what came is no message
            ended = self._scribbles()
        except BaseException:  # what comes next would be taken for the answer of another call
            self._ended = UnitEnded("it was ended where the run was broken off", self._function())
            self._kill()
            raise
        texts = [plain for _, text in self.said if (plain := one_line(text))]
        self._ended = UnitEnded(f"{ended}; it said last: {texts[-1]}", ended.function) if texts else ended
        self._kill()
        raise self._ended

    def _function(self) -> str:
        """Where it is: the name of the call that it made last, which it may have overwritten."""
        with suppress(OSError):
            name = self._shown.read_bytes().rstrip(b"\0 ").decode(errors="replace")
            if name.isalnum() or name == LOADING:
                return name
        return "one of its calls"

    def _hangs(self, limit: float) -> UnitEnded:
        where = self._function()
        return UnitEnded(
            f"it did not return from {where} within {limit:g} s; give it longer by timeout, or ask its maker", where
        )

    def _scribbles(self) -> UnitEnded:
        where = self._function()
        return UnitEnded(f"it wrote to or closed files that are not its own in {where}; {_RETURNS}", where)

    def _end(self) -> UnitEnded:
        """Of a process whose channel is closed."""
        where = self._function()
        try:
            code = self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            return self._scribbles()
        if code >= 0:
            return UnitEnded(f"it ended its process by itself in {where}, with exit code {code}; {_RETURNS}", where)
        name = next((s.name for s in signal.Signals if s == -code), f"signal {-code}")
        why = _FAULTS.get(name, ", a fault of its own code")
        return UnitEnded(f"its process was ended by {name} in {where}{why}; {_RETURNS}", where)

    def _kill(self) -> None:
        """The process and those that it started."""
        self._socket.close()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """Frees the unit and ends its process."""
        if self._ended is None:
            with suppress(UnitEnded):
                self.ask([("close",)], FREE_S)
                self._ended = UnitEnded("it was closed", "")
                self._kill()


def one_line(text: str) -> str:
    """Without what moves a terminal."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
