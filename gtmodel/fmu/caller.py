"""Call an FMU with ctypes, in co-simulation, FMI 2.0 and 3.0: our own FMUs in this process, foreign ones in a separate
program that may crash (`process.py`). This file imports only the standard library, so that the program starts fast.
"""

from __future__ import annotations

import _thread
import ctypes as c
import marshal
import mmap
import os
import select
import struct
import sys
import time
from array import array
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

TIMEOUT_S, LONGEST_S = 60.0, 86_400.0  # default and largest timeout of a call; slow instantiations take seconds
WARNING = 1  # the worst status of a successful call
SHOWN = 40  # bytes for the name of the running call
LONGEST = 2000  # characters of a log message
LOADING = "the loading of its library"
LOOK_S = 1e-4
SIZE = struct.Struct("<I")  # header of a message: its size
_FALSE, _TRUE = c.c_bool(False), c.c_bool(True)
_TERMINATED, _LAST_TIME = 3, 2  # kinds of status of FMI 2.0
_SAME = ("Reset", "EnterInitializationMode", "ExitInitializationMode", "DoStep", "FreeInstance")
_NEEDED = {
    2: (*_SAME, "Instantiate", "SetupExperiment", "SetReal", "GetReal"),
    3: (*_SAME, "InstantiateCoSimulation", "SetFloat64", "GetFloat64"),
}
_LOG2 = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)
_LOG3 = c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p)

Log = Callable[[int, bytes], None]


class _Callbacks(c.Structure):
    _fields_ = [
        ("logger", _LOG2),
        *[(name, c.c_void_p) for name in ("allocate", "free", "finished", "environment")],
    ]


