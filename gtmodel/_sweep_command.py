"""``gtmodel sweep``: what the command line says as a design, and the sweep of a problem file."""

from __future__ import annotations

import csv
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel._crew import crew_of
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.load import Loaded, apply, load, refuse_twice
from gtmodel.problem_files.run import Finished, ProblemRows
from gtmodel.results import ArgumentError
from gtmodel.results.written import sha256
from gtmodel.sweep import LogUniform, Normal, OneOf, Uniform, study
from gtmodel.sweep.design import Distribution

CHECKED = 50  # values of a list that are checked before the work
_RANGE = re.compile(r"(?P<low>[^:,\[]+):(?P<high>[^:]+):(?P<number>\d+)")
_DRAWN = re.compile(r"(?P<name>uniform|loguniform|normal|choice)\((?P<rest>.*)\)", re.DOTALL)
_FORMS = (
    "expected key=a:b:n for n values from a to b, key=x,y,z for a list, a CSV file whose head names keys, or with "
    "--random key=uniform(a,b), loguniform(a,b), normal(mean,std) or choice(x,y)"
)
# argument of the library -> option
_OPTIONS = {
    "vary": "--vary", "rows": "--vary", "samples": "--random", "seed": "--seed", "method": "--design", "part": "--part",
    "show": "--show", "folder": "--out", "only_merge": "--merge",
    "parquet": "--parquet",
}  # fmt: skip


def run(
    loaded: Loaded, vary: Sequence[str], job: Context, *, out: Path | None, samples: int | None, seed: int, method: Any,
    part: str | None, merge: bool, runs: bool, plot: bool, parquet: bool, show: Sequence[str], workers: int | None,
    cluster: str | None,
) -> Finished:  # fmt: skip
    """Run a problem for every row and write the table into `out`. Raises InputError about an option."""
    values, rows = _varied(vary, samples or 0)
    keys = [*values, *(rows[0] if rows else ())]
    refuse_twice([*loaded.settings, *(f"{key}=" for key in keys)])
    task = ProblemRows(str(loaded.path.absolute()), loaded.settings, sha256(loaded.content))
    _check_first(loaded, task, values, rows)
    try:
        with crew_of(workers, cluster, all_cores=True), job.under_way():
            outcome = study(
                task, values, rows=rows, samples=samples or 0, seed=seed, method=method, part=_part(part),
                only_merge=merge, folder=out, keep_runs=runs, plot=plot, parquet=parquet, show=show,
                title=loaded.problem.heading, **job.work(),
            )  # fmt: skip
    except ArgumentError as error:
        option = _OPTIONS.get(error.argument, "")
        raise InputError(f"{option} {error.message}" if option else str(error)) from error
    place = None if out is None else out if part is None else out / _part_folder(part)
    files = sorted(p for p in place.iterdir() if p.is_file()) if place is not None else []
    return Finished(outcome, time.monotonic() - job.began, files)


def _varied(vary: Sequence[str], samples: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    values: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    for text in vary:
        key, equals, rest = (part.strip() for part in text.partition("="))
        if not equals:
            if rows:
                raise InputError(f"--vary {text}: a second file; expected one at most")
            rows = _rows_of(text)
        elif key in values:
            raise InputError(f"--vary {key} is given twice; leave one of them out")
        elif not key or not rest:
            raise InputError(f"--vary {text}: {_FORMS}")
        else:
            values[key] = _distribution(text, rest, samples) or _list(text, rest)
    return values, rows


def _distribution(text: str, rest: str, samples: int) -> Distribution | None:
    drawn = _DRAWN.fullmatch(rest)
    if drawn is None:
        return None
    if not samples:
        raise InputError(f"--vary {text}: give the number of samples with --random N")
    arguments = _list(text, drawn["rest"])
    kinds = {"uniform": Uniform, "loguniform": LogUniform, "normal": Normal}
    try:
        if drawn["name"] == "choice":
            return OneOf(tuple(arguments))
        return kinds[drawn["name"]](*map(float, arguments))
    except (TypeError, ValueError) as error:
        raise InputError(f"--vary {text}: {error}; {_FORMS}") from error


def _list(text: str, rest: str) -> list[Any]:
    if matched := _RANGE.fullmatch(rest):
        try:
            low, high, number = float(matched["low"]), float(matched["high"]), int(matched["number"])
        except ValueError:
            raise InputError(f"--vary {text}: {_FORMS}") from None
        if number < 1 or not np.isfinite([low, high]).all():
            raise InputError(f"--vary {text}: {_FORMS}")
        spaced = [float(x) for x in np.linspace(low, high, number)]
        whole = all(re.fullmatch(r"\s*[-+]?\d+\s*", matched[name]) for name in ("low", "high"))
        return [int(x) for x in spaced] if whole and all(x.is_integer() for x in spaced) else spaced
    listed = apply({}, [f"values=[{rest}]"])["values"]
    return listed if isinstance(listed, list) else [_one(part) for part in rest.split(",")]


def _one(text: str) -> Any:
    return apply({}, [f"value={text.strip()}"])["value"]


def _rows_of(name: str) -> list[dict[str, Any]]:
    try:
        with open(name, encoding="utf-8-sig", newline="") as file:
            lines = [line for line in csv.reader(file) if any(cell.strip() for cell in line)]
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "not UTF-8 text"
        raise InputError(f"--vary {name}: cannot be read ({why}); {_FORMS}") from error
    head, *rest = lines or [[]]
    keys = [cell.strip() for cell in head]
    if not rest or not all(keys) or len(set(keys)) < len(keys):
        raise InputError(f"--vary {name}: expected a line of different keys and at least one row of values")
    for number, line in enumerate(rest, 2):
        if len(line) != len(keys):
            raise InputError(f"--vary {name}: row {number} has {len(line)} cells; the head has {len(keys)} keys")
    return [dict(zip(keys, map(_one, line), strict=True)) for line in rest]


def _check_first(
    loaded: Loaded, task: ProblemRows, values: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Check the first row, and each other value of a short list in it, before the work. Raises InputError."""
    first: dict[str, Any] = dict(rows[0]) if rows else {}
    first |= {key: v[0] if isinstance(v, list) else v.at(0.5) for key, v in values.items()}
    others = [{**first, key: x} for key, v in values.items() if isinstance(v, list) for x in v[1:CHECKED]]
    for keys in [first, *others]:
        load(loaded.path, task.settings_of(keys))


def _part(text: str | None) -> tuple[int, int]:
    if text is None:
        return 1, 1
    numbers = re.fullmatch(r"(\d+)/(\d+)", text)
    if numbers is None or not 1 <= int(numbers[1]) <= int(numbers[2]):
        raise InputError(f"--part {text}: expected I/N with 1 <= I <= N, such as 3/10")
    return int(numbers[1]), int(numbers[2])


def _part_folder(text: str) -> str:
    i, n = _part(text)
    return "" if n == 1 else f"part-{i}-of-{n}"
