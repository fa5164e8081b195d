"""The map over processes: equal for any number of them, bounded, in order; and what happens when a worker dies."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from gtmodel.results import ArgumentError
from gtmodel.results.work import Crew, never
from gtmodel.workers import Done, WorkerDied, each
from gtmodel.workers.mapped import shared
from tests.support.commands import environment
from tests.workers.tasks import fails, first_waits, kills_always, kills_once, product

needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
Rows = Callable[..., list[Done]]


@pytest.fixture
def rows(crew: Crew) -> Rows:
    """The results of a task in the two workers of all tests."""
    return lambda task, items, ordered=True: list(shared(crew, task, items, never, ordered=ordered))


def test_results_are_equal_for_one_two_and_four_workers(rows: Rows) -> None:
    one, four = ([done.value for done in each(product, range(12), workers=n)] for n in (1, 4))
    assert one == [done.value for done in rows(product, range(12))] == four
    assert [k for k, _, _ in one] == list(range(12)) and {threads for _, _, threads in one} == {"1"}


@needs_signals
def test_a_killed_worker_is_replaced_and_its_row_repeated(rows: Rows, tmp_path: Path) -> None:
    found = rows(partial(kills_once, tmp_path), range(8))
    assert (tmp_path / "killed").exists()
    assert [done.value for done in found] == [product(k)[1] for k in range(8)]
    assert all(done.error is None for done in found)


@needs_signals
def test_a_row_that_kills_three_workers_is_left_out(tmp_path: Path) -> None:
    found = list(each(partial(kills_always, tmp_path), range(4), workers=1))
    assert [done.value for done in found] == [0, 1, None, 3]
    assert isinstance(found[2].error, WorkerDied)
    assert len((tmp_path / "deaths").read_text()) == 3


@pytest.mark.parametrize("elsewhere", [False, True])
def test_an_error_belongs_to_its_row(elsewhere: bool, rows: Rows) -> None:
    found = rows(fails, range(4)) if elsewhere else list(each(fails, range(4)))
    assert [done.value for done in found] == [None, None, None, 3]
    assert "sys.exit(3)" in str(found[0].error)
    assert "1 and 2" in str(found[1].error)
    assert isinstance(found[2].error, ValueError) and str(found[2].error) == "no such pose"


@pytest.mark.parametrize("ordered", [True, False])
def test_results_wait_for_their_turn_or_not(ordered: bool, rows: Rows, tmp_path: Path) -> None:
    found = [done.index for done in rows(partial(first_waits, tmp_path), range(6), ordered)]
    assert sorted(found) == list(range(6)) and (found[0] == 0) == ordered


def test_items_are_read_as_needed_and_the_caller_may_end_early() -> None:
    read: list[int] = []

    def items() -> Iterator[int]:
        for k in range(10_000):
            read.append(k)
            yield k

    with closing(each(product, items(), workers=1)) as found:
        assert [next(found).index for _ in range(3)] == [0, 1, 2]
    assert len(read) < 30


def test_stop_ends_the_iteration() -> None:
    seen: list[Done] = []
    for done in each(product, range(1000), workers=1, stop=lambda: len(seen) >= 5):
        seen.append(done)
    assert 5 <= len(seen) < 20


def test_threads_need_no_pickle() -> None:
    with ThreadPoolExecutor(2) as executor:
        found = list(each(lambda k: k * k, range(5), executor=executor))
    assert [done.value for done in found] == [0, 1, 4, 9, 16]


def test_an_executor_closed_on_the_way_is_named() -> None:
    with ThreadPoolExecutor(1) as executor, pytest.raises(ArgumentError) as caught:
        for _ in each(abs, range(100), executor=executor):
            executor.shutdown()
    assert caught.value.argument == "executor"


@pytest.mark.parametrize(
    ("argument", "given"), [("workers", {"workers": -1}), ("workers", {"workers": "2"}), ("executor", {"executor": 3})]
)
def test_wrong_arguments_are_named(argument: str, given: dict[str, Any]) -> None:
    with pytest.raises(ArgumentError) as caught:
        each(product, range(2), **given)
    assert caught.value.argument == argument


def test_a_script_without_main_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("from gtmodel.workers import each\nprint([d.value for d in each(abs, [-1], workers=1)])\n")
    done = subprocess.run([sys.executable, script], env=environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "if __name__ == '__main__':" in done.stderr.splitlines()[-1]


def test_a_function_of_a_notebook_can_be_a_task() -> None:
    script = (
        "from gtmodel.workers import each\ndef square(k):\n    return k * k\n"
        "print([d.value for d in each(square, range(4), workers=1)])"
    )
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, env=environment(), capture_output=True, text=True, timeout=60)
    assert done.stdout == "[0, 1, 4, 9]\n", done.stderr
