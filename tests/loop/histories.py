"""Drawn histories of what a robot sends, with what the loop has to count; and the C loop as a library.

A history plants faults at known cycles, at least 18 apart, so that what has to be counted follows from the plan alone.
"""

from __future__ import annotations

import ctypes
import random
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel._files import codegen_dir
from gtmodel.loop import Exchange, LoopLimits, PythonLoop, ReferenceTable, Settings, TrajectoryLaw, egm, rsi
from gtmodel.loop.process import COLUMNS
from gtmodel.loop.python_loop import WINDOW

CYCLES, CYCLE_MS, HOLD = 200, 4, 5
STEP_M, DECELERATION, FOLLOWING_M = 0.02, 2.0, 0.25
FIRST, APART = 25, 18  # the first fault, and cycles between two: longer than any of them lasts
WAY_M = (0.2, -0.1, 0.15)  # in 1.2 s, as in the issue that asks for these tests
LAST_MS = 4_208_000
LOOP = "gt_loop gt_pace gt_bounds gt_coast gt_record gt_peer gt_sequence gt_law_trajectory"
RUNTIME = "gt_egm gt_egm_write gt_rsi gt_rsi_write gt_wire gt_scan gt_decimal gt_wrench_egm gt_wrench_rsi"
DRIVER = """
#include "gt_guard.h"
#include "gt_law_trajectory.h"
#include "gt_loop.h"
#include <string.h>

/* Datagrams one behind the other, a length of 0 ends a cycle; a record and an answer of 512 bytes for each. */
void history(int rsi, const double *rows, uint32_t count, const double *limits, uint32_t hold, const uint8_t *data,
             const uint32_t *lengths, uint32_t entries, double *records, uint8_t *answers, uint32_t *answered);
void history(int rsi, const double *rows, uint32_t count, const double *limits, uint32_t hold, const uint8_t *data,
             const uint32_t *lengths, uint32_t entries, double *records, uint8_t *answers, uint32_t *answered)
{
    static uint8_t answer[GT_DATAGRAM_MAX];
    static uint8_t one[GT_DATAGRAM_MAX];
    gt_law_trajectory state;
    gt_loop_settings settings;
    gt_peer peer;
    gt_law law;
    gt_loop loop;
    uint32_t n;

    memset(&state, 0, sizeof(state));
    memset(&settings, 0, sizeof(settings));
    memset(&peer, 0, sizeof(peer));
    state.reference.rows = rows;
    state.reference.count = count;
    state.reference.columns = 18U;
    state.reference.step_ms = 4U;
    state.axes = 3U;
    state.cycle_ms = 4U;
    settings.hold_cycles = hold;
    settings.ramp_cycles = 50U;
    settings.limits.step_m = limits[0];
    settings.deceleration_m_s2 = limits[1];
    settings.limits.following_m = limits[2];
    for (n = 0U; n < GT_AXES; n++) {
        settings.limits.lowest_m[n] = -10.0;
        settings.limits.highest_m[n] = 10.0;
    }
    peer.protocol = rsi ? GT_PEER_RSI : GT_PEER_EGM;
    peer.axes = 3U;
    peer.cycle_ms = 4U;
    law = gt_law_trajectory_of(&state);
    gt_loop_init(&loop, &settings, &peer, &law);
    for (n = 0U; n < entries; n++) {
        if (lengths[n] > 0U) {
            memcpy(one, data, lengths[n]);
            gt_loop_datagram(&loop, one, lengths[n]);
            data += lengths[n];
        } else {
            *answered = gt_loop_cycle(&loop, answer);
            memcpy(answers, answer, 512U);
            memcpy(records, loop.record, sizeof(loop.record));
            records += GT_RECORD_COLUMNS;
            answers += 512;
            answered++;
        }
    }
}
"""


def reference() -> ReferenceTable:
    """From rest to rest by a fifth-order polynomial in 1.2 s, from the origin."""
    s, duration = np.clip(np.arange(CYCLES + 20) / 300, 0.0, 1.0)[:, None], 1.2
    way = np.array(WAY_M)
    q = (10 * s**3 - 15 * s**4 + 6 * s**5) * way
    dq = (30 * s**2 - 60 * s**3 + 30 * s**4) * way / duration
    ddq = (60 * s - 180 * s**2 + 120 * s**3) * way / duration**2
    return ReferenceTable(np.hstack([q, dq, ddq, np.zeros((len(q), 9))]))


REFERENCE = reference()


