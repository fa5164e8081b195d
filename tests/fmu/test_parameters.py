"""Parameters of a model that stay parameters of its unit, against models that were compiled with the other numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import gtmodel as gt
from gtmodel.fmu.checking import other_values
from gtmodel.fmu.table import fmi_name
from gtmodel.results.status import Status
from gtmodel.robots.inverse_model import InverseModel
from tests.fmu.makers import KEPT, STOP, Pendulum, Spiral, function, l1
from tests.fmu.raw import DISCARD, ERROR, OK, Raw, unpacked
from tests.fmu.test_derivatives import python

NEAR = 1e-12  # of the largest number: symbols are added and multiplied in another order than numbers
ITERATED = 1e-10  # where Newton's method stops
RUN = 1e-8


def kept(unit):
    return [unit.table.variables[r] for r in unit.table.parameters]


def drawn(unit, n, seed=1):
    """Rows of parameters that are not those of the start."""
    return np.array([other_values(v, n, seed) for v in kept(unit)]).T


def compiled(name, names, values):
    """The same function of the model with these numbers, compiled anew."""
    given, at = {}, 0
    f = function(name)
    for n in names:
        shape = next(r.shape for r in f.flat.tree.parameters if r.name == n)
        size = int(np.prod(shape, dtype=int))
        given[n] = values[at : at + size].reshape(shape) if shape else float(values[at])
        at += size
    own = {n.removeprefix("robot."): v for n, v in given.items()}
    if name == "filtered":
        return InverseModel(robot=l1().with_(**own)).causal(known="reference", targets=["tau", "robot.q", "robot.T"])
    base = Spiral() if name == "spiral" else gt.robots.f1_gantry_tau() if name == "f1_ik" else l1()
    known, targets = [g[0] for g in f.groups], [s.name for s in f.outputs]
    return base.with_(**own).causal(known=known, targets=targets, prefer=prefer(name))


def prefer(name):
    return {"forward": "T", "spiral": ["x", "v"]}.get(name, ())


FEW = [("forward", 3), ("spiral", 2)]  # the others, which take longer to compile, are for `-m proof`
EACH = [(n, v) if (n, v) in FEW else pytest.param(n, v, marks=pytest.mark.proof) for n in sorted(KEPT) for v in (3, 2)]


@pytest.mark.parametrize("name, version", EACH)
def test_changed_parameters_give_what_a_model_with_these_numbers_gives(made, name, version):
    """The unit equals its own function to the last bit, that one the model compiled with the numbers to round-off."""
    unit, path, _ = made(f"{name}_p", version)
    raw, rng, own = Raw(unit, path), np.random.default_rng(3), unit.function
    start = {v.name: v.start for v in unit.table.of("input", "state")}
    rows = drawn(unit, 4)
    if name == "f1_ik":  # Newton's method of the unit begins where the lengths are those of the start
        rows = np.array([[v.start * (1 + 2e-4 * rng.normal()) for v in kept(unit)] for _ in range(3)])
    good = 0
    for values in rows:
        other = compiled(name, KEPT[name], values)
        at = start if name == "f1_ik" else {n: x + 1e-2 * max(0.1, abs(x)) * rng.normal() for n, x in start.items()}
        assert raw.do("Reset") == raw.set(list(unit.table.parameters), values) == OK
        assert raw.set([raw.names[n] for n in at], list(at.values())) == OK
        began = raw.begin()
        everything = {**at, **dict(zip([v.name for v in kept(unit)], values, strict=True))}
        arguments = [_argument(own, s, everything) for s in own.inputs]
        *exact, said = own(*arguments)
        *wanted, status = other(*[_argument(other, s, everything) for s in other.inputs])
        assert (began == OK) == (said is Status.OK) == (status is Status.OK)
        if began != OK:
            continue
        good += 1
        there = {s.name: np.ravel(w) for s, w in zip(other.outputs, wanted, strict=True)}
        for s, number in zip(own.outputs, map(np.ravel, exact), strict=True):
            here = [fmi_name(own.flat.symbol_name(*p)) for p in s.pairs]
            if not all(n in raw.names for n in here):
                continue
            got = raw.get([raw.names[n] for n in here])[1]
            assert own.kernels or got.tolist() == number.tolist()
            if s.name in there:
                near = ITERATED if own.kernels else NEAR
                assert np.max(np.abs(got - there[s.name])) <= near * max(1.0, float(np.max(np.abs(got))))
    assert good >= len(rows) / 2


def _argument(f, signal, at):
    values = [at[fmi_name(f.flat.symbol_name(*p))] for p in signal.pairs]
    return np.array(values).reshape(signal.shape) if signal.shape else values[0]


def test_how_they_stand_in_the_table(made):
    unit, *_ = made("spiral_p", 3)
    stiffness, bend = kept(unit)
    assert (stiffness.name, stiffness.unit, stiffness.start, stiffness.most) == ("stiffness", "1/s", 2.0, 8.0)
    assert stiffness.description == "of the drive" and 0.0 < stiffness.least < 1e-300  # positive
    assert (bend.least, bend.most) == (0.0, 0.9)
    fmpy = pytest.importorskip("fmpy")
    for version in (3, 2):
        described = fmpy.read_model_description(str(made("spiral_p", version)[2]))
        v = next(v for v in described.modelVariables if v.name == "bend")
        assert (v.causality, v.variability, float(v.start)) == ("parameter", "tunable", 0.25)
        assert (float(v.min), float(v.max)) == (0.0, 0.9)


@pytest.mark.parametrize("version", [3, 2])
def test_when_they_can_be_set(made, version):
    unit, path, _ = made("spiral_p", version)
    which = list(unit.table.parameters)
    raw = Raw(unit, path, co=False)
    assert raw.set(which, [3.0, 0.2]) == OK  # instantiated
    assert raw.begin({"stiffness": 3.5}, step=False) == OK  # initialization mode, then event mode
    assert raw.set(which, [4.0, 0.1]) == OK
    assert raw.update()[0] == raw.do("EnterContinuousTimeMode") == OK
    before = raw.get(unit.table.computed)[1]
    assert raw.set(which, [5.0, 0.3]) == ERROR
    assert raw.get(which)[1].tolist() == [4.0, 0.1] and raw.get(unit.table.computed)[1].tolist() == before.tolist()
    assert raw.do("EnterEventMode") == OK and raw.set(which, [5.0, 0.3]) == OK
    assert raw.get(unit.table.computed)[1].tolist() != before.tolist()  # they were out of date
    assert raw.do("Terminate") == OK and raw.set(which, [5.0, 0.3]) == ERROR
    stepping = Raw(unit, path)
    assert stepping.begin() == stepping.step(0.0, 4e-3)[0] == stepping.set(which, [4.0, 0.1]) == OK


@pytest.mark.parametrize("version", [3, 2])
def test_saved_restored_and_reset(made, version):
    """Parameters are part of the state; a reset brings the numbers of the model back."""
    unit, path, _ = made("forward_p", version)
    which, all_of = list(unit.table.parameters), [v.reference for v in unit.table.numbers]
    start, others = [v.start for v in kept(unit)], drawn(unit, 2)[1]
    raw, plain = Raw(unit, path), Raw(unit, path)
    assert raw.begin() == plain.begin() == OK
    assert raw.set(which, others) == OK and raw.step(0.0, 4e-3)[0] == OK
    state, data = raw.save(), raw.serialized(raw.save())
    assert raw.set(which, start) == OK and raw.step(4e-3, 4e-3)[0] == OK
    away = raw.get(all_of)[1]
    assert raw.restore(state) == OK and raw.get(which)[1].tolist() == list(others)
    assert raw.step(4e-3, 4e-3)[0] == OK
    with_others = raw.get(all_of)[1]
    assert with_others.tolist() != away.tolist()
    status, there = plain.deserialized(data)
    assert status == OK and plain.restore(there) == OK and plain.step(4e-3, 4e-3)[0] == OK
    assert plain.get(all_of)[1].tolist() == with_others.tolist()
    fresh = Raw(unit, path)
    assert raw.do("Reset") == OK and raw.get(which)[1].tolist() == start
    assert raw.begin() == fresh.begin() == raw.step(0.0, 4e-3)[0] == fresh.step(0.0, 4e-3)[0] == OK
    assert raw.get(all_of)[1].tolist() == fresh.get(all_of)[1].tolist()


@pytest.mark.parametrize("version", [3, 2])
def test_a_change_between_two_steps(made, version):
    """The L1 gets payload and friction while it moves: three pieces, each by DOP853 with its own numbers."""
    unit, path, _ = made("forward_p", version)
    raw = Raw(unit, path)
    forces = {v.name: v.start + 30.0 for v in unit.table.of("input")}
    assert raw.begin(forces) == OK
    x = raw.states()[1]
    names = [unit.table.variables[r].name for r in unit.table.states]
    for k, values in enumerate([[v.start for v in kept(unit)], *drawn(unit, 2, seed=4)]):
        own = dict(zip([v.name for v in kept(unit)], values, strict=True))
        assert raw.set(list(unit.table.parameters), values) == OK

        def rates(_, x, own=own):
            return python(unit.function, unit.table, {**forces, **own, **dict(zip(names, x, strict=True))})[0]

        x = solve_ivp(rates, (0, 0.06), x, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        for n in range(15):
            assert raw.step(0.06 * k + n * 4e-3, 4e-3)[0] == OK
        assert np.max(np.abs(raw.states()[1] - x)) <= RUN


@pytest.mark.parametrize("name, version", [e for e in EACH if "ik" not in str(e)])
def test_derivatives_at_other_parameters(made, name, version):
    """By inputs, states and the parameters themselves, against differences of order 4; the adjoint against both."""
    unit, path, _ = made(f"{name}_p", version)
    raw, rng = Raw(unit, path, co=False), np.random.default_rng(5)
    inputs, states, which = [v.reference for v in unit.table.of("input")], list(unit.table.states), kept(unit)
    knowns, unknowns = [*inputs, *states, *unit.table.parameters], unit.table.computed
    start = np.array([unit.table.variables[r].start for r in knowns])
    share = np.array([1e-5 if name == "filtered" and v.role != "tunable" else 1e-3 for v in
                      (unit.table.variables[r] for r in knowns)])  # fmt: skip
    sizes = share * np.maximum(0.1, np.abs(start))
    assert raw.begin() == OK

    def at(x):
        assert raw.do("EnterEventMode") == raw.set(unit.table.parameters, x[-len(which) :]) == OK
        assert raw.do("EnterContinuousTimeMode") == raw.set(inputs, x[: len(inputs)]) == OK
        assert raw.set_states(x[len(inputs) : -len(which)]) == OK
        status, values = raw.get(unknowns)
        assert status == OK
        return values

    units = np.array([unit.table.variables[r].unit for r in unknowns])
    for values in drawn(unit, 4):
        point = start + sizes * rng.normal(size=len(start))
        point[-len(which) :] = np.clip(values, 0.7 * np.abs(start[-len(which) :]), 1.3 * np.abs(start[-len(which) :]))
        seed = sizes * rng.normal(size=len(start))
        h = 0.5
        a, b, c, d = (at(point + k * h * seed) for k in (-2, -1, 1, 2))
        difference = (a - 8 * b + 8 * c - d) / (12 * h)
        at(point)
        status, slope = raw.directional(unknowns, knowns, seed)
        assert status == OK
        for u in set(units):
            own = units == u
            assert np.max(np.abs(slope - difference)[own]) <= 1e-6 * np.max(np.abs(difference)[own])
        parts = [raw.directional(unknowns, [k], [s])[1] for k, s in zip(knowns, seed, strict=True)]
        assert np.sum(parts, axis=0) == pytest.approx(slope, rel=1e-9, abs=1e-9 * np.max(np.abs(slope)))
        if version == 3:
            back = rng.normal(size=len(unknowns))
            status, against = raw.directional(unknowns, knowns, back, adjoint=True)
            assert status == OK
            assert against @ seed == pytest.approx(back @ slope, rel=1e-9, abs=1e-9 * np.abs(back) @ np.abs(slope))


@pytest.mark.parametrize("version", [3, 2])
def test_a_thousand_hostile_numbers(made, version):
    """What is refused leaves nothing behind; what is taken is what the function gives there."""
    unit, path, _ = made("spiral_p", version)
    raw, rng, f = Raw(unit, path), np.random.default_rng(6), unit.function
    which, all_of = list(unit.table.parameters), [v.reference for v in unit.table.numbers]
    limits = np.array([(v.least, v.most) for v in kept(unit)])
    assert raw.begin() == OK
    there = [raw.names["u"], *unit.table.states]
    wild = [np.nan, np.inf, -np.inf, -1e-300, 1e300, -1.0, 8.0 + 1e-12, 0.0, -0.0, 5e-324, 1.7e308, 9.0, 0.90001]
    refused = taken = 0
    for _ in range(1000):
        values = np.array([rng.choice(wild) if rng.random() < 0.4 else rng.uniform(0.0, 1.2) for _ in which])
        before = raw.get(all_of)[1] if raw.get(all_of)[0] == OK else None
        old = raw.get(which)[1]
        status = raw.set(which, values)
        if np.all((values >= limits[:, 0]) & (values <= limits[:, 1])):  # NaN is not
            assert status == OK and raw.get(which)[1].tolist() == values.tolist()
            taken += 1
            status, got = raw.get(unit.table.computed)
            u, x, v = raw.get(there)[1]
            said = f(x, v, u, *values)[-1]
            if status == OK and said is Status.OK:
                y = raw.get([raw.names["y"]])[1][0]
                assert y + values[1] * np.sin(3 * y) == pytest.approx(x, abs=1e-9)  # one of several
                assert got[unit.table.computed.index(raw.names["der(v)"])] == pytest.approx(
                    u - 9.0 * y - values[0] * v, abs=1e-9
                )
            else:
                assert status in (OK, DISCARD)
        else:
            assert status == ERROR and raw.said[-1][2] != "" and raw.get(which)[1].tolist() == old.tolist()
            assert before is None or raw.get(all_of)[1].tolist() == before.tolist()
            refused += 1
    assert refused > 200 and taken > 200
    broken = Raw(unit, path, co=False)
    for value in (np.nan, -1.0, 9.0):
        assert broken.set(which[:1], [value]) == ERROR
    assert broken.get(which)[1].tolist() == [v.start for v in kept(unit)]


SHARP = 1e-3  # of the friction's velocity scale, in m/s, of which 0.1 is the start


@pytest.fixture(scope="module")
def friction(tmp_path_factory):
    unit = gt.fmu.export(function("forward"), None, name="u_friction", stop=STOP, parameters="velocity_scale")
    rough = gt.fmu.export(
        function("forward"), None, name="u_friction", version=2, stop=STOP, parameters="velocity_scale"
    )
    place = tmp_path_factory.mktemp("friction")
    return {u.version: (u, unpacked(u, place / str(u.version))) for u in (unit, rough)}


def moved_by(friction, version, scale, h, until=0.1):
    """Status, time reached and states of a run with forces that make it move."""
    unit, path = friction[version]
    raw = Raw(unit, path)
    assert raw.begin({v.name: v.start + 60.0 for v in unit.table.of("input")}) == OK
    assert raw.set(list(unit.table.parameters), [scale]) == OK
    for k in range(round(until / h)):
        status, last = raw.step(k * h, h)
        if status != OK:
            return status, last, None, raw.said[-1][2]
    return OK, until, raw.states()[1], ""


@pytest.mark.parametrize("version", [3, 2])
def test_a_step_inside_that_is_too_long_for_other_parameters_says_so(friction, version):
    """The step was chosen for smooth friction; for sharp one DoStep ends with Discard, and short steps go well."""
    assert moved_by(friction, version, 0.1, 4e-3)[0] == OK
    status, last, _, said = moved_by(friction, version, SHARP, 4e-3)
    assert status == DISCARD and last < 0.1 and "too long" in said
    assert moved_by(friction, version, SHARP, 4e-5)[0] == OK


@pytest.mark.parametrize("force", [300.0, 1000.0, 4000.0])
def test_a_part_in_which_friction_turns_at_once_is_refused(friction, force):
    """From rest the rates behind the first one agree, and still the part is wrong: OK is near the truth, or Discard."""
    unit, path = friction[3]
    names = {v.name: v.start + force for v in unit.table.of("input")}
    ends = []
    for h in (5e-4, 1e-5):
        raw = Raw(unit, path)
        assert raw.begin(names) == OK
        assert raw.set(list(unit.table.parameters), [SHARP]) == OK
        for k in range(round(0.01 / h)):
            if raw.step(k * h, h)[0] != OK:
                break
        else:
            ends.append(raw.states()[1])
        raw.free()
    assert len(ends) in (1, 2)  # the short steps go well
    assert np.max(np.abs(ends[0] - ends[-1])) <= 20 * unit.table.part_error, force  # of 20 parts


def test_what_such_a_unit_says_is_right(friction):
    """Of ever sharper friction each run either ends with Discard or is near the truth by DOP853."""
    unit, _ = friction[3]
    forces = {v.name: v.start + 60.0 for v in unit.table.of("input")}
    names = [unit.table.variables[r].name for r in unit.table.states]
    start = [unit.table.variables[r].start for r in unit.table.states]
    outcomes = []
    for scale in (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-5):
        status, _, x, _ = moved_by(friction, 3, scale, 4e-3)
        outcomes.append(status)
        if status != OK:
            continue

        def rates(_, x, scale=scale):
            own = {"velocity_scale": scale, **forces, **dict(zip(names, x, strict=True))}
            return python(unit.function, unit.table, own)[0]

        end = solve_ivp(rates, (0, 0.1), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        assert np.max(np.abs(x - end)) <= 1e-6
    assert outcomes[0] == OK and outcomes[-1] == DISCARD


@pytest.mark.parametrize("version", [3, pytest.param(2, marks=pytest.mark.proof)])
def test_newton_beside_states(made, version):
    """Its answers and runs against a bisection inside of DOP853: both interfaces, saved on the way."""

    def rates(_, x, u=0.7):
        y = brentq(lambda y: y + 0.25 * np.sin(3 * y) - x[0], -10, 10, xtol=1e-15)
        return [x[1], u - 9.0 * y - 2.0 * x[1]]

    end = solve_ivp(rates, (0, 0.4), [0.5, 0.0], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    unit, path, fmu = made("spiral", version)
    raw = Raw(unit, path)
    assert raw.begin({"u": 0.7}) == OK
    for k in range(50):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    state, half = raw.save(), raw.states()[1]
    for k in range(50, 100):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    first = raw.get([v.reference for v in unit.table.numbers])[1]
    assert np.max(np.abs(raw.states()[1] - end)) <= RUN
    assert raw.restore(state) == OK and raw.states()[1].tolist() == half.tolist()
    for k in range(50, 100):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    assert raw.get([v.reference for v in unit.table.numbers])[1].tolist() == first.tolist()
    solved, trial = Raw(unit, path, co=False), Raw(unit, path, co=False)
    assert solved.begin({"u": 0.7}) == trial.begin({"u": 0.7}) == OK
    for x in np.linspace(0.5, 1.5, 50):  # trials leave no trace
        assert trial.set_states([x + 0.02, 1.0]) == trial.derivatives()[0] == OK
        for one in (solved, trial):
            assert one.set_states([x, 0.2]) == OK and one.derivatives()[0] == OK and one.completed() == OK
        assert solved.derivatives()[1] == pytest.approx(rates(0, [x, 0.2]), abs=1e-10)
        assert trial.derivatives()[1].tolist() == solved.derivatives()[1].tolist()
    fmpy = pytest.importorskip("fmpy")
    run = fmpy.simulate_fmu(str(fmu), stop_time=0.4, output_interval=0.02, fmi_type="ModelExchange", solver="CVode",
                            relative_tolerance=1e-10, start_values={"u": 0.7}, output=["x", "v"])  # fmt: skip
    assert np.max(np.abs([run["x"][-1] - end[0], run["v"][-1] - end[1]])) <= RUN


class Powered(gt.Model):
    n = gt.parameter(0.0)
    high = gt.parameter(3.0)
    low = gt.parameter(1.0, max=high)
    both = gt.parameter(2.0, positive=True)
    order = gt.parameter([1.0, 2.0], increasing=True)
    x = gt.input()
    y = gt.variable(start=1.0)
    z = gt.variable()

    def equations(self):
        yield self.n * gt.exp(self.y) + self.y**2 + self.y == self.x
        yield self.z == self.low * self.y + self.both + self.order[1]


REFUSED = {
    "an unknown one": (["y", "z"], ["m"]),
    "one that does not enter": (["y", "z"], ["high"]),
    "one that has another for a limit": (["y", "z"], ["low"]),
    "one that decides how it is solved": (["y", "z"], ["n"]),
    "numbers that belong together": (["y", "z"], ["order"]),
    "twice the same": (["y", "z"], ["both", "both"]),
    "its element too": (None, ["A", "A[0,1]"]),
    "one that follows from another": (None, ["arm[0].rod.L"]),
    "a direction": (None, ["v"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_stay_a_parameter_is_refused(case):
    targets, names = REFUSED[case]
    f = Powered().causal(known="x", targets=targets) if targets else l1().causal(known="q", targets="T")
    with pytest.raises(gt.results.ArgumentError) as refusal:
        gt.fmu.export(f, None, name="u", parameters=names)
    assert refusal.value.argument == "parameters"


def test_a_step_function_has_none():
    with pytest.raises(gt.results.ArgumentError, match="parameters"):
        gt.fmu.export(function("block"), None, name="u", parameters=["kp"])


def test_one_element_alone():
    unit = gt.fmu.export(Pendulum(), None, known="torque", targets="der(angle,2)", prefer="angle", name="u",
                         parameters="weight", stop=STOP)  # fmt: skip
    assert [v.name for v in kept(unit)] == ["weight"]
    one = gt.fmu.export(function("inverse"), None, name="u", parameters=["coulomb[1]"])
    assert [(v.name, v.start) for v in kept(one)] == [("coulomb[2]", 145.13)]


def test_a_unit_without_has_nothing_of_it(made):
    for version in (3, 2):
        for name in ("forward", "d1_fk", "tunable"):
            assert not any("GT_FMU_PARAMETERS" in text for text in made(name, version)[0].sources.values())


@pytest.mark.parametrize("version", [3, 2])
def test_fmpy_sets_them(made, version):
    fmpy = pytest.importorskip("fmpy")
    unit, library, path = made("forward_p", version)
    values = dict(zip([v.name for v in kept(unit)], drawn(unit, 2)[1], strict=True))
    names = [unit.table.variables[r].name for r in unit.table.states]
    run = fmpy.simulate_fmu(str(path), stop_time=0.04, output_interval=4e-3, fmi_type="CoSimulation",
                            start_values=values, output=names)  # fmt: skip
    raw = Raw(unit, library)
    assert raw.begin(values) == OK
    for k in range(10):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    assert raw.states()[1] == pytest.approx([run[n][-1] for n in names], rel=0, abs=1e-13)
    assert np.max(np.abs(raw.states()[1] - [unit.table.variables[r].start for r in unit.table.states])) > 1e-6


def test_libcosimpy_sets_them(made):
    cosim = pytest.importorskip("libcosimpy.CosimExecution", reason="libcosimpy is not installed")
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    unit, library, path = made("forward_p", 2)
    execution = cosim.CosimExecution.from_step_size(step_size=int(4e6))
    index = execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name="unit"))
    observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
    execution.add_observer(observer)
    execution.add_manipulator(manipulator)
    values = drawn(unit, 2)[1]
    for r, value in zip(unit.table.parameters, values, strict=True):
        manipulator.slave_real_values(index, [r], [value])
    assert execution.simulate_until(int(40e6))
    raw = Raw(unit, library)
    assert raw.begin(dict(zip([v.name for v in kept(unit)], values, strict=True))) == OK
    for k in range(10):
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
    outputs = [v.reference for v in unit.table.of("output")]
    assert np.array(observer.last_real_values(index, outputs)) == pytest.approx(raw.get(outputs)[1], rel=0, abs=1e-9)
