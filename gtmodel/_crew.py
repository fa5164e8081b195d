"""The options --workers and --cluster: who runs the independent rows of a command."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

from gtmodel.problem_files.base import InputError
from gtmodel.results import ArgumentError
from gtmodel.results.work import Crew
from gtmodel.workers import connected, using

CLUSTER = "GTMODEL_CLUSTER"


@contextmanager
def crew_of(workers: int | None, cluster: str | None, *, all_cores: bool = False) -> Iterator[Crew]:
    """Run the rows of the block in `workers` processes, on the cluster of an address, or on that of GTMODEL_CLUSTER.

    all_cores: without any of these use one process per usable core, else what the study does by itself. Raises
    InputError about an option.
    """
    if cluster and workers is not None:
        raise InputError("--workers and --cluster exclude each other; leave one of them out")
    if workers is not None and workers < 0:
        raise InputError(f"--workers {workers}: expected a number of processes, at least 0")
    address = cluster or (os.environ.get(CLUSTER) if workers is None else None)
    if workers is None and not address and not all_cores:
        yield Crew()
        return
    try:
        with connected(address) if address else nullcontext() as client, using(workers, client) as crew:
            yield crew
    except ArgumentError as error:
        if error.argument not in ("cluster", "executor"):
            raise
        raise InputError(f"{'--cluster' if cluster else CLUSTER} {error.message}") from error
