"""Drawn histories of stamps, numbers, losses and garbage: how far and how hard the loop moves, and what it counts.

The seeds are all numbers from 0 on: 10,000 of each protocol in `make proof`, 60 in the ordinary suite.
"""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.loop import egm, expected_counters, rsi
from gtmodel.loop.process import COLUMNS, COUNTERS, STATES, WATCHES
from tests.loop.histories import CYCLE_MS, DECELERATION, STEP_M, LoopLibrary, drawn, python_loop

ORDINARY, PROOF, TWINS = 60, 10_000, 20
PERIOD = CYCLE_MS / 1000.0
ROUND_M = 1e-14  # of positions of some tenths of a metre, in double
SENT_M = 6e-10  # RSI sends whole 1e-6 mm; EGM's doubles in mm lose less
WAITING, RUNNING, BRAKES = 0, 1, (2, 3, 4)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> LoopLibrary:
    return LoopLibrary.made(tmp_path_factory.mktemp("histories"))


@pytest.mark.parametrize("seeds", [ORDINARY, pytest.param(PROOF, marks=pytest.mark.proof)])
@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_drawn_histories_keep_step_speed_and_deceleration_and_are_counted(
    library: LoopLibrary, protocol: str, seeds: int
) -> None:
    for seed in range(seeds):
        history = drawn(protocol, seed)
        rows, answers = library.run(protocol, history)
        about = f"{protocol} {seed}: {history.planted}"
        column = {name: rows[:, n] for n, name in enumerate(COLUMNS)}
        counted = {name: int(column[name][-1]) for name in (*COUNTERS, *WATCHES)}
        expected = expected_counters(history.numbers) | {
            "clock_faults": history.clock_faults, "following_faults": history.following_faults,
        }  # fmt: skip
        assert counted == expected, about
        state = column["state"].astype(int)
        assert STATES[state[-1]] == ("stopped" if history.stops else "running"), about
        position, speed = rows[:, 21:24], rows[:, 27:30]
        way = np.diff(position, axis=0)
        assert np.abs(way).max() <= STEP_M + ROUND_M, about
        passed = np.array([history.jumps.get(n, 1) for n in range(1, len(rows))])[:, None]
        assert np.abs(speed[1:] * PERIOD * passed - way).max() <= ROUND_M, about
        lost = np.abs(np.diff(speed, axis=0)).max(axis=1)
        brakes = np.isin(state[1:], BRAKES)
        sent = _sent(protocol, answers)
        if protocol == "rsi":  # nothing is sent in a silent cycle: the loop goes no further than a step from what was
            last = np.where(np.isnan(sent[:, :1]), np.nan, position)
            for n in range(1, len(last)):
                last[n] = last[n - 1] if np.isnan(last[n, 0]) else last[n]
            at_its_end = np.abs(position[1:] - last[:-1]).max(axis=1) >= STEP_M - ROUND_M
            brakes &= ~at_its_end & ~np.append(False, at_its_end[:-1])
        assert lost[brakes].max(initial=0.0) <= DECELERATION * PERIOD * (1 + 1e-9), about
        held = state[1:] == STATES.index("holding")
        assert lost[held & brakes].max(initial=0.0) <= 1e-12, about
        there = sent[~np.isnan(sent[:, 0])]
        assert np.abs(np.diff(there, axis=0)).max() <= STEP_M + 2 * SENT_M, f"{about}: from answer to answer"
        assert np.nanmax(np.abs(sent - position)) <= SENT_M, about
        assert np.all(speed[state == STATES.index("stopped")][1:] == 0.0), about


def _sent(protocol: str, answers: list[bytes]) -> np.ndarray:
    """Positions [m] that the robot is sent, as a robot reads them; NaN for a cycle without an answer."""
    sent = np.full((len(answers), 3), np.nan)
    for n, answer in enumerate(answers):
        if answer:
            values = rsi.decode_sensor(answer).ek_mm if protocol == "rsi" else egm.decode_sensor(answer).external_mm
            sent[n] = values[:3]
    return sent / 1000.0


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_the_twin_in_python_gives_the_same_bytes(library: LoopLibrary, protocol: str) -> None:
    for seed in range(TWINS):
        history, twin = drawn(protocol, seed), python_loop(protocol)
        rows, answers = library.run(protocol, history)
        assert [b"".join(twin.exchange(cycle)) for cycle in history.cycles] == answers
        assert rows.tobytes() == bytes(twin.log)