class UnitCaller:
    """One co-simulation instance of a shared library.

    library: path. version: 2 or 3. resources: place of the resources, in the form that the version requires. log:
    receives status and text of log messages; None: logging is off. proxy: path of FMPy's library that formats the log
    messages of FMI 2.0. running: buffer that receives the name of each call before it starts.

    Statuses follow the standard: 0 OK, 1 warning, 2 Discard, 3 Error; `last` is the function that returned the last
    one. References and values: sequences of numbers, or bytes of native unsigned integers and doubles. Raises OSError
    if the file is not a library, AttributeError if it lacks a function, RuntimeError if it returns no instance.
    """

    def __init__(
        self, library: str, version: int, name: str, token: str, resources: str = "", *, log: Log | None = None,
        proxy: str = "", running: Any = None,
    ) -> None:  # fmt: skip
        self._running: Any = bytearray(SHOWN) if running is None else running
        self._three, self._prefix, self.last = version == 3, f"fmi{version}", LOADING
        self._running[:SHOWN] = LOADING.encode().ljust(SHOWN)
        folder = os.getcwd()
        os.chdir(os.path.dirname(library))  # so that the loader finds the libraries it depends on
        try:
            self._library = c.CDLL(library)
        finally:
            os.chdir(folder)
        self._functions = {n: self._function(n) for n in _NEEDED[version]}
        logs = log is not None
        if self._three:
            self._log: Any = _LOG3(lambda _, status, category, text: log(status, text or b"")) if log else _LOG3()
            # visible, logging, events, early return; required intermediate variables; environment
            options = [_FALSE, c.c_bool(logs), _FALSE, _FALSE, None, c.c_size_t(0), None, self._log, None]
            self._instance = self._new("InstantiateCoSimulation", name, token, resources, options)
        else:
            libc = c.CDLL(None)
            logger = _LOG2(lambda _, name, status, category, text: log(status, text or b"")) if log else _LOG2()
            memory = [c.cast(f, c.c_void_p) for f in (libc.calloc, libc.free)]
            self._log = _Callbacks(logger, *memory, None, None), logger
            if proxy and log:
                self._proxy = c.CDLL(proxy)
                self._proxy.addLoggerProxy(c.byref(self._log[0]))
            self._instance = self._new("Instantiate", name, token, resources, [c.byref(self._log[0]), 0, int(logs)])

    def _function(self, name: str, result: Any = c.c_int) -> Any:
        function = self._library[f"{self._prefix}{name}"]
        function.restype = c.c_void_p if name.startswith("Instantiate") else result
        return function

    def _new(self, call: str, name: str, token: str, place: str, more: list[Any]) -> c.c_void_p:
        self._begins(call)
        kind = [] if self._three else [1]  # co-simulation
        instance = self._functions[call](name.encode(), *kind, token.encode(), place.encode(), *more)
        if not instance:
            raise RuntimeError(f"{self.last} returned no instance")
        return c.c_void_p(instance)

    def _begins(self, name: str) -> None:
        self.last = self._prefix + name
        self._running[:SHOWN] = self.last.encode().ljust(SHOWN)

    def _do(self, name: str, *arguments: Any) -> int:
        if name not in self._functions:
            self._functions[name] = self._function(name)
        self._begins(name)
        return int(self._functions[name](self._instance, *arguments))

    def reset(self) -> int:
        """Return to the state after instantiation."""
        return self._do("Reset")

    def begin(self, references: Sequence[int] | bytes, values: Sequence[float] | bytes, time: float = 0.0) -> int:
        """Initialise with these start values at this time. Return the first status of failure, otherwise 0."""
        start, none = c.c_double(time), c.c_double()
        steps: list[Callable[[], int]] = [lambda: self.set(references, values)] if len(references) else []
        if self._three:
            steps.append(lambda: self._do("EnterInitializationMode", _FALSE, none, start, _FALSE, none))
        else:
            steps.append(lambda: self._do("SetupExperiment", 0, none, start, 0, none))
            steps.append(lambda: self._do("EnterInitializationMode"))
        steps.append(lambda: self._do("ExitInitializationMode"))
        return next((bad for step in steps if (bad := step()) > WARNING), 0)

    def set(self, references: Sequence[int] | bytes, values: Sequence[float] | bytes) -> int:
        """Set real variables."""
        return self._values("SetFloat64" if self._three else "SetReal", references, array("d", values))

    def set_integers(self, references: Sequence[int], values: Sequence[int]) -> int:
        """Set integers."""
        return self._values("SetInt32" if self._three else "SetInteger", references, array("i", values))

    def get(self, references: Sequence[int] | bytes) -> tuple[int, array[float]]:
        """Return status and real variables; NaN if the FMU wrote none."""
        indices = array("I", references)
        values = array("d", [float("nan")]) * len(indices)
        return self._values("GetFloat64" if self._three else "GetReal", indices, values), values

    def get_integers(self, references: Sequence[int]) -> tuple[int, array[int]]:
        """Return status and integers."""
        values = array("i", [-1]) * len(references)
        return self._values("GetInt32" if self._three else "GetInteger", references, values), values

    def _values(self, name: str, references: Sequence[int] | bytes, values: array[Any]) -> int:
        indices = array("I", references)
        more = [c.c_size_t(len(values))] if self._three else []
        pointers = [c.c_void_p(a.buffer_info()[0]) for a in (indices, values)]
        return self._do(name, pointers[0], c.c_size_t(len(indices)), pointers[1], *more)

    def step(self, time: float, length: float) -> tuple[int, tuple[bool, bool, bool, float]]:
        """Step from `time` by `length` [s]. Return the status; whether the FMU requests an event, requests the end,
        returned early; and the time that it reached, NaN if it does not report one."""
        if self._three:
            flags, last = [c.c_bool() for _ in range(3)], c.c_double(float("nan"))
            arguments = [c.c_double(time), c.c_double(length), _TRUE, *map(c.byref, flags), c.byref(last)]
            status = self._do("DoStep", *arguments)
            return status, (*[bool(f.value) for f in flags], last.value)  # type: ignore[return-value]
        status = self._do("DoStep", c.c_double(time), c.c_double(length), 1)
        ends, reached = False, float("nan")
        if status > WARNING:
            call, flag, last = self.last, c.c_int(), c.c_double()
            with suppress(AttributeError):  # a unit may lack the call
                ends = self._do("GetBooleanStatus", _TERMINATED, c.byref(flag)) <= WARNING and bool(flag.value)
            with suppress(AttributeError):
                if self._do("GetRealStatus", _LAST_TIME, c.byref(last)) <= WARNING:
                    reached = last.value
            self.last = call
        return status, (False, ends, False, reached)

    def close(self) -> None:
        """Free the instance."""
        self._begins("FreeInstance")
        free = self._function("FreeInstance", None)
        free(self._instance)


