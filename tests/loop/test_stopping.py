"""Hold last, then ramp to stop; limits; statuses of laws: what the loop commands when things go wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtmodel.loop import Faults, LoopProcess, ReferenceTable, TrajectoryLaw, lockstep
from gtmodel.loop.process import STATES, rows_of
from gtmodel.loop.python_loop import STOPPED
from gtmodel.results import Status
from tests.loop.bench import HOLD, RAMP, STEP, Bench, text

BEFORE, SILENT, AFTER = 180, 100, 20


def _through_silence(bench: Bench, protocol: str) -> tuple[np.ndarray, bytes]:
    """Log of the C loop and of the Python loop: running, then no datagrams for a while, then datagrams again."""
    robots = bench.robot(protocol), bench.robot(protocol)
    python_loop = bench.python_loop(protocol, "trajectory")
    with LoopProcess(bench.program, [*bench.options(protocol, "trajectory"), "--cycles", "300"]) as process:
        for robot, answering in zip(robots, (process.exchange, python_loop.exchange), strict=True):
            for cycle in range(BEFORE + SILENT + AFTER):
                silent = BEFORE <= cycle < BEFORE + SILENT
                answers = answering([] if silent else [robot.datagram()])
                robot.step([] if silent else answers)
        process.finish()
    return rows_of(bench.log.read_bytes()), bytes(python_loop.log)


@pytest.mark.parametrize("deceleration", [3.0, 40.0, 1e-300])
def test_a_declared_deceleration_is_kept_and_the_way_is_told(bench: Bench, deceleration: float) -> None:
    robots = bench.robot("egm"), bench.robot("egm")
    python_loop = bench.python_loop("egm", "trajectory")
    python_loop.settings.deceleration_m_s2 = deceleration
    options = [*bench.options("egm", "trajectory"), "--cycles", "600", "--deceleration", repr(deceleration)]
    with LoopProcess(bench.program, options) as process:
        for robot, answering in zip(robots, (process.exchange, python_loop.exchange), strict=True):
            for cycle in range(600):
                silent = cycle >= BEFORE
                answers = answering([] if silent else [robot.datagram()])
                robot.step([] if silent else answers)
        report = process.finish()
    rows = rows_of(bench.log.read_bytes())
    assert rows.tobytes() == bytes(python_loop.log)
    speed, command = rows[:, 27:30], rows[:, 21:24]
    fastest = np.abs(speed).max(axis=1)
    assert fastest[BEFORE - 1] > 0.1 and np.all(fastest[BEFORE : BEFORE + HOLD] == fastest[BEFORE - 1])
    lost = -np.diff(fastest[BEFORE + HOLD - 1 :]) / 0.004
    assert np.all(lost >= 0)
    if deceleration > 1.0:  # of a smaller one the ramp has as many cycles as there can be
        assert lost.max() <= deceleration * (1 + 1e-9)
        cycles = int(np.ceil(fastest[BEFORE - 1] / (0.004 * deceleration)))
        assert rows[BEFORE + HOLD + cycles - 1, 3] == STOPPED and np.count_nonzero(lost) == cycles
        way = 0.004 * fastest[BEFORE - 1] * (HOLD + (cycles - 1) / 2)
        assert np.isclose(np.abs(command[-1] - command[BEFORE - 1]).max(), way, rtol=1e-9)
        assert np.isclose(report["coasted_m"], way, rtol=1e-9) and python_loop.coasted_m == report["coasted_m"]
    assert sum(report["compute_below_us"].values()) == report["cycles"]


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_silence_holds_the_speed_then_ramps_to_a_stop(bench: Bench, protocol: str) -> None:
    rows, python_log = _through_silence(bench, protocol)
    assert rows.tobytes() == python_log
    states, speed, command = rows[:, 3], rows[:, 27:30], rows[:, 21:24]
    if protocol == "rsi":
        _no_further_than_a_step_from_what_was_sent(rows)
        return
    held = slice(BEFORE, BEFORE + HOLD)
    ramp = slice(BEFORE + HOLD, BEFORE + HOLD + RAMP)
    assert {STATES[int(s)] for s in states[held]} == {"holding"}
    assert {STATES[int(s)] for s in states[ramp][:-1]} == {"ramping"}
    assert np.all(states[ramp][-1:] == STOPPED)
    assert np.all(states[ramp.stop :] == STOPPED), "it stays stopped when datagrams come again"
    assert np.all(speed[held] == speed[BEFORE - 1]) and np.abs(speed[BEFORE - 1]).max() > 0.1
    falling = np.abs(speed[ramp])
    assert np.all(np.diff(falling, axis=0) <= 0) and np.all(falling[-1] == 0)
    moved = np.abs(np.diff(command[BEFORE - 1 :], axis=0))
    assert moved.max() <= 0.004 * np.abs(speed[BEFORE - 1]).max() + 1e-12, "never faster than before"
    assert np.all(rows[held, 4] == Status.STALE_INPUT)
    assert np.all(rows[BEFORE : BEFORE + SILENT, 13] > 0), "EGM takes the newest command"


def _no_further_than_a_step_from_what_was_sent(rows: np.ndarray) -> None:
    """RSI has no stamp to answer: the robot stands where the last answer put it, and goes on from there by a step at
    the most, however long the silence was."""
    states, command = rows[:, 3], rows[:, 21:24]
    assert np.all(rows[BEFORE : BEFORE + SILENT, 13] == 0)
    assert np.all(states[BEFORE + HOLD + RAMP :] == STOPPED) and states[BEFORE] == STATES.index("holding")
    moved = np.abs(command[BEFORE:] - command[BEFORE - 1]).max(axis=1)
    unlimited = 0.004 * np.abs(rows[BEFORE - 1, 27:30]).max() * (HOLD + (RAMP - 1) / 2)
    assert unlimited > 2 * STEP, "without this bound it would be a jump"
    assert np.all(np.diff(moved) >= 0) and np.isclose(moved[-1], STEP, rtol=1e-12)


def test_a_command_outside_the_limits_ramps_at_once(bench: Bench) -> None:
    python_loop = bench.python_loop("egm", "trajectory")
    python_loop.settings.limits.highest_m[0] = bench.start_m[0] + 0.02
    robot = bench.robot("egm")
    options = [*bench.options("egm", "trajectory"), "--cycles", "300"]
    options += ["--highest", text([bench.start_m[0] + 0.02, 10.0, 10.0])]
    with LoopProcess(bench.program, options) as process:
        for _ in range(300):
            datagram = robot.datagram()
            answers = process.exchange([datagram])
            python_loop.exchange([datagram])
            robot.step(answers)
        report = process.finish()
    log = bench.log.read_bytes()
    rows = rows_of(log)
    assert log == bytes(python_loop.log)
    assert STATES[report["state"]] == "stopped" and report["status"] == Status.OUT_OF_RANGE
    assert "holding" not in {STATES[int(s)] for s in rows[:, 3]}
    assert rows[:, 21].max() <= bench.start_m[0] + 0.02


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_a_robot_that_stands_outside_of_the_limits_is_not_moved(bench: Bench, protocol: str) -> None:
    """The first command is refused; the ramp from rest ends where the robot stands, half a metre above the limit."""
    start = bench.reference.rows[0, :3]
    lowest, highest = [float(min(start)) - 2.0] * 6, [*(start - 0.5).tolist(), 0.0, 0.0, 0.0]
    python_loop = bench.python_loop(protocol, "trajectory")
    python_loop.settings.limits = replace(python_loop.settings.limits, lowest_m=lowest, highest_m=highest)
    limits = ["--lowest", text(lowest), "--highest", text(highest)]
    robots = bench.robot(protocol), bench.robot(protocol)
    with LoopProcess(bench.program, [*bench.options(protocol, "trajectory"), *limits, "--cycles", "60"]) as process:
        runs = [
            lockstep(r, answering, 60)
            for r, answering in zip(robots, (process.exchange, python_loop.exchange), strict=True)
        ]
        report = process.finish()
    assert bench.log.read_bytes() == bytes(python_loop.log)
    assert Status(report["status"]) is Status.OUT_OF_RANGE and STATES[report["state"]] == "stopped"
    for run in runs:
        assert np.abs(run.measured_m - start).max() < 1e-9


def test_a_reference_that_begins_elsewhere_is_not_followed(bench: Bench) -> None:
    away = bench.reference.rows.copy()
    away[:, :3] += 2 * STEP
    python_loop = bench.python_loop("egm", "trajectory")
    law = python_loop.law
    assert isinstance(law, TrajectoryLaw)
    law.reference = ReferenceTable(away)
    robot = bench.robot("egm")
    for _ in range(5):
        robot.step(python_loop.exchange([robot.datagram()]))
    assert python_loop.status is Status.OUT_OF_RANGE
    assert np.all(robot.plant.position_m == bench.start_m)


def test_a_law_without_its_table_never_starts(bench: Bench) -> None:
    python_loop = bench.python_loop("rsi", "replay")
    python_loop.law.corrections = ReferenceTable(np.zeros((10, 2)))  # type: ignore[attr-defined]
    robot = bench.robot("rsi")
    robot.step(python_loop.exchange([robot.datagram()]))
    assert (python_loop.state, python_loop.status) == (STOPPED, Status.OUT_OF_RANGE)


def test_only_garbage_never_starts_anything(bench: Bench) -> None:
    pair = bench.both("rsi", "trajectory", 50, Faults(lost=1.0, garbage=1.0, seed=2))
    assert pair.c_log == pair.python_log
    assert pair.report["garbage"] == 50 and STATES[pair.report["state"]] == "waiting"
    assert np.all(rows_of(pair.c_log)[:, 13] == 0)
