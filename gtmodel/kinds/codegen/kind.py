"""Kind "codegen": C code of a robot's functions, written by ``gtmodel codegen``."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any

from gtmodel.certify.code import statements
from gtmodel.cgen import CodeStudy, StepFunction, study
from gtmodel.cgen.folder import held
from gtmodel.compiler.causal import CausalFunction, c_name, compile_causal
from gtmodel.filtering import ControllerFilter, InitialState, ProcessModel, Sensor, System
from gtmodel.fmu import FmuStudy
from gtmodel.fmu.unit_study import study as unit_study
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.noted import doubts, refuse_distrusted
from gtmodel.results import ArgumentError
from gtmodel.results.refusal import naming

from .keys import FilterSection, PredictiveSection, Schema, from_result, keys_of_units

arguments = keys_of_units
VERSIONS = {"3": (3,), "2": (2,), "both": (3, 2)}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the functions; add `folder=`, which the file does not name."""
    return Call(
        study, functions_of(problem, context), name=problem.name or c_name(context.name), real=problem.real,
        box=problem.box, along=[f.name for f in problem.functions if f.trajectory], check=problem.check.options(),
        provenance={
            "problem": context.name, "title": problem.title, "robot": problem.robot,
            "problem_sha256": sha256(problem.model_dump_json().encode()).hexdigest(),
        },
        problem=problem.model_dump(mode="json", exclude_unset=True), title=problem.title,
    )  # fmt: skip


def write(
    problem: Schema, context: Context, out: Path, *, verify: bool = False, write_failed: bool = False,
    fmu: str | None = None, costs: bool = False, certify: bool = False,
) -> CodeStudy | FmuStudy:  # fmt: skip
    """Generate the code into `out`.

    With `verify` the code is first compiled and compared with Python in another folder, and written only if all checks
    passed; with `write_failed` it is written anyway, marked in the first lines.

    fmu: "3", "2" or "both": functional mock-up units of these versions instead of C code.
    costs: with `verify`, also measure machine code, stack and instructions. certify: prove, and write a certificate.

    Raises InputError for a wrong problem, ArgumentError for a folder with files that gtmodel did not write.
    """
    if fmu is not None and (costs or certify):
        raise InputError("--costs, --certify: only C code is measured or proved, not a unit; leave them out, or --fmu")
    if fmu is not None:
        return _units(problem, context, out, fmu, verify, write_failed)
    with held(out) as folder:
        if folder.message:
            context.notice(folder.message)
        call_ = call(problem, context)
        call_.options["problem"]["robot"] = problem.robot_from(context, folder.path)
        if problem.plant is not None:
            call_.options["problem"]["plant"] |= problem.plant.of_folder(context, folder.path)
        if not write_failed and not context.interrupted():
            refuse_distrusted(context, "the code")
        call_.options |= {"costs": costs} if verify else {"check": None}
        functions, name = call_.arguments[0] if certify else {}, call_.options["name"]
        proved = statements(functions, problem.box, name, problem.real, context.clock(), *problem.wanted)
        call_.options |= {"also": doubts(context) | {**proved.checks}, "beside": proved.beside}
        return call_(folder=folder, write_failed=write_failed, by="--write-failed", **context.work())


def _units(problem: Schema, context: Context, out: Path, fmu: str, verify: bool, write_failed: bool) -> FmuStudy:
    if fmu not in VERSIONS:
        raise InputError(f"--fmu {fmu!r}: expected 3, 2 or both")
    if problem.real != "double":
        raise InputError("units compute in double; leave it out, or generate C code", "real")
    functions = {n: f for n, f in functions_of(problem, context).items() if n not in problem.jacobians}
    s = problem.fmu
    all_ = {"stop": s.stop_s, "on_fault": s.on_fault, "tolerance": s.tolerance, "step": s.step_s}
    options = {f.name: {**all_, **f.model_dump(include={"start", "tunable", "parameters"})} for f in problem.functions}
    if not write_failed and not context.interrupted():
        refuse_distrusted(context, "the units")
    call_ = Call(
        unit_study, functions, name=problem.name or c_name(context.name), versions=VERSIONS[fmu], box=problem.box,
        options={name: options.get(name, {"stop": s.stop_s}) for name in functions},
        provenance={"problem": context.name, "title": problem.title, "robot": problem.robot}, title=problem.title,
        check=problem.check.options() if verify else None,
    )  # fmt: skip
    return call_(folder=out, also=doubts(context), write_failed=write_failed, by="--write-failed", **context.work())


def explain(problem: Schema, context: Context) -> str:
    """Return the certificate of every function."""
    return "\n\n".join(f"{name}\n{f.explain(context.full)}" for name, f in functions_of(problem, context).items())


def functions_of(problem: Schema, context: Context) -> dict[str, CausalFunction | StepFunction]:
    """Return all functions by name; after a stop request, those finished so far. Raises InputError."""
    if not (problem.functions or problem.filters or problem.predictive):
        raise InputError("there is nothing to generate; give [[functions]], [[filters]] or [[predictive]]", "functions")
    model = problem.model(context)
    functions: dict[str, CausalFunction | StepFunction] = {}
    for n, f in enumerate(problem.functions):
        if twice := [name for name in f.names if name in functions]:
            raise InputError(f"'{twice[0]}' names two functions", f"functions[{n}].name")
        if context.interrupted():
            break
        context.progress(f"deriving {f.name}", n / len(problem.functions))
        try:
            functions |= f.with_jacobian(compile_causal(model, f.known, f.targets, f.prefer, f.branches, f.name))
        except ModelError as error:
            raise InputError(f"{error} (function '{f.name}')", f"functions[{n}]") from error
    steps: list[tuple[str, Any, Any]] = [(f"filters[{n}]", s, _filter) for n, s in enumerate(problem.filters)]
    steps += [(f"predictive[{n}]", s, PredictiveSection.made) for n, s in enumerate(problem.predictive)]
    for n, (key, section, made) in enumerate(steps):
        if section.name in functions:
            raise InputError(f"'{section.name}' names two functions", f"{key}.name")
        if context.interrupted():
            break
        context.progress(f"deriving {section.name}", n / len(steps))
        try:
            functions[section.name] = made(section, model, context, key)
        except ArgumentError as error:
            raise InputError(error.message, f"{key}.{section.key_of(error.argument)}".rstrip(".")) from error
        except ModelError as error:
            raise InputError(str(error), key) from error
    return functions


def _filter(section: FilterSection, model: Model, context: Context, key: str) -> ControllerFilter:
    """The filter of one table."""
    section = from_result(section, context, key)
    process = ProcessModel(model, section.noise, **section.model_dump(include={"inputs", "states", "quaternions"}))
    sensors: list[Sensor] = []
    for s in section.sensors:
        with naming(f"{s.name}."):
            sensors.append(
                Sensor(
                    s.name, s.signal, deviation=s.deviation, density=s.density, period=s.period_s, kind=s.kind,
                    delay=s.delay_s, gate=s.gate,
                )
            )  # fmt: skip
    stale = {s.name: s.stale_cycles for s in section.sensors if s.stale_cycles is not None}
    closed = {s.name: s.closed_cycles for s in section.sensors if s.closed_cycles is not None}
    start = InitialState(section.start.mean, section.start.deviation) if section.start else InitialState({}, {})
    return ControllerFilter(System(process, sensors), section.period_s, start, stale=stale, closed=closed)
