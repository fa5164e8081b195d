"""What travels to a worker and back: the task once, then batches of rows and their results as bytes."""

from __future__ import annotations

import hashlib
import pickle
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .._pickling import dumps
from .._version import __version__
from ..results.refusal import ArgumentError

DEATHS = 3  # workers that a row may end before it is left out
KEPT = 4  # tasks that a worker keeps unpacked, with everything that they have compiled


class Packed(NamedTuple):
    """A task as bytes or the path of a file that contains them, with the hash under which a worker keeps it and the
    version of gtmodel that packed it."""

    content: bytes | str
    key: str
    version: str


def packed(task: Callable[[Any], Any]) -> Packed:
    """Pickle a task once for all workers. Raises ArgumentError if that is impossible."""
    try:
        content = dumps(task)
    except Exception as error:
        raise ArgumentError(
            f"cannot be sent to another process ({type(error).__name__}: {error}); expected a function, or "
            "functools.partial of one, whose values can be pickled",
            "task",
        ) from error
    return Packed(content, hashlib.sha256(content).hexdigest(), __version__)


_UNPACKED: OrderedDict[str, Callable[[Any], Any]] = OrderedDict()


Reply = tuple[bool, Any]  # True and the value, or False and the error
Replies = tuple[float, list[Any]]  # duration of a batch [s], and the reply to each of its rows


def run(task: Packed, items: Sequence[bytes], number: int = 0) -> Replies:
    """Run the task on the rows of a batch in a worker and return the pickled replies.

    `number` only makes two calls with equal items different.
    """
    begin = time.perf_counter()
    return _timed(begin, [_sent(_row(task, item)) for item in items])


def run_here(task: Callable[[Any], Any], items: Sequence[Any]) -> Replies:
    """Run the task on the rows of a batch in a thread of this process and return the replies."""
    begin = time.perf_counter()
    return _timed(begin, [attempted(task, item) for item in items])


def attempted(task: Callable[[Any], Any], item: Any) -> Reply:
    """Return True and the value, or False and the error; a task that calls sys.exit() ends only this item."""
    try:
        return True, task(item)
    except SystemExit as error:
        return False, RuntimeError(f"the task called sys.exit({error.code!r})")
    except Exception as error:
        return False, error


def _timed(begin: float, replies: list[Any]) -> Replies:
    return time.perf_counter() - begin, replies


def _row(task: Packed, item: bytes) -> Reply:
    try:
        answered, value = attempted(unpacked(task), pickle.loads(item))
    except Exception as error:  # of unpacking
        answered, value = False, error
    return answered, value if answered else _portable(value)


def _sent(reply: Reply) -> bytes:
    """Pickle a reply before the next row runs, which may change arrays that the task uses again."""
    try:
        return dumps(reply)
    except Exception as error:
        return dumps((False, TypeError(f"the result cannot be sent back ({type(error).__name__}: {error})")))


def unpacked(task: Packed) -> Callable[[Any], Any]:
    """Return the task; the last ones are kept. Raises RuntimeError if another version of gtmodel packed it."""
    if task.version != __version__:
        raise RuntimeError(
            f"this worker has gtmodel {__version__}, but the task comes from {task.version}; install one version on all"
        )
    if task.key not in _UNPACKED:
        content = task.content if isinstance(task.content, bytes) else Path(task.content).read_bytes()
        _UNPACKED[task.key] = pickle.loads(content)
        while len(_UNPACKED) > KEPT:
            _UNPACKED.popitem(last=False)
    return _UNPACKED[task.key]


def _portable(error: Exception) -> Exception:
    """The error itself if it survives pickling, else a RuntimeError with its type and text; with its traceback."""
    try:
        again = pickle.loads(dumps(error))
        same = type(again) is type(error) and str(again) == str(error)
    except Exception:
        same = False
    sent = error if same else RuntimeError(f"{type(error).__name__}: {error}")
    sent.add_note("".join(traceback.format_exception(error)))
    return sent
