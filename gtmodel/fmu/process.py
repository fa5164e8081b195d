"""A unit in a process of its own: it may crash, end itself, hang or print, and only that process is lost."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..results.refusal import ArgumentError
from ..results.work import parents_signals
from . import caller
from .caller import LOADING, SHOWN, look, message, received

FREE_S = 2.0  # in which a unit lets its memory go
END_S = 5.0  # between the end of the channel and that of the process, which may write its memory to a disk
_KEPT = 64  # last sentences of its log
_POLL_S = 1e-3
_RETURNS = "a unit has to return a status from every call; ask its maker for one that does"
_FAULTS = {
    "SIGABRT": f", as abort() does; {_RETURNS}",
    "SIGKILL": ", as the system does where memory is short; free memory, or look for who ended it in the system's log",
    "SIGXCPU": ", as the system does at a limit of computing time; raise it (ulimit -t)",
}


class UnitEnded(RuntimeError):
    """The process of a unit is no more, or was ended; one sentence without its subject, and the function it was in."""

    def __init__(self, sentence: str, function: str) -> None:
        super().__init__(sentence)
        self.function = function


class UnitProcess:
    """A process that calls a unit.

    folder: where it may write. timeout: of a call [s].

    What the unit prints goes to the standard error stream. Signals that ask to stop reach this process only; the other
    one ends with it. A process that is forked from this one leaves the unit alone. Raises OSError where no process can
    be started.
    """

    def __init__(self, folder: Path, timeout: float) -> None:
        self._timeout, self._shown, self._rest = timeout, folder / "running-call", bytearray()
        self._shown.write_bytes(LOADING.encode().ljust(SHOWN))
        self.said: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self._owner, self._lock = os.getpid(), threading.RLock()
        self._ended: tuple[str, str] | None = None  # no exception: its traceback would hold whoever called
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

    @contextmanager
    def held(self) -> Iterator[None]:
        """The unit for one thread; others wait. Raises ArgumentError in a process that is forked from its owner."""
        if os.getpid() != self._owner:
            raise ArgumentError(
                f"a unit answers the process that made it, {self._owner}; this is process {os.getpid()}: make a unit "
                "in each process"
            )
        with self._lock:
            yield

    def ask(self, calls: Sequence[tuple[Any, ...]], timeout: float | None = None) -> tuple[list[Any], Any]:
        """Results of calls up to the first that went wrong, and of that one the function and the status, or a sentence
        alone; where it is held. Raises UnitEnded where the process ends, or has ended, or a call takes too long."""
        if self._ended is not None:
            raise UnitEnded(*self._ended)
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
            sentence, where = self._end(0.0, self._hangs(limit))
        except OSError:  # the other end is closed
            sentence, where = self._end(END_S, self._scribbles())
        except (ValueError, EOFError, TypeError):  # what came is no message
            sentence, where = self._scribbles()
        except BaseException:  # what comes next would be taken for the answer of another call
            self._ended = "it was ended where the run was broken off", self._function()
            self._kill()
            raise
        texts = [plain for _, text in self.said if (plain := one_line(text))]
        self._ended = f"{sentence}; it said last: {texts[-1]}" if texts else sentence, where
        self._kill()
        raise UnitEnded(*self._ended)

    def _function(self) -> str:
        """Where it is: the name of the call that it made last, which it may have overwritten."""
        with suppress(OSError):
            name = self._shown.read_bytes().rstrip(b"\0 ").decode(errors="replace")
            if name.isalnum() or name == LOADING:
                return name
        return "one of its calls"

    def _hangs(self, limit: float) -> tuple[str, str]:
        where = self._function()
        return f"it did not return from {where} within {limit:g} s; give it longer by timeout, or ask its maker", where

    def _scribbles(self) -> tuple[str, str]:
        where = self._function()
        return f"it wrote to or closed files that are not its own in {where}; {_RETURNS}", where

    def _end(self, seconds: float, otherwise: tuple[str, str]) -> tuple[str, str]:
        """How the process ended; `otherwise` where it still runs after some seconds."""
        until, number, status = time.monotonic() + seconds, 0, 0
        while not number:
            try:
                number, status = os.waitpid(self._process.pid, os.WNOHANG)
            except ChildProcessError:  # SIGCHLD is ignored, or somebody else has waited
                where = self._function()
                return f"its process ended in {where}, exit code unknown; {_RETURNS}", where
            if not number and time.monotonic() >= until:
                return otherwise
            time.sleep(0.0 if number else _POLL_S)
        where, code = self._function(), os.waitstatus_to_exitcode(status)
        self._process.returncode = code
        if code >= 0:
            return f"it ended its process by itself in {where}, with exit code {code}; {_RETURNS}", where
        name = next((s.name for s in signal.Signals if s == -code), f"signal {-code}")
        why = _FAULTS.get(name, f", a fault of its own code; {_RETURNS}")
        return f"its process was ended by {name} in {where}{why}", where

    def _kill(self) -> None:
        """The process and those that it started."""
        self._socket.close()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """Frees the unit and ends its process, in the process that made it."""
        if os.getpid() != self._owner:
            return
        free = self._lock.acquire(timeout=FREE_S)  # a thread may be in a call of it when the program ends
        try:
            if self._ended is None:
                with suppress(UnitEnded):
                    if free:
                        self.ask([("close",)], FREE_S)
                    self._ended = "it was closed", ""
                    self._kill()
        finally:
            if free:
                self._lock.release()


def one_line(text: str) -> str:
    """Without what moves a terminal."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
