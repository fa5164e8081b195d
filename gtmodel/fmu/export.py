"""From a function to the archive of a functional mock-up unit, with the shared library made by the C compiler of
this machine."""

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

# one folder, relative names, no time, no build number: the same bytes wherever it is made. Only what the standard
# names is seen from outside, so that two units in one program share nothing. Nothing runs at loading: no start files.
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
    """Folder of the library for this machine in archives of FMI 3.0 and 2.0. Raises GenerationError for a machine for
    which no name is known."""
    machine, system = platform.machine().lower(), platform.system()
    names = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
    if system != "Linux" or machine not in names:
        raise GenerationError(f"libraries are made on Linux for x86_64 and aarch64 only; this is {system} on {machine}")
    return f"{names[machine]}-linux", "linux64" if names[machine] == "x86_64" else "aarch64-linux"


def library(files: Mapping[str, str]) -> bytes:
    """The library of these sources, by name. Raises GenerationError without a compiler, and where one fails."""
    tools = find()
    if isinstance(tools, str):
        raise GenerationError(tools)
    return _compiled(tools.cc, files, LINK)


def windows_library(compiler: str, files: Mapping[str, str]) -> bytes:
    """The same for Windows by a cross compiler such as x86_64-w64-mingw32-gcc. Raises GenerationError as `library`."""
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
            said = next((line for line in lines if "error" in line or "undefined" in line), done.stderr.strip())
            raise GenerationError(f"the compiler refuses the unit: {said}")
        return (folder / "library.bin").read_bytes()


Version = Literal[2, 3]
TOLERANCE = 1e-6  # of the integrator inside, over the size of a state or one
_CORE = ("gt_fmu.h", "gt_fmu.c", "gt_fmu_step.c")
RESERVED = ("fmu", "fmu_model", "fmu_step", "fmu2", "fmu3", "fmu3_none")  # gt_NAME.c are files of every unit
_OF_VERSION = {2: ("gt_fmu2.c",), 3: ("gt_fmu3.h", "gt_fmu3.c", "gt_fmu3_none.c")}


@dataclass(frozen=True)
class Fmu:
    """A unit that was exported.

    path: where, None where it was not written. version: of the standard. table: its variables. token: instantiation
    token (guid). data: the archive. sources: its C by name. function: what it computes, with the rates of its states.
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
    """A functional mock-up unit: one archive for model exchange and co-simulation, from the C that `gt.cgen` makes.

    Args:
        what: a causal function, a step function (a filter, a sampled block), or a model with `known`, `targets` and
            `prefer` as for `Model.causal`. States of the function become continuous states.
        path: of the archive, NAME.fmu; a file that is no unit of gtmodel stays. None: it is made, not written.
        version: 3 for FMI 3.0, 2 for FMI 2.0.
        name: model identifier; that of the path if empty. title: description; that of the model if empty.
        start: values of inputs and states at the start by name, in SI; else the home pose or declared starts,
            at rest, held by its inputs; states that have neither, such as those of filters, want one.
        tunable: names of known variables that become tunable parameters.
        parameters: names of parameters of the model that stay tunable parameters, as "m_p" or "coulomb[0]", with the
            model's values as start, its units and limits; the others are folded into the code. States stay as they are
            when one is set. With states each part of a step inside is checked, since a step that is short enough for
            the start may be too long for other values: `DoStep` then ends with Discard.
        on_fault: "discard" where there is no answer, as the standard has it; "hold" keeps the outputs and says so in an
            integer output `status`, for functions without states only.
        step: longest step of the integrator inside [s], where there are states; None: the longest of 1 ms, 0.5 ms,
            ... with an error of at most 1e-8, else of at most `tolerance`. The error is the largest of a state over its
            size or one, against half the step up to `stop` [s] with inputs held.
        box: intervals by input inside which it answers everywhere, for its page.
        provenance: what its C says about the origin.

    The same input gives the same bytes. Raises ArgumentError for what cannot be exported, GenerationError, an
    ArgumentError, where there is no C compiler. Source: FMI 3.0.2 and 2.0.5.

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
        raise ArgumentError("known, targets and prefer belong to a model; this is a function already", "known")
    place = None if path is None else Path(path)
    own = name or (c_name(place.stem) if place is not None else c_name(getattr(what, "name", "") or "unit"))
    check_identifier(own, "a unit", "name")
    if own.lower() in RESERVED:
        raise ArgumentError(
            f"'{own}' cannot name a unit: gt_{own}.c is a file of every unit; take another name", "name"
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
        check_names({own: what}, box)
        box_of(what, box)
    tunable = [tunable] if isinstance(tunable, str) else tunable
    kept = [parameters] if isinstance(parameters, str) else list(parameters)
    content, function = _content(what, own, title, start, tunable, kept, on_fault, step, tolerance, stop, provenance)
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
            raise ArgumentError("a step function has its own start and period; leave start, tunable, step out", "start")
        return step_content(what, name, title=title, stop=stop, provenance=provenance), what
    h, error = 1e-3, None
    made = with_states(what)
    if made.states:
        h, error = step_and_error(made, starts(made, start or {}), step, tolerance, stop, bool(parameters))
    content, made = causal_content(
        what, name, title=title, start=start, tunable=tunable, parameters=parameters, hold=on_fault == "hold", step=h,
        part_error=tolerance, stop=stop, provenance=provenance,
    )  # fmt: skip
    return replace(content, table=replace(content.table, error=error)), made.function


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
    own = {f: (place / f).read_text(encoding="utf-8") for f in (*_CORE, *_OF_VERSION[version])}
    own = own if table.parameters else {f: without_parameters(text) for f, text in own.items()}
    sources = {**content.files, **model_files(content, token), **own, **headers}
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
    """A hash of description and equations in the form of a guid: no clock, no random number."""
    texts = [description3(content.table, ""), *[f"{name}\n{content.files[name]}" for name in sorted(content.files)]]
    digits = hashlib.sha256("\n".join([str(version), content.functions, *texts]).encode()).hexdigest()
    return "{" + re.sub(r"(.{8})(.{4})(.{4})(.{4})(.{12}).*", r"\1-\2-\3-\4-\5", digits) + "}"


__all__ = ["Fmu", "GenerationError", "export"]
