"""A study run for many values of its arguments, on all cores or on a cluster."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from .._lazy import hint
from ..results import written
from ..results.as_json import result
from ..results.check import at_most
from ..results.folder import FolderError, Held
from ..results.quantity import Quantity
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from ..results.study import Study
from ..results.work import CREW, Crew, Interrupted, Work, WorkOptions, study_function
from ..workers.each import WorkerDied
from ..workers.mapped import shared
from .design import Design, Method, design
from .row import Keyed, Record, Store, Task, ran

if TYPE_CHECKING:
    from pandas import DataFrame
else:
    DataFrame = hint("pandas", "DataFrame")

TABLE, PARQUET = "table.csv", "table.parquet"
OWN = {"row", "status", "message", "run"}  # columns besides keys and quantities
_OF_SOLVER = ("objective", "iterations")  # drawn last
CURVES = 4  # quantities in the picture, if none are named
_OPEN_S = 5.0  # time in which parts that start together open the folder one after the other


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sweep(Study):
    """Result of a sweep. A failed row does not lose the others: it stands in the table with its status and message.

    keys: varied keys. table: column -> values of all finished rows, None where a row has no value: "row" (counted from
    0), the keys, "status", the quantities, "message".
    """

    rows_declared: Annotated[int, Quantity("", "rows of the design, or of this part", "rows")]
    rows_done: Annotated[int, Quantity("", "rows that ended, solved or not", "rows done")]
    rows_solved: Annotated[int, Quantity("", "rows that were solved and passed all checks", "rows solved")]
    failed: Annotated[list[int], Quantity("", "numbers of the rows that were not solved, from 0")]
    keys: tuple[str, ...] = ()
    table: Mapping[str, Sequence[Any]] = field(default_factory=dict)

    def frame(self) -> DataFrame:
        """Return the table for pandas, with the row numbers as index. Raises ArgumentError if pandas is missing."""
        try:
            from pandas import DataFrame as Frame
        except ImportError as error:
            raise ArgumentError(f"frame() needs pandas ({error}): pip install pandas") from error
        return Frame(dict(self.table)).set_index("row")


@study_function
def study(
    task: Task,
    vary: Mapping[str, Any],
    *,
    rows: Sequence[Mapping[str, Any]] = (),
    samples: int = 0,
    seed: int = 0,
    method: Method = "random",
    part: tuple[int, int] = (1, 1),
    only_merge: bool = False,
    folder: str | Path | None = None,
    identity: str = "",
    keep_runs: bool = False,
    plot: bool = False,
    parquet: bool = False,
    show: Sequence[str] = (),
    **work_options: Unpack[WorkOptions],
) -> Sweep:
    """Run a study for each row of a design; the table does not depend on the number of workers.

    Args:
        task: called as task(**keys), returns a Study, a dictionary of numbers, or a number; or a problem as
            `gt.load` returns it, whose keys are then those of the file.
        vary, rows, samples, seed, method: the design, see `design`.
        part: (i, n), run every n-th row from the i-th, i = 1..n, for job arrays on a common `folder`.
        only_merge: run nothing; make the table of the rows in `folder`.
        folder: rows are kept there when they are done, and a later call does not repeat them. At the end it contains
            result.json and table.csv too.
        identity: for a function, all that its result depends on besides the keys, such as a version; without it,
            `folder` keeps no rows of a function, because gtmodel cannot see whether the function has changed.
        keep_runs: write the result of each row into a folder of its own, `folder`/runs/NAME; column "run" of the table.
        plot, parquet: write the picture and table.parquet into `folder` too; Parquet needs the extra `logs`.
        show: columns in the picture; the first quantities that vary if left out.
        work_options: see `Work`; `workers` and `executor` run the rows.

    Raises ArgumentError for a wrong design and for a folder that cannot be used.

    >>> def area(width, height):
    ...     return {"area_m2": width * height}
    >>> swept = gt.sweep.study(area, {"width": [1.0, 2.0], "height": [3.0, 5.0]})
    >>> swept.table["area_m2"]
    [3.0, 5.0, 6.0, 10.0]
    """
    work = Work(**work_options)
    if rows_of := getattr(task, "rows_of", None):  # a problem that `gt.load` returned
        task = rows_of()
    plan = design(vary, rows=rows, samples=samples, seed=seed, method=method)
    i, n = part
    if not 1 <= i <= n:
        raise ArgumentError(f"expected (i, n) with 1 <= i <= n; found ({i}, {n})", "part")
    if folder is None and (keep_runs or only_merge or n > 1):
        raise ArgumentError("is needed for parts, for merging and to keep the runs; name a folder", "folder")
    if taken := set(plan.keys) & OWN:
        raise ArgumentError(f"'{min(taken)}' is a column of every table; give the key another name", "vary")
    numbers = range(i - 1, len(plan), n)
    same = task.identity if isinstance(task, Keyed) else identity
    place = None if folder is None else Path(folder)
    own = place if place is None or n == 1 else place / f"part-{i}-of-{n}"
    described = {"keys": list(plan.keys), "rows": len(plan), "identity": same}
    if samples:
        described |= {"samples": samples, "seed": seed, "method": method}
    with _opened(place, own, described) as held:
        store = Store(None if place is None or not same else place / "rows", same)
        names = [store.name(plan[k]) for k in numbers]
        runs = place / "runs" if keep_runs and place is not None else None
        if not only_merge:
            _run(partial(ran, task), plan, numbers, names, store, runs, work)
        made = _made(plan, numbers, names, store, runs, show, work.title)
        if held is not None:
            files = written.files_of(made, result("", None, made))
            if parquet:
                files[PARQUET] = parquet_of(made.table)
            faults = written.pictured(made, files) if plot else []
            written.put(held, files, lambda files: written.record(described, None, files))
            if faults:
                raise ArgumentError(faults[0], "plot")
    return made


def _run(
    task: Callable[[Any], Record], plan: Design, numbers: range, names: Sequence[str], store: Store, runs: Path | None,
    work: Work,
) -> None:  # fmt: skip
    """Run the rows that are not done and store each when it ends."""
    done = failed = 0
    left = list[int]()  # positions of the rows under way, by their number among the items

    def items() -> Iterator[tuple[dict[str, Any], Path | None]]:
        nonlocal done
        for position, (k, name) in enumerate(zip(numbers, names, strict=True)):
            folder = None if runs is None else runs / name[:12]
            if store.get(name) is not None and (folder is None or folder.is_dir()):
                done += 1
                continue
            left.append(position)
            yield plan[k], folder

    results = shared(CREW.get() or Crew(), task, items(), work.interrupted, ordered=False)
    try:
        with closing(results):
            for one in results:
                done += 1
                record = one.value if one.error is None else _unexpected(one.error)
                if record["status"] == SolveStatus.INTERRUPTED.value:
                    continue
                failed += record["status"] != SolveStatus.SOLVED.value
                store.put(names[left[one.index]], record, again=one.error is not None)
                work.progress("rows", done / len(names), {"done": done, "failed": failed})
    except KeyboardInterrupt:
        pass  # what is done is kept


def _unexpected(error: Exception) -> Record:
    if isinstance(error, Interrupted):  # of a row in this process
        return {"status": SolveStatus.INTERRUPTED.value, "message": str(error), "values": {}}
    kind = "" if isinstance(error, WorkerDied) else f"{type(error).__name__}: "
    return {"status": SolveStatus.FAILED.value, "message": f"{kind}{' '.join(str(error).split())}", "values": {}}


def _made(
    plan: Design, numbers: range, names: Sequence[str], store: Store, runs: Path | None, show: Sequence[str], title: str
) -> Sweep:
    shown, done, failed = dict[str, None](), 0, list[int]()
    table: dict[str, list[Any]] = {name: [] for name in ("row", *plan.keys, "status")}
    others = ("run", "message") if runs is not None else ("message",)
    last, measured = {name: list[Any]() for name in others}, dict[str, list[Any]]()
    for k, name in zip(numbers, names, strict=True):
        if (record := store.get(name)) is None:
            continue
        status = record["status"]
        if status != SolveStatus.SOLVED.value:
            failed.append(k)
        shown |= dict.fromkeys(record.get("shown", ()))
        cells = plan[k] | {"row": k, "run": name[:12], "status": status, "message": record["message"]}
        for column, entries in (table | last).items():
            entries.append(cells[column])
        for quantity, value in record["values"].items():
            if quantity not in cells:
                entries = measured.setdefault(quantity, [])
                entries += [None] * (done - len(entries))  # rows before this one do not have it
                entries.append(value)
        done += 1
    for entries in measured.values():
        entries += [None] * (done - len(entries))
    table, quantities = table | measured | last, list(measured)
    for name in show:
        if name not in quantities:
            raise ArgumentError(f"there is no quantity '{name}'; there are {', '.join(quantities) or 'none'}", "show")
    picked = list(show) or sorted(quantities, key=lambda name: (name in _OF_SOLVER, name not in shown))
    checks = {}
    if done == len(names):
        first = ""
        if failed:
            at = table["row"].index(failed[0])
            keys = ", ".join(f"{key} = {table[key][at]}" for key in plan.keys)
            first = f"row {failed[0]} ({keys}): {table['status'][at]}: {table['message'][at]}"
        checks = {"rows_failed": at_most(float(len(failed)), 0.0, first)}
    status = SolveStatus.SOLVED if done == len(names) else SolveStatus.INTERRUPTED
    left = f"{done} of {len(names)} rows are done"
    if store.kept:
        left += "; the same call with the same folder runs the others"
    return Sweep(
        status=status, message="" if status.ok else left, title=title, rows_declared=len(names), rows_done=done,
        rows_solved=done - len(failed), failed=failed, keys=plan.keys, table=table, checks=checks,
        files={TABLE: csv_of(table)}, figures={"sweep": partial(_figure, plan.keys, table, picked, bool(show), title)},
    )  # fmt: skip


def _figure(keys: Sequence[str], table: Mapping[str, Sequence[Any]], picked: list[str], named: bool, title: str) -> Any:
    from ..plot.sweep import sweep_figure

    return sweep_figure(keys, table, picked, most=len(picked) if named else CURVES, title=title)


def csv_of(table: Mapping[str, Sequence[Any]]) -> str:
    """Return the table as CSV: numbers with all their digits, an empty cell for None."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows([_cell(x) for x in row] for row in zip(*table.values(), strict=True))
    return text.getvalue()


