"""Run an FMU in a separate process: if it crashes, exits, hangs or prints, only that process is affected."""

from __future__ import annotations

import errno
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

FREE_S = 2.0  # time for a unit to free its memory
END_S = 5.0  # from the end of the channel to the end of the process, which may write a core dump
_KEPT = 64  # log messages kept
_POLL_S = 1e-3
_RETURNS = "an FMU must return a status from every call; ask its maker to correct it"
_FAULTS = {
    "SIGABRT": f", as from abort(); {_RETURNS}",
    "SIGKILL": ", which the system sends if memory is short; free memory, or look in the system's log for the sender",
    "SIGXCPU": ", which the system sends at the limit of computing time; raise it (ulimit -t)",
}


class UnitEnded(RuntimeError):
    """The process of an FMU has ended or was ended; holds a sentence without subject, and the function that ran."""

    def __init__(self, sentence: str, function: str) -> None:
        super().__init__(sentence)
        self.function = function


class UnitProcess:
    """A process that calls an FMU.

    folder: folder where it may write. timeout: of a call [s].

    Output of the FMU goes to the standard error stream. Stop signals reach only the parent process; the process of the
    FMU ends with it. A fork of the parent cannot use the FMU. Raises OSError if no process can be started.
    """

    def __init__(self, folder: Path, timeout: float) -> None:
        if not hasattr(select, "poll"):
            raise OSError(errno.ENOSYS, "gtmodel runs units on POSIX systems only, such as Linux, and not on Windows")
        self._timeout, self._shown, self._rest = timeout, folder / "running-call", bytearray()
        self._shown.write_bytes(LOADING.encode().ljust(SHOWN))
        self.log: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self._owner, self._lock = os.getpid(), threading.RLock()
        self._ended: tuple[str, str] | None = None  # not an exception: its traceback would keep the caller alive
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
        """Reserve the FMU for one thread; others wait. Raises ArgumentError in a fork of the owner."""
        if os.getpid() != self._owner:
            raise ArgumentError(
                f"the FMU belongs to process {self._owner}, not to {os.getpid()}; create one in each process"
            )
        with self._lock:
            yield

    def ask(self, calls: Sequence[tuple[Any, ...]], timeout: float | None = None) -> tuple[list[Any], Any]:
        """Return the results of calls up to the first failure, and the failure: function and status, or a sentence.

        Call it inside `held`. Raises UnitEnded if the process ends or has ended, or if a call takes too long.
        """
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
                reply = received(read, self._rest)
                if reply is None:
                    raise ConnectionResetError
                if len(reply) == 3:  # an answer; a log message has two parts
                    return reply[0], reply[1]
                self.log.append(reply)
                if time.monotonic() > end:
                    raise TimeoutError
        except TimeoutError:
            sentence, function = self._end(0.0, self._hangs(limit))
        except OSError:  # the other end is closed
            sentence, function = self._end(END_S, self._scribbles())
        except (ValueError, EOFError, TypeError):  # the bytes are not a message
            sentence, function = self._scribbles()
        except BaseException:  # the pending answer would be taken for that of the next call
            self._ended = "it was ended because the run was interrupted", self._function()
            self._kill()
            raise
        texts = [plain for _, text in self.log if (plain := one_line(text))]
        self._ended = f"{sentence}; its last message: {texts[-1]}" if texts else sentence, function
        self._kill()
        raise UnitEnded(*self._ended)

    def _function(self) -> str:
        """Return the name of the last call, which the FMU may have overwritten."""
        with suppress(OSError):
            name = self._shown.read_bytes().rstrip(b"\0 ").decode(errors="replace")
            if name.isalnum() or name == LOADING:
                return name
        return "one of its calls"

    def _hangs(self, limit: float) -> tuple[str, str]:
        name = self._function()
        return f"it did not return from {name} within {limit:g} s; raise the timeout, or ask its maker", name

    def _scribbles(self) -> tuple[str, str]:
        name = self._function()
        return f"it wrote to or closed files of another program in {name}; {_RETURNS}", name

    def _end(self, seconds: float, otherwise: tuple[str, str]) -> tuple[str, str]:
        """Return how the process ended; `otherwise` if it still runs after some seconds."""
        until, number, status = time.monotonic() + seconds, 0, 0
        while not number:
            try:
                number, status = os.waitpid(self._process.pid, os.WNOHANG)
            except ChildProcessError:  # SIGCHLD is ignored, or somebody else has waited
                function = self._function()
                return f"its process ended in {function}, exit code unknown; {_RETURNS}", function
            if not number and time.monotonic() >= until:
                return otherwise
            time.sleep(0.0 if number else _POLL_S)
        function, code = self._function(), os.waitstatus_to_exitcode(status)
        self._process.returncode = code
        if code >= 0:
            return f"it ended its process in {function}, with exit code {code}; {_RETURNS}", function
        name = next((s.name for s in signal.Signals if s == -code), f"signal {-code}")
        reason = _FAULTS.get(name, f", a fault of its own code; {_RETURNS}")
        return f"its process was ended by {name} in {function}{reason}", function

    def _kill(self) -> None:
        """Kill the process and its children."""
        self._socket.close()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def close(self) -> None:
        """Free the FMU and end its process; does nothing in a fork of the owner."""
        if os.getpid() != self._owner:
            return
        free = self._lock.acquire(timeout=FREE_S)  # a thread may still be in a call when the program ends
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
    """Return the text as one line without control characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
