"""The loop in Python, cycle for cycle like gt_loop.c: which datagram is new, how late it is, and what the law
answers."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from enum import Enum, auto

from ..results.status import Status
from .egm import DATAGRAM_MAX
from .exchange import AXES, Command, Exchange, RobotFeedback
from .laws import LoopLaw
from .predictive_law import PLAN_COLUMNS, PredictiveLaw
from .process import COLUMNS

SKEW_MOST = 1_000_000  # ms: larger differences are clipped


class Arrival(Enum):
    """Whether the law may answer a datagram."""

    GOOD = auto()
    MISS = auto()  # the clock stopped or went back, or the robot is further behind than the loop may hold
    FALSE = auto()  # the clocks disagree by more than a cycle, or report time that has not passed for the loop


@dataclass
class LoopPace:
    """Numbers and time stamps of the robot, since the law's last command.

    elapsed_ms: time of the law [ms]; cycles: by how many it advances now. faults: datagrams whose stamp does not
    increase or disagrees with the numbers by more than a cycle. skew_ms: stamps minus numbers [ms], reduced by a
    millisecond with each datagram. held: cycles without a command since the law's last one. lead: cycles by which the
    law is ahead of `number`.
    """

    number: int = 0
    time_ms: int = 0
    elapsed_ms: int = 0
    cycles: int = 0
    faults: int = 0
    lead: int = 0
    held: int = 0
    skew_ms: int = 0
    false_stamp: bool = False

    def begin(self, first: RobotFeedback) -> None:
        """Start the law with this datagram."""
        self.number, self.time_ms = first.sequence, first.time_ms
        self.elapsed_ms = self.cycles = self.lead = self.held = self.skew_ms = 0
        self.false_stamp = False

    def note(self, before: RobotFeedback, newer: RobotFeedback, cycle_ms: int) -> None:
        """Compare the stamp of a newer datagram with the one before."""
        clock = _difference(newer.time_ms, before.time_ms)
        skew = self.skew_ms + clock - _difference(newer.sequence * cycle_ms, before.sequence * cycle_ms)
        disagrees = abs(skew) > cycle_ms
        self.false_stamp |= disagrees
        self.skew_ms = 0 if disagrees else skew - (skew > 0) + (skew < 0)
        self.faults += disagrees or clock <= 0

    def verdict(self, now: RobotFeedback, cycle_ms: int, hold_cycles: int, *, answered: bool) -> Arrival:
        """Return whether the law may answer this datagram; if so, `cycles` is how far the law advances.

        hold_cycles: largest number of cycles without a command. answered: cycles without a datagram are answered (EGM).
        """
        numbers, waited = now.sequence - self.number, self.held + 1
        self.cycles = waited if numbers else 0  # 0: the law's first cycle
        if numbers == 0:
            return Arrival.GOOD
        if now.time_ms <= self.time_ms:
            return Arrival.MISS
        if self.false_stamp:
            return Arrival.FALSE
        if numbers > self.lead + self.held:
            lesser = min(numbers, (now.time_ms - self.time_ms) // cycle_ms)
            self.cycles = max(lesser, self.lead + waited) - self.lead
            return Arrival.FALSE if self.cycles > waited + hold_cycles else Arrival.GOOD
        if not answered:  # held commands were not sent, so the law is not ahead
            self.cycles = numbers
            return Arrival.GOOD
        return Arrival.MISS if self.lead + waited > numbers + hold_cycles else Arrival.GOOD

    @property
    def moved(self) -> int:
        """Cycles over which the law's command moves the carts from their present position, at least 1."""
        return max(1, self.cycles - self.held)

    def take(self, now: RobotFeedback, cycle_ms: int) -> None:
        """Accept the law's command for this datagram."""
        self.elapsed_ms += self.cycles * cycle_ms
        self.lead = max(0, self.lead + self.cycles - (now.sequence - self.number))
        self.number, self.time_ms = now.sequence, now.time_ms
        self.held = 0


def _difference(a: int, b: int) -> int:
    """Return a - b of two counters, clipped to SKEW_MOST."""
    return max(-SKEW_MOST, min(a - b, SKEW_MOST))


WINDOW = 64
_SEEN = (1 << WINDOW) - 1
_UINT32 = (1 << 32) - 1


def near(last: int, low: int) -> int:
    """Return the number nearest to `last` whose low 32 bits are `low`; it may be negative."""
    ahead = (low - last) & _UINT32
    return last + ahead if ahead <= _UINT32 // 2 else last + ahead - (_UINT32 + 1)


