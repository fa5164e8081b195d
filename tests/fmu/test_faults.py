"""Where there is no answer: a status, a sentence, the last good values; never a wrong number."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from gtmodel.results.status import Status
from tests.fmu.makers import function
from tests.fmu.raw import DISCARD, ERROR, OK, Raw

FEW, MANY = 4_000, 100_000
PUSH = 4000.0  # N on one cart: out of the workspace within the second


@pytest.mark.parametrize("version", [3, 2])
def test_out_of_reach_is_discarded_with_the_sentence(made, version):
    unit, path, _ = made("ik", version)
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    T, q = ([raw.names[f"{name}[{k}]"] for k in (1, 2, 3)] for name in "Tq")
    home = [unit.table.variables[r].start for r in T]
    before = raw.get(q)[1].tolist()
    assert raw.set(T, [9.0, 9.0, 9.0]) == OK
    status, values = raw.get(q)
    assert status == DISCARD and set(values.tolist()) == {-77.0}
    assert (DISCARD, "logStatusDiscard") == raw.said[-1][:2]
    assert Status.OUT_OF_RANGE.message in raw.said[-1][2]
    assert raw.set(T, [np.nan, 0.0, 0.0]) == ERROR and raw.said[-1][1] == "logStatusError"
    assert raw.set(T, home) == OK
    assert raw.get(q)[1].tolist() == before


def pushed(unit, raw):
    force = {v.name: v.start for v in unit.table.of("input")}
    force["tau[1]"] += PUSH
    assert raw.begin(force) == OK


@pytest.mark.parametrize("version", [3, 2])
def test_leaving_the_workspace_inside_a_step(made, version):
    """lastSuccessfulTime is the end of the last inner step that has an answer, which a run in such steps shows."""
    unit, path, _ = made("forward", version)
    fine, coarse = Raw(unit, path), Raw(unit, path)
    pushed(unit, fine)
    pushed(unit, coarse)
    states, h, long = list(unit.table.states), 1e-3, 16
    last = None
    for k in range(2000):
        status, reached = fine.step(k * h, h)
        if status != OK:
            assert status == DISCARD and reached == pytest.approx(k * h, abs=1e-12)
            last = k
            break
    assert last is not None and last % long != 0
    wanted = fine.get(states)[1]
    for k in range(last // long):
        assert coarse.step(k * long * h, long * h)[0] == OK
    before = coarse.get(states)[1]
    status, reached = coarse.step((last // long) * long * h, long * h)
    assert status == DISCARD
    assert reached == pytest.approx(last * h, abs=1e-12)
    assert any(text.startswith("DoStep") for _, _, text in coarse.said)
    after = coarse.get(states)[1]
    if version == 2:  # at the last good part
        assert after == pytest.approx(wanted, rel=0, abs=1e-12)
        assert coarse.step(reached, h)[0] == DISCARD
    else:  # as before the call, as the standard has it; up to there it goes well
        assert after.tolist() == before.tolist()
        start = (last // long) * long * h
        assert coarse.step(start, reached - start)[0] == OK
        assert coarse.get(states)[1] == pytest.approx(wanted, rel=0, abs=1e-12)


def test_a_solver_that_leaves_the_workspace_is_told_so(made):
    """By Euler's method in steps of 0.1 ms: there is no rate behind the last good point, and the log says why."""
    unit, path, _ = made("forward", 3)
    raw = Raw(unit, path, co=False)
    pushed(unit, raw)
    x, h = raw.states()[1], 1e-4
    for k in range(20_000):
        assert raw.set_time(k * h) == OK and raw.set_states(x) == OK
        status, dx = raw.derivatives()
        if status != OK:
            break
        x = x + h * dx
    assert status == DISCARD and set(dx.tolist()) == {-77.0}
    assert raw.said[-1][:2] == (DISCARD, "logStatusDiscard")


ODD = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-310, 0.0, 9.0, -9.0, 1e17]


