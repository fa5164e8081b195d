"""Check a unit with the installed tools: Python, FMPy's schema, validator and simulation, CasADi's import."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..cgen.interface import interfaces
from ..cgen.points import draw, evaluate
from ..cgen.real import DOUBLE
from ..cgen.steps.function import StepFunction, dtype_of, record
from ..compiler.causal import CausalFunction
from ..results.check import Check, at_least, at_most
from ..results.disk import scratch
from ..results.status import Status
from .caller import UnitCaller
from .content import unpack
from .export import Fmu
from .table import FmuVariable, fmi_name, texts_of

POINTS = 1000
LONGEST_RUN = 50  # communication steps that FMPy simulates
SPREAD, NEAREST = 0.5, 1e-4  # relative spread of parameters at random points, and the smallest share of it
NUDGE = 0.01  # relative change of parameters in a run and in CasADi
IMPORT_NEAR = 1e-12  # tolerance of CasADi's import, relative to max(1, largest number)
WITHOUT_FMPY = (
    "FMPy is not installed: schema, validator and simulation were not checked; install it with "
    "pip install 'gtmodel[fmi]'"
)
WITHOUT_IMPORT = "CasADi cannot import integers or sampled units: {} was not imported"


@dataclass(frozen=True)
class UnitReport:
    """Checks by name, and notes on checks that could not run."""

    checks: Mapping[str, Check]
    notes: Sequence[str]


def check(unit: Fmu, *, points: int = POINTS, seed: int = 0) -> UnitReport:
    """Compare a unit with its original function, and read and run it with the installed tools.

    Args:
        unit: from `export`. points, seed: random inputs, or steps of a step function.

    Values and statuses must agree with Python bit for bit; the validator must report nothing; runs with both interfaces
    must reach their end; CasADi's import must agree with the function to 1e-12.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> unit = gt.fmu.export(robot, None, known="q", targets="T", name="l1_fk")
    >>> report = gt.fmu.check(unit, points=20)
    >>> all(c.passed for c in report.checks.values())
    True
    """
    key = f"{unit.table.name}_fmi{unit.version}"
    notes: list[str] = []
    with scratch("gtmodel-fmu-") as place:
        (file := place / "unit.fmu").write_bytes(unit.data)
        unpack(file, folder := place / "unit")
        caller = UnitCaller(str(next((folder / "binaries").rglob("*.so"))), unit.version, unit.table.name, unit.token)
        try:
            if isinstance(unit.function, StepFunction):
                checks = _steps(unit, unit.function, caller, points, seed)
            else:
                checks = _values(unit, unit.function, caller, points, seed)
        finally:
            caller.close()
        if find_spec("fmpy") is None:
            notes.append(WITHOUT_FMPY)
        else:
            checks |= _by_fmpy(unit, file)
        if isinstance(unit.function, CausalFunction) and not unit.table.integers:
            checks |= _by_casadi(unit, unit.function, folder)
        else:
            notes.append(WITHOUT_IMPORT.format(key))
    return UnitReport({f"{key}_{name}": c for name, c in checks.items()}, notes)


def _names(unit: Fmu) -> dict[str, int]:
    return {v.name: v.reference for v in unit.table.variables}


def _name(f: CausalFunction, p: tuple[int, int]) -> str:
    return fmi_name(f.flat.symbol_name(*p), texts_of(f.flat))


def _values(unit: Fmu, f: CausalFunction, caller: UnitCaller, points: int, seed: int) -> dict[str, Check]:
    """Compare values bit for bit, and statuses, at random inputs."""
    (face,) = interfaces({"model": f}, unit.table.name)
    rows = draw(face, points, seed)
    settings_of = [p for s in f.inputs for p in s.pairs]
    for v in unit.table.numbers:
        if v.reference in unit.table.parameters:
            column = [_name(f, p) for p in settings_of].index(v.name)
            rows[:, column] = other_values(v, points, seed)
    expected, expected_statuses = evaluate(face, rows)
    names = _names(unit)
    settings = [names[_name(f, p)] for p in settings_of]
    columns = list(range(len(settings)))
    guesses = [v.reference for v in unit.table.variables if v.role == "fixed"]
    columns += [face.input_size + k for k in range(len(guesses))]
    pairs = [p for s in f.outputs for p in s.pairs]
    outputs = [(n, names.get(_name(f, p))) for n, p in enumerate(pairs)]
    known = [(n, r) for n, r in outputs if r is not None and r not in settings]
    different = statuses = good = 0
    for row, value, status in zip(rows, expected, expected_statuses, strict=True):
        time = float(row[face.input_size - 1]) if f.plan.uses_time else 0.0
        answer = caller.begin([*settings, *guesses], row[columns].tolist(), time) if caller.reset() == 0 else 3
        got = b""
        if answer == 0:
            answer, numbers = caller.get([r for _, r in known])
            got = numbers.tobytes()
        if unit.table.hold and answer == 0:  # an integer output reports held outputs
            answer = int(caller.get_integers([unit.table.integers[0].reference])[1][0])
        ok = status == Status.OK
        statuses += (answer == 0) != ok
        good += answer == 0 and ok
        different += ok and answer == 0 and got != value[[n for n, _ in known]].tobytes()
    return {
        "values_different": at_most(int(different), 0, f"of {points} points, bit for bit"),
        "statuses_different": at_most(int(statuses), 0, f"of {points} points"),
        "points_ok": at_least(int(good), 1, f"of {points} random points"),
    }


def other_values(v: FmuVariable, n: int, seed: int) -> np.ndarray:
    """Draw values (n,) of a parameter around its start, within its limits. All parameters of a row share one spread, as
    Newton's method reaches other lengths of a robot only if these are near."""
    start = float(v.start or 0.0)
    spread = SPREAD * NEAREST ** np.random.default_rng(seed).random(n)
    values = start + spread * (abs(start) or 1.0) * np.random.default_rng([seed, v.reference]).uniform(-1.0, 1.0, n)
    return np.clip(values, v.least, v.most)


