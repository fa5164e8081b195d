"""Many independent runs by seed, in parallel processes with one BLAS thread each."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..results.refusal import ArgumentError
from ..results.work import parents_signals

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
LOOK = 0.2  # s between looks at `interrupted`
AHEAD = 4  # runs handed out per process beyond those at work: little is left to cancel

Task = Callable[[np.random.Generator, int], Any]


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Results of the runs that ended, in the order of their numbers `indices`; all of them unless `interrupted`."""

    results: tuple[Any, ...]
    indices: tuple[int, ...]
    runs: int
    seed: int
    interrupted: bool


def monte_carlo(
    task: Task,
    runs: int,
    seed: int,
    *,
    processes: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    interrupted: Callable[[], bool] | None = None,
    executor: Any = None,
) -> MonteCarlo:
    """Call task(rng, k) for k = 0..runs-1, each with its own generator spawned from `seed`.

    The results are the same for any number of `processes`: by default one per core; 0 runs all in this process (and
    its BLAS threads), for looking inside. For other processes the task must be importable: a function of a module, or
    functools.partial of one. `executor` is something else to hand the runs to, with submit() as
    concurrent.futures.Executor has it, or a Dask client, whose get_executor() is called. `progress(done, runs)` is
    called after each run. Ctrl-C, or `interrupted()` returning True, ends the workers and returns what is done; workers
    leave Ctrl-C and SIGTERM to this process, and end with it.

    Raises ArgumentError for fewer than one run, RuntimeError naming the run in which the task failed.

    >>> def run(rng, k):
    ...     return rng.normal()
    >>> ended = gt.inference.monte_carlo(run, 3, seed=1, processes=0)
    >>> ended.indices, np.round(ended.results, 2)
    ((0, 1, 2), array([-0.64,  2.49,  1.44]))
    """
    if runs < 1:
        raise ArgumentError(f"a Monte Carlo needs at least one run; found {runs}")
    seeds = np.random.SeedSequence(seed).spawn(runs)
    if hasattr(executor, "get_executor"):  # a client of Dask, which is no dependency
        executor = executor.get_executor()
    if executor is None and processes == 0:
        return _here(task, seeds, seed, progress, interrupted)
    if executor is not None:
        return _handed_out(executor, 64, task, seeds, seed, progress, interrupted)
    count = max(1, min(runs, processes if processes is not None else os.cpu_count() or 1))
    with _one_thread():
        # spawn: a forked process would inherit locks and BLAS threads
        pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _follow_the_parent)
        whole = False
        try:
            ended = _handed_out(pool, count, task, seeds, seed, progress, interrupted)
            whole = not ended.interrupted
            return ended
        finally:
            if not whole:  # a run at work has no other end; Python 3.14 has terminate_workers() for this
                for process in list((pool._processes or {}).values()):
                    process.kill()
            pool.shutdown(wait=True, cancel_futures=True)


def _here(task: Task, seeds: list[np.random.SeedSequence], seed: int, progress: Callable[[int, int], object] | None,
          interrupted: Callable[[], bool] | None) -> MonteCarlo:  # fmt: skip
    results: dict[int, Any] = {}
    stopped = False
    try:
        for k, s in enumerate(seeds):
            if interrupted is not None and interrupted():
                stopped = True
                break
            results[k] = _named(k, lambda k=k, s=s: _run(task, s, k))
            if progress is not None:
                progress(len(results), len(seeds))
    except KeyboardInterrupt:
        stopped = True
    return MonteCarlo(tuple(results.values()), tuple(results), len(seeds), seed, stopped)


def _handed_out(
    pool: Executor,
    workers: int,
    task: Task,
    seeds: list[np.random.SeedSequence],
    seed: int,
    progress: Callable[[int, int], object] | None,
    interrupted: Callable[[], bool] | None,
) -> MonteCarlo:
    results: dict[int, Any] = {}
    waiting: dict[Future[Any], int] = {}
    rest = iter(enumerate(seeds))
    stopped = False
    try:
        while True:
            while len(waiting) < AHEAD * workers and (following := next(rest, None)) is not None:
                k, s = following
                with parents_signals():  # submitting starts workers
                    waiting[pool.submit(_run, task, s, k)] = k
            if not waiting:
                break
            done, _ = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=lambda f: waiting[f]):
                k = waiting.pop(future)
                results[k] = _named(k, future.result)
                if progress is not None:
                    progress(len(results), len(seeds))
            if interrupted is not None and interrupted():
                stopped = True
                break
    except KeyboardInterrupt:
        stopped = True
    finally:
        for future in waiting:
            future.cancel()
    indices = tuple(sorted(results))
    return MonteCarlo(tuple(results[k] for k in indices), indices, len(seeds), seed, stopped)


def _run(task: Task, seed: np.random.SeedSequence, k: int) -> Any:
    return task(np.random.default_rng(seed), k)


def _named(k: int, run: Callable[[], Any]) -> Any:
    try:
        return run()
    except Exception as error:
        raise RuntimeError(f"run {k}: {type(error).__name__}: {error}") from error


def _follow_the_parent() -> None:
    """A worker ends when its parent says so, or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Windows has no mask that it would inherit
    parent = multiprocessing.parent_process()

    def watch() -> None:
        assert parent is not None
        parent.join()
        os._exit(1)

    if parent is not None:
        threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _one_thread() -> Iterator[None]:
    """BLAS reads its thread count once, when it is loaded: processes started meanwhile take one."""
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
