"""Run a task for each item in worker processes, on a cluster or here."""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from typing import Any

from ..results.refusal import ArgumentError
from ..results.work import never
from .cluster import Elsewhere
from .processes import Processes, usable_cores

LOOK = 0.2  # s between calls of `stop`
AHEAD = 2  # submitted items per worker: one at work and one waiting, so that a death repeats few
EARLY = 16  # results per worker that may wait for an earlier one
DEATHS = 3  # workers that an item may end before it is left out
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

    The results do not depend on where the tasks run: worker processes have one BLAS thread each. A worker that dies is
    replaced, and the items under way are repeated one at a time; an item that ended three workers yields WorkerDied as
    its error. A caller that ends the iteration, Ctrl-C, and `stop` returning True end the workers.

    Args:
        task: any function whose values can be pickled, also one of a notebook. It is sent once to each worker.
        items: read as needed; each is pickled.
        workers: number of processes; 0 for this process, None for one per usable core.
        executor: runs the tasks instead: an object with submit() as in concurrent.futures.Executor, or a Dask client.
        stop: called at least every 0.2 s; True ends the iteration.
        ordered: yield in the order of the items, else as they are done.

    Raises ArgumentError if the task cannot be pickled.

    >>> [done.value for done in gt.workers.each(abs, [-3, 4])]
    [3, 4]
    """
    if workers is not None and workers < 0:
        raise ArgumentError(f"expected a number of processes, at least 0; found {workers}", "workers")
    count = usable_cores() if workers is None else workers
    if executor is None and count == 0:
        return _here(task, items, stop)
    crew = Processes(task, count) if executor is None else Elsewhere(task, executor)
    return _handed_out(crew, items, stop, ordered)


def _here(task: Callable[[Any], Any], items: Iterable[Any], stop: Callable[[], bool]) -> Generator[Done, None, None]:
    for index, item in enumerate(items):
        if stop():
            return
        try:
            done = Done(index, task(item))
        except Exception as error:
            done = Done(index, error=error)
        yield done


@dataclass(slots=True)
class _Row:
    index: int
    item: Any
    deaths: int = 0
    alone: bool = False  # submitted with no other row under way


def _handed_out(
    crew: Processes | Elsewhere, items: Iterable[Any], stop: Callable[[], bool], ordered: bool
) -> Generator[Done, None, None]:
    whole = False
    rest = (_Row(index, item) for index, item in enumerate(items))
    again: deque[_Row] = deque()  # not accepted by a broken pool
    suspects: deque[_Row] = deque()  # under way when a worker died: repeated one at a time
    waiting: dict[Future[Any], _Row] = {}
    early: dict[int, Done] = {}
    following = 0  # the next index in order
    try:
        while not stop():
            room = again or len(early) < EARLY * crew.size
            while not suspects and room and len(waiting) < AHEAD * crew.size:
                row = again.popleft() if again else next(rest, None)
                if row is None or not _accepted(crew, row, waiting, again):
                    break
            if suspects and not waiting:
                suspects[0].alone = True
                _accepted(crew, suspects.popleft(), waiting, suspects)
            if waiting:
                finished = _finished(crew, waiting, suspects)
            elif again or suspects:
                continue
            else:
                whole = True
                return
            if not ordered:
                yield from finished
                continue
            early |= {done.index: done for done in finished}
            while following in early:
                yield early.pop(following)
                following += 1
    finally:
        for future in waiting:
            future.cancel()
        crew.close(now=not whole)


def _accepted(
    crew: Processes | Elsewhere, row: _Row, waiting: dict[Future[Any], _Row], refused: deque[_Row]
) -> bool:  # fmt: skip
    """Submit a row; if the pool is broken, put the row back and, if it has nothing else to tell, replace the pool."""
    try:
        waiting[crew.submit(row.item)] = row
    except BrokenExecutor:
        if isinstance(crew, Elsewhere):
            raise
        refused.appendleft(row)
        if not waiting:
            crew.replace()
        return False
    return True


def _finished(crew: Processes | Elsewhere, waiting: dict[Future[Any], _Row], suspects: deque[_Row]) -> list[Done]:
    """Wait a moment and take the finished rows out of `waiting`; rows whose worker died become suspects."""
    ready, _ = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
    if isinstance(crew, Processes) and any(_lost(crew, future) for future in ready):
        ready, _ = wait(waiting)  # the whole pool is broken; what was done before counts
    finished, dead = list[Done](), list[_Row]()
    for future in sorted(ready, key=lambda f: waiting[f].index):
        row = waiting.pop(future)
        if _lost(crew, future):
            row.deaths += 1
            dead.append(row)
            continue
        if future.cancelled():
            raise ArgumentError("its scheduler or its workers were closed before the last row; start them", "executor")
        reply = future.result()
        answered, value = pickle.loads(reply) if isinstance(reply, bytes) else reply
        finished.append(Done(row.index, value) if answered else Done(row.index, error=value))
    if dead and isinstance(crew, Processes):
        crew.replace()
    for row in dead:
        # a scheduler has counted the deaths, but of all rows that a dying worker was to run
        if row.alone and (isinstance(crew, Elsewhere) or row.deaths >= DEATHS):
            finished.append(Done(row.index, error=WorkerDied(_LEFT_OUT)))
        else:
            suspects.append(row)
    return finished


def _lost(crew: Processes | Elsewhere, future: Future[Any]) -> bool:
    return not future.cancelled() and (error := future.exception()) is not None and crew.lost(error)
