"""The study of FMUs: export functions as archives in a folder, checked before they are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Unpack

from ..cgen.code_result import Verification
from ..cgen.interface import check_names
from ..cgen.steps.function import StepFunction
from ..compiler.causal import CausalFunction
from ..results import Check, Quantity, Row, SolveStatus, Study, Work
from ..results.folder import FolderError, holding
from ..results.refusal import ArgumentError
from ..results.work import WorkOptions, study_function
from .checking import check as checked
from .content import is_ours
from .export import Fmu, Version, export

FAILED = ".failed"  # in the name of an archive that failed a check
COMPARED = Verification()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FmuStudy(Study):
    """Exported FMUs, by file name of the archive."""

    folder: Annotated[str | None, Quantity("", "folder of the archives")] = None
    units: Annotated[
        Mapping[str, Mapping[str, Any]] | None,
        Quantity(
            "",
            "archive -> bytes, instantiation token, inputs, parameters, states, outputs, inner step [s] and its error",
        ),
    ] = None
    written: Annotated[Sequence[str] | None, Quantity("", "files written, sorted", key="files")] = None

    @property
    def values(self) -> Mapping[str, Any]:
        """The quantities that are not None."""
        return {name: value for name, value in super().values.items() if value is not None}

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        return [
            Row("folder", self.folder),
            *[Row(name, f"{', '.join(u['outputs'])} from {', '.join(u['inputs']) or 'nothing'}"
                        f"{'; parameters ' if u.get('parameters') else ''}{', '.join(u.get('parameters', []))}"
                        f"; {u['bytes']} bytes")
              for name, u in (self.units or {}).items()],
        ]  # fmt: skip


@study_function
def study(
    functions: Mapping[str, CausalFunction | StepFunction],
    folder: str | Path,
    *,
    name: str,
    versions: Sequence[Version] = (3,),
    options: Mapping[str, Mapping[str, Any]] | None = None,
    box: Mapping[str, Sequence[Sequence[float]]] | None = None,
    check: Verification | None = COMPARED,
    provenance: Mapping[str, str] | None = None,
    also: Mapping[str, Check] | None = None,
    write_failed: bool = False,
    by: str = "write_failed=True",
    **work_options: Unpack[WorkOptions],
) -> FmuStudy:
    """Export functions as functional mock-up units NAME_FUNCTION_fmi3.fmu, check them, and write them to a folder.

    Args:
        functions: by name; model identifiers are `<name>_<function>`.
        folder: other files in it stay; an archive does not overwrite a file that gtmodel did not write.
        versions: 3 for FMI 3.0, 2 for FMI 2.0.
        options: further arguments of `export` by function name, such as `start` and `step`.
        box: intervals by input, for all functions that have it; see `export`.
        check: number of points that `gt.fmu.check` compares; None: no check.
        also, write_failed, by, progress, max_seconds, stop: as in `gt.cgen.study`; archives that fail a check are
            written only if `write_failed`, with `.failed` in their names.

    Raises ArgumentError if a function cannot be exported; its argument has the function's name: "options.fk.start".

    >>> import tempfile
    >>> fk = gt.robots.gantry_tau("l1_tape").causal(known="q", targets="T")
    >>> with tempfile.TemporaryDirectory() as place:
    ...     s = gt.fmu.study({"fk": fk}, place, name="l1", check=None)
    >>> s.written
    ['l1_fk_fmi3.fmu']
    """
    work = Work(**work_options)
    for key in set(options or {}) - set(functions):
        raise ArgumentError(f"there is no function '{key}'; functions are {', '.join(functions)}", "options")
    inputs = {key: {s.name for s in f.inputs} for key, f in functions.items() if isinstance(f, CausalFunction)}
    check_names({key: f for key, f in functions.items() if isinstance(f, CausalFunction)}, box or {})
    units: dict[str, Fmu] = {}
    checks: dict[str, Check] = dict(also or {})
    notes: list[str] = []
    for n, (key, function) in enumerate(functions.items()):
        for version in versions:
            if work.interrupted():
                return FmuStudy(
                    status=SolveStatus.INTERRUPTED, message="stopped before all FMUs were exported", title=work.title
                )
            work.progress(f"exporting {key}", n / len(functions))
            own = {n: x for n, x in (box or {}).items() if n in inputs.get(key, ())}
            more: dict[str, Any] = {**({"box": own} if own else {}), **(options or {}).get(key, {})}
            try:
                unit = export(function, None, version=version, name=f"{name}_{key}", provenance=provenance, **more)
            except ArgumentError as error:
                if not error.argument:  # not about an argument, for example a missing compiler
                    raise
                raise type(error)(f"{error.message} (function '{key}')", f"options.{key}.{error.argument}") from error
            units[f"{name}_{key}_fmi{version}.fmu"] = unit
            if check is not None:
                work.progress(f"checking {key}", n / len(functions))
                report = checked(unit, points=check.points, seed=check.seed)
                checks |= report.checks
                notes += [note for note in report.notes if note not in notes]
    result = FmuStudy(
        status=SolveStatus.SOLVED, message=f"exported {len(units)} units", title=work.title, folder=str(folder),
        notes=notes,
        units={file: _about(u) for file, u in units.items()}, checks=checks,
    )  # fmt: skip
    if not result.status.ok and not write_failed:
        advice = f"nothing was written; {by} writes the FMUs, with '{FAILED}' in their names"
        return result.with_(message=f"{result.message}; {advice}")
    names = {file: file if result.status.ok else file.replace(".fmu", f"{FAILED}.fmu") for file in units}
    _write(Path(folder), {names[file]: u.data for file, u in units.items()})
    return result.with_(written=sorted(names.values()))


def _about(unit: Fmu) -> dict[str, Any]:
    t = unit.table
    inner = {"step_s": t.step, "error": t.error} if t.states else {}
    return {
        "bytes": len(unit.data),
        "token": unit.token,
        "inputs": [f"{v.name} [{v.unit}]" for v in t.of("input", "tunable") if v.reference not in t.parameters],
        **(
            {"parameters": [f"{v.name} [{v.unit}]" for v in t.numbers if v.reference in t.parameters]}
            if t.parameters
            else {}
        ),
        "states": [f"{v.name} [{v.unit}]" for v in t.of("state")],
        "outputs": [f"{v.name} [{v.unit}]" for v in t.of("output")],
        **inner,
        **({"period_s": t.period} if t.period else {}),
    }


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    try:
        with holding(folder) as mine:
            for name in files:
                if (folder / name).exists() and not is_ours(folder / name):
                    raise ArgumentError(
                        f"'{folder / name}' was not written by gtmodel; choose another folder", "folder"
                    )
            mine.write(files)
    except FolderError as error:
        raise ArgumentError(f"'{folder}' {error}", "folder") from error