def _steps(unit: Fmu, f: StepFunction, caller: UnitCaller, points: int, seed: int) -> dict[str, Check]:
    """Compare outputs bit for bit, and statuses, after every step of a run."""
    twin = f.twin(DOUBLE)
    state, out = record(f.state, DOUBLE), np.zeros((), dtype_of(f.outputs, DOUBLE))
    started = twin.init(state, record(f.start, DOUBLE, f.defaults)) == Status.OK
    different = int(started != (caller.reset() == 0 and caller.begin([], []) == 0))
    statuses = 0

    def places(members: Sequence[Any], integer: bool) -> list[tuple[str, int]]:
        return [(m.identifier, m.count) for m in members if m.integer is integer]

    integers = [v.reference for v in unit.table.variables if v.integer and v.role == "input"]
    numbers = [v.reference for v in unit.table.of("input") if not v.integer]
    results = [v.reference for v in unit.table.of("output") if not v.integer]
    time = 0.0
    for example in f.examples(points, seed, DOUBLE).reshape(-1, 1):
        row = example.reshape(())
        values = np.concatenate([np.zeros(0), *[np.ravel(row[m]) for m, _ in places(f.inputs, False)]])
        flags = np.concatenate([np.zeros(0), *[np.ravel(row[m]) for m, _ in places(f.inputs, True)]]).astype(int)
        if not np.all(np.isfinite(values)):  # a unit refuses these
            continue
        expected = twin.step(state, row, out)
        worst = max(caller.set(numbers, values.tolist()), caller.set_integers(integers, flags.tolist()))
        worst = max(worst, caller.step(time, f.period)[0])
        statuses += (worst == 0) != (expected == Status.OK)
        if worst == 0:
            time += f.period
        outputs = np.concatenate([np.zeros(0), *[np.ravel(out[m]) for m, _ in places(f.outputs, False)]])
        if expected == Status.OK:
            different += caller.get(results)[1].tobytes() != outputs.tobytes()
    return {
        "steps_different": at_most(int(different), 0, f"of {points} steps, bit for bit"),
        "statuses_different": at_most(int(statuses), 0, f"of {points} steps"),
    }


