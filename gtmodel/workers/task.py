"""What travels to a worker and back: the task once, then an item and its result as bytes."""

from __future__ import annotations

import hashlib
import pickle
import traceback
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from .._pickling import dumps
from .._version import __version__
from ..results.refusal import ArgumentError

KEPT = 4  # tasks that a worker keeps unpacked, with everything that they have compiled


class Packed(NamedTuple):
    """A task as bytes, with the hash under which a worker keeps it and the version of gtmodel that packed it."""

    content: bytes
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


def run(task: Packed, item: bytes, number: int = 0) -> bytes:
    """Run the task in a worker and return the pickled reply: True and the result, or False and the error.

    `number` only makes two calls with equal items different.
    """
    try:
        value = unpacked(task)(pickle.loads(item))
    except Exception as error:
        return dumps((False, _portable(error)))
    try:
        return dumps((True, value))
    except Exception as error:
        return dumps((False, TypeError(f"the result cannot be sent back ({type(error).__name__}: {error})")))


def run_here(task: Callable[[Any], Any], item: Any) -> tuple[bool, Any]:
    """Run the task in a thread of this process and return the reply."""
    try:
        return True, task(item)
    except Exception as error:
        return False, error


def unpacked(task: Packed) -> Callable[[Any], Any]:
    """Return the task; the last ones are kept. Raises RuntimeError if another version of gtmodel packed it."""
    if task.version != __version__:
        raise RuntimeError(
            f"this worker has gtmodel {__version__}, but the task comes from {task.version}; install one version on all"
        )
    if task.key not in _UNPACKED:
        _UNPACKED[task.key] = pickle.loads(task.content)
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