@dataclass
class Sent:
    """A datagram of the robot, before it is written."""

    number: int
    stamp: int
    measured_m: np.ndarray
    kind: int = egm.TYPE_DATA
    motors: int = 1
    running: bool = True
    late: int = 0  # cycles on the way
    lost: bool = False
    twice: bool = False

    def bytes_of(self, protocol: str) -> bytes:
        mm = (1000.0 * self.measured_m).tolist()
        if protocol == "rsi":
            stamp = LAST_MS + CYCLE_MS * self.number
            values = {"EIPos": mm + [0.0] * 3, "ESPos": mm + [0.0] * 3}
            return rsi.encode_robot(rsi.RsiRobot(stamp, values=values))
        pose = egm.EgmPose(external_mm=mm)
        state = egm.MCI_RUNNING if self.running else 2
        return egm.encode_robot(egm.EgmRobot(self.number, self.stamp, self.kind, pose, pose, self.motors, state, 2))


@dataclass
class History:
    """Datagrams cycle by cycle, and what has to come of them.

    counted: by name. stops: whether a fault has to bring the ramp. jumps: cycle -> cycles of the robot that pass in it,
    where numbers and stamps go ahead together.
    """

    cycles: list[list[bytes]] = field(default_factory=list)
    numbers: list[list[int | None]] = field(default_factory=list)
    clock_faults: int = 0
    following_faults: int = 0
    stops: bool = False
    jumps: dict[int, int] = field(default_factory=dict)
    planted: list[str] = field(default_factory=list)


EGM = ("lose", "lose long", "delay", "repeat", "garbage", "spoil", "stamp ahead", "stamp back", "stamp spike",
       "stamp stands once", "stamp stands", "stamp stands, stays behind", "number ahead", "ahead", "far ahead",
       "motors off", "ends", "type", "apart", "stamp jitters")  # fmt: skip
RSI = ("lose", "lose long", "delay", "repeat", "garbage", "spoil", "ahead", "far ahead", "back", "apart")


def drawn(protocol: str, seed: int) -> History:
    """One to seven faults of a protocol, at cycles and of sizes that the seed draws."""
    rng, h = random.Random(f"{protocol} {seed}"), History()
    sent = [Sent(n, 1_000_000 + CYCLE_MS * n, REFERENCE.rows[n, :3]) for n in range(CYCLES)]
    noise: dict[int, list[bytes]] = {}
    at = FIRST + rng.randrange(60)
    while at < CYCLES - 55 and len(h.planted) < 7:
        kind = rng.choice(EGM if protocol == "egm" else RSI)
        _plant(kind, at, sent, h, noise, rng, protocol)
        h.planted.append(f"{kind} at {at}")
        at += APART + rng.randrange(30)
    arriving: list[list[Sent]] = [[] for _ in range(CYCLES + 70)]
    for cycle, one in enumerate(sent):
        if not one.lost:
            arriving[cycle + one.late].append(one)
            if one.twice:
                arriving[cycle + one.late + 2].append(one)
    for cycle in range(CYCLES):
        here = arriving[cycle]
        good = [one for one in here if one.kind in (egm.TYPE_DATA, egm.TYPE_UNDEFINED)]
        h.cycles.append([one.bytes_of(protocol) for one in here] + noise.get(cycle, []))
        h.numbers.append([*(one.number for one in good), *[None] * (len(here) - len(good) + len(noise.get(cycle, [])))])
    return h


