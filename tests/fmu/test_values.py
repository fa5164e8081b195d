"""Values of units against the C of gt.cgen, compiled apart, and against Python: every bit."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.points import draw, evaluate
from gtmodel.cgen.real import DOUBLE
from gtmodel.cgen.steps.function import dtype_of
from gtmodel.cgen.verification.comparison import call
from gtmodel.compiler.toolchain import find
from gtmodel.fmu.table import fmi_name
from gtmodel.results.status import Status
from tests.fmu.makers import function
from tests.fmu.raw import DISCARD, ERROR, OK, Raw

FEW, MANY = 500, 10_000
CLOSED = ["fk", "ik", "inverse", "forward", "filtered"]
NEWTON = ["d1_fk", "f1_fk", "f1_ik"]


@pytest.fixture(scope="module")
def library(made, tmp_path_factory):
    """C of the same function by gt.cgen at -O2, which the unit is not made from."""

    def compiled(name: str):
        unit, *_ = made(name, 3)
        folder = tmp_path_factory.mktemp(f"c_{name}")
        gt.cgen.generate({"model": unit.function}, folder, name=f"u_{name}")
        tools = find()
        objects = []
        for file in sorted(folder.glob("*.c")):
            if not file.name.endswith("_main.c"):
                objects.append(file.with_suffix(".o"))
                good, text = tools.compile(file, objects[-1])
                assert good, text
        assert tools.link_shared(objects, folder / "all.so")[0]
        (face,) = interfaces({"model": unit.function}, f"u_{name}")
        return face, ctypes.CDLL(str(folder / "all.so"))

    return compiled


def points(face, n: int) -> np.ndarray:
    """Near consistent points and far from them."""
    return draw(face, n, seed=5)


def places(unit) -> tuple[list[int], list[list[int]]]:
    """Value references of the inputs as the function takes them, and of each output number, by all its names."""
    names = {v.name: v.reference for v in unit.table.variables}
    symbol = unit.function.flat.symbol_name
    inputs = [names[fmi_name(symbol(*p))] for s in unit.function.inputs for p in s.pairs]
    own = [fmi_name(symbol(*p)) for s in unit.function.outputs for p in s.pairs]
    aliases = [n.replace("der(T[", "d2_T_out[").replace("],2)", "]") for n in own]
    return inputs, [[names[n] for n in sorted({a, b}) if n in names] for a, b in zip(own, aliases, strict=True)]


def answers(raw, unit, rows):
    """Outputs and statuses of the unit at rows of inputs, behind them Newton's start."""
    inputs, outputs = places(unit)
    settings = [*inputs, *[v.reference for v in unit.table.variables if v.name.startswith("guess.")]]
    values, codes = np.full((len(rows), len(outputs)), np.nan), np.zeros(len(rows), int)
    for n, row in enumerate(rows):
        assert raw.do("Reset") == OK
        status = raw.set(settings, row[: len(settings)])
        if status == OK:
            status = raw.begin()
        if status == OK:
            status, values[n] = raw.get([there[0] for there in outputs])
            for there in outputs:
                assert len(set(raw.get(there)[1].tolist())) == 1
        codes[n] = status
    return values, codes


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", [*CLOSED, *NEWTON])
@pytest.mark.parametrize("n", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
def test_outputs_are_those_of_the_c_function(made, library, name, version, n):
    unit, path, _ = made(name, version)
    face, dll = library(name)
    rows = points(face, n)
    wanted, status = call(dll, face, rows)
    got, codes = answers(Raw(unit, path, co=name != "forward"), unit, rows)
    good = status == Status.OK
    assert good.sum() > n / 20
    if name != "fk":
        assert (~good).sum() > n / 50
    assert np.array_equal(codes == OK, good)
    assert set(codes[~good].tolist()) <= {DISCARD, ERROR}
    outputs = wanted[:, : face.output_size]
    assert np.array_equal(got[good].view(np.uint64), outputs[good].view(np.uint64))
    python, said = evaluate(face, rows)
    assert np.array_equal(np.asarray(said) == Status.OK, good)
    assert np.array_equal(got[good].view(np.uint64), python[good, : face.output_size].copy().view(np.uint64))


@pytest.mark.parametrize("version", [3, 2])
def test_derivatives_in_model_exchange_are_those_of_the_function(made, version):
    unit, path, _ = made("forward", version)
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    f, rng = unit.function, np.random.default_rng(1)
    start = np.array([unit.table.variables[r].start for r in unit.table.states])
    tau = [v.reference for v in unit.table.of("input")]
    which = [s.name for s in f.outputs].index("der(T,2)")
    for _ in range(200):
        x, u = start + 0.1 * rng.normal(size=6), 50 * rng.normal(size=3)
        *values, status = f(x[:3], x[3:], u)
        assert raw.set(tau, u) == OK and raw.set_states(x) == OK
        got, dx = raw.derivatives()
        assert (got == OK) == (status is Status.OK)
        if got == OK:
            assert dx.tolist() == [*x[3:], *values[which]]


def test_a_sampled_block_does_what_its_twin_does(made):
    """At 0, 4, 8 ms: with the inputs of that instant, in both interfaces and both versions."""
    f = function("block")
    twin = f.twin(DOUBLE)
    rng = np.random.default_rng(3)
    errors = rng.normal(size=20)
    state, out = np.zeros((), dtype_of(f.state, DOUBLE)), np.zeros((), dtype_of(f.outputs, DOUBLE))
    start = np.zeros((), dtype_of(f.start, DOUBLE))
    assert twin.init(state, start) == Status.OK
    wanted = []
    for e in errors:
        given = np.zeros((), dtype_of(f.inputs, DOUBLE))
        given["error_m"] = e
        assert twin.step(state, given, out) == Status.OK
        wanted.append(float(out["speed_m_s"]))
    for version in (3, 2):
        unit, path, _ = made("block", version)
        raw = Raw(unit, path, co=True)
        assert raw.begin() == OK
        got = []
        for k, e in enumerate(errors):
            assert raw.set([raw.names["error"]], [e]) == OK
            assert raw.step(0.004 * k, 0.004)[0] == OK
            got.append(raw.get([raw.names["speed"]])[1][0])
        assert got == wanted
        raw = Raw(unit, path, co=False)
        assert raw.begin({"error": errors[0]}, step=False) == OK
        got, time = [], 0.0
        for k, e in enumerate(errors):
            if k:
                assert raw.do("EnterEventMode") == OK and raw.set_time(time) == OK
            assert raw.set([raw.names["error"]], [e]) == OK
            status, defined, time = raw.update()
            assert status == OK and defined and time == pytest.approx(0.004 * (k + 1))
            assert raw.do("EnterContinuousTimeMode") == OK
            got.append(raw.get([raw.names["speed"]])[1][0])
        assert got == wanted


def test_a_longer_step_takes_all_its_samples(made):
    unit, path, _ = made("block", 3)
    one, three = (Raw(unit, path) for _ in range(2))
    assert one.begin({"error": 1.0}) == three.begin({"error": 1.0}) == OK
    for k in range(6):
        assert one.step(0.004 * k, 0.004)[0] == OK
    assert three.step(0.0, 0.012)[0] == three.step(0.012, 0.012)[0] == OK
    assert one.get([one.names["speed"]])[1] == three.get([one.names["speed"]])[1]


def test_a_declared_start_is_a_parameter(made):
    unit, path, _ = made("block", 3)
    raw = Raw(unit, path)
    assert raw.begin({"start.integral": 0.25, "error": 0.0}) == OK
    assert raw.step(0.0, 0.004)[0] == OK
    assert raw.get([raw.names["speed"]])[1][0] == 2.0 * 0.25


def test_a_tunable_parameter_changes_between_steps(made):
    unit, path, _ = made("tunable", 3)
    assert [v.name for v in unit.table.of("tunable")] == ["torque"]
    raw = Raw(unit, path)
    assert raw.begin() == OK
    before = raw.get([unit.table.rates[-1]])[1][0]
    assert raw.set([raw.names["torque"]], [3.0 + unit.table.of("tunable")[0].start]) == OK
    assert raw.get([unit.table.rates[-1]])[1][0] == pytest.approx(before + 3.0, abs=1e-12)


def test_held_outputs_say_so(made):
    for version in (3, 2):
        unit, path, _ = made("held", version)
        raw = Raw(unit, path)
        assert raw.begin() == OK
        status, codes = [raw.names["status"]], [raw.names[f"q[{k}]"] for k in (1, 2, 3)]
        good = raw.get(codes)[1]
        place = [raw.names[f"T[{k}]"] for k in (1, 2, 3)]
        assert raw.set(place, [9.0, 9.0, 9.0]) == OK and raw.step(0.0, 0.004)[0] == OK
        assert raw.get(codes)[0] == OK and raw.get(codes)[1].tolist() == good.tolist()
        assert raw.get_integers(status)[1].tolist() == [int(Status.OUT_OF_RANGE)]
        assert raw.set(place, [unit.table.variables[r].start for r in place]) == OK
        assert raw.get_integers(status)[1].tolist() == [0] and raw.get(codes)[1].tolist() == good.tolist()
