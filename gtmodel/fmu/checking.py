"""A unit checked by what is installed: Python, FMPy's schema, validator and simulation, CasADi's import."""

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
SPREAD, NEAREST = 0.5, 1e-4  # of parameters at random points, over their start values, and which part of it at least
NUDGE = 0.01  # the same in a run and in CasADi
IMPORT_NEAR = 1e-12  # of CasADi's import, over the largest number or one
WITHOUT_FMPY = (
    "there is no FMPy on this machine: schema, validator and simulation were left out; install it by "
    "pip install 'gtmodel[fmi]'"
)
WITHOUT_IMPORT = "CasADi imports no integers and no samples: {} was not imported"


@dataclass(frozen=True)
class UnitReport:
    """Checks by name, and what could not be checked, in sentences."""

    checks: Mapping[str, Check]
    notes: Sequence[str]


def check(unit: Fmu, *, points: int = POINTS, seed: int = 0) -> UnitReport:
    """Compare a unit with the function that it was made from, and have it read and run by what is installed.

    Args:
        unit: as `export` made it. points, seed: random inputs, or steps of a step function.

    Values must be those of Python to the last bit, statuses too; the validator must find nothing; runs of both
    interfaces must end; what CasADi computes with it must be that of the function to 1e-12.

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
    """At random inputs: values bit for bit, and whether there is an answer."""
    (face,) = interfaces({"model": f}, unit.table.name)
    rows = draw(face, points, seed)
    settings_of = [p for s in f.inputs for p in s.pairs]
    for v in unit.table.numbers:
        if v.reference in unit.table.parameters:
            column = [_name(f, p) for p in settings_of].index(v.name)
            rows[:, column] = other_values(v, points, seed)
    expected, wanted = evaluate(face, rows)
    names = _names(unit)
    settings = [names[_name(f, p)] for p in settings_of]
    columns = list(range(len(settings)))
    guesses = [v.reference for v in unit.table.variables if v.role == "fixed"]
    columns += [face.input_size + k for k in range(len(guesses))]
    pairs = [p for s in f.outputs for p in s.pairs]
    outputs = [(n, names.get(_name(f, p))) for n, p in enumerate(pairs)]
    known = [(n, r) for n, r in outputs if r is not None and r not in settings]
    different = statuses = good = 0
    for row, value, status in zip(rows, expected, wanted, strict=True):
        time = float(row[face.input_size - 1]) if f.plan.uses_time else 0.0
        answer = caller.begin([*settings, *guesses], row[columns].tolist(), time) if caller.reset() == 0 else 3
        got = b""
        if answer == 0:
            answer, numbers = caller.get([r for _, r in known])
            got = numbers.tobytes()
        if unit.table.hold and answer == 0:  # outputs are held, and an integer says so
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
    """Values (n,) of a parameter about its start, within its limits. In each row all are drawn with one spread:
    Newton's method goes to other lengths of a robot only where these are near."""
    start = float(v.start or 0.0)
    spread = SPREAD * NEAREST ** np.random.default_rng(seed).random(n)
    drawn = start + spread * (abs(start) or 1.0) * np.random.default_rng([seed, v.reference]).uniform(-1.0, 1.0, n)
    return np.clip(drawn, v.least, v.most)