def _by_fmpy(unit: Fmu, path: Path) -> dict[str, Check]:
    """Validate the archive, and run each interface from the start."""
    fmpy: Any = import_module("fmpy")
    validation: Any = import_module("fmpy.validation")
    problems = list(validation.validate_fmu(str(path)))
    fixed = unit.table.period or unit.table.step
    stop = min(unit.table.stop, LONGEST_RUN * fixed)
    failed: list[str] = []
    for kind in ("ModelExchange", "CoSimulation"):
        for values in _settings(unit):
            try:
                with contextlib.redirect_stdout(io.StringIO()):
                    run = fmpy.simulate_fmu(
                        str(path), fmi_type=kind, stop_time=stop, output_interval=fixed, start_values=values
                    )
                if (last := float(run["time"][-1])) < stop - 0.5 * fixed:
                    failed.append(f"{kind}{' at other parameters' if values else ''}: it ended at {last:g} s")
            except Exception as error:
                failed.append(f"{kind}{' at other parameters' if values else ''}: {error}")
    return {
        "validator_findings": at_most(len(problems), 0, "; ".join(problems) or "schema and validator of FMPy"),
        "runs_failed": at_most(len(failed), 0, "; ".join(failed) or "model exchange and co-simulation by FMPy"),
    }


def _settings(unit: Fmu) -> list[dict[str, float]]:
    """Return sets of parameter values to test: none, and, if the FMU has parameters, changed ones."""
    parameters = [unit.table.variables[r] for r in unit.table.parameters]
    others = {v.name: float(np.clip(float(v.start or 0.0) * (1.0 + NUDGE), v.least, v.most)) for v in parameters}
    return [{}, others] if others else [{}]


def _by_casadi(unit: Fmu, f: CausalFunction, folder: Path) -> dict[str, Check]:
    """Compare rates and outputs of CasADi's importer at the start, also with other parameters."""
    difference = 0.0
    for values in _settings(unit):
        try:
            difference = max(difference, _imported(unit, f, folder, values))
        except RuntimeError as error:
            return {"import_failed": at_most(1, 0, str(error).splitlines()[0])}
    about = "of numbers from CasADi's import, relative to the largest or one"
    return {"import_difference": at_most(difference, IMPORT_NEAR, about)}


def _imported(unit: Fmu, f: CausalFunction, folder: Path, values: Mapping[str, float]) -> float:
    """Return the relative difference between CasADi's numbers and the function's, with these parameter values."""
    variables = {v.name: v for v in unit.table.variables}
    builder: Any = ca.DaeBuilder(unit.table.name, str(folder))
    if values:  # set here, not as inputs: CasADi would set those in a mode in which the unit refuses parameters
        builder.set(list(values), list(values.values()))
    imported = builder.create("imported", ["x", "u"], ["ode", "y"])
    starts = [[float(variables[n].start or 0.0) for n in group] for group in (builder.x(), builder.u())]
    got = np.concatenate([np.array(part).ravel() for part in imported(*starts)])

    def value_of(p: tuple[int, int]) -> float:
        name = _name(f, p)
        return float(values.get(name, variables[name].start or 0.0))

    arguments = [np.array([value_of(p) for p in s.pairs]).reshape(s.shape) for s in f.inputs]
    *results, _ = f(*arguments, *([0.0] if f.plan.uses_time else []))
    numbers = {
        _name(f, p): float(x)
        for s, r in zip(f.outputs, results, strict=True)
        for p, x in zip(s.pairs, np.ravel(r), strict=True)
    }
    table = unit.table
    rates = [numbers.get(table.variables[r].name, float(table.variables[r].start or 0.0)) for r in table.rates]
    order = [list(table.states).index(variables[n].reference) for n in builder.x()]
    flat = [float(x) for r in results for x in np.ravel(r)]  # the targets come first, in the order of outputs
    outputs = {v.name: flat[k] for k, v in enumerate(table.of("output"))}
    expected = [rates[k] for k in order] + [outputs[n] for n in builder.y()]
    scale = max(1.0, float(np.max(np.abs(expected), initial=0.0)))
    return float(np.max(np.abs(got - np.array(expected)), initial=0.0)) / scale
