"""The C loop as a child process, the robot's end of its socket, and the log with a record per cycle."""

from __future__ import annotations

import json
import re
import select
import socket
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..results import Trajectory
from .egm import DATAGRAM_MAX
from .exchange import AXES
from .predictive_law import PLAN_COLUMNS, PLAN_COUNTERS

STATES = ("waiting", "running", "holding", "ramping", "stopped", "braking")
COUNTERS = ("late", "lost", "repeated", "reordered", "stale", "garbage")
WATCHES = ("clock_faults", "following_faults")  # datagrams, cycles
COLUMNS = (
    "cycle",
    "sequence",
    "time_ms",
    "state",
    "status",
    "datagrams",
    *COUNTERS,
    "delay",
    "answer_bytes",
    "answer_hash",
    *(f"measured[{n}]" for n in range(AXES)),
    *(f"command[{n}]" for n in range(AXES)),
    *(f"speed[{n}]" for n in range(AXES)),
    *(f"path[{n}]" for n in range(3)),
    "dry",
    *WATCHES,
    *PLAN_COLUMNS,
)


def rows_of(log: bytes) -> np.ndarray:
    """Return the records (n, columns) of a log. Raises ValueError if the last record is incomplete."""
    size = 8 * len(COLUMNS)
    if len(log) % size:
        raise ValueError(f"the log has {len(log)} bytes; expected whole records of {size}")
    return np.frombuffer(log, dtype="<f8").reshape(-1, len(COLUMNS))


def trajectory_of(
    log: bytes, axes: int, cycle_s: float, title: str = "", unit: str = "m", limits: Sequence[str] | None = None
) -> Trajectory:
    """Return a log over the cycles of the loop: measured and commanded carts [m] or joints [rad], state and counters.

    limits: names of the limits of a plan; adds its numbers, with `active_NAME` 1 where a limit is active in the plan.
    """
    rows = rows_of(log)
    column = {name: rows[:, n] for n, name in enumerate(COLUMNS)}
    units = {"measured": unit, "command": unit, "speed": f"{unit}/s"}
    values = {name: np.stack([column[f"{name}[{n}]"] for n in range(axes)], axis=1) for name in units}
    integers = ("state", *COUNTERS, *WATCHES)
    values |= {name: column[name] for name in integers}
    units |= dict.fromkeys(integers, "1")
    if limits is not None:
        more = {"predicted": unit, "force": "N" if unit == "m" else "N.m"}
        values |= {name: np.stack([column[f"{name}[{n}]"] for n in range(axes)], axis=1) for name in more}
        plain = ("iterations", "cost", "kkt_residual", *PLAN_COUNTERS)
        bits = column["active"].astype(np.int64)
        named = {f"active_{re.sub(r'[^0-9A-Za-z]+', '_', name)}": bits >> k & 1 for k, name in enumerate(limits)}
        values |= {name: column[name] for name in plain} | {name: flag.astype(float) for name, flag in named.items()}
        units |= more | dict.fromkeys([*plain, *named], "1")
    return Trajectory(cycle_s * (column["cycle"] - 1), values, units, title=title)


SECONDS = 10.0
FULL = "the log is incomplete: make room on the disk"
LOG_INCOMPLETE = 1  # exit code of a run with an incomplete log


class LoopError(RuntimeError):
    """The loop did not start or did not answer; the message is one sentence."""


class LoopProcess:
    """A running gt_loop. Use it as a context manager, which ends the process in any case."""

    def __init__(self, program: Path, options: Sequence[str]) -> None:
        self._process = subprocess.Popen(
            [str(program), *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C goes to this process, which ends the loop
        )
        self.port = self._port()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.connect(("127.0.0.1", self.port))
        self.printed = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        if self._process.poll() is None:
            self._process.kill()
        self._process.communicate()

    def send(self, data: bytes) -> None:
        """Send one datagram to the loop; it is lost if the loop has ended."""
        with suppress(ConnectionRefusedError):
            self._socket.send(data)

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def received(self) -> list[bytes]:
        """Return the answers that have arrived, without waiting."""
        datagrams: list[bytes] = []
        while select.select([self._socket], [], [], 0.0)[0]:
            try:
                datagrams.append(self._socket.recv(DATAGRAM_MAX))
            except ConnectionRefusedError:
                break
        return datagrams

    def exchange(self, datagrams: list[bytes]) -> list[bytes]:
        """Run one cycle in lock step: send the datagrams and an empty one; return the answers up to an empty one.

        Raises LoopError if the loop does not answer.
        """
        self._socket.settimeout(SECONDS)
        answers: list[bytes] = []
        try:
            for data in datagrams:
                self._socket.send(data)
            self._socket.send(b"")
            while data := self._socket.recv(DATAGRAM_MAX):
                answers.append(data)
        except OSError as error:
            raise LoopError(f"the loop does not answer ({error}); it printed: {self._ending()}") from error
        return answers

    def end(self) -> None:
        """Ask the loop to ramp to a stop and end, like Ctrl-C; `finish` waits for it."""
        self._process.terminate()

    def finish(self) -> dict[str, Any]:
        """Wait until the loop ends and return its report. Raises LoopError."""
        try:
            out, self.printed = self._process.communicate(timeout=SECONDS)
        except subprocess.TimeoutExpired:
            raise LoopError(f"the loop did not end within {SECONDS:g} s") from None
        if self._process.returncode not in (0, LOG_INCOMPLETE) or not out.strip():
            raise LoopError(f"the loop ended with exit code {self._process.returncode}: {self.printed.strip()}")
        return json.loads(out)

    def _port(self) -> int:
        stream = self._process.stdout
        assert stream is not None
        ready = select.select([stream], [], [], SECONDS)[0]
        word, _, port = (stream.readline() if ready else "").partition(" ")
        if word != "port":
            raise LoopError(f"the loop did not start: {self._ending()}")
        return int(port)

    def _ending(self) -> str:
        if self._process.poll() is None:
            self._process.kill()
        return (self._process.communicate()[1] or "nothing").strip()