def _steps(unit: Fmu, f: StepFunction, caller: UnitCaller, points: int, seed: int) -> dict[str, Check]:
    """A run: outputs byte for byte after every step, and whether it went well."""
    twin = f.twin(DOUBLE)
    state, out = record(f.state, DOUBLE), np.zeros((), dtype_of(f.outputs, DOUBLE))
    begun = twin.init(state, record(f.start, DOUBLE, f.defaults)) == Status.OK
    different = int(begun != (caller.reset() == 0 and caller.begin([], []) == 0))
    statuses = 0

    def places(members: Sequence[Any], integer: bool) -> list[tuple[str, int]]:
        own = [m for m in members if m.integer is integer]
        return [(m.identifier, m.count) for m in own]

    integers = [v.reference for v in unit.table.variables if v.integer and v.role == "input"]
    numbers = [v.reference for v in unit.table.of("input") if not v.integer]
    results = [v.reference for v in unit.table.of("output") if not v.integer]
    time = 0.0
    for given in f.examples(points, seed, DOUBLE).reshape(-1, 1):
        row = given.reshape(())
        values = np.concatenate([np.zeros(0), *[np.ravel(row[m]) for m, _ in places(f.inputs, False)]])
        flags = np.concatenate([np.zeros(0), *[np.ravel(row[m]) for m, _ in places(f.inputs, True)]]).astype(int)
        if not np.all(np.isfinite(values)):  # a unit takes no such number at all
            continue
        wanted = twin.step(state, row, out)
        worst = max(caller.set(numbers, values.tolist()), caller.set_integers(integers, flags.tolist()))
        worst = max(worst, caller.step(time, f.period)[0])
        statuses += (worst == 0) != (wanted == Status.OK)
        if worst == 0:
            time += f.period
        there = np.concatenate([np.zeros(0), *[np.ravel(out[m]) for m, _ in places(f.outputs, False)]])
        if wanted == Status.OK:
            different += caller.get(results)[1].tobytes() != there.tobytes()
    return {
        "steps_different": at_most(int(different), 0, f"of {points} steps, bit for bit"),
        "statuses_different": at_most(int(statuses), 0, f"of {points} steps"),
    }


def _by_fmpy(unit: Fmu, path: Path) -> dict[str, Check]:
    """Schema and validator, and a run of each interface from the start."""
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
    """Values of parameters that are set: none, and, where the model has some, others than those of the start."""
    kept = [unit.table.variables[r] for r in unit.table.parameters]
    others = {v.name: float(np.clip(float(v.start or 0.0) * (1.0 + NUDGE), v.least, v.most)) for v in kept}
    return [{}, others] if others else [{}]


def _by_casadi(unit: Fmu, f: CausalFunction, folder: Path) -> dict[str, Check]:
    """Rates and outputs at the start by CasADi's importer, with other parameters too."""
    far = 0.0
    for values in _settings(unit):
        try:
            far = max(far, _imported(unit, f, folder, values))
        except RuntimeError as error:
            return {"import_failed": at_most(1, 0, str(error).splitlines()[0])}
    return {"import_difference": at_most(far, IMPORT_NEAR, "of numbers by CasADi's import, over the largest or one")}


def _imported(unit: Fmu, f: CausalFunction, folder: Path, values: Mapping[str, float]) -> float:
    """How far CasADi's numbers are from the function's where these parameters are set."""
    variables = {v.name: v for v in unit.table.variables}
    builder: Any = ca.DaeBuilder(unit.table.name, str(folder))
    if values:  # once and for all: CasADi would set them as inputs in the mode of the solver, which takes none
        builder.set(list(values), list(values.values()))
    imported = builder.create("imported", ["x", "u"], ["ode", "y"])
    starts = [[float(variables[n].start or 0.0) for n in group] for group in (builder.x(), builder.u())]
    got = np.concatenate([np.array(part).ravel() for part in imported(*starts)])

    def given(p: tuple[int, int]) -> float:
        name = _name(f, p)
        return float(values.get(name, variables[name].start or 0.0))

    arguments = [np.array([given(p) for p in s.pairs]).reshape(s.shape) for s in f.inputs]
    *results, _ = f(*arguments, *([0.0] if f.plan.uses_time else []))
    numbers = {
        _name(f, p): float(x)
        for s, r in zip(f.outputs, results, strict=True)
        for p, x in zip(s.pairs, np.ravel(r), strict=True)
    }
    table = unit.table
    wanted = [numbers.get(table.variables[r].name, float(table.variables[r].start or 0.0)) for r in table.rates]
    order = [list(table.states).index(variables[n].reference) for n in builder.x()]
    flat = [float(x) for r in results for x in np.ravel(r)]  # what was asked for comes first, in the order of outputs
    behind = {v.name: flat[k] for k, v in enumerate(table.of("output"))}
    wanted = [wanted[k] for k in order] + [behind[n] for n in builder.y()]
    scale = max(1.0, float(np.max(np.abs(wanted), initial=0.0)))
    return float(np.max(np.abs(got - np.array(wanted)), initial=0.0)) / scale