@dataclass
class Sequence:
    """Counters of datagrams: lost (missing between the first and the newest), repeated, reordered (arrived after a
    newer one), stale (older than the first, or more than 63 numbers behind the newest)."""

    first: int | None = None
    newest: int = 0
    seen: int = 0
    lost: int = 0
    repeated: int = 0
    reordered: int = 0
    stale: int = 0

    def take_32(self, low: int) -> int | None:
        """`take` for a 32-bit counter: return the unwrapped number, or None unless it is newer than all before."""
        number = low if self.first is None else near(self.newest, low)
        if number < 0:
            self.stale += 1
            return None
        return number if self.take(number) else None

    def take(self, number: int) -> bool:
        """Count a datagram with this number; return whether it is newer than all before."""
        if self.first is None:
            self.first = self.newest = number
            self.seen = 1
            return True
        if number > self.newest:
            gap = number - self.newest
            self.lost += gap - 1
            self.seen = (self.seen << gap | 1) & _SEEN if gap < WINDOW else 1
            self.newest = number
            return True
        age = self.newest - number
        if age >= WINDOW or number < self.first:
            self.stale += 1
        elif self.seen >> age & 1:
            self.repeated += 1
        else:
            self.seen |= 1 << age
            self.reordered += 1
            self.lost -= 1
        return False


WAITING, RUNNING, HOLDING, RAMPING, STOPPED, BRAKING = range(6)
RAMP_MOST = 100_000  # cycles


@dataclass
class LoopLimits:
    """Limits of a command: cart positions [m], their change per cycle [m], path correction [m].

    following_m: largest distance of a cart from the last command sent [m].
    """

    lowest_m: list[float] = field(default_factory=lambda: [-10.0] * AXES)
    highest_m: list[float] = field(default_factory=lambda: [10.0] * AXES)
    step_m: float = 0.02
    path_m: float = 0.01
    following_m: float = 0.25


@dataclass
class Settings:
    """How the loop runs and stops.

    dry: commands are logged, not sent. Without a command the loop holds the last speed for hold_cycles, then ramps it
    to zero and stays stopped. The fastest cart brakes at deceleration_m_s2 [m/s2] or, if that is 0, over ramp_cycles.
    The ramp starts at once if a command exceeds the limits, the robot stops running, the clock disagrees with the
    numbers, or the carts do not follow.
    """

    dry: bool = True
    hold_cycles: int = 5
    ramp_cycles: int = 50
    deceleration_m_s2: float = 0.0
    limits: LoopLimits = field(default_factory=LoopLimits)