def look(waiting: select.poll) -> None:
    """Poll for a message briefly before the process sleeps: waking it takes longer than a typical step of an FMU."""
    until = time.perf_counter() + LOOK_S
    while not waiting.poll(0) and time.perf_counter() < until:
        os.sched_yield()


def received(read: Callable[[int], bytes], rest: bytearray) -> Any:
    """Return the next message, None at the end. rest: buffer of bytes that arrived with the previous message."""
    size = SIZE.size
    while len(rest) < size or len(rest) < (whole := size + SIZE.unpack_from(rest)[0]):
        if not (more := read(1 << 16)):
            return None
        rest += more
    message = marshal.loads(rest[size:whole])
    del rest[:whole]
    return message


def message(content: Any) -> bytes:
    """Return the bytes of a message for `received`."""
    data = marshal.dumps(content)
    return SIZE.pack(len(data)) + data


class _Host:
    """The program. A request is a tuple of calls. An answer is (results, function and status of a failed call or None,
    None); log messages (status, text) may come in between."""

    def __init__(self, channel: int, shown: str) -> None:
        self._channel, self._lock = channel, _thread.allocate_lock()
        with open(shown, "r+b") as file:
            self._running = mmap.mmap(file.fileno(), SHOWN)
        self._caller: UnitCaller | None = None

    def _send(self, content: Any) -> None:
        data = memoryview(message(content))
        with self._lock:  # the log may come from threads of the unit
            while data:
                data = data[os.write(self._channel, data) :]

    def _send_log(self, status: int, text: bytes) -> None:
        self._send((status, text[: 4 * LONGEST].decode("utf-8", "replace")[:LONGEST]))

    def _call(self, name: str, *arguments: Any) -> tuple[int, Any]:
        """Return status and result."""
        if name == "make":
            library, version, unit, token, resources, proxy = arguments
            self._caller = UnitCaller(
                library, version, unit, token, resources, log=self._send_log, proxy=proxy, running=self._running
            )
            return 0, None
        if name == "close":
            if self._caller is not None:
                self._caller.close()
            c.CDLL(None).fflush(None)
            return 0, None
        assert self._caller is not None
        result = getattr(self._caller, name)(*arguments)
        if name == "get":
            return result[0], result[1].tobytes()
        return result if isinstance(result, tuple) else (result, None)

    def serve(self) -> None:
        """Answer requests until the channel is closed."""
        rest, waiting = bytearray(), select.poll()
        waiting.register(self._channel, select.POLLIN)

        def read(size: int) -> bytes:
            look(waiting)
            return os.read(self._channel, size)

        while (calls := received(read, rest)) is not None:
            results: list[Any] = []
            fault: tuple[str, int] | tuple[str] | None = None
            try:
                for call in calls:
                    status, result = self._call(*call)
                    results.append(result)
                    if status > WARNING:
                        assert self._caller is not None
                        fault = (self._caller.last, status)
                        break
            except (OSError, AttributeError, RuntimeError) as error:
                fault = (str(error),)
            self._send((results, fault, None))


def _follow(channel: int) -> None:
    """End the process when the other side is gone, even during a call of the FMU."""
    waiting = select.poll()
    waiting.register(channel, 0)
    waiting.poll()
    os._exit(1)


def main() -> None:
    """Run the program `caller.py CHANNEL FILE`: an inherited socket, and a file for the name of the running call."""
    channel, shown = int(sys.argv[1]), sys.argv[2]
    os.set_inheritable(channel, False)
    with suppress(AttributeError, ValueError):  # line buffering: nothing printed is lost in a crash
        libc = c.CDLL(None)
        libc.setvbuf(c.c_void_p.in_dll(libc, "stdout"), None, 1, c.c_size_t(0))
    _thread.start_new_thread(_follow, (channel,))
    _Host(channel, shown).serve()


if __name__ == "__main__":
    main()
