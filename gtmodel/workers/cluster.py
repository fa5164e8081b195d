"""Executors that other packages provide: Dask's, and any object with submit()."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from typing import Any

from ..results.refusal import ArgumentError
from .task import Packed, dumps, packed, run, run_here

UNKNOWN = 64  # workers of an executor that does not tell their number
WAIT_S = 30.0  # for the scheduler to answer


class Elsewhere:
    """Runs a task with an executor, or on the cluster of a Dask client. The caller owns it; `close` leaves it open."""

    def __init__(self, task: Callable[[Any], Any], executor: Any) -> None:
        client, self._executor = None, executor
        if hasattr(executor, "get_executor"):  # a Dask client; Dask is not a dependency
            client, self._executor = executor, executor.get_executor()
        if not hasattr(self._executor, "submit"):
            raise ArgumentError(
                f"expected an object with submit(), such as concurrent.futures.Executor or a Dask client; "
                f"found {type(executor).__name__}",
                "executor",
            )
        self.size = _size(client, self._executor)
        self._number = count()
        self._threads = isinstance(self._executor, ThreadPoolExecutor)
        self._task: Any = task if self._threads else packed(task)
        if client is not None and hasattr(client, "submit"):
            # once to each worker, not with every item; a scattered value would be lost with the worker that holds it,
            # but the scheduler repeats a task
            self._task = client.submit(_same, self._task, pure=False)

    def submit(self, item: Any) -> Future[Any]:
        """Submit one item."""
        if self._threads:
            return self._executor.submit(run_here, self._task, item)
        # the number tells equal rows apart: Dask answers a repeated call with the reply, or the death, of the first
        return self._executor.submit(run, self._task, dumps(item), next(self._number))

    def lost(self, error: BaseException) -> bool:
        """Return True if the error says that the workers of this item died, as often as the scheduler allows."""
        return type(error).__name__ == "KilledWorker"

    def close(self, *, now: bool) -> None:
        """Forget the task; pending items were cancelled before."""
        self._task = None


def _same(task: Packed) -> Packed:
    return task


def _size(client: Any, executor: Executor) -> int:
    if client is not None and hasattr(client, "nthreads"):
        return max(1, sum(client.nthreads().values()))
    return int(getattr(executor, "_max_workers", UNKNOWN))


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Connect to the Dask scheduler at `address`, such as "tcp://host:8786", and yield its client for `executor=`.

    A cluster runs pickled code: use clusters of trusted networks only. Raises ArgumentError if Dask is not installed,
    and if no scheduler answers.

    >>> with gt.workers.connected("tcp://127.0.0.1:8786") as client:  # doctest: +SKIP
    ...     study = gt.sweep.study(task, {"force": [500, 700]}, executor=client)
    """
    try:
        connect = import_module("distributed").Client
    except ImportError as error:
        raise ArgumentError(
            f"needs Dask ({error}); install it here and on the workers: pip install 'gtmodel[cluster]'", "cluster"
        ) from error
    try:
        client = connect(address, timeout=WAIT_S)
    except (OSError, ValueError, TypeError) as error:
        raise ArgumentError(
            f"no Dask scheduler answers at '{address}' ({' '.join(str(error).split())}); expected an address such as "
            "tcp://host:8786, which `dask scheduler` prints when it starts",
            "cluster",
        ) from error
    try:
        yield client
    finally:
        client.close()
