"""Executors that other packages provide: Dask's, and any object with submit()."""

from __future__ import annotations

import concurrent.futures
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from typing import Any

from ..results.refusal import ArgumentError
from .task import DEATHS, Packed, Replies, dumps, packed, run, run_here

UNKNOWN = 64  # workers of an executor that does not tell their number
WAIT_S = 30.0  # for the scheduler to answer
CLOSED = "its scheduler or its workers were closed before the last row; start them"


class Elsewhere:
    """Runs a task with an executor, or on the cluster of a Dask client. The caller owns it; `close` leaves it open."""

    def __init__(self, task: Callable[[Any], Any], executor: Any) -> None:
        self._client, self._executor = None, executor
        if hasattr(executor, "get_executor"):  # a Dask client; Dask is not a dependency
            self._client = executor if hasattr(executor, "submit") else None
            self._executor = executor.get_executor()
        if not hasattr(self._executor, "submit"):
            raise ArgumentError(
                f"expected an object with submit(), such as concurrent.futures.Executor or a Dask client; "
                f"found {type(executor).__name__}",
                "executor",
            )
        self.size = _size(self._client, self._executor)
        self._number = count()
        self._remote: dict[Future[Replies], Any] = {}  # Dask's futures of the batches under way
        self._threads = isinstance(self._executor, ThreadPoolExecutor)
        self._task: Any = task if self._threads else packed(task)
        if self._client is not None:
            # once to each worker, not with every batch; a scattered value would be lost with the worker that holds it,
            # but the scheduler repeats a task
            self._task = self._client.submit(_same, self._task, pure=False)

    def packed(self, item: Any) -> Any:
        """Return an item as it is submitted."""
        return item if self._threads else dumps(item)

    def submit(self, items: Sequence[Any]) -> Future[Replies]:
        """Submit the packed items of a batch. Raises ArgumentError if the executor or the client was closed."""
        try:
            return self._submitted(items)
        except BrokenExecutor:
            raise
        except Exception as error:  # Dask has a class of its own
            raise ArgumentError(CLOSED, "executor") from error

    def _submitted(self, items: Sequence[Any]) -> Future[Replies]:
        if self._threads:
            return self._executor.submit(run_here, self._task, items)
        if self._client is None:
            return self._executor.submit(run, self._task, items)
        # the number tells equal batches apart: Dask answers a repeated call with the reply, or the death, of the first
        remote = self._client.submit(run, self._task, items, next(self._number), pure=False)
        future = Future[Any]()
        self._remote[future] = remote
        self._client.loop.add_callback(self._hand_over, future, remote)
        return future

    async def _hand_over(self, future: Future[Replies], remote: Any) -> None:
        """Wait for Dask's future; the futures of its own executor never end if a result is lost with its worker."""
        assert self._client is not None
        try:
            replies: Replies | None = await self._client.gather(remote, asynchronous=True)
            error = None
        except BaseException as caught:
            replies, error = None, caught
        self._remote.pop(future, None)
        if error is not None and self._client.status != "running":
            future.cancel()
        if not future.set_running_or_notify_cancel():
            return
        if replies is not None:
            future.set_result(replies)
        else:
            future.set_exception(error)

    def deaths(self, error: BaseException) -> int:
        """Return how many workers of this batch died if the error says so, else 0."""
        if type(error).__name__ == "KilledWorker":
            return DEATHS  # or more: the scheduler repeats a batch before it tells
        return int(isinstance(error, (CancelledError, concurrent.futures.CancelledError)))  # lost with its worker

    def close(self, *, now: bool) -> None:
        """Forget the task, and with `now` the batches under way."""
        if now and self._client is not None and self._remote:
            self._client.cancel(list(self._remote.values()))
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
