"""Export a function as the archive of a functional mock-up unit, with a shared library built by the C compiler of this
machine."""

from __future__ import annotations

import hashlib
import math
import platform
import re
import subprocess
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from .._files import codegen_dir
from ..cgen.interface import box_of, check_identifier, check_names
from ..cgen.real import GenerationError
from ..cgen.steps.function import StepFunction
from ..compiler.causal import CausalFunction, c_name, compile_causal
from ..compiler.toolchain import SECONDS, STANDARD, find
from ..lang.model import Model
from ..results.disk import scratch, write_whole
from ..results.refusal import ArgumentError
from .causal_content import causal_content, starts, step_and_error, with_states
from .content import FmuContent, archive, is_ours, model_files, without_parameters
from .description import build_description3, description2, description3
from .page import page
from .step_content import step_content
from .table import FmuTable

# one folder, relative names, no time, no build number: the same bytes on every machine. Only the functions of the
# standard are visible, so that two units in one program share nothing. No start files: nothing runs at loading.
FLAGS = (
    *STANDARD, "-Os", "-fPIC", "-fvisibility=hidden", "-ffunction-sections", "-fdata-sections", "-fno-ident",
    "-fno-asynchronous-unwind-tables", "-g0",
)  # fmt: skip
LINK = (
    "-shared", "-s", "-nostartfiles", "-Wl,--build-id=none", "-Wl,--gc-sections", "-Wl,--no-undefined",
    "-Wl,-z,noexecstack", "-Wl,-z,noseparate-code", "-Wl,--hash-style=gnu", "-lm",
)  # fmt: skip
WINDOWS = "x86_64-w64-mingw32-gcc"


def binary_places() -> tuple[str, str]:
    """Return the folders of the library for this machine in archives of FMI 3.0 and 2.0. Raises GenerationError if the
    machine is not supported."""
    machine, system = platform.machine().lower(), platform.system()
    names = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
    if system != "Linux" or machine not in names:
        raise GenerationError(f"FMUs can be built on Linux for x86_64 and aarch64 only; this is {system} on {machine}")
    return f"{names[machine]}-linux", "linux64" if names[machine] == "x86_64" else "aarch64-linux"


def library(files: Mapping[str, str]) -> bytes:
    """Compile the library of these sources, by name. Raises GenerationError without a compiler, or if it fails."""
    tools = find()
    if isinstance(tools, str):
        raise GenerationError(tools)
    return _compiled(tools.cc, files, LINK)


def windows_library(compiler: str, files: Mapping[str, str]) -> bytes:
    """Compile the library for Windows with a cross compiler such as x86_64-w64-mingw32-gcc. Raises GenerationError."""
    return _compiled(compiler, files, ("-shared", "-s", "-Wl,--no-insert-timestamp", "-static-libgcc", "-lm"))


def _compiled(compiler: str, files: Mapping[str, str], link: tuple[str, ...]) -> bytes:
    with scratch("gtmodel-fmu-") as folder:
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = sorted(name for name in files if name.endswith(".c"))
        command = [compiler, *FLAGS, *sources, "-o", "library.bin", *link]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=SECONDS
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise GenerationError(f"the compiler cannot be run: {error}") from error
        if done.returncode != 0:
            lines = done.stderr.splitlines()
            first = next((line for line in lines if "error" in line or "undefined" in line), done.stderr.strip())
            raise GenerationError(f"the compiler cannot compile the FMU: {first}")
        return (folder / "library.bin").read_bytes()


Version = Literal[2, 3]
TOLERANCE = 1e-6  # of the inner integrator, relative to max(1, |state|)
_CORE = ("gt_fmu.h", "gt_fmu.c", "gt_fmu_step.c")
RESERVED = ("fmu", "fmu_model", "fmu_step", "fmu2", "fmu3", "fmu3_none")  # gt_NAME.c are files of every unit
_OF_VERSION = {2: ("gt_fmu2.c",), 3: ("gt_fmu3.h", "gt_fmu3.c", "gt_fmu3_none.c")}


@dataclass(frozen=True)
class Fmu:
    """An exported unit.

    path: of the archive, None if it was not written. version: of the standard. table: its variables. token:
    instantiation token (guid). data: the archive. sources: C files by name. function: the function that it computes,
    with the rates of its states.
    """

    path: Path | None
    version: Version
    table: FmuTable
    token: str
    data: bytes
    sources: Mapping[str, str]
    function: CausalFunction | StepFunction


