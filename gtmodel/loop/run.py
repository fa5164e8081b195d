"""Runs of a simulated controller against a loop, in lock step or in real time, over a channel that loses, delays and
corrupts datagrams."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .plant import PlantStopped
from .process import SECONDS, LoopProcess
from .robot_side import RobotSide


@dataclass(frozen=True)
class Faults:
    """Faults of a channel: shares from 0 to 1 of datagrams that are lost, delayed, repeated or joined by garbage.

    The faults are drawn independently, from `seed`; a delay is 1 to `longest_delay` cycles.
    """

    lost: float = 0.0
    delayed: float = 0.0
    repeated: float = 0.0
    garbage: float = 0.0
    longest_delay: int = 3
    seed: int = 0


@dataclass
class Channel:
    """One direction of a connection with faults.

    `put` takes a datagram in its cycle; `due` returns the datagrams that arrive in a cycle, in the order they were
    sent. `history` keeps their numbers, cycle by cycle, for `expected_counters`.

    >>> channel = gt.loop.Channel(gt.loop.Faults(lost=1.0))
    >>> channel.put(0, 7, b"datagram")
    >>> channel.due(0)
    []
    """

    faults: Faults = field(default_factory=Faults)
    history: list[list[int | None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = random.Random(self.faults.seed)
        self._waiting: list[tuple[int, int | None, bytes]] = []  # arrival cycle; number, None for garbage; bytes

    def put(self, cycle: int, number: int, data: bytes) -> None:
        """Send a datagram."""
        f, draw = self.faults, self._random.random
        lost, delayed, repeated, garbage = (draw() < share for share in (f.lost, f.delayed, f.repeated, f.garbage))
        delay = self._random.randint(1, f.longest_delay) if delayed else 0
        if garbage:
            self._waiting.append((cycle, None, self._corrupted(data)))
        if not lost:
            self._waiting.append((cycle + delay, number, data))
        if repeated and not lost:
            self._waiting.append((cycle + delay + self._random.randint(0, f.longest_delay), number, data))

    def due(self, cycle: int) -> list[bytes]:
        """Return the datagrams that arrive in this cycle."""
        arrived = [d for d in self._waiting if d[0] <= cycle]
        self._waiting = [d for d in self._waiting if d[0] > cycle]
        self.history.append([number for _, number, _ in arrived])
        return [data for _, _, data in arrived]

    def _corrupted(self, data: bytes) -> bytes:
        """Return random bytes or a truncated datagram; neither can be read as a complete one."""
        if self._random.random() < 0.5:
            return b"\xff" + self._random.randbytes(self._random.randint(0, 200))
        return data[: self._random.randint(1, max(1, len(data) // 3))]


def expected_counters(history: Iterable[list[int | None]]) -> dict[str, int]:
    """Return the counters that a loop must report, from the numbers that arrived in each cycle; None means garbage.

    This independent count uses sets, to compare with the loop, which keeps a window of numbers. A cycle without a newer
    datagram counts as late, a number below the first as stale, a number that never arrives as lost.

    >>> history = [[1], [2, 2], [], [5], [4, None]]
    >>> counted = gt.loop.expected_counters(history)
    >>> counted["lost"], counted["repeated"], counted["reordered"], counted["garbage"], counted["late"]
    (1, 1, 1, 1, 2)
    """
    arrived: set[int] = set()
    count = dict.fromkeys(("late", "repeated", "reordered", "stale", "garbage"), 0)
    newest = first = None
    for numbers in history:
        before = newest
        for number in numbers:
            if number is None:
                count["garbage"] += 1
            elif first is None or newest is None:
                first = newest = number
                arrived.add(number)
            elif number < first:
                count["stale"] += 1
            elif number in arrived:
                count["repeated"] += 1
            else:
                arrived.add(number)
                count["reordered"] += number < newest
                newest = max(newest, number)
        count["late"] += newest is not None and newest == before
    span = 0 if newest is None or first is None else newest - first + 1
    return {**count, "lost": span - len(arrived)}


Answering = Callable[[list[bytes]], list[bytes]]
Stopped = Callable[[float], bool]  # called in every cycle with the share done; True ends the run


def _never(share: float) -> bool:
    return False


@dataclass
class LoopRun:
    """Result of a run: carts (cycles, n) [m] before each cycle's step.

    `measured_m`: as the motors measure them, `arm_m`: on the arm's side, `planned_m`: as the robot planned them.

    `to_loop` and `to_robot` are the channels with their history, `longest_gap_s` is the longest time between two
    datagrams of the robot in real time [s]. `stopped`: message of a plant that failed at `stopped_s` [s] from the start
    of the run, which ends there; "" and None if no plant failed.
    """

    measured_m: np.ndarray
    arm_m: np.ndarray
    planned_m: np.ndarray
    to_loop: Channel = field(default_factory=Channel)
    to_robot: Channel = field(default_factory=Channel)
    longest_gap_s: float = 0.0
    stopped: str = ""
    stopped_s: float | None = None


def lockstep(
    robot: RobotSide,
    answering: Answering,
    cycles: int,
    to_loop: Channel | None = None,
    to_robot: Channel | None = None,
    stopped: Stopped = _never,
) -> LoopRun:
    """Run a simulated controller against a loop cycle by cycle, as fast as the machine allows.

    In each cycle the robot sends, the loop answers and the robot moves.

    Args:
        robot: the controller, with its plant.
        answering: datagrams of a cycle -> answers, such as `exchange` of a `LoopProcess` or of a `PythonLoop`.
        cycles: number of cycles.
        to_loop, to_robot: channels with faults; None: without faults.
        stopped: called in every cycle with the share done; True ends the run.

    A plant that raises `PlantStopped` also ends the run, see `LoopRun.stopped`.

    >>> plant = gt.loop.DrivePlant([0.0, 0.1, 0.2], a=[0.9] * 3, b=[0.1] * 3, delay=0)
    >>> robot = gt.loop.RobotSide("egm", plant)
    >>> run = gt.loop.lockstep(robot, lambda datagrams: [], cycles=5)  # a loop that never answers
    >>> run.measured_m[-1].tolist()  # the robot stays where it is
    [0.0, 0.1, 0.2]
    """
    out, back = to_loop or Channel(), to_robot or Channel()
    carts: list[np.ndarray] = []
    fault: PlantStopped | None = None
    for cycle in range(cycles):
        carts.append(_carts(robot))
        out.put(cycle, robot.number, robot.datagram())
        for answer in answering(out.due(cycle)):
            back.put(cycle, robot.number, answer)
        try:
            robot.step(back.due(cycle))
        except PlantStopped as error:
            fault = error
            break
        if stopped(cycle / cycles):
            break
    return _run(carts, fault, to_loop=out, to_robot=back)


def real_time(robot: RobotSide, loop: LoopProcess, cycles: int, stopped: Stopped = _never) -> LoopRun:
    """Run a simulated controller against a loop program in real time: the robot sends every cycle_ms.

    An answer counts if it has arrived when the next cycle begins. At the end the loop is asked to stop, and the robot
    follows it without being recorded. robot, cycles, stopped: as in `lockstep`. loop: a running `LoopProcess`, as in
    `with LoopProcess(build(...), options) as loop:`. `study` does all this for a folder.

    >>> plant = gt.loop.DrivePlant([0.0, 0.1, 0.2], a=[0.9] * 3, b=[0.1] * 3, delay=0)
    >>> class Quiet:  # stands for a loop that never answers
    ...     ended = True
    ...     def send(self, datagram): pass
    ...     def received(self): return []
    ...     def end(self): pass
    >>> run = gt.loop.real_time(gt.loop.RobotSide("egm", plant), Quiet(), cycles=5)
    >>> run.measured_m.shape
    (5, 3)
    """
    carts: list[np.ndarray] = []
    fault: PlantStopped | None = None
    begin, step = time.monotonic(), robot.cycle_ms / 1000.0
    sent, gap = begin, 0.0
    for cycle in range(cycles):
        carts.append(_carts(robot))
        loop.send(robot.datagram())
        now = time.monotonic()
        sent, gap = now, max(gap, now - sent)
        if stopped(cycle / cycles):
            break
        time.sleep(max(0.0, begin + (cycle + 1) * step - time.monotonic()))
        try:
            robot.step(loop.received())
        except PlantStopped as error:  # the robot falls silent, and the loop brakes
            fault = error
            break
    loop.end()
    deadline = time.monotonic() + SECONDS
    run = _run(carts, fault, longest_gap_s=gap)
    while fault is None and not loop.ended and time.monotonic() < deadline:
        loop.send(robot.datagram())
        time.sleep(step)
        try:
            robot.step(loop.received())
        except PlantStopped:  # the run is over
            break
    return run


def _run(carts: list[np.ndarray], fault: PlantStopped | None, **more: Any) -> LoopRun:
    failure = {} if fault is None else {"stopped": str(fault), "stopped_s": fault.time}
    return LoopRun(*np.stack(carts, axis=1), **failure, **more)


def _carts(robot: RobotSide) -> np.ndarray:
    """Return the carts (3, n): measured, on the arm's side, planned."""
    return np.array([robot.plant.position_m, robot.plant.arm_m, robot.planned_m])
