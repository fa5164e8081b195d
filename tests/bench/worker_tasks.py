"""Tasks of bench_workers.py that worker processes import."""

import os
import time

import numpy as np

ROW_S = 0.002  # s: a cheap study


def one_row(k: int) -> float:
    """Work for some milliseconds of processor time and return the processor time [s]."""
    begin = time.process_time()
    x = np.arange(100.0) + k
    while time.process_time() - begin < ROW_S:
        x = np.sin(x)
    return time.process_time() - begin


def resident(_: int) -> float:
    """Memory of this process [MB]."""
    import gtmodel.optimize.solve  # noqa: F401  CasADi, SciPy and most engines

    with open(f"/proc/{os.getpid()}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
