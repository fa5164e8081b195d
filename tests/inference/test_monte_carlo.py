"""Runs by seed: the same for any number of processes, counted, interrupted; and the binomial band."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import comb

from gtmodel.inference import binomial_band, coverage, monte_carlo
from gtmodel.results import ArgumentError
from tests.inference.runs import mean_of_ten, own_seed, slow, third_fails
from tests.support.commands import environment


def test_the_band_is_exact():
    assert binomial_band(200) == (179, 198)
    assert binomial_band(500) == (458, 489)
    low, high = binomial_band(200)
    p = np.array([comb(200, k) * 0.95**k * 0.05 ** (200 - k) for k in range(201)])
    assert p[:low].sum() <= 0.0005 < p[: low + 1].sum()
    assert p[high + 1 :].sum() <= 0.0005 < p[high:].sum()


def test_students_intervals_hold_and_normal_ones_would_not():
    runs = monte_carlo(mean_of_ten, 200, 20, processes=0)
    found = coverage(runs.results, {"m": 3.0})
    assert found.passed and found.pooled == found.hits[0] / 200
    assert not coverage(runs.results, {"m": 3.05}).passed  # biased
    assert "179..198" in str(found)
    with pytest.raises(ValueError, match="found none"):
        coverage([], {"m": 3.0})


@pytest.fixture(scope="module")
def two():
    """Runs in two processes whose group is asked to stop after each, and what they told and left behind."""
    told: list[int] = []
    before = dict(os.environ)

    def progress(done: int, of: int) -> None:
        told.append(done)
        for worker in multiprocessing.active_children() if sys.platform != "win32" else ():
            os.kill(worker.pid or 0, signal.SIGTERM)
            os.kill(worker.pid or 0, signal.SIGINT)

    found = monte_carlo(own_seed, 5, 42, processes=2, progress=progress)
    return SimpleNamespace(found=found, told=told, environment_kept=dict(os.environ) == before)


def test_processes_change_nothing_and_have_one_thread_each(two):
    here = monte_carlo(own_seed, 5, 42, processes=0)
    threads = monte_carlo(own_seed, 5, 42, executor=ThreadPoolExecutor(3))
    client = SimpleNamespace(get_executor=lambda: ThreadPoolExecutor(2))  # as a Dask client has it
    cluster = monte_carlo(own_seed, 5, 42, executor=client)
    results = two.found.results
    assert [r[:2] for r in results] == [r[:2] for r in here.results] == [r[:2] for r in threads.results]
    assert [r[:2] for r in cluster.results] == [r[:2] for r in here.results]
    assert {r[2] for r in results} == {"1"} and two.told == [1, 2, 3, 4, 5]
    assert len({r[1] for r in here.results}) == 5 and not two.found.interrupted
    assert two.environment_kept


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals on Windows")
def test_signals_to_the_whole_group_leave_the_workers_to_the_parent(two):
    """A batch system, or Ctrl-C, reaches every process of the group: the runs at work are not lost for it."""
    assert not two.found.interrupted and two.found.indices == tuple(range(5))


def test_a_failing_run_is_named():
    with pytest.raises(RuntimeError, match="run 2: ValueError: no such pose"):
        monte_carlo(third_fails, 4, 1, processes=0)


def test_an_interruption_keeps_what_is_done_and_ends_the_workers():
    done: list[int] = []
    begun = time.monotonic()
    found = monte_carlo(slow, 6, 1, processes=1, progress=lambda n, of: done.append(n), interrupted=lambda: bool(done))
    assert found.interrupted and found.indices == (0,) and found.results == (0,)
    assert time.monotonic() - begun < 30


def test_ctrl_c_keeps_what_is_done():
    def stop(done: int, of: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    found = monte_carlo(own_seed, 6, 1, processes=0, progress=stop)
    assert found.interrupted and found.indices == (0, 1, 2)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
def test_workers_end_with_their_parent(tmp_path):
    """Killed without a word, it leaves nobody computing."""
    script = tmp_path / "parent.py"
    script.write_text(
        "import os\nfrom gtmodel.inference import monte_carlo\nfrom tests.inference.runs import tells_its_number\n"
        "if __name__ == '__main__':\n    monte_carlo(tells_its_number, 2, 1, processes=1)\n"
    )
    with subprocess.Popen([sys.executable, script], env=environment(), stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        parent.kill()
    deadline = time.monotonic() + 30
    while alive(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(worker)


def alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_coverage_needs_true_values() -> None:
    with pytest.raises(ArgumentError, match=r"truth: .*true value"):
        coverage([mean_of_ten(np.random.default_rng(1), 0)], {})