def _plant(
    kind: str, at: int, sent: list[Sent], h: History, noise: dict[int, list[bytes]], rng: random.Random, protocol: str
) -> None:
    """One fault from a cycle on; what it has to bring."""
    one, stops = sent[at], False
    if kind in ("lose", "lose long"):
        count = rng.randint(1, HOLD) if kind == "lose" else rng.randint(HOLD + 1, HOLD + 10)
        for lost in sent[at : at + count]:
            lost.lost = True
        stops = count > HOLD
    elif kind == "delay":
        one.late = rng.randint(1, 3)
    elif kind == "repeat":
        one.twice = True
    elif kind == "garbage":
        noise[at] = [b"\xff" + rng.randbytes(rng.randrange(200)) for _ in range(rng.randint(1, 3))]
    elif kind == "spoil":
        data = one.bytes_of(protocol)
        noise[at], one.lost = [data[: rng.randint(1, len(data) // 3)]], True
    elif kind == "apart":
        one.measured_m = one.measured_m + np.array([0.0, rng.choice((-1, 1)) * rng.uniform(0.5, 3.0), 0.0])
        h.following_faults += not h.stops
        stops = True
    elif kind in ("ahead", "far ahead"):
        more = rng.randint(1, HOLD) if kind == "ahead" else rng.randint(HOLD + 1, 400)
        if not h.stops and more <= HOLD:
            h.jumps[at] = more + 1
        _moved(sent[at:], more, CYCLE_MS * more)
        stops = more > HOLD
    elif kind == "back":
        more = rng.randint(HOLD + 1, APART - 2)  # as many datagrams are of numbers that had come
        _moved(sent[at:], -more, -CYCLE_MS * more)
        stops = True
    elif kind == "number ahead":
        more = rng.randint(2, 500)
        _moved(sent[at:], more, 0)
        h.clock_faults += 1
        stops = True
    elif kind == "type":
        one.kind = rng.choice((1, 3, 4, 5, 99))
    elif kind in ("motors off", "ends"):
        for off in sent[at : at + rng.randint(1, 20)]:
            off.motors, off.running = (2, True) if kind == "motors off" else (1, False)
        stops = True
    else:
        stops = _stamps(kind, at, sent, h, rng)
    h.stops |= stops


def _stamps(kind: str, at: int, sent: list[Sent], h: History, rng: random.Random) -> bool:
    """A fault of the time stamps alone; whether it has to bring the ramp."""
    if kind == "stamp ahead":
        _moved(sent[at:], 0, rng.choice((9, 36, 40, 1000, rng.randint(5, 100_000))))
        h.clock_faults += 1
    elif kind == "stamp back":
        _moved(sent[at:], 0, -rng.randint(5, 900))
        h.clock_faults += 1
    elif kind == "stamp spike":
        _moved(sent[at : at + 1], 0, rng.choice((-1, 1)) * rng.randint(10, 900))
        h.clock_faults += 2  # there and back again
    elif kind == "stamp jitters":
        for one in sent[at : at + 10]:
            one.stamp += rng.randint(0, 1)
        return False
    elif kind == "stamp stands once":
        sent[at].stamp = sent[at - 1].stamp
        h.clock_faults += 1
        return False
    else:
        count = rng.randint(2, 15)
        for one in sent[at : at + count]:
            one.stamp = sent[at - 1].stamp
        if kind == "stamp stands":
            h.clock_faults += 1  # when it goes on at its old place
        else:
            _moved(sent[at + count :], 0, -CYCLE_MS * count)
        h.clock_faults += count
    return True


def _moved(sent: list[Sent], numbers: int, ms: int) -> None:
    for one in sent:
        one.number += numbers
        one.stamp += ms


def python_loop(protocol: str) -> PythonLoop:
    """The twin, with the settings of these histories."""
    limits = LoopLimits(step_m=STEP_M, following_m=FOLLOWING_M)
    settings = Settings(dry=False, hold_cycles=HOLD, deceleration_m_s2=DECELERATION, limits=limits)
    law = TrajectoryLaw(REFERENCE, 3, False, 0, CYCLE_MS, [0.0] * 6, [1.0] * 6)
    return PythonLoop(settings, Exchange(protocol, 3), law)  # type: ignore[arg-type]


@dataclass
class LoopLibrary:
    """The C loop, in this process."""

    loaded: ctypes.CDLL

    @classmethod
    def made(cls, place: Path, *flags: str) -> LoopLibrary:
        source, target = place / "driver.c", place / "loop.so"
        source.write_text(DRIVER)
        places = {codegen_dir() / "loop": LOOP, codegen_dir() / "runtime": RUNTIME}
        files = [str(place / f"{name}.c") for place, names in places.items() for name in names.split()]
        include = [f"-I{codegen_dir() / name}" for name in ("runtime", "loop")]
        command = ["cc", "-std=c99", "-O2", "-ffp-contract=off", *flags, *include, "-fPIC", "-shared", str(source)]
        done = subprocess.run([*command, *files, "-o", str(target), "-lm"], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        return cls(ctypes.CDLL(str(target)))

    def run(self, protocol: str, history: History) -> tuple[np.ndarray, list[bytes]]:
        """Records (cycles, columns) and answers of all cycles."""
        datagrams = [data for cycle in history.cycles for data in (*cycle, b"")]
        lengths = np.array([len(data) for data in datagrams], dtype=np.uint32)
        count = len(history.cycles)
        records = np.zeros((count, len(COLUMNS)))
        answers, answered = np.zeros((count, 512), dtype=np.uint8), np.zeros(count, dtype=np.uint32)
        limits = np.array([STEP_M, DECELERATION, FOLLOWING_M])
        rows = np.ascontiguousarray(REFERENCE.rows)
        self.loaded.history(
            int(protocol == "rsi"), _at(rows), len(rows), _at(limits), HOLD, b"".join(datagrams), _at(lengths),
            len(lengths), _at(records), _at(answers), _at(answered),
        )  # fmt: skip
        return records, [answers[n, : answered[n]].tobytes() for n in range(count)]


def _at(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)


assert APART + 2 < WINDOW
