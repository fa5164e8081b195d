"""Tasks that worker processes import."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np


def product(k: int) -> tuple[int, float, str | None]:
    """A sum whose last bits depend on the number of BLAS threads, and that number."""
    A = np.random.default_rng(k).normal(size=(120, 120))
    return k, float((A @ A.T).sum()), os.environ.get("OPENBLAS_NUM_THREADS")


def kills_once(folder: Path, k: int) -> float:
    """Row 3 kills its worker the first time."""
    mark = folder / "killed"
    if k == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.02)
    return product(k)[1]


def kills_always(folder: Path, k: int) -> int:
    """Row 2 kills each worker that runs it, and counts them."""
    if k == 2:
        with open(folder / "deaths", "a") as file:
            file.write("x")
        time.sleep(0.3)  # a worker of Dask that dies while it starts is not replaced
        os.kill(os.getpid(), signal.SIGKILL)
    return k


class Stubborn(Exception):
    """An error that does not survive pickling."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__(f"{a} and {b}")


def fails(k: int) -> int:
    if k == 0:
        sys.exit(3)
    if k == 1:
        raise Stubborn(1, 2)
    if k == 2:
        raise ValueError("no such pose")
    return k


def first_waits(folder: Path, k: int) -> int:
    """Row 0 waits until row 5 is done."""
    (folder / str(k)).touch()
    deadline = time.monotonic() + 60
    while k == 0 and not (folder / "5").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    return k
