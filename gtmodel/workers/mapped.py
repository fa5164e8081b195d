"""The map inside studies: rows run where the caller of the study says."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, contextmanager
from itertools import chain, islice
from typing import Any, TypeVar

from ..results.work import CREW, Crew, never
from .each import Done, each, handed_out
from .processes import Pool, Processes, count_of

Item = TypeVar("Item")
Value = TypeVar("Value")


@contextmanager
def using(workers: int | None = None, executor: Any = None) -> Iterator[Crew]:
    """Let `mapped`, and so all studies and functions with independent rows, run these in workers inside the block.

    workers: number of processes; 0 for this process, None for one per usable core. executor: runs the rows instead: an
    object with submit(), or a Dask client. A study called with `workers=` or `executor=` runs its own rows there.
    Raises ArgumentError for a wrong number of processes.

    >>> with gt.workers.using(workers=0):
    ...     sizes = list(gt.workers.mapped(abs, [-3, 4]))
    >>> sizes
    [3, 4]
    """
    count_of(workers)
    crew = Crew(workers, executor)
    before = CREW.set(crew)
    try:
        yield crew
    finally:
        CREW.reset(before)
        crew.close()


def mapped(
    task: Callable[[Item], Value],
    items: Iterable[Item],
    *,
    here: Callable[[Item], Value] | None = None,
    waiting: Callable[[], bool] = never,
) -> Generator[Value, None, None]:
    """Call task(item) for each item and yield the values in the order of the items, as `map` does.

    Rows run in this process unless the running study, or `using`, names workers; the values are the same. Ends the
    workers if the caller ends the iteration, and raises the error of the first row that fails.

    here: the task in this process, such as the same one with progress. waiting: called every 0.2 s while workers run;
    True ends the iteration. Without workers only the caller can end it.

    >>> list(gt.workers.mapped(abs, [-3, 4]))
    [3, 4]
    """
    crew = CREW.get()
    if crew is None or (crew.executor is None and count_of(crew.workers) == 0):
        yield from map(here or task, items)
        return
    rows = iter(items)
    first = list(islice(rows, 2))
    if len(first) < 2:  # nothing to share
        yield from map(here or task, first)
        return
    with closing(shared(crew, task, chain(first, rows), waiting)) as finished:
        for done in finished:
            if done.error is not None:
                raise done.error
            yield done.value


def shared(
    crew: Crew, task: Callable[[Any], Any], items: Iterable[Any], stop: Callable[[], bool], *, ordered: bool = True
) -> Generator[Done, None, None]:
    """Run rows with a crew as `each` does, in processes that are kept for the next map of the study."""
    crew.used = True
    size = count_of(crew.workers)
    if crew.executor is not None or size == 0:
        return each(task, items, workers=size, executor=crew.executor, stop=stop, ordered=ordered)
    if crew.pool is None or not crew.pool.open:
        crew.pool = Pool(size)  # to start a process takes a second
    return handed_out(Processes(task, crew.pool, kept=True), items, stop, ordered)
