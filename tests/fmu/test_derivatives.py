"""Directional and adjoint derivatives against differences, against each other, and through CasADi."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fmu.raw import DISCARD, ERROR, OK, Raw

FEW, MANY = 24, 1000
NEAR = 1e-7  # of the largest one of that unit
STEPS = (
    4.0,
    1.0,
    0.25,
    0.06,
)  # of a seed, which is a thousandth of the sizes; the best counts: long ones err, short ones lose digits
SMOOTH = ["fk", "ik", "inverse", "forward", "filtered", "pendulum", "d1_fk", "f1_fk"]


def sizes_of(unit, knowns):
    # three lags of 100 rad/s make accelerations a million times as large as the places are apart
    share = 1e-5 if "filtered" in unit.table.name else 1e-3
    return np.array([share * max(0.1, abs(unit.table.variables[r].start)) for r in knowns])


def far(at, point, seed, h, slope, units):
    """How far a slope is from the difference of order 4, over the largest one of its unit; None without an answer."""
    ends = [at(point + k * h * seed) for k in (-2, -1, 1, 2)]
    if any(e is None for e in ends):
        return None
    a, b, c, d = ends
    difference = (a - 8 * b + 8 * c - d) / (12 * h)
    own = [np.array(units) == name for name in sorted(set(units))]
    return max(np.max(np.abs(slope - difference)[k]) / np.max(np.abs(difference)[k]) for k in own)


@pytest.mark.parametrize("n", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", SMOOTH)
def test_derivatives_are_differences(made, name, version, n):
    unit, path, _ = made(name, version)
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    t, rng = unit.table, np.random.default_rng(2)
    inputs, states = [v.reference for v in t.of("input")], list(t.states)
    knowns, unknowns = inputs + states, [*t.computed]
    start = np.array([t.variables[r].start for r in knowns])
    sizes = sizes_of(unit, knowns)

    def at(x):
        assert raw.set(inputs, x[: len(inputs)]) == OK
        assert not states or raw.set_states(x[len(inputs) :]) == OK
        status, values = raw.get(unknowns)
        return values if status == OK else None

    units = [t.variables[r].unit for r in unknowns]
    checked, worst = 0, 0.0
    for _ in range(n):
        point = start + sizes * rng.normal(size=len(start))
        seed = sizes * rng.normal(size=len(start))
        here = at(point)
        if here is None:
            continue
        status, slope = raw.directional(unknowns, knowns, seed)
        assert status == OK
        errors = [far(at, point, seed, h, slope, units) for h in STEPS]
        if None in errors:
            continue
        worst = max(worst, min(errors))
        checked += 1
        if version == 3:  # <b, J s> = <J' b, s>
            at(point)
            back = rng.normal(size=len(unknowns))
            status, against = raw.directional(unknowns, knowns, back, adjoint=True)
            assert status == OK
            assert against @ seed == pytest.approx(back @ slope, rel=1e-9, abs=1e-9 * np.abs(back) @ np.abs(slope))
    assert checked > n / 2
    assert worst <= NEAR


def test_the_rate_of_a_place_is_the_velocity_itself(made):
    unit, path, _ = made("forward", 3)
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    (v, *_), (x, *_) = unit.table.rates, unit.table.states
    assert raw.directional([v], [v], [2.0])[1].tolist() == [2.0]
    assert raw.directional([v], [x], [2.0])[1].tolist() == [0.0]


def test_no_derivative_where_there_is_no_answer(made):
    unit, path, _ = made("ik", 3)
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    inputs = [v.reference for v in unit.table.of("input")]
    assert raw.set(inputs, [9.0, 9.0, 9.0]) == OK
    status, values = raw.directional(unit.table.computed, inputs, [1.0, 0.0, 0.0])
    assert status == DISCARD and set(values.tolist()) == {-77.0}
    assert raw.directional(inputs, inputs, [1.0, 0.0, 0.0])[0] == ERROR  # an input is no unknown
    assert raw.directional(unit.table.computed, unit.table.computed[:1], [1.0])[0] == ERROR


@pytest.mark.parametrize("name", SMOOTH)
def test_dependencies_are_those_of_the_derivatives(made, name):
    """What is not declared has no derivative anywhere; what is declared has one, but where terms cancel in sum."""
    unit, path, _ = made(name, 3)
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    t, rng = unit.table, np.random.default_rng(0)
    inputs, states = [v.reference for v in t.of("input")], list(t.states)
    knowns = inputs + states
    start = np.array([t.variables[r].start for r in knowns])
    seen = np.zeros((len(t.computed), len(knowns)), bool)
    for _ in range(5):
        point = start + sizes_of(unit, knowns) * rng.normal(size=len(start))
        assert raw.set(inputs, point[: len(inputs)]) == OK
        assert not states or raw.set_states(point[len(inputs) :]) == OK
        for k, known in enumerate(knowns):
            status, column = raw.directional(t.computed, [known], [1.0])
            if status == OK:
                seen[:, k] |= column != 0.0
    declared = np.array([[r in t.dependencies[u] for r in knowns] for u in t.computed])
    assert not np.any(seen & ~declared)
    assert seen.sum() >= 0.8 * declared.sum()


@pytest.mark.parametrize("name", ["forward", "filtered", "pendulum"])
def test_casadi_imports_it_with_its_derivatives(made, name):
    """`ode` and `jac:ode:x` by another reader and caller, against the causal function."""
    ca = pytest.importorskip("casadi")
    unit, path, _ = made(name, 3)
    dae = ca.DaeBuilder("unit", str(path.parents[2]))
    t, rng = unit.table, np.random.default_rng(4)
    rates = dae.create("f", ["x", "u"], ["ode"])
    jacobian = dae.create("j", ["x", "u"], ["jac_ode_x"])
    names = {v.name: v for v in t.variables}
    share = 1e-5 if name == "filtered" else 1e-2
    x0, u0 = (np.array([names[n].start for n in group]) for group in (dae.x(), dae.u()))
    raw = Raw(unit, path, co=False)
    assert raw.begin() == OK
    f = unit.function
    order = [names[n].reference for n in dae.x()]
    assert order == list(t.states)
    for _ in range(20):
        x = x0 + share * np.maximum(0.1, np.abs(x0)) * rng.normal(size=len(x0))
        u = u0 + share * np.maximum(0.1, np.abs(u0)) * rng.normal(size=len(u0))
        values = dict(zip(dae.x(), x, strict=True)) | dict(zip(dae.u(), u, strict=True))
        wanted, exact = python(f, t, values)
        got = np.array(rates(x, u)).ravel()
        assert np.max(np.abs(got - wanted)) <= 1e-12 * max(1.0, np.max(np.abs(wanted)))
        got = np.array(jacobian(x, u))
        assert np.max(np.abs(got - exact)) <= 1e-12 * max(1.0, np.max(np.abs(exact)))


def python(f, t, values):
    """Rates of the states and their derivatives by the states, by the causal function."""
    from gtmodel.fmu.table import fmi_name

    name_of = lambda p: fmi_name(f.flat.symbol_name(*p))  # noqa: E731
    arguments = [np.array([values[name_of(p)] for p in s.pairs]) for s in f.inputs]
    shaped = [a.reshape(s.shape) if s.shape else float(a[0]) for a, s in zip(arguments, f.inputs, strict=True)]
    *results, _ = f(*shaped)
    full, _ = f.jacobian(*shaped)
    inputs = [name_of(p) for s in f.inputs for p in s.pairs]
    flat = dict(
        zip(
            [name_of(p) for s in f.outputs for p in s.pairs],
            np.concatenate([np.ravel(r) for r in results]),
            strict=True,
        )
    )
    rows = {n: k for k, n in enumerate(flat)}
    states = [t.variables[r].name for r in t.states]
    rate, jacobian = [], []
    for r in t.rates:
        n = t.variables[r].name
        if n in rows:
            rate.append(flat[n])
            jacobian.append([full[rows[n], inputs.index(s)] for s in states])
        else:
            rate.append(values[n])
            jacobian.append([float(s == n) for s in states])
    return np.array(rate), np.array(jacobian)
