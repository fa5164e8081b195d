"""The small parts of the runtime: sequence numbers, sampled references, the log's ring."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from gtmodel.loop import ReferenceTable, expected_counters
from gtmodel.loop.python_loop import Sequence
from gtmodel.results import Status
from tests.loop import c_codecs

COUNTED = ("lost", "repeated", "reordered", "stale")


@settings(max_examples=100, deadline=None)
@given(steps=st.lists(st.integers(-6, 9), max_size=60))
def test_sequence_counts_as_sets_do(runtime: ctypes.CDLL, steps: list[int]) -> None:
    numbers = np.maximum(0, 1000 + np.cumsum(steps)).tolist()
    c, python = c_codecs.Sequence(), Sequence()
    runtime.gt_sequence_init(ctypes.byref(c))
    for number in numbers:
        assert bool(runtime.gt_sequence_take(ctypes.byref(c), ctypes.c_uint64(number))) == python.take(number)
    found = {name: getattr(python, name) for name in COUNTED}
    assert {name: getattr(c, name) for name in COUNTED} == found
    if numbers and max(numbers) - min(numbers) < 64:
        expected = expected_counters([[int(n)] for n in numbers])
        assert found == {name: expected[name] for name in COUNTED}


def test_sequence_of_a_robot_that_started_again_is_stale(runtime: ctypes.CDLL) -> None:
    c, python = c_codecs.Sequence(), Sequence()
    runtime.gt_sequence_init(ctypes.byref(c))
    for number in (5000, 5001, 1, 2, 4000, 5100, 5001):
        runtime.gt_sequence_take(ctypes.byref(c), ctypes.c_uint64(number))
        python.take(number)
    assert (c.stale, python.stale) == (4, 4)
    assert (c.newest, python.newest, c.lost, python.lost) == (5100, 5100, 98, 98)


def _at(runtime: ctypes.CDLL, table: ReferenceTable, time_ms: int) -> tuple[Status, list[float]]:
    rows = np.ascontiguousarray(table.rows)
    given_rows = rows.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    traj = c_codecs.Traj(given_rows, rows.shape[0], rows.shape[1], table.step_ms)
    row = (ctypes.c_double * max(1, rows.shape[1]))(*[7.0] * max(1, rows.shape[1]))
    status = Status(runtime.traj_at(ctypes.byref(traj), ctypes.c_uint64(time_ms), row))
    assert status is Status.OK or set(row) == {7.0}, "a row that fails is not written"
    return status, list(row) if status is Status.OK else []


@given(time_ms=st.integers(0, 60) | st.integers(0, 2**62), step_ms=st.sampled_from([1, 4, 12]))
@settings(max_examples=100, deadline=None)
def test_reference_in_c_and_python(runtime: ctypes.CDLL, time_ms: int, step_ms: int) -> None:
    table = ReferenceTable(np.random.default_rng(3).normal(size=(6, 4)), step_ms)
    status, row = _at(runtime, table, time_ms)
    assert (status, row) == table.at(time_ms)
    times = step_ms * np.arange(6)
    expected = [np.interp(min(time_ms, times[-1]), times, column) for column in table.rows.T]
    assert row == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_references_that_cannot_be_used(runtime: ctypes.CDLL) -> None:
    spoilt = np.ones((4, 2))
    spoilt[2, 1] = np.nan
    for table, time_ms, expected in (
        (ReferenceTable(np.zeros((0, 2))), 0, Status.OUT_OF_RANGE),
        (ReferenceTable(spoilt), 8, Status.NOT_FINITE),
        (ReferenceTable(spoilt), 5, Status.NOT_FINITE),
        (ReferenceTable(spoilt), 4, Status.OK),
        # finite rows whose difference overflows: halfway is 0, not infinity
        (ReferenceTable(np.array([[1.7e308], [-1.7e308]])), 2, Status.NOT_FINITE),
        (ReferenceTable(np.array([[1.7e308], [-1.7e308]])), 4, Status.OK),
    ):
        assert _at(runtime, table, time_ms)[0] is expected
        assert table.at(time_ms)[0] is expected


def test_ring_keeps_order_and_counts_what_it_drops(runtime: ctypes.CDLL) -> None:
    room, log = (ctypes.c_double * 8)(), c_codecs.Log()
    assert not runtime.gt_log_init(ctypes.byref(log), room, 3, 2), "a capacity that is no power of two"
    assert runtime.gt_log_init(ctypes.byref(log), room, 4, 2)
    log.put = log.taken = 2**32 - 2  # the counters run over
    record = (ctypes.c_double * 2)()
    put = [runtime.gt_log_put(ctypes.byref(log), (ctypes.c_double * 2)(n, -n)) for n in range(6)]
    assert put == [1, 1, 1, 1, 0, 0] and log.dropped == 2
    taken = []
    while runtime.gt_log_take(ctypes.byref(log), record):
        taken.append(tuple(record))
    assert taken == [(n, -n) for n in range(4)]
    assert runtime.gt_log_has_room(ctypes.byref(log))


def test_numbers_of_the_log_are_little_endian(runtime: ctypes.CDLL) -> None:
    out = (ctypes.c_uint8 * 8)()
    runtime.gt_log_bytes(ctypes.c_double(-1303.68), out)
    assert bytes(out) == np.array([-1303.68], dtype="<f8").tobytes()
