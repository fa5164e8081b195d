"""A real Dask cluster: the same bytes as in this process, also if its workers die."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError
from gtmodel.sweep.sweep_study import csv_of
from gtmodel.workers import WorkerDied, each, using
from tests.sweep.tasks import counted, worker_killed_once
from tests.workers.tasks import kills_always

needs_signals = pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL on Windows")
distributed: Any = pytest.importorskip("distributed", reason="needs the extra cluster")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes under one scheduler; to start one again takes seconds."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def client(cluster: Any) -> Iterator[Any]:
    with gt.workers.connected(cluster.scheduler_address) as client:
        yield client


def test_a_study_writes_the_same_bytes_on_a_cluster(client: Any) -> None:
    robot = gt.robots.gantry_tau("l1_tape")
    T = np.random.default_rng(1).uniform([0.5, -1.0, 0.2], [1.5, 0.3, 0.8], (4001, 3))  # in three parts
    here = gt.kinematics.causality_study(robot, "T", "q", T).files
    with using(executor=client) as crew:
        there = gt.kinematics.causality_study(robot, "T", "q", T).files
    assert crew.used and here and there == here


@needs_signals
def test_a_sweep_gives_the_same_table_with_a_worker_killed(client: Any, tmp_path: Path) -> None:
    X = [float(x) for x in range(12)]
    swept = gt.sweep.study(partial(worker_killed_once, tmp_path), {"x": X}, executor=client)
    assert (tmp_path / "killed").exists() and swept.status.ok
    assert csv_of(swept.table) == csv_of(gt.sweep.study(partial(counted, tmp_path, 0.0), {"x": X}, workers=0).table)


@needs_signals
def test_only_the_row_that_kills_its_workers_is_left_out(
    client: Any, cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)  # one death is enough
    found = list(each(partial(kills_always, tmp_path), range(6), executor=client))
    assert [done.value for done in found] == [0, 1, None, 3, 4, 5]
    assert isinstance(found[2].error, WorkerDied)


def test_an_address_without_a_scheduler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gt.workers.cluster, "WAIT_S", 0.5)
    with pytest.raises(ArgumentError) as caught, gt.workers.connected("tcp://127.0.0.1:9"):
        pass
    assert caught.value.argument == "cluster" and "tcp://127.0.0.1:9" in str(caught.value)
