"""Run a task for each item in worker processes, on a cluster or here."""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from ..results.refusal import ArgumentError
from ..results.work import never
from .cluster import CLOSED, Elsewhere
from .processes import Pool, Processes, count_of
from .task import DEATHS, Replies, attempted

LOOK = 0.2  # s between calls of `stop`
AHEAD = 2  # submitted batches per worker: one at work and one waiting, so that a death repeats few
EARLY = 16  # batches per worker whose results may wait for an earlier one
BATCH_S, MOST = 0.2, 4096  # s, for which rows are sent together, and the largest number of them
_LEFT_OUT = f"ended {DEATHS} workers or more without an answer, perhaps for want of memory; it was left out"


class WorkerDied(RuntimeError):
    """The workers that ran this item ended without an answer."""


@dataclass(frozen=True, slots=True)
class Done:
    """The result of the item `index`, counted from 0; or its error, and then the value is None."""

    index: int
    value: Any = None
    error: Exception | None = None


def each(
    task: Callable[[Any], Any],
    items: Iterable[Any],
    *,
    workers: int | None = 0,
    executor: Any = None,
    stop: Callable[[], bool] = never,
    ordered: bool = True,
) -> Generator[Done, None, None]:
    """Call task(item) for each item and yield the results one by one; few items are under way at a time.

    The results do not depend on where the tasks run: worker processes have one BLAS thread each. Short items are sent
    in batches of about 0.2 s. A worker that dies is replaced, and the batches under way are repeated one at a time, a
    batch that ends a worker again item by item; an item that ended three workers yields WorkerDied as its error. A
    caller that ends the iteration, Ctrl-C, and `stop` returning True end the workers; sys.exit() ends only its item.

    Args:
        task: any function whose values can be pickled, also one of a notebook. It is sent once to each worker.
        items: read as needed; each is pickled.
        workers: number of processes; 0 for this process, None for one per usable core.
        executor: runs the tasks instead: an object with submit() as in concurrent.futures.Executor, or a Dask client.
        stop: called at least every 0.2 s; True ends the iteration.
        ordered: yield in the order of the items, else as they are done.

    Raises ArgumentError for a wrong number of processes, and if the task cannot be pickled.

    >>> [done.value for done in gt.workers.each(abs, [-3, 4])]
    [3, 4]
    """
    count = count_of(workers)
    if executor is None and count == 0:
        return _here(task, items, stop)
    crew = Processes(task, Pool(count)) if executor is None else Elsewhere(task, executor)
    return handed_out(crew, items, stop, ordered)


def _here(task: Callable[[Any], Any], items: Iterable[Any], stop: Callable[[], bool]) -> Generator[Done, None, None]:
    for index, item in enumerate(items):
        if stop():
            return
        answered, value = attempted(task, item)
        yield Done(index, value) if answered else Done(index, error=value)


@dataclass(slots=True)
class _Batch:
    """Rows that are sent together: their indices and packed items."""

    indices: list[int]
    items: list[Any]
    deaths: int = 0
    alone: bool = False  # submitted with no other batch under way

    def rows(self) -> Iterator[_Batch]:
        """Yield each row as a batch of its own."""
        for index, item in zip(self.indices, self.items, strict=True):
            yield _Batch([index], [item], self.deaths)


@dataclass(slots=True)
class _Handout:
    """Batches on their way through the workers. rows: size of the next batch, at most twice that of a finished one."""

    crew: Processes | Elsewhere
    rest: Iterator[tuple[int, Any]]
    rows: int = 1
    ended: bool = False  # all items are read
    again: deque[_Batch] = field(default_factory=deque)  # not accepted by a broken pool
    suspects: deque[_Batch] = field(default_factory=deque)  # under way when a worker died: repeated one at a time
    waiting: dict[Future[Replies], _Batch] = field(default_factory=dict)

    def fill(self) -> None:
        """Submit batches until each worker has one at work and one waiting."""
        while not self.suspects and len(self.waiting) < AHEAD * self.crew.size:
            batch = self.again.popleft() if self.again else self._next()
            if not batch.indices or not self._accepted(batch, self.again):
                break
        if self.suspects and not self.waiting:
            self.suspects[0].alone = True
            self._accepted(self.suspects.popleft(), self.suspects)

    def _next(self) -> _Batch:
        rows = [(index, self.crew.packed(item)) for index, item in islice(self.rest, self.rows)]
        self.ended = len(rows) < self.rows
        return _Batch([index for index, _ in rows], [item for _, item in rows])

    def _accepted(self, batch: _Batch, refused: deque[_Batch]) -> bool:
        """Submit a batch; if the pool is broken, put it back and, if the pool has nothing else to tell, replace it."""
        try:
            self.waiting[self.crew.submit(batch.items)] = batch
        except BrokenExecutor:
            if isinstance(self.crew, Elsewhere):
                raise
            refused.appendleft(batch)
            if not self.waiting:
                self.crew.replace()
            return False
        return True

    def finished(self) -> list[Done]:
        """Wait a moment and take the finished batches out of `waiting`; those whose worker died become suspects."""
        crew, waiting = self.crew, self.waiting
        ready, _ = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
        if isinstance(crew, Processes) and any(_deaths(crew, future) for future in ready):
            ready, _ = wait(waiting)  # the whole pool is broken; what was done before counts
        finished, dead = list[Done](), list[_Batch]()
        for future in sorted(ready, key=lambda f: waiting[f].indices[0]):
            batch = waiting.pop(future)
            if deaths := _deaths(crew, future):
                batch.deaths += deaths if batch.alone else 1  # perhaps another batch ended the worker
                dead.append(batch)
                continue
            if future.cancelled():
                raise ArgumentError(CLOSED, "executor")
            seconds, replies = future.result()
            fitting = int(BATCH_S * len(replies) / max(seconds, 1e-9))
            self.rows = max(1, min(fitting, 2 * len(replies), MOST))
            for index, reply in zip(batch.indices, replies, strict=True):
                answered, value = pickle.loads(reply) if isinstance(reply, bytes) else reply
                finished.append(Done(index, value) if answered else Done(index, error=value))
        if dead and isinstance(crew, Processes):
            crew.replace()
        for batch in dead:
            if not batch.alone:
                self.suspects.append(batch)
            elif len(batch.indices) > 1:
                self.suspects.extend(batch.rows())
            elif batch.deaths >= DEATHS:
                finished.append(Done(batch.indices[0], error=WorkerDied(_LEFT_OUT)))
            else:
                self.suspects.append(batch)
        return finished


def handed_out(
    crew: Processes | Elsewhere, items: Iterable[Any], stop: Callable[[], bool], ordered: bool
) -> Generator[Done, None, None]:
    """Yield the results of a crew; `close` it at the end, at once unless all rows are done."""
    handout = _Handout(crew, iter(enumerate(items)))
    early: dict[int, Done] = {}
    following = 0  # the next index in order
    try:
        while not stop():
            if len(early) < EARLY * crew.size * handout.rows or handout.again or handout.suspects:
                handout.fill()
            if handout.waiting:
                finished = handout.finished()
            elif handout.again or handout.suspects:
                continue
            else:
                return
            if not ordered:
                yield from finished
                continue
            early |= {done.index: done for done in finished}
            while following in early:
                yield early.pop(following)
                following += 1
    finally:
        for future in handout.waiting:
            future.cancel()
        crew.close(now=not handout.ended or bool(handout.waiting or handout.again or handout.suspects))


def _deaths(crew: Processes | Elsewhere, future: Future[Any]) -> int:
    error = None if future.cancelled() else future.exception()
    return 0 if error is None else crew.deaths(error)
