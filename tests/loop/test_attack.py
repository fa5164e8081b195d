"""What a controller, a network or a person may do to the loop: it goes on, or stops in an orderly way, and says so."""

from __future__ import annotations

import math
import random
import resource
import socket
import subprocess
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from gtmodel.loop import LoopError, LoopProcess, PythonLoop, RobotSide, egm, lockstep, rsi
from gtmodel.loop.process import COLUMNS, COUNTERS, STATES, rows_of
from gtmodel.results import Status
from tests.loop.bench import HOLD, RAMP, Bench
from tests.loop.spoiling import spoilt
from tests.loop.test_rsi import TELEGRAM

Cycles = list[list[bytes]]
LAWS = ("trajectory", "dynamics", "replay", "path")
RECORD = 8 * len(COLUMNS)  # bytes
WRAP = 1 << 32
NASTY = (0.0, -0.0, 5e-324, 1e-300, 1e8, 1e22, 1e300, -1e308, math.pi)


def _both(bench: Bench, protocol: str, law: str, cycles: Cycles) -> tuple[np.ndarray, PythonLoop, dict]:
    """The same datagrams, cycle by cycle, to the C loop and to the Python one: logs and answers have to be equal."""
    python_loop = bench.python_loop(protocol, law)
    with LoopProcess(bench.program, [*bench.options(protocol, law), "--cycles", str(len(cycles))]) as process:
        for datagrams in cycles:
            assert process.exchange(datagrams) == python_loop.exchange(datagrams)
        report = process.finish()
    log = bench.log.read_bytes()
    assert log == bytes(python_loop.log)
    return rows_of(log), python_loop, report


def _moving(bench: Bench, cycles: int, **keys: int) -> tuple[RobotSide, PythonLoop]:
    """An EGM robot that follows the reference; the loop is the one in Python."""
    robot, python_loop = bench.robot("egm", **keys), bench.python_loop("egm", "trajectory")
    lockstep(robot, python_loop.exchange, cycles)
    return robot, python_loop


@pytest.mark.parametrize("after", [40, 150])
def test_counters_of_32_bits_run_over(bench: Bench, after: int) -> None:
    """A controller's clock does so every 49.7 days: the motion goes on, and nothing is lost."""
    keys = {"first_number": WRAP - after, "first_ms": WRAP - 4 * (after + 50)}
    robots = bench.robot("egm", **keys), bench.robot("egm", **keys)
    python_loop = bench.python_loop("egm", "trajectory")
    with LoopProcess(bench.program, [*bench.options("egm", "trajectory"), "--cycles", "400"]) as process:
        runs = [lockstep(r, a, 400) for r, a in zip(robots, (process.exchange, python_loop.exchange), strict=True)]
        report = process.finish()
    assert bench.log.read_bytes() == bytes(python_loop.log)
    assert {name: report[name] for name in COUNTERS} == dict.fromkeys(COUNTERS, 0)
    assert np.abs(runs[0].measured_m - bench.reference.rows[:, :3]).max() < 1e-9
    assert robots[0].late == 0, "the robot knows the answers by their numbers of 32 bits"
    numbers = rows_of(bytes(python_loop.log))[:, 1]
    assert np.all(np.diff(numbers) == 1) and numbers[-1] > WRAP


def test_numbers_before_zero_are_stale(bench: Bench) -> None:
    robot = bench.robot("egm")
    datagrams = [[robot.datagram()]]
    older = egm.decode_robot(datagrams[0][0])
    older.sequence = WRAP - 3
    rows, _, report = _both(bench, "egm", "trajectory", [*datagrams, [egm.encode_robot(older)]])
    assert (report["stale"], report["lost"], rows[-1, 1]) == (1, 0, 0)


