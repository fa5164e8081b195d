"""Saved states, resets, instances side by side: every bit."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.fmu.raw import ERROR, OK, Raw

ALL = ["fk", "forward", "filtered", "d1_fk", "f1_ik", "block", "filter"]
H = 4e-3


def run(raw, first, last, rng_seed=0):
    """Steps with inputs that vary; what comes out."""
    t, rows = raw.table, []
    inputs = [v for v in t.of("input") if not v.integer]
    flags = [v.reference for v in t.of("input") if v.integer]  # whether a sensor has a value
    outputs = [v.reference for v in t.of("output", "derivative", "state") if not v.integer]
    counts = [v.reference for v in t.of("output") if v.integer]
    for k in range(first, last):
        values = [v.start + 2e-3 * max(0.1, abs(v.start)) * np.sin(0.3 * k + n) for n, v in enumerate(inputs)]
        if any(v.name.startswith("e[") for v in inputs):  # a quaternion stays one
            values = [v.start + (2e-3 * np.sin(0.3 * k) if v.unit == "m" else 0.0) for v in inputs]
        assert raw.set([v.reference for v in inputs], values) == OK
        assert raw.set_integers(flags, [int((k + n) % 3 != 0) for n in range(len(flags))]) == OK
        assert raw.step(k * H, H)[0] == OK
        status, got = raw.get(outputs)
        more, integers = raw.get_integers(counts)
        assert status == more == OK
        rows.append([*got, *integers])
    return np.array(rows)


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ALL)
def test_save_run_restore_run(made, name, version):
    unit, path, _ = made(name, version)
    raw = Raw(unit, path)
    assert raw.begin() == OK
    run(raw, 0, 5)
    state = raw.save()
    data = raw.serialized(state)
    first = run(raw, 5, 20)
    assert raw.restore(state) == OK
    assert np.array_equal(run(raw, 5, 20), first)
    other = Raw(unit, path)  # in another instance, from bytes
    status, there = other.deserialized(data)
    assert status == OK and other.restore(there) == OK
    assert np.array_equal(run(other, 5, 20), first)
    assert raw.forget(state) == OK and other.forget(there) == OK
    broken = bytearray(data)
    broken[len(data) // 2] ^= 1
    assert other.deserialized(bytes(broken))[0] == ERROR
    assert other.deserialized(data[:-1])[0] == ERROR


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ALL)
def test_a_reset_gives_what_instantiation_gives(made, name, version):
    unit, path, _ = made(name, version)
    raw = Raw(unit, path)
    assert raw.begin() == OK
    first = run(raw, 0, 10)
    assert raw.do("Reset") == OK and raw.begin() == OK
    assert np.array_equal(run(raw, 0, 10), first)


@pytest.mark.parametrize("name", ["forward", "f1_ik", "block", "filter"])
def test_two_instances_in_two_threads(made, name):
    """Interleaved with resets, each is what one alone is."""
    unit, path, _ = made(name, 3)

    def work(_):
        raw = Raw(unit, path)
        rows = []
        for _ in range(6):
            assert raw.do("Reset") == OK and raw.begin() == OK
            rows.append(run(raw, 0, 15))
        return np.array(rows)

    alone = work(0)
    with ThreadPoolExecutor(2) as pool:
        for result in pool.map(work, range(4)):
            assert np.array_equal(result, alone)


def test_two_ways_into_one_point_agree(made):
    """Newton's memory in the state: the six-link robot led to one point along two paths."""
    unit, path, _ = made("d1_fk", 3)
    inputs = unit.table.of("input")
    start = np.array([v.start for v in inputs])
    goal = start + np.array([0.08, -0.06, 0.05])
    results = []
    for way in (np.linspace(0, 1, 11), np.sin(np.linspace(0, 2.5 * np.pi, 41))):
        raw = Raw(unit, path)
        assert raw.begin() == OK
        for k, s in enumerate(way):
            bend = 0.02 * np.sin(np.pi * s) if len(way) > 20 else 0.0
            assert raw.set([v.reference for v in inputs], start + s * (goal - start) + bend) == OK
            assert raw.step(k * H, H)[0] == OK
        assert raw.set([v.reference for v in inputs], goal) == OK and raw.step(len(way) * H, H)[0] == OK
        results.append(raw.get(unit.table.computed)[1])
    assert np.max(np.abs(results[0] - results[1])) <= 1e-10


def test_trial_steps_do_not_move_newtons_memory(made):
    """In model exchange only a completed step does: trials before it leave no trace."""
    unit, path, _ = made("d1_fk", 3)
    inputs = [v.reference for v in unit.table.of("input")]
    start = np.array([v.start for v in unit.table.of("input")])
    straight, trying = (Raw(unit, path, co=False) for _ in range(2))
    assert straight.begin() == trying.begin() == OK
    for k in range(1, 6):
        for away in (0.03, -0.02, 0.01):
            trying.set(inputs, start + 0.01 * k + away)
            trying.get(unit.table.computed)
        for raw in (straight, trying):
            assert raw.set(inputs, start + 0.01 * k) == OK
            assert raw.get(unit.table.computed)[0] == OK and raw.completed() == OK
    assert straight.get(unit.table.computed)[1].tolist() == trying.get(unit.table.computed)[1].tolist()
