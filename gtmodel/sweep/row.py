"""One row of a sweep: run it, and keep its record under a name made of its content and the versions."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from ..results import written
from ..results.as_json import plain
from ..results.disk import write_whole
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from ..results.study import Study

VECTOR = 6  # the longest vector whose entries become columns
TEXT = 80  # the longest text that becomes a cell
Record = dict[str, Any]


@runtime_checkable
class Keyed(Protocol):
    """A study that is described by data, such as a problem file, and so can be resumed."""

    @property
    def identity(self) -> str:
        """All that the result depends on, besides the varied keys and the files that a row reads."""
        ...

    def run(self, keys: Mapping[str, Any], folder: Path | None) -> tuple[Study, Mapping[str, Path]]:
        """Run with these keys, write the result into a folder if there is one, and return it with the files read.

        Raises ArgumentError for keys that are refused.
        """
        ...


Task = Callable[..., Any] | Keyed


def ran(task: Task, item: tuple[dict[str, Any], Path | None]) -> Record:
    """Run one row in a worker and return its record."""
    keys, folder = item
    inputs: Mapping[str, Path] = {}
    try:
        if isinstance(task, Keyed):
            result, inputs = task.run(keys, folder)
        else:
            result = task(**keys)
            if folder is not None and isinstance(result, Study):
                result.write(folder)
    except ArgumentError as error:
        return {"status": SolveStatus.BAD_INPUT.value, "message": " ".join(str(error).split()), "values": {}}
    files = {str(path): written.sha256_of_file(path) for path in inputs.values()}
    return _record(result) | ({"inputs": files} if files else {})


def _record(result: Any) -> Record:
    if isinstance(result, Study):
        numbers = {"objective": result.objective, "iterations": result.iterations, **result.values}
        values = dict(cells({name: plain(value) for name, value in numbers.items() if name != "notes"}))
        shown = [q.name(attribute) for attribute, q in result.quantities().items() if q.label]
        return {"status": result.status.value, "message": result.message, "values": values, "shown": shown}
    numbers = result if isinstance(result, Mapping) else {"value": result}
    values = dict(cells({str(name): plain(value) for name, value in numbers.items()}))
    return {"status": SolveStatus.SOLVED.value, "message": "", "values": values}


def cells(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the numbers and short texts among JSON values: "mean.x" of a dictionary, "force_N[0]" of a short vector."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from cells(value, f"{before}{name}.")
        elif isinstance(value, list):
            if 0 < len(value) <= VECTOR and all(isinstance(x, (int, float)) for x in value):
                yield from ((f"{before}{name}[{k}]", x) for k, x in enumerate(value))
        elif value is not None and not (isinstance(value, str) and len(value) > TEXT):
            yield f"{before}{name}", value


class Store:
    """Records of rows: files of a folder, each written by renaming, or memory if there is no folder.

    A record is found again only for the same keys, task and versions, and if the files that its row read are unchanged.
    """

    def __init__(self, folder: Path | None, identity: str) -> None:
        self._folder, self._memory = folder, dict[str, Record]()
        versions = {name: v for name, v in written.versions().items() if name != "platform"}
        self._same = json.dumps([identity, versions], sort_keys=True)

    @property
    def kept(self) -> bool:
        """Whether a later call finds the records."""
        return self._folder is not None

    def name(self, keys: Mapping[str, Any]) -> str:
        """Return the name of a row: a hash of its content and the versions."""
        text = self._same + json.dumps(plain(keys), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def put(self, name: str, record: Record, *, again: bool = False) -> None:
        """Keep a record; `again` only in memory, so that a later call repeats its row."""
        if self._folder is None or again:
            self._memory[name] = record
            return
        path, data = self._path(name), (json.dumps(record, ensure_ascii=False) + "\n").encode()
        try:
            write_whole(path, data, overwrite=True)
        except FileNotFoundError:  # the first one of its folder
            os.makedirs(os.path.dirname(path), exist_ok=True)
            write_whole(path, data, overwrite=True)

    def get(self, name: str) -> Record | None:
        """Return the record of a row that is done; None if there is none."""
        if name in self._memory or self._folder is None:
            return self._memory.get(name)
        try:
            with open(self._path(name), "rb") as file:
                record = json.loads(file.read())
        except (FileNotFoundError, ValueError):
            return None
        except OSError as error:
            raise ArgumentError(f"{self._path(name)} cannot be read: {error.strerror}", "folder") from error
        if not isinstance(record, dict) or not {"status", "message", "values"} <= record.keys():
            return None  # written by something else
        same = all(_unchanged(path, digest) for path, digest in record.get("inputs", {}).items())
        return record if same else None

    def _path(self, name: str) -> str:
        return f"{self._folder}/{name[:2]}/{name}.json"  # a Path costs more than the file


@cache
def _sha256_once(path: str, mtime_ns: int, size: int) -> str:
    return written.sha256_of_file(Path(path))


def _unchanged(path: str, digest: str) -> bool:
    try:
        seen = Path(path).stat()
    except OSError:
        return False
    return _sha256_once(path, seen.st_mtime_ns, seen.st_size) == digest