def export(
    what: CausalFunction | StepFunction | Model,
    path: str | Path | None,
    *,
    version: Version = 3,
    known: str | Sequence[str] = (),
    targets: str | Sequence[str] = (),
    prefer: str | Sequence[str] = (),
    name: str = "",
    title: str = "",
    start: Mapping[str, Sequence[float] | float] | None = None,
    tunable: str | Collection[str] = (),
    parameters: str | Sequence[str] = (),
    on_fault: Literal["discard", "hold"] = "discard",
    step: float | None = None,
    tolerance: float = TOLERANCE,
    stop: float = 1.0,
    box: Mapping[str, Sequence[Sequence[float]]] | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Fmu:
    """Export a functional mock-up unit: one archive for model exchange and co-simulation, with C from `gt.cgen`.

    Args:
        what: a causal function, a step function (a filter, a sampled block), or a model with `known`, `targets` and
            `prefer` as for `Model.causal`. States of the function become continuous states.
        path: of the archive, NAME.fmu; only an FMU of gtmodel is overwritten. None: nothing is written.
        version: 3 for FMI 3.0, 2 for FMI 2.0.
        name: model identifier; from the path if empty. title: description; from the model if empty.
        start: start values of inputs and states by name, in SI. Default: the home pose or declared starts, at rest,
            with inputs that hold it. States without either, such as those of filters, need a value.
        tunable: names of known variables that become tunable parameters.
        parameters: names of model parameters that stay tunable, such as "m_p" or "coulomb[0]", with the model's values
            as start, its units and limits; the others are folded into the code. Setting one does not change the states.
            If the FMU has states, it checks each inner step, as a step short enough at the start may be too long for
            other values: `DoStep` then returns Discard.
        on_fault: "discard" if the function fails, as in the standard; "hold" keeps the outputs and reports it in an
            integer output `status`, only for functions without states.
        step: longest step of the inner integrator [s] for FMUs with states; None: the longest of 1 ms, 0.5 ms, ...
            with an error of at most 1e-8, otherwise of at most `tolerance`. The error is the largest difference from a
            run with half the step up to `stop` [s], inputs held, relative to max(1, |state|).
        box: intervals per input inside which the function never fails, for the documentation page.
        provenance: origin, for the comments of the C files.

    The same input gives the same bytes. Raises ArgumentError if the function cannot be exported, and its subclass
    GenerationError if there is no C compiler. Source: FMI 3.0.2 and 2.0.5.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> unit = gt.fmu.export(robot, None, known="q", targets="T", name="l1_fk")
    >>> [v.name for v in unit.table.of("output")]
    ['T[1]', 'T[2]', 'T[3]']
    >>> unit = gt.fmu.export(robot, None, known="T", targets="tau", parameters=["m_p"], name="l1_inverse_dynamics")
    >>> [(v.name, v.unit, v.start) for v in unit.table.of("tunable")]
    [('m_p', 'kg', 9.13)]
    """
    if not isinstance(what, (CausalFunction, StepFunction, Model)):
        raise ArgumentError(
            f"expected a model, a causal function or a step function; found {type(what).__name__}", "what"
        )
    if version not in (2, 3):
        raise ArgumentError(f"expected 2 or 3; found {version!r}", "version")
    if isinstance(what, Model):
        what = compile_causal(what, known, targets, prefer)
    elif known or targets or prefer:
        raise ArgumentError("known, targets and prefer are for models; leave them out for a function", "known")
    place = None if path is None else Path(path)
    identifier = name or (c_name(place.stem) if place is not None else c_name(getattr(what, "name", "") or "unit"))
    check_identifier(identifier, "an FMU", "name")
    if identifier.lower() in RESERVED:
        raise ArgumentError(
            f"'{identifier}' cannot name an FMU: every FMU has a file gt_{identifier}.c; choose another name", "name"
        )
    if place is not None and place.is_file() and place.stat().st_size and not is_ours(place):
        raise ArgumentError(f"'{place}' was not written by gtmodel; choose another name", "path")
    for argument, number in (("stop", stop), ("tolerance", tolerance), ("step", step)):
        if number is not None and not 0.0 < number < math.inf:
            raise ArgumentError(f"expected a finite number above zero; found {number!r}", argument)
    if on_fault not in ("discard", "hold"):
        raise ArgumentError(f"expected discard or hold; found {on_fault!r}", "on_fault")
    if box and isinstance(what, StepFunction):
        raise ArgumentError("a step function has no box; leave it out", "box")
    if box and isinstance(what, CausalFunction):
        check_names({identifier: what}, box)
        box_of(what, box)
    tunable = [tunable] if isinstance(tunable, str) else tunable
    parameters = [parameters] if isinstance(parameters, str) else list(parameters)
    content, function = _content(
        what, identifier, title, start, tunable, parameters, on_fault, step, tolerance, stop, provenance
    )
    unit = _unit(content, function, version, box or {})
    if place is not None:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            write_whole(place, unit.data, overwrite=True)
        except OSError as error:
            raise ArgumentError(f"'{place}' cannot be written: {error.strerror}", "path") from error
    return replace(unit, path=place)


def _content(
    what: CausalFunction | StepFunction,
    name: str,
    title: str,
    start: Mapping[str, Sequence[float] | float] | None,
    tunable: Collection[str],
    parameters: Sequence[str],
    on_fault: str,
    step: float | None,
    tolerance: float,
    stop: float,
    provenance: Mapping[str, str] | None,
) -> tuple[FmuContent, CausalFunction | StepFunction]:
    if isinstance(what, StepFunction):
        if parameters:
            raise ArgumentError("the numbers of a step function are part of its code; leave it out", "parameters")
        if start or tunable or on_fault != "discard" or step is not None:
            raise ArgumentError(
                "a step function has its own start and period; leave out start, tunable, on_fault and step", "start"
            )
        return step_content(what, name, title=title, stop=stop, provenance=provenance), what
    h, error = 1e-3, None
    extended = with_states(what)
    if extended.states:
        begin, guarded = starts(extended, start or {}), bool(parameters)
        key = ("fmu step", *begin.items(), step, tolerance, stop, guarded)
        if key not in what.kept:  # the same for both versions
            what.kept[key] = step_and_error(extended, begin, step, tolerance, stop, guarded)
        h, error = what.kept[key]
    content, extended = causal_content(
        what, name, title=title, start=start, tunable=tunable, parameters=parameters, hold=on_fault == "hold", step=h,
        part_error=tolerance, stop=stop, provenance=provenance,
    )  # fmt: skip
    return replace(content, table=replace(content.table, error=error)), extended.function


def _unit(
    content: FmuContent,
    function: CausalFunction | StepFunction,
    version: Version,
    box: Mapping[str, Sequence[Sequence[float]]],
) -> Fmu:
    table = content.table
    token = _token(content, version)
    place = codegen_dir() / "fmu"
    headers = {p.name: p.read_text(encoding="utf-8") for p in sorted((place / f"fmi{version}").glob("*.h"))}
    runtime = {f: (place / f).read_text(encoding="utf-8") for f in (*_CORE, *_OF_VERSION[version])}
    runtime = runtime if table.parameters else {f: without_parameters(text) for f, text in runtime.items()}
    sources = {**content.files, **model_files(content, token), **runtime, **headers}
    compiled = sorted(f for f in sources if f.endswith(".c"))
    in_three, in_two = binary_places()
    hashes = {
        "sha256 of the sources": hashlib.sha256("".join(sources[f] for f in sorted(sources)).encode()).hexdigest()
    }
    notes = list(function.notes()) if isinstance(function, StepFunction) else []
    causal = function if isinstance(function, CausalFunction) else None
    binary = f"binaries/{in_three if version == 3 else in_two}/{table.name}.so"
    texts = {
        "modelDescription.xml": description3(table, token) if version == 3 else description2(table, token, compiled),
        **({"sources/buildDescription.xml": build_description3(table, compiled)} if version == 3 else {}),
        **{f"sources/{name}": text for name, text in sources.items()},
        "documentation/index.html": page(table, token, causal, hashes, box, notes),
        "documentation/licenses/fmi-headers.txt": (place / "FMI-LICENSE.txt").read_text(encoding="utf-8"),
        "documentation/licenses/gtmodel.txt": (place / "LICENSE.txt").read_text(encoding="utf-8"),
    }
    data = archive({**{f: text.encode() for f, text in texts.items()}, binary: library(sources)})
    return Fmu(None, version, table, token, data, sources, function)


def _token(content: FmuContent, version: Version) -> str:
    """Return a hash of description and equations in the form of a guid: no clock, no random number."""
    texts = [description3(content.table, ""), *[f"{name}\n{content.files[name]}" for name in sorted(content.files)]]
    digits = hashlib.sha256("\n".join([str(version), content.functions, *texts]).encode()).hexdigest()
    return "{" + re.sub(r"(.{8})(.{4})(.{4})(.{4})(.{12}).*", r"\1-\2-\3-\4-\5", digits) + "}"


__all__ = ["Fmu", "GenerationError", "export"]