def test_robot_that_stops_running_is_not_waited_for(bench: Bench) -> None:
    """When it runs again the motion would have gone on without it: ramp at once, then stay stopped."""
    ends = 180
    robot, python_loop = _moving(bench, ends + 1, ends=ends)
    assert STATES[python_loop.state] == "ramping" and python_loop.status is Status.STALE_INPUT
    robot.ends = None
    lockstep(robot, python_loop.exchange, RAMP + 5)
    rows = rows_of(bytes(python_loop.log))
    assert STATES[python_loop.state] == "stopped"
    assert np.abs(np.diff(rows[ends - 1 :, 21:24], axis=0)).max() <= 0.004 * np.abs(rows[ends - 1, 27:30]).max() + 1e-12
    again = bench.robot("egm", ends=ends)
    c_rows, _, report = _both(bench, "egm", "trajectory", _stream(bench, again, ends + RAMP + 10))
    assert STATES[report["state"]] == "stopped" and "holding" not in {STATES[int(s)] for s in c_rows[:, 3]}


def _stream(bench: Bench, robot: RobotSide, cycles: int) -> Cycles:
    """What the robot sends while the loop in Python moves it."""
    python_loop, sent = bench.python_loop("egm", "trajectory"), []
    for _ in range(cycles):
        sent.append([robot.datagram()])
        robot.step(python_loop.exchange(sent[-1]))
    return sent


@pytest.mark.parametrize("law", LAWS)
def test_clock_that_goes_back_holds_then_stops(bench: Bench, law: str) -> None:
    sent = _stream(bench, bench.robot("egm"), 200 + HOLD + RAMP + 5)
    for k in range(200, len(sent)):
        robot = egm.decode_robot(sent[k][0])
        robot.time_ms -= 400
        sent[k] = [egm.encode_robot(robot)]
    rows, _, report = _both(bench, "egm", law, sent)
    assert [STATES[int(s)] for s in rows[199:201, 3]] == ["running", "holding"]
    # 100 cycles back: the clock is at the last command again after the hold and the ramp
    assert STATES[report["state"]] == "stopped" and rows[200, 4] == Status.STALE_INPUT
    assert report["lost"] == report["stale"] == 0


def _nasty(protocol: str, rng: random.Random, good: Iterator[bytes]) -> list[bytes]:
    """Datagrams of a cycle: a good one, one with extreme numbers, a spoilt one, bytes, or none."""
    kind = rng.randrange(6)
    data = next(good)
    if kind < 2:
        return [data]
    if kind == 2:
        return [rng.randbytes(rng.randrange(1, 1500))]
    if kind == 3:
        variants = spoilt(data, 4, rng.randrange(1 << 30), b"\x00\xff09<>\"'= eE+-.")
        return [variant for variant in variants if variant]  # an empty one would end the cycle in lock step
    if kind == 4:
        return []
    if protocol == "rsi":
        telegram = rsi.decode_robot(data)
        telegram.values["EIPos"] = telegram.values["ESPos"] = [rng.choice(NASTY) % 1e9 for _ in range(6)]
        telegram.ipoc += rng.choice((0, 1, 4, -400, 10**15))
        telegram.stamp = b"%d" % telegram.ipoc
        return [rsi.encode_robot(telegram)]
    robot = egm.decode_robot(data)
    robot.feedback.external_mm = [rng.choice((*NASTY, math.nan, math.inf)) for _ in range(rng.randrange(7))]
    robot.planned.external_mm = [rng.choice(NASTY) for _ in range(rng.randrange(7))]
    robot.time_ms, robot.sequence = rng.randrange(WRAP), rng.choice((robot.sequence, 0, WRAP - 1))
    return [egm.encode_robot(robot)]


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
@pytest.mark.parametrize("law", [*LAWS, "lead_through"])
def test_anything_at_all_gives_the_twins_answers_within_the_limits(bench: Bench, protocol: str, law: str) -> None:
    rng = random.Random(f"{protocol} {law}")
    for after in (0, 60):  # from the beginning, and once the robot moves
        robot = bench.guided(protocol) if law == "lead_through" else bench.robot(protocol)
        good: list[bytes] = []
        for _ in range(after + 200):
            good.append(robot.datagram())
            robot.step([])
        stream = iter(good[after:])
        cycles = [[data] for data in good[:after]] + [_nasty(protocol, rng, stream) for _ in range(200)]
        rows, python_loop, report = _both(bench, protocol, law, cycles)
        assert np.all(np.isfinite(rows)) and report["garbage"] > 20
        limits = python_loop.settings.limits
        moved = np.abs(np.diff(rows[:, 21:24], axis=0)).max(axis=1)
        running = rows[1:, 3] != STATES.index("waiting")
        assert moved[running & (rows[:-1, 3] != 0)].max(initial=0.0) <= limits.step_m * (HOLD + 1)
        assert np.abs(rows[:, 33:36]).max() <= limits.path_m