class PythonLoop:
    """gt_loop in Python. `exchange` takes the datagrams of a cycle and returns at most one answer."""

    def __init__(self, settings: Settings, peer: Exchange, law: LoopLaw) -> None:
        self.settings, self.peer, self.law = settings, peer, law
        self.plan = law if isinstance(law, PredictiveLaw) else None
        peer.reads_wrenches = law.reads_wrenches
        self.sequence = Sequence()
        self.state, self.status = WAITING, Status.STALE_INPUT
        self.fresh: RobotFeedback | None = None
        self.feedback: RobotFeedback | None = None
        self.pace = LoopPace()
        self.cycles = self.late = self.garbage = self.apart = self.datagrams = self.misses = 0
        self.ramp_left = self.ramp_cycles = 0
        self.ramp_from = [0.0] * AXES
        self.coasting_m, self.coasted_m = [0.0] * AXES, 0.0
        self.command = Command()
        self.sent_m = [0.0] * AXES  # position in the last answer
        self.going_m_s = [0.0] * AXES  # speed to hold without a command
        self.log = bytearray()

    def exchange(self, datagrams: list[bytes]) -> list[bytes]:
        """Run one cycle: take its datagrams, return its answers."""
        for data in datagrams:
            self.datagram(data)
        answer = self.cycle()
        return [answer] if answer else []

    def datagram(self, data: bytes) -> None:
        """Take one datagram of this cycle; arbitrary bytes are allowed."""
        self.datagrams += 1
        feedback = self.peer.read(data) if len(data) <= DATAGRAM_MAX else None
        if feedback is None:
            self.garbage += 1
        elif self._is_newer(feedback):
            if self.feedback is not None:
                self.pace.note(self.feedback, feedback, self.peer.cycle_ms)
            self.feedback = self.fresh = feedback

    def stop(self) -> None:
        """End the law; the following cycles ramp to a stop."""
        if self.state == WAITING:
            self.state = STOPPED
        if self.state in (RUNNING, HOLDING):
            self._begin_ramp()

    def _is_newer(self, feedback: RobotFeedback) -> bool:
        """Return whether the datagram is newer than all before; unwrap EGM's 32-bit number and time."""
        if self.peer.protocol != "egm":
            return self.sequence.take(feedback.sequence)
        if self.feedback is not None:
            feedback.time_ms = max(0, near(self.feedback.time_ms, feedback.time_ms))
        number = self.sequence.take_32(feedback.sequence)
        feedback.sequence = feedback.sequence if number is None else number
        return number is not None

    def cycle(self) -> bytes:
        """End the cycle: log a record and return the answer to the newest datagram, empty if there is none."""
        fresh = self.fresh
        self.cycles += 1
        if self.state == STOPPED:
            self.command.speed_m_s = [0.0] * AXES
        if fresh is not None and self.state == WAITING:
            self._wait(fresh)
        if self.state in (RUNNING, HOLDING, BRAKING):
            if self.state != BRAKING:
                self.status = Status.STALE_INPUT  # BRAKING keeps the reason of the stop
            if fresh is None or not self._law(fresh):
                self._miss()
        if self.state == RAMPING:
            self._ramp()
        self.late += fresh is None and self.feedback is not None
        answer = self._answer(fresh is not None)
        if fresh is not None or self.peer.protocol == "egm":
            self.sent_m = list(self.command.position_m)  # in a dry run as well
        self._record(answer)
        self.fresh, self.datagrams = None, 0
        return answer

    def _wait(self, first: RobotFeedback) -> None:
        self.peer.begin(first)
        self.command.position_m, self.sent_m = list(self.peer.start_m), list(self.peer.start_m)
        if first.running and self._is_apart(first):
            self.apart += 1
            self.state, self.status = STOPPED, Status.OUT_OF_RANGE
        elif first.running:
            self.pace.begin(first)
            self.status = self.law.init(first)
            self.state = RUNNING if self.status is Status.OK else STOPPED

    def _asks(self, feedback: RobotFeedback) -> Status:
        """Return OK if the law may run, otherwise the reason; a full count of misses starts the ramp at once."""
        hold = self.settings.hold_cycles
        answered = self.peer.protocol == "egm"
        pace = self.pace.verdict(feedback, self.peer.cycle_ms, hold, answered=answered)
        if self._is_apart(feedback):
            self.apart += 1
            self.misses = hold
            return Status.OUT_OF_RANGE
        if not feedback.running or pace is Arrival.FALSE:
            self.misses = hold
            return Status.STALE_INPUT
        return Status.STALE_INPUT if pace is Arrival.MISS else Status.OK

    def _law(self, feedback: RobotFeedback) -> bool:
        """Run the law; return whether its command is accepted."""
        self.status = self._asks(feedback)
        if self.status is not Status.OK:
            return False
        command = self.command.copy()
        command.braking = False
        elapsed_ms = self.pace.elapsed_ms + self.pace.cycles * self.peer.cycle_ms
        self.status = self.law.step(feedback, elapsed_ms, command)
        commanded = self.status is Status.OK or command.braking
        if commanded and not self._allowed(command):
            self.status, self.misses = Status.OUT_OF_RANGE, self.settings.hold_cycles
            return False
        if commanded:
            self._take(command, feedback)
        return commanded

    def _take(self, command: Command, feedback: RobotFeedback) -> None:
        """Accept the command. If the law is braking, a missing command starts the ramp at once."""
        moves = any(abs(x) > 0.0 for x in command.speed_m_s[: self.peer.axes])
        self._follow(command)
        self.pace.take(feedback, self.peer.cycle_ms)
        self.misses, self.state = 0, RUNNING
        if command.braking:
            self.misses, self.state = self.settings.hold_cycles, BRAKING if moves else STOPPED

    def _follow(self, command: Command) -> None:
        """Adopt the law's command; replace its speeds by distance over the time that the robot has for it."""
        before, seconds = self.command.position_m, float(self.pace.moved) * self._cycle_s
        # after cycles without the law the distance includes a correction: do not hold that speed; nor one that makes
        # a force, as that of a plan does
        plain = self.pace.held == 0 and self.pace.cycles <= 1 and self.plan is None
        self.command = command
        for n in range(self.peer.axes):
            stated = command.speed_m_s[n]
            command.speed_m_s[n] = (command.position_m[n] - before[n]) / seconds
            self.going_m_s[n] = command.speed_m_s[n] if plain else stated
            self.coasting_m[n] = 0.0

    @property
    def _cycle_s(self) -> float:
        return self.peer.cycle_ms / 1000.0

    def _is_apart(self, feedback: RobotFeedback) -> bool:
        """Return whether a cart is too far from its command; never with path corrections."""
        sent = zip(feedback.position_m[: self.peer.axes], self.sent_m, strict=False)
        return not self.command.along_path and not all(abs(x - u) <= self.settings.limits.following_m for x, u in sent)

    def _allowed(self, command: Command) -> bool:
        limits = self.settings.limits
        if command.along_path:
            return all(abs(x) <= limits.path_m for x in command.path_m)
        return all(
            limits.lowest_m[n] <= command.position_m[n] <= limits.highest_m[n]
            and abs(command.position_m[n] - self.command.position_m[n]) <= limits.step_m
            and abs(command.position_m[n] - self.sent_m[n]) <= limits.step_m
            and abs(command.speed_m_s[n] * self._cycle_s) <= limits.step_m
            for n in range(self.peer.axes)
        )

    def _coast(self, speed: list[float], share: float) -> None:
        """Move the carts on within the limits, at most one step from the last answer.

        A robot outside the limits moves no further out, and does not jump back to them.
        """
        limits, seconds = self.settings.limits, self._cycle_s
        for n in range(self.peer.axes):
            before, now = self.command.position_m[n], speed[n] * share
            target = before + now * seconds
            near = _clamped(target, self.sent_m[n] - limits.step_m, self.sent_m[n] + limits.step_m)
            position = _clamped(near, min(before, limits.lowest_m[n]), max(before, limits.highest_m[n]))
            self.command.position_m[n] = position
            self.command.speed_m_s[n] = (position - before) / seconds if position != target else now
            self.coasting_m[n] += abs(self.command.speed_m_s[n] * seconds)
            self.coasted_m = max(self.coasted_m, self.coasting_m[n])

    def _miss(self) -> None:
        self.misses += 1
        self.pace.held += 1
        if self.misses <= self.settings.hold_cycles and self._goes_on():
            self.state = HOLDING
        else:
            self._begin_ramp()

    def _goes_on(self) -> bool:
        """Hold the last speed, or follow the plan of a law that has one; return whether there still is one."""
        if self.plan is None:
            self._coast(self.going_m_s, 1.0)
            return True
        command, before = self.command.copy(), self.command.position_m
        if self.plan.go_on(command) is not Status.OK or not self._allowed(command):
            return False
        self.command = command
        for n in range(self.peer.axes):
            way = command.position_m[n] - before[n]
            self.going_m_s[n], command.speed_m_s[n] = command.speed_m_s[n], way / self._cycle_s
            self.coasting_m[n] += abs(way)
            self.coasted_m = max(self.coasted_m, self.coasting_m[n])
        return True

    def _begin_ramp(self) -> None:
        self.state = RAMPING
        self.ramp_cycles = self.ramp_left = self._ramp_length()
        self.ramp_from = list(self.going_m_s)

    def _ramp_length(self) -> int:
        """Return the cycles of a ramp to zero, rounded up, with the fastest cart at the declared deceleration."""
        change = self.settings.deceleration_m_s2 * self._cycle_s
        if not change > 0.0:
            return self.settings.ramp_cycles
        cycles = max(abs(x) for x in self.going_m_s[: self.peer.axes]) / change
        return math.ceil(cycles) if cycles < RAMP_MOST else RAMP_MOST

    def _ramp(self) -> None:
        if self.ramp_left > 0:
            self.ramp_left -= 1
            self._coast(self.ramp_from, self.ramp_left / self.ramp_cycles)
        if self.ramp_left == 0:
            self._coast(self.ramp_from, 0.0)
            self.state = STOPPED

    def _answer(self, fresh: bool) -> bytes:
        if self.feedback is None or (not fresh and self.peer.protocol == "rsi"):
            return b""
        command = self.command
        if self.settings.dry:
            if self.peer.protocol == "egm":
                return b""
            command = Command(position_m=list(self.peer.start_m))
        return self.peer.write(self.feedback, command)

    def _record(self, answer: bytes) -> None:
        f, s = self.feedback or RobotFeedback(0, 0, [0.0] * AXES, [], False, False), self.sequence
        numbers = [
            *(self.cycles, f.sequence, f.time_ms, self.state, int(self.status), self.datagrams),
            *(self.late, s.lost, s.repeated, s.reordered, s.stale, self.garbage),
            *(f.delay, len(answer), _hash(answer)),
            *f.position_m,
            *self.command.position_m,
            *self.command.speed_m_s,
            *self.command.path_m,
            *(self.settings.dry, self.pace.faults, self.apart),
            *([0.0] * len(PLAN_COLUMNS) if self.plan is None else self.plan.numbers),
        ]
        self.log += struct.pack(f"<{len(COLUMNS)}d", *numbers)


def _clamped(value: float, lowest: float, highest: float) -> float:
    return lowest if value < lowest else min(value, highest)


def _hash(data: bytes) -> int:
    """Return the 32-bit FNV-1a hash."""
    value = 2166136261
    for byte in data:
        value = (value ^ byte) * 16777619 & 0xFFFFFFFF
    return value
