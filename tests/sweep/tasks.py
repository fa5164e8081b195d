"""Tasks that worker processes import; each run leaves a file, so that a test can count it."""

import os
import signal
import time
import uuid
from pathlib import Path

import numpy as np


def counted(folder: Path, seconds: float, **keys: float) -> dict[str, float]:
    """Synthetic numbers of a row, after some time."""
    time.sleep(seconds)
    x, y = keys["x"], keys.get("y", 0.0)
    (folder / f"{x!r}_{y!r}_{uuid.uuid4().hex}").touch()
    return {"value": float(np.sin(x) + y), "norm": float(np.linalg.norm(np.arange(100.0) * x))}


def worker_killed_once(folder: Path, x: float) -> dict[str, float]:
    """The row x = 5 kills its worker the first time."""
    if x == 5.0 and not (folder / "killed").exists():
        (folder / "killed").touch()
        time.sleep(0.3)  # a worker of Dask that dies while it starts is not replaced
        os.kill(os.getpid(), signal.SIGKILL)
    return counted(folder, 0.01, x=x)


def fails_at_two(x: float) -> dict[str, float]:
    if x == 2.0:
        raise ZeroDivisionError("x is two")
    return {"value": 1 / (x - 2)}
