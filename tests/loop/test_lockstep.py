"""The C loop against the loop in Python: equal logs byte for byte, exact counters, no divergence under faults."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.loop import Faults, expected_counters
from gtmodel.loop.process import COUNTERS, STATES, rows_of
from tests.loop.bench import Bench

CYCLES = 5000
FAULTS = Faults(lost=0.05, delayed=0.2, repeated=0.05, garbage=0.02, longest_delay=3, seed=11)
# a command that is three cycles old at up to 0.9 m/s, some of them in a row, through a drive of 1.1 Hz
FAULT_ERROR_M = 0.02
ROUND_OFF_M = 1e-9  # RSI sends whole 1e-6 mm, which the drive's inverse magnifies by a / b


@pytest.mark.parametrize("cycles", [1500, pytest.param(CYCLES, marks=pytest.mark.proof)])
@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_the_log_equals_the_twins_under_faults(bench: Bench, protocol: str, cycles: int) -> None:
    pair = bench.both(protocol, "trajectory", cycles, FAULTS)
    assert len(rows_of(pair.c_log)) == cycles
    assert pair.c_log == pair.python_log
    counted = {name: pair.report[name] for name in COUNTERS}
    assert counted == expected_counters(pair.c_run.to_loop.history)
    assert min(counted[name] for name in COUNTERS if name != "stale") > cycles / 100
    assert STATES[pair.report["state"]] == "running"
    wanted = bench.reference.rows[np.minimum(np.arange(cycles), 399), :3]
    assert np.abs(pair.c_run.measured_m - wanted).max() < FAULT_ERROR_M


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
@pytest.mark.parametrize("law", ["trajectory", "dynamics", "replay", "path", "lead_through"])
def test_every_law_equals_its_twin(bench: Bench, protocol: str, law: str) -> None:
    pair = bench.both(protocol, law, 200, waits=5)
    assert pair.c_log == pair.python_log
    assert np.array_equal(pair.c_run.measured_m, pair.python_run.measured_m)
    rows = rows_of(pair.c_log)
    moved = rows[:, 33:36] if law == "path" else rows[:, 21:24]
    assert np.ptp(moved, axis=0).max() > 1e-3
    assert not any(pair.report[name] for name in COUNTERS)


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_inverted_drives_track_the_reference(bench: Bench, protocol: str) -> None:
    pair = bench.both(protocol, "trajectory", 400)
    off = np.abs(pair.c_run.measured_m - bench.reference.rows[:, :3]).max()
    assert off < ROUND_OFF_M


def test_dry_run_computes_and_does_not_move_the_robot(bench: Bench) -> None:
    egm, rsi = (bench.both(protocol, "trajectory", 200, live=False) for protocol in ("egm", "rsi"))
    for pair in (egm, rsi):
        assert pair.c_log == pair.python_log
        assert np.all(pair.c_run.measured_m == pair.c_run.measured_m[0])
        assert np.ptp(rows_of(pair.c_log)[:, 21]) > 0.01, "the law's command stands in the log"
    assert np.all(rows_of(egm.c_log)[:, 13] == 0), "EGM gets no answer"
    assert np.all(rows_of(rsi.c_log)[:, 13] > 0), "RSI gets corrections of zero, or it would drop the connection"


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(20))
def test_many_seeds_of_faults(bench: Bench, seed: int) -> None:
    pair = bench.both("egm" if seed % 2 else "rsi", "trajectory", CYCLES, Faults(0.05, 0.2, 0.1, 0.05, 4, seed))
    assert pair.c_log == pair.python_log
    assert {name: pair.report[name] for name in COUNTERS} == expected_counters(pair.c_run.to_loop.history)
