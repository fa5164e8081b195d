"""The study of generated code: a folder of C, compared with Python before it is written, and its costs on request."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, Literal, Unpack

from ..compiler.causal import CausalFunction
from ..results import Check, SolveStatus, Work
from ..results.disk import marked, scratch
from ..results.folder import Held, others
from ..results.work import WorkOptions, study_function
from . import measurement
from .code_result import COSTS, CodeStudy, Verification
from .costs_file import write_costs
from .folder import held
from .generation import Beside, Generated, generate
from .measurement import Costs
from .real import GenerationError
from .steps.function import StepFunction
from .verification import against_python

_PREFIX = "gtmodel-codegen-"
COMPARED = Verification()
Functions = Mapping[str, CausalFunction | StepFunction]


@study_function
def study(
    functions: Mapping[str, CausalFunction | StepFunction],
    folder: str | Path | Held,
    *,
    name: str,
    real: Literal["double", "float"] = "double",
    box: Mapping[str, Sequence[Sequence[float]]] | None = None,
    along: Collection[str] = (),
    check: Verification | None = COMPARED,
    costs: bool = False,
    provenance: Mapping[str, str] | None = None,
    problem: Mapping[str, Any] | None = None,
    also: Mapping[str, Check] | None = None,
    beside: Callable[[Mapping[str, str]], Beside] | None = None,
    write_failed: bool = False,
    by: str = "write_failed=True",
    **work_options: Unpack[WorkOptions],
) -> CodeStudy:
    """C code of causal functions: generated, compiled and compared with Python, then written.

    Args:
        functions: causal functions and step functions by Python name, see `generate`.
        folder: a new or empty one, or one that gtmodel generated; or such a folder already locked, see `folder.held`.
        name, real, box, along, provenance, problem: see `generate`.
        check: options of the comparison; None: write the code without compiling it.
        costs: after the comparison, also measure machine code, stack and instructions, into costs.json; this takes
            longer than the comparison.
        also: further checks that must pass, for example of the data from which the functions were made.
        beside: texts by file name -> what else the folder says, such as a certificate.
        write_failed: also write code that failed a check, with a mark in its first lines.
        by: name of this option for the user, for messages.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Code that failed a check, or whose check was interrupted, is not written unless `write_failed` is set. Raises
    GenerationError, an ArgumentError, if the code cannot be generated or the folder holds files of another origin.

    >>> import tempfile
    >>> import gtmodel as gt
    >>> fk = gt.robots.gantry_tau("l1_tape").causal(known="q", targets="T")
    >>> with tempfile.TemporaryDirectory() as place:
    ...     s = gt.cgen.study({"fk": fk}, place + "/code", name="l1", check=None)
    >>> s.functions["gt_l1_fk"]["outputs"]
    ['T [m]']
    """
    work = Work(**work_options)
    checks = also or {}
    with nullcontext(folder) if isinstance(folder, Held) else held(Path(folder)) as locked:
        if work.interrupted():
            message = "stopped before the code was generated"
            return CodeStudy(status=SolveStatus.INTERRUPTED, message=message, title=work.title)

        def make(out: Path | Held, failed: str = "") -> CodeStudy:
            """Generate into a folder, with a mark if a check failed, and return the study."""
            generated = generate(
                functions, out, name=name, provenance=provenance, problem=problem, along=along, real=real, box=box,
                mark=partial(_marked, failed, by) if failed else None, beside=beside,
            )  # fmt: skip
            return _study_of(generated, functions, real, work.title)

        work.progress("generating")
        cost = None
        if check is None:
            outcome = CodeStudy(status=SolveStatus.SOLVED, title=work.title, real=real)
        else:
            with scratch(_PREFIX) as temporary:
                code = temporary / "code"
                outcome, cost = _compared(make(code), code, functions, check, costs, work)
            outcome = outcome.with_(folder=str(locked.path))
        outcome = outcome.judged(checks)
        if not outcome.status.ok and not write_failed:
            kept = "; the files of an earlier run are kept" if others(locked.path) else ""
            return outcome.with_(message=f"{outcome.message}; the code is not written; {by} writes it, marked{kept}")
        written = make(locked, "" if outcome.status.ok else outcome.message)
        if cost is not None:
            write_costs(locked, cost)
        return written.judged(checks) if check is None else outcome


def _study_of(
    generated: Generated, functions: Mapping[str, CausalFunction | StepFunction], real: str, title: str
) -> CodeStudy:
    files = sorted(str(f) for f in generated.files)
    return CodeStudy(
        status=SolveStatus.SOLVED, message=f"generated {len(files)} files", title=title, real=real,
        folder=str(generated.folder),
        functions={generated.functions[name]: _signature(f) for name, f in functions.items()},
        written=files, operations=generated.operations,
    )  # fmt: skip


def _compared(
    generated: CodeStudy,
    scratch: Path,
    functions: Mapping[str, CausalFunction | StepFunction],
    check: Verification,
    costs: bool,
    work: Work,
) -> tuple[CodeStudy, Costs | None]:
    """Compare the code in its scratch folder with Python. Returns the study, and the costs if they are asked for."""
    if work.interrupted():
        return _stopped(generated, "generated, but not checked"), None
    work.progress("compiling and comparing")
    try:
        report = against_python.check(scratch, functions, points=check.points, seed=check.seed)
    except GenerationError as error:
        return generated.with_(status=SolveStatus.FAILED, message=str(error)), None
    if costs and work.interrupted() and report.passed:
        return _stopped(generated, "generated and compared with Python, but costs were not counted"), None
    compared = generated.with_(
        status=SolveStatus.SOLVED if report.passed or report.checks else SolveStatus.FAILED,
        message=report.message,
        checks=report.checks,
        points=check.points,
    )
    if not costs:
        return compared, None
    work.progress("counting")
    cost = measurement.costs(scratch, functions)
    counted = {name: value for name, value in vars(cost).items() if name != "missing"}
    files = sorted([*(generated.written or ()), COSTS])
    return compared.with_(written=files, notes=[cost.missing] if cost.missing else [], **counted), cost


def _stopped(outcome: CodeStudy, done: str) -> CodeStudy:
    return outcome.with_(status=SolveStatus.INTERRUPTED, message=f"stopped: {done}")


def _marked(message: str, by: str, file: str, text: str) -> str:
    if not file.endswith((".c", ".h")):
        return text
    return marked(file, text.encode(), message, f", written by {by}").decode()


def _signature(function: CausalFunction | StepFunction) -> dict[str, list[str]]:
    if isinstance(function, StepFunction):
        return {
            side: [f"{m.name} [{m.unit}]" for m in members if not m.integer]
            for side, members in (("inputs", function.inputs), ("outputs", function.outputs))
        }
    return {
        "inputs": [f"{s.name} [{s.unit}]" for s in function.inputs],
        "outputs": [f"{s.name} [{s.unit}]" for s in function.outputs],
    }
