"""The study of generated code: a folder of C, compared with Python before it is written, and what it costs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
from .generation import Generated, generate
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
    provenance: Mapping[str, str] | None = None,
    problem: Mapping[str, Any] | None = None,
    also: Mapping[str, Check] | None = None,
    write_failed: bool = False,
    by: str = "write_failed=True",
    **work_options: Unpack[WorkOptions],
) -> CodeStudy:
    """C code of causal functions: generated, compiled and compared with Python, its costs counted, then written.

    Args:
        functions: by the name they get in C, `gt_<name>_<function>`; parameters are folded in. Step functions too.
        folder: a new or empty one, or one that gtmodel generated; or such a folder already held, see `folder.held`.
        name, real, box, along, provenance, problem: see `generate`.
        check: how it is compared; None: it is written as generated, nothing compiled.
        also: further checks that must pass, such as of the data that the functions rest on.
        write_failed: write it also where a check failed, marked in the first lines; by: how a person asks for that.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Code that failed a check, or was not checked to the end, is not written. Raises GenerationError, an ArgumentError,
    for what cannot be generated and for a folder with files of another origin.

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
    with nullcontext(folder) if isinstance(folder, Held) else held(Path(folder)) as mine:
        if work.interrupted():
            message = "stopped before the code was generated"
            return CodeStudy(status=SolveStatus.INTERRUPTED, message=message, title=work.title)

        def make(out: Path | Held, failed: str = "") -> CodeStudy:
            """The code in a folder, marked where a check failed, and what it is."""
            made = generate(
                functions, out, name=name, provenance=provenance, problem=problem, along=along, real=real, box=box,
                mark=partial(_marked, failed, by) if failed else None,
            )  # fmt: skip
            return _study_of(made, functions, real, work.title)

        work.progress("generating")
        cost = None
        if check is None:
            outcome = CodeStudy(status=SolveStatus.SOLVED, title=work.title, real=real)
        else:
            with scratch(_PREFIX) as place:
                code = place / "code"
                outcome, cost = _compared(make(code), code, functions, check, work)
            outcome = outcome.with_(folder=str(mine.path))
        outcome = outcome.judged(checks)
        if not outcome.status.ok and not write_failed:
            kept = "; what an earlier run wrote there stays" if others(mine.path) else ""
            return outcome.with_(message=f"{outcome.message}; the code is not written; {by} writes it, marked{kept}")
        made = make(mine, "" if outcome.status.ok else outcome.message)
        if cost is not None:
            write_costs(mine, cost)
        return made.judged(checks) if check is None else outcome


def _study_of(
    made: Generated, functions: Mapping[str, CausalFunction | StepFunction], real: str, title: str
) -> CodeStudy:
    files = sorted(str(f) for f in made.files)
    return CodeStudy(
        status=SolveStatus.SOLVED, message=f"generated {len(files)} files", title=title, real=real,
        folder=str(made.folder), functions={made.functions[name]: _signature(f) for name, f in functions.items()},
        written=files, operations=made.operations,
    )  # fmt: skip


def _compared(
    made: CodeStudy,
    scratch: Path,
    functions: Mapping[str, CausalFunction | StepFunction],
    check: Verification,
    work: Work,
) -> tuple[CodeStudy, Costs | None]:
    """The code in a folder of its own compared with Python; what it costs where that was counted."""
    if work.interrupted():
        return _stopped(made, "generated, but not checked"), None
    work.progress("compiling and comparing")
    try:
        report = against_python.check(scratch, functions, points=check.points, seed=check.seed)
    except GenerationError as error:
        return made.with_(status=SolveStatus.FAILED, message=str(error)), None
    if work.interrupted() and report.passed:
        return _stopped(made, "generated and compared with Python, but costs were not counted"), None
    work.progress("counting")
    cost = measurement.costs(scratch, functions)
    compared = made.with_(
        status=SolveStatus.SOLVED if report.passed or report.checks else SolveStatus.FAILED,
        message=report.message,
        checks=report.checks,
        written=sorted([*(made.written or ()), COSTS]),
        points=check.points,
        notes=[cost.missing] if cost.missing else [],
        **{name: value for name, value in vars(cost).items() if name != "missing"},
    )
    return compared, cost


def _stopped(made: CodeStudy, done: str) -> CodeStudy:
    return made.with_(status=SolveStatus.INTERRUPTED, message=f"stopped: {done}")


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