def parquet_of(table: Mapping[str, Sequence[Any]]) -> bytes:
    """Return the table as Parquet; a column with texts and numbers becomes texts. Raises ArgumentError without
    pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ArgumentError(f"needs pyarrow ({error}): pip install 'gtmodel[logs]'", "parquet") from error
    columns = {}
    for name, values in table.items():
        try:
            columns[name] = pyarrow.array(values)
        except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError):
            columns[name] = pyarrow.array([None if x is None else str(_cell(x)) for x in values])
    file = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), file)
    return file.getvalue()


def _cell(x: Any) -> Any:
    if isinstance(x, bool):
        return "true" if x else "false"
    return json.dumps(x) if isinstance(x, (list, tuple, dict)) else x


@contextmanager
def _opened(place: Path | None, own: Path | None, described: Mapping[str, Any]) -> Iterator[Held | None]:
    """Make the folder ours and hold it, or only the folder of this part."""
    if place is None or own is None:
        yield None
        return
    if own == place:
        with written.held(place, lambda _: None) as held:
            _declared(held, described)
            yield held
        return
    with _patiently(place) as held:
        _declared(held, described)
    with written.held(own, lambda _: None) as held:
        yield held


@contextmanager
def _patiently(place: Path) -> Iterator[Held]:
    """Hold a folder that other parts open at the same time, each for a moment."""
    until = time.monotonic() + _OPEN_S
    while True:
        try:
            with written.held(place, lambda _: None) as held:
                yield held
                return
        except ArgumentError as error:
            if not isinstance(error.__cause__, FolderError) or time.monotonic() > until:
                raise
            time.sleep(0.05)


def _declared(held: Held, described: Mapping[str, Any]) -> None:
    """Write run.toml, unless it stands there: a run that is killed then leaves a folder that is ours."""
    if not (held.path / written.RUN).exists():
        written.put(held, {}, lambda files: written.record(described, None, files))
