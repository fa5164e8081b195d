"""Runs of units with states, against an integrator of SciPy that knows nothing of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gtmodel.fmu import causal_content
from tests.fmu.makers import STOP, function, unit as unit_of
from tests.fmu.raw import OK, Raw, unpacked
from tests.fmu.test_derivatives import python

AWAY = 5.0  # N above the forces that hold it
NEAR = 1e-8


def moved(unit):
    """Inputs at which it moves."""
    return {v.name: v.start + (AWAY if v.unit == "N" else 0.02) for v in unit.table.of("input")}


def exact(unit, inputs, times):
    """States at these times by DOP853 at 1e-12."""
    t = unit.table
    names = [t.variables[r].name for r in t.states]

    def rates(_, x):
        return python(unit.function, t, {**inputs, **dict(zip(names, x, strict=True))})[0]

    start = [t.variables[r].start for r in t.states]
    run = solve_ivp(rates, (0, times[-1]), start, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=times)
    return run.y.T


@pytest.fixture(scope="module")
def truth(made):
    results = {}

    def of(name):
        if name not in results:
            unit, *_ = made(name, 3)
            results[name] = exact(unit, moved(unit), np.linspace(0, STOP, 21))
        return results[name]

    return of


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ["forward", "filtered", "pendulum"])
@pytest.mark.parametrize("h", [1e-3, 4e-3, 1e-2])
def test_co_simulation_with_constant_inputs(made, truth, name, version, h):
    unit, path, _ = made(name, version)
    raw = Raw(unit, path)
    assert raw.begin(moved(unit)) == OK
    far = 0.0
    for k in range(1, round(STOP / h) + 1):
        assert raw.step((k - 1) * h, h) == (OK, pytest.approx(k * h, abs=1e-12))
        row = round(k * h / (STOP / 20))  # on the way too: at the end the lags have forgotten
        if abs(k * h - row * STOP / 20) < 1e-9:
            far = max(far, np.max(np.abs(raw.get(list(unit.table.states))[1] - truth(name)[row])))
    assert far <= NEAR, far


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ["forward", "filtered", "pendulum"])
def test_model_exchange_by_cvode(made, truth, name, version):
    fmpy = pytest.importorskip("fmpy")
    unit, _, path = made(name, version)
    names = [unit.table.variables[r].name for r in unit.table.states]
    result = fmpy.simulate_fmu(
        str(path), stop_time=STOP, output_interval=STOP / 20, fmi_type="ModelExchange", solver="CVode",
        relative_tolerance=1e-10, start_values=moved(unit), output=names,
    )  # fmt: skip
    got = np.array([result[n] for n in names]).T
    assert np.max(np.abs(got - truth(name))) <= NEAR


@pytest.mark.parametrize("version", [3, 2])
def test_co_simulation_by_fmpy_is_that_of_the_headers(made, version):
    fmpy = pytest.importorskip("fmpy")
    unit, library, path = made("forward", version)
    names = [unit.table.variables[r].name for r in unit.table.states]
    result = fmpy.simulate_fmu(
        str(path), stop_time=STOP, output_interval=4e-3, fmi_type="CoSimulation", start_values=moved(unit), output=names
    )
    raw = Raw(unit, library)
    assert raw.begin(moved(unit)) == OK
    for k in range(50):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    # the ends of steps differ in the last digit of the time
    assert raw.get(list(unit.table.states))[1] == pytest.approx([result[n][-1] for n in names], rel=0, abs=1e-13)


def test_the_order_of_the_integrator_inside_is_four(tmp_path):
    """Halving the step divides the error by 16, between errors that are above round-off; no friction."""
    errors = []
    for k, h in enumerate((0.05, 0.025, 0.0125)):
        unit = unit_of("pendulum", 3, step=h, tolerance=1.0)
        raw = Raw(unit, unpacked(unit, tmp_path / str(k)))
        assert raw.begin({"torque": 5.0}) == OK
        assert raw.step(0.0, 1.0)[0] == OK
        end = exact(unit, {"torque": 5.0}, np.array([0.0, 1.0]))[-1]
        errors.append(np.max(np.abs(raw.get(list(unit.table.states))[1] - end)))
    assert min(errors) > 1e-9
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx([16, 16], abs=2)


def test_the_energy_book_closes(made):
    """Without friction what a constant torque has done is what the energy has gained."""
    unit, path, _ = made("pendulum", 3)
    raw = Raw(unit, path)
    assert raw.begin({"torque": 5.0}) == OK
    before, angle = raw.get([raw.names["energy"], raw.names["angle"]])[1]
    largest = abs(before)
    for k in range(200):
        assert raw.step(k * 1e-3, 1e-3)[0] == OK
        energy, here = raw.get([raw.names["energy"], raw.names["angle"]])[1]
        largest = max(largest, abs(energy))
        assert abs(energy - before - 5.0 * (here - angle)) <= 1e-8 * largest


def test_energy_of_the_robot(made):
    """The L1 with friction: power of the motors is never less than what the kinetic and potential energy gain."""
    unit, path, _ = made("forward", 3)
    raw = Raw(unit, path)
    assert raw.begin() == OK
    for k in range(20):
        assert raw.step(k * 1e-3, 1e-3)[0] == OK
    x = raw.get(list(unit.table.states))[1]
    start = np.array([unit.table.variables[r].start for r in unit.table.states])
    assert np.max(np.abs(x - start)) < 1e-4  # the forces of the start hold it, to the digits of the description


def test_a_step_is_chosen_by_its_error_and_by_the_tolerance_where_that_is_out_of_reach(made, monkeypatch):
    chosen = made("filtered", 3)[0].table
    assert chosen.step < 1e-3 and chosen.error <= NEAR
    monkeypatch.setattr(causal_content, "AIM", 1e-15)
    for key in [k for k in function("filtered").kept if isinstance(k, tuple) and k[0] == "fmu step"]:
        monkeypatch.delitem(function("filtered").kept, key)  # the step of the aim before
    rough = unit_of("filtered", 3).table
    assert rough.step > chosen.step and NEAR < rough.error <= 1e-6


def test_a_large_error_inside_is_refused():
    with pytest.raises(ValueError, match="step"):
        unit_of("filtered", 3, step=0.02, tolerance=1e-9)


@pytest.mark.parametrize("version", [3, 2])
def test_the_time_enters_where_the_equations_have_it(made, version):
    """x' = u + r (cos(r t) - 1) x from 0.5 at a start time that is not zero, in both interfaces."""
    unit, path, _ = made("driven", version)
    begin, u, start = 1.5, 0.3, unit.table.of("state")[0].start
    assert start == 0.5  # as declared

    def rate(t, x):
        return u + 2.0 * (np.cos(2.0 * t) - 1.0) * x

    end = solve_ivp(rate, (begin, begin + 0.5), [start], method="DOP853", rtol=1e-12, atol=1e-12).y[0, -1]
    raw = Raw(unit, path)
    assert raw.begin({"u": u}, time=begin) == OK
    for k in range(125):
        assert raw.step(begin + k * 4e-3, 4e-3)[0] == OK
    assert raw.get(list(unit.table.states))[1][0] == pytest.approx(end, abs=NEAR)
    raw = Raw(unit, path, co=False)
    assert raw.begin({"u": u}, time=begin) == OK
    for t in (begin, begin + 0.7):
        assert raw.set_time(t) == OK
        assert raw.derivatives()[1][0] == pytest.approx(rate(t, start), abs=1e-14)
    assert 0 in unit.table.dependencies[unit.table.rates[0]]