E1 = b' E1="-1303.68"'
VARIANTS: dict[str, Callable[[bytes], bytes]] = {
    "attributes in another order": lambda t: t.replace(E1, b"").replace(b' E6="0"/>', b' E6="0"' + E1 + b"/>"),
    "spaces round the sign": lambda t: t.replace(b"=", b' =\t'),
    "single quotes": lambda t: t.replace(b'"', b"'"),
    "lines and tabs": lambda t: t.replace(b" ", b"\r\n\t"),
    "spaces before an end": lambda t: t.replace(b"</Rob>", b"</Rob\n>").replace(b"</IPOC>", b"</IPOC >"),
    "spaces round the stamp": lambda t: t.replace(b">00004208163634<", b">\n 00004208163634 <"),
    "unknown elements": lambda t: t.replace(b"<AIPos", b'<Tech C11="1" T21="x"/><Krl><Inner Z="1"/></Krl><AIPos'),
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
def test_telegrams_mean_the_same_however_they_are_written(bench: Bench, variant: str) -> None:
    changed = VARIANTS[variant](TELEGRAM)
    assert changed != TELEGRAM
    assert rsi.decode_robot(changed) == rsi.decode_robot(TELEGRAM)
    _, _, report = _both(bench, "rsi", "trajectory", [[changed]])
    assert report["garbage"] == 0


def test_a_telegram_without_one_cart_is_no_feedback(bench: Bench) -> None:
    """A number that was not sent must not be taken for zero."""
    whole, lacking = TELEGRAM, TELEGRAM.replace(b' E3="0.0"', b"")
    rows, _, report = _both(bench, "rsi", "trajectory", [[lacking], [whole]])
    assert report["garbage"] == 1 and rows[0, 13] == 0 < rows[1, 13]


def _real_time(bench: Bench, *words: str) -> list[str]:
    """These robots send when they were answered, not by a clock: on a busy machine they fall far behind the loop's."""
    return [*(w for w in bench.options("egm", "trajectory") if w != "--lockstep"), "--hold", "1000", *words]


def _answer(process: LoopProcess, robot: RobotSide) -> bytes:
    """To the datagram of this cycle, behind those that the loop sent while it waited for it."""
    until = time.monotonic() + 5.0
    while time.monotonic() < until:
        for answer in process.received():
            if egm.decode_sensor(answer).sequence == robot.number:
                return answer
    raise AssertionError("the loop does not answer")


def test_a_second_robot_is_foreign(bench: Bench) -> None:
    """The first one that can be read is the robot; what others send is counted, and no answer goes to them."""
    robot, number = bench.robot("egm"), 0
    with LoopProcess(bench.program, _real_time(bench)) as process, socket.socket(type=socket.SOCK_DGRAM) as other:
        other.connect(("127.0.0.1", process.port))
        other.send(b"garbage of another")
        for _ in range(20):
            process.send(robot.datagram())
            for data in (b"garbage", robot.datagram(), bench.robot("egm", first_number=5000 + number).datagram()):
                other.send(data)
            number += 1
            robot.step([_answer(process, robot)])
        process.end()
        report = process.finish()
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(2000)
    assert report["foreign"] >= 3 * 19 and report["lost"] == report["repeated"] == 0 and report["garbage"] <= 1
    assert robot.late == 0


def test_noise_makes_no_cycles(bench: Bench) -> None:
    """Garbage and repetitions between two datagrams of the robot must not count as cycles, or the hold is over soon."""
    robot = bench.robot("egm")
    with LoopProcess(bench.program, _real_time(bench)) as process:
        for _ in range(5):
            data = robot.datagram()
            process.send(data)
            robot.step([_answer(process, robot)])
            for _ in range(60):
                process.send(b"garbage")
                process.send(data)
            time.sleep(0.002)
        process.end()
        report = process.finish()
    assert report["repeated"] > 200 and report["garbage"] > 200
    assert STATES[report["state"]] in ("running", "holding")
    # five with datagrams, the ramp, and those that a busy machine lets pass
    assert report["cycles"] < 5 + RAMP + 60


def test_a_robot_that_starts_again_ends_the_run(bench: Bench) -> None:
    robot = bench.robot("egm", first_number=500)
    with LoopProcess(bench.program, _real_time(bench, "--idle-ms", "400", "--hold", "3", "--ramp", "5")) as process:
        for _ in range(30):
            process.send(robot.datagram())
            robot.step([_answer(process, robot)])
        robot = bench.robot("egm")
        while not process.ended:
            process.send(robot.datagram())
            robot.step([])
            time.sleep(0.004)
        report = process.finish()
    assert report["ended_by"] == "silence" and STATES[report["state"]] == "stopped" and report["stale"] > 20


def test_asked_to_end_it_ramps_to_a_stop(bench: Bench) -> None:
    """The robot keeps its last speed when answers end, so that they may not end in the middle of a motion."""
    robot = bench.robot("egm")
    with LoopProcess(bench.program, _real_time(bench)) as process:
        begin = time.monotonic()
        for cycle in range(180):  # by the clock: what is late on a busy machine follows at once
            process.send(robot.datagram())
            time.sleep(max(0.0, begin + 0.004 * (cycle + 1) - time.monotonic()))
            robot.step(process.received())
        process.end()
        report = process.finish()
        last = egm.decode_sensor(process.received()[-1])
    rows = rows_of(bench.log.read_bytes())
    assert report["ended_by"] == "signal" and STATES[report["state"]] in ("running", "holding")
    ramp = rows[-RAMP:]
    assert {STATES[int(s)] for s in ramp[:-1, 3]} == {"ramping"} and STATES[int(ramp[-1, 3])] == "stopped"
    assert np.abs(rows[-RAMP - 1, 27:30]).max() > 0.1 and last.external_speeds_mm_s == [0.0] * 3
    assert np.all(np.diff(np.abs(ramp[:, 27:30]), axis=0) <= 0)


def test_asked_twice_it_ends_at_once(bench: Bench) -> None:
    robot = bench.robot("egm")
    with LoopProcess(bench.program, _real_time(bench, "--ramp", "5000", "--idle-ms", "60000")) as process:
        for _ in range(120):
            process.send(robot.datagram())
            robot.step([_answer(process, robot)])
        process.end()
        time.sleep(0.05)
        assert not process.ended
        process.end()
        report = process.finish()
    assert report["ended_by"] == "signal" and report["cycles"] < 5000


def test_a_log_that_exists_is_kept(bench: Bench) -> None:
    options = bench.options("egm", "trajectory")
    bench.log.write_text("precious")
    with pytest.raises(LoopError, match=r"loop\.log: cannot write this log: File exists"):
        LoopProcess(bench.program, options)
    assert bench.log.read_text() == "precious"


def test_a_full_disk_costs_the_log_not_the_motion(bench: Bench) -> None:
    """Room for ten records: the loop answers all cycles, says that its log is not complete, and ends with 1."""
    options = [*bench.options("egm", "trajectory"), "--cycles", "400"]

    def little_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10 * RECORD, 10 * RECORD))

    process = subprocess.Popen(
        [str(bench.program), *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=little_room,
    )  # fmt: skip
    assert process.stdout is not None
    port = int(process.stdout.readline().split()[1])
    robot, answered = bench.robot("egm"), 0
    with socket.socket(type=socket.SOCK_DGRAM) as s:
        s.connect(("127.0.0.1", port))
        s.settimeout(10.0)
        for _ in range(400):
            s.send(robot.datagram())
            s.send(b"")
            answers = []
            while data := s.recv(2000):
                answers.append(data)
            answered += len(answers)
            robot.step(answers)
    out, said = process.communicate(timeout=10)
    assert process.returncode == 1 and '"log_complete": 0' in out and answered == 400
    assert "the log is not complete: records were dropped or could not be written" in said
    assert len(rows_of(bench.log.read_bytes())) == 10
