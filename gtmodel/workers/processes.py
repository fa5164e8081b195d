"""Worker processes of this machine: spawned, one BLAS thread each, replaced when they die, ended with their parent."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Annotated, Any

from ..results.agreement import Within, agree
from ..results.work import parents_signals
from .task import Replies, dumps, packed, run

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
LARGE = 2**20  # bytes of a task
_inside = False  # in a worker


def usable_cores() -> int:
    """Return the number of cores that this process may use; 0 in a worker, which starts no workers of its own.

    >>> gt.workers.usable_cores() >= 1
    True
    """
    if _inside:
        return 0
    if hasattr(os, "sched_getaffinity"):  # fewer than the machine's under taskset and in batch systems
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def count_of(workers: int | None) -> int:
    """Return the number of processes that an argument `workers` asks for. Raises ArgumentError."""
    agree(workers, Annotated[int | None, Within(least=0)], "workers")
    return usable_cores() if workers is None else workers


class NotStarted(RuntimeError):
    """Worker processes end before their first task."""


class Pool:
    """`size` processes, which start with the first task. `replace` starts new ones if one has died."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.open = True
        # spawn, since a forked process would inherit locks and BLAS threads
        context = multiprocessing.get_context("spawn")
        main = sys.modules["__main__"]
        if not hasattr(main, "__spec__"):  # multiprocessing reads it; %reset of a notebook removes it
            main.__spec__ = None
        self._pool = ProcessPoolExecutor(size, context, _begin)
        self._probe = self.submit(_ready)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit one call. Raises BrokenExecutor if a worker has died."""
        if len(self._pool._processes or ()) >= self.size:
            return self._pool.submit(function, *arguments)
        with _one_thread(), parents_signals():  # submitting starts workers
            return self._pool.submit(function, *arguments)

    def replace(self) -> None:
        """Replace all workers: after a death the others of the pool have been ended too.

        Raises NotStarted if no worker has begun.
        """
        if not self._probe.done() or self._probe.exception() is not None:
            raise NotStarted(
                "the worker processes ended before their first task; a script that starts workers must do so below "
                "if __name__ == '__main__':, because each worker imports the script"
            )
        self.close(now=True)
        self.__init__(self.size)  # type: ignore[misc]

    def close(self, *, now: bool = False) -> None:
        """End the workers; `now` also in the middle of a task."""
        self.open = False
        if now:  # there is no other way to end a running task; Python 3.14 has kill_workers()
            for process in list((self._pool._processes or {}).values()):
                process.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)


class Processes:
    """Runs a task in the processes of a pool, and closes the pool at the end unless it is `kept`."""

    def __init__(self, task: Callable[[Any], Any], pool: Pool, *, kept: bool = False) -> None:
        self.size = pool.size
        self._pool, self._kept, self._file = pool, kept, ""
        self._task = packed(task)
        if len(self._task.content) > LARGE:  # once to the disk, not with every batch through a pipe
            number, self._file = tempfile.mkstemp(prefix="gtmodel-task-")
            with open(number, "wb") as file:
                file.write(self._task.content)  # type: ignore[arg-type]
            self._task = self._task._replace(content=self._file)

    def packed(self, item: Any) -> bytes:
        """Return an item as it is submitted."""
        return dumps(item)

    def submit(self, items: Sequence[bytes]) -> Future[Replies]:
        """Submit the packed items of a batch. Raises BrokenExecutor if a worker has died."""
        return self._pool.submit(run, self._task, items)

    def deaths(self, error: BaseException) -> int:
        """Return 1 if the error says that a worker died, else 0."""
        return int(isinstance(error, BrokenExecutor))

    def replace(self) -> None:
        """Replace all workers."""
        self._pool.replace()

    def close(self, *, now: bool) -> None:
        """End the workers, unless they are kept; `now` in any case, also in the middle of a task."""
        if now or not self._kept:
            self._pool.close(now=now)
        if self._file:
            os.unlink(self._file)


def _begin() -> None:
    global _inside
    _inside = True
    _follow_the_parent()


def _ready() -> None:
    """Do nothing: the first task of a pool shows that its workers can start."""


def _follow_the_parent() -> None:
    """End a worker when its parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Windows has no signal mask to inherit
    parent = multiprocessing.parent_process()

    def watch() -> None:
        assert parent is not None
        parent.join()
        os._exit(1)

    if parent is not None:
        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes started in this context use one BLAS thread: BLAS reads its thread count once, when it is loaded."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