@pytest.mark.parametrize("calls", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize(
    "name, version", [("ik", 3), ("ik", 2), ("forward", 3), ("forward", 2), ("f1_ik", 3), ("block", 3)]
)
def test_hostile_calls(made, name, version, calls):
    """Random calls with random arguments in random modes. What is OK is what Python answers; the rest writes none."""
    unit, path, _ = made(name, version)
    t, rng = unit.table, np.random.default_rng(8)
    inputs = [v.reference for v in t.of("input")]
    outputs = [v.reference for v in t.of("output", "derivative") if not v.integer]
    raws = [Raw(unit, path, co=bool(k)) for k in (0, 1)]
    counts = {OK: 0, DISCARD: 0, ERROR: 0}
    answered = 0
    for _ in range(calls):
        raw = raws[rng.integers(2)]
        kind = rng.integers(12)
        if kind == 0 and rng.random() < 0.1:
            status = raw.do("Reset")
        elif kind <= 1:
            status = raw.begin()
        elif kind <= 4:
            r = rng.choice(inputs if rng.random() < 0.9 else len(t.variables) + 5, size=rng.integers(1, 4))
            v = np.array([t.variables[k].start or 0.0 if k < len(t.variables) else 0.0 for k in r], float)
            v += rng.choice([0.0, 1e-3, 0.1]) * rng.normal(size=len(v))
            if rng.random() < 0.2:
                v[0] = rng.choice(ODD)
            settable = all(k in inputs for k in r)
            before = raw.get(r)[1] if settable else None
            status = raw.set(r, v)
            if settable and status != OK:
                assert raw.get(r)[1].tolist() == before.tolist()
            if not np.all(np.isfinite(v)):
                assert status == ERROR
        elif kind <= 7:
            status, values = raw.get(outputs)
            if status == OK:
                assert np.all(np.isfinite(values))
                answered += right(unit, raw, outputs, values) if raw.table.period == 0 else 1
            else:
                assert set(values.tolist()) == {-77.0}
        elif kind == 8:
            now = raw.get([0])[1][0]
            h = rng.choice([1e-3, 4e-3, 0.0, -1.0, np.nan, np.inf, 1e9])
            status, _ = raw.step(now if rng.random() < 0.8 else rng.choice(ODD), h)
            if not 0 < h < 1e6:
                assert status == ERROR
        elif kind == 9:
            x = raw.states()[1]
            x = x + rng.choice([0.0, 1e-3, 1.0]) * rng.normal(size=len(x))
            if len(x) and rng.random() < 0.2:
                x[0] = rng.choice(ODD)
            status = raw.set_states(x if rng.random() < 0.9 else [*x, 1.0])
        elif kind == 10:
            status, dx = raw.derivatives()
            if status != OK:
                assert set(dx.tolist()) <= {-77.0}
        else:
            status, _ = raw.directional(rng.choice(outputs, 2), rng.choice(inputs, 1), [rng.choice([1.0, np.nan])])
        counts[status] += 1
    assert answered > calls / (200 if "e[1]" in raw.names else 50)  # a quaternion is seldom of unit length
    assert counts[ERROR] > calls / 50
    for raw in raws:
        raw.free()


def right(unit, raw, outputs, values) -> int:
    """1 where what the unit says is the answer of Python at what it holds; fails otherwise."""
    from gtmodel.fmu.table import fmi_name

    f = unit.function
    own = [fmi_name(f.flat.symbol_name(*p)) for s in f.inputs for p in s.pairs]
    given = dict(zip(own, raw.get([raw.names[n] for n in own])[1], strict=True))
    arguments = [
        np.array([given[fmi_name(f.flat.symbol_name(*p))] for p in s.pairs]).reshape(s.shape) for s in f.inputs
    ]
    said = dict(zip([unit.table.variables[r].name for r in outputs], values, strict=True))
    if f.kernels:
        return closes(given, said)
    *wanted, status = f(*arguments)
    assert status is Status.OK
    names = [fmi_name(f.flat.symbol_name(*p)) for s in f.outputs for p in s.pairs]
    numbers = dict(zip(names, np.concatenate([np.ravel(w) for w in wanted]), strict=True))
    assert all(said[n] == number for n, number in numbers.items() if n in said)
    return 1


def closes(given, said) -> int:
    """The F1: from its last solution C may reach one that Python, from home, does not; the axes must lead back."""
    pose = [np.array([given[f"{name}[{k}]"] for k in range(1, n + 1)]) for name, n in (("T", 3), ("e", 4))]
    q = np.array([said[f"q[{k}]"] for k in range(1, 7)])
    T, e, status = function("f1_fk")(q, guess={"T": pose[0], "e": pose[1]})
    assert status is Status.OK
    assert np.concatenate([T, e]) == pytest.approx(np.concatenate(pose), rel=0, abs=1e-6)  # e is of unit length to 1e-6
    return 1


@pytest.mark.parametrize("version", [3, 2])
def test_null_pointers_and_other_tokens(made, version):
    unit, path, _ = made("fk", version)
    assert Raw(unit, path, token="{other}").i is None
    raw = Raw(unit, path)
    assert raw.begin() == OK
    null, one = ctypes.c_void_p(), ctypes.c_size_t(1)
    more = [one] if version == 3 else []
    for name in ("SetFloat64", "GetFloat64") if version == 3 else ("SetReal", "GetReal"):
        assert raw.do(name, null, one, null, *more) == ERROR
        assert raw.f(name)(null, null, one, null, *more) == ERROR
    assert raw.f("Terminate")(null) == ERROR
    raw.free()
    raw.f("FreeInstance", None)(null)


@pytest.mark.parametrize("version", [3, 2])
def test_calls_in_the_wrong_mode_are_refused(made, version):
    unit, path, _ = made("forward", version)
    raw = Raw(unit, path, co=True)
    assert raw.step(0.0, 1e-3)[0] == ERROR
    assert raw.get(unit.table.computed)[0] == ERROR
    assert raw.begin() == OK
    assert raw.begin() == ERROR
    assert raw.set(list(unit.table.states), [0.0] * 6) == ERROR
    assert raw.set_time(1.0) == ERROR
    assert raw.do("Terminate") == OK
    assert raw.step(0.0, 1e-3)[0] == ERROR
    assert raw.get(unit.table.computed)[0] == OK


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("deviation", [-1.0, 0.0, 1e200])
def test_a_start_that_a_filter_refuses_is_not_run_from(made, version, deviation):
    """Set before initialisation it is refused on entering it, during it at once; a good one is taken afterwards."""
    unit, path, _ = made("filter", version)
    output = [unit.table.of("output")[0].reference]
    raw = Raw(unit, path)
    which = [raw.names["start.x.deviation"]]
    assert raw.set(which, [deviation]) == OK
    assert raw.begin() != OK
    assert raw.step(0.0, 4e-3)[0] == ERROR and raw.get(output)[0] == ERROR
    assert raw.set(which, [0.5]) == OK and raw.begin() == OK and raw.step(0.0, 4e-3)[0] == OK
    during, plain = Raw(unit, path), Raw(unit, path)
    assert during.begin({"start.x.deviation": deviation}) == DISCARD
    assert during.get(which)[1].tolist() == [1.0]  # as declared, and it runs from there
    assert plain.begin() == OK
    numbers = [v.reference for v in unit.table.numbers]
    assert during.step(0.0, 4e-3)[0] == plain.step(0.0, 4e-3)[0] == OK
    assert during.get(numbers)[1].tolist() == plain.get(numbers)[1].tolist()


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ["forward", "filter"])
def test_a_state_of_the_other_interface_is_refused(made, name, version):
    unit, path, _ = made(name, version)
    stepping, solved = (Raw(unit, path, co=co) for co in (True, False))
    assert stepping.begin() == solved.begin() == OK
    of_steps, of_solver = stepping.save(), solved.save()
    assert solved.restore(of_steps) == ERROR and stepping.restore(of_solver) == ERROR
    assert solved.step(0.0, 4e-3)[0] == ERROR and solved.set_time(0.001) == OK
    assert stepping.step(0.0, 4e-3)[0] == OK
    assert stepping.restore(of_steps) == solved.restore(of_solver) == OK


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ["forward", "filter", "block", "held"])
def test_wrong_steps_references_and_twice_the_same_call(made, name, version):
    unit, path, _ = made(name, version)
    raw = Raw(unit, path)
    assert raw.do("ExitInitializationMode") == raw.do("Terminate") == raw.step(0.0, 4e-3)[0] == ERROR
    for v in unit.table.of("input", "fixed", "state"):
        assert v.integer or raw.set([v.reference], [np.nan]) == ERROR
    assert raw.begin() == OK and raw.do("ExitInitializationMode") == ERROR
    for reference in (len(unit.table.variables), 2**31, 2**32 - 1):
        for get in (raw.get, raw.get_integers):
            status, values = get([reference])
            assert status == ERROR and values.tolist() == [-77]
        assert raw.set([reference], [0.0]) == raw.set_integers([reference], [0]) == ERROR
    for h in (0.0, -4e-3, np.nan, np.inf, -np.inf, 1e300):
        assert raw.step(0.0, h)[0] == ERROR
    assert raw.step(np.nan, 4e-3)[0] == raw.step(1.0, 4e-3)[0] == ERROR
    assert raw.step(0.0, 4e-3)[0] == OK and raw.step(0.0, 4e-3)[0] == ERROR
    if version == 3:
        two, one = ctypes.c_size_t(2), ctypes.c_size_t(1)
        references, values = (ctypes.c_uint32 * 2)(0, 1), (ctypes.c_double * 2)(-77.0, -77.0)
        for call in ("GetFloat64", "SetFloat64"):
            assert raw.do(call, references, two, values, one) == ERROR
        assert list(values) == [-77.0, -77.0]
    assert raw.do("Terminate") == OK and raw.do("Terminate") == ERROR
    assert raw.restore(ctypes.c_void_p()) == ERROR and raw.forget(ctypes.c_void_p()) == OK
    raw.free()
