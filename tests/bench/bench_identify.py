"""Time of an identification: reading 60 s at 250 Hz from a CSV file against the algebra; 200 seeds in processes.

Prints Markdown. Both in one process, processor times, the best of some repetitions. Issue 6, point 6.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from gtmodel.identify import Sensors, identify, repeat_identification, rows_of
from gtmodel.measurements import Column, read_log
from tests.identify.plants import NOISE, SAMPLE_TIME, SEED, regressor, session, simulator, truth

REPETITIONS = 5
COLUMNS = {"q": Column("q", "m"), "tau": Column("tau", "N")}


def seconds(work) -> float:
    best = np.inf
    for _ in range(REPETITIONS):
        begin = time.process_time()
        work()
        best = min(best, time.process_time() - begin)
    return float(best)


def main() -> int:
    one = session(Sensors(effort_noise=NOISE), SEED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        one.trajectory.to_csv(path)
        size = path.stat().st_size / 1e6
        (read,) = read_log(path, COLUMNS, sample_time=SAMPLE_TIME)
        reading = seconds(lambda: read_log(path, COLUMNS, sample_time=SAMPLE_TIME))
    t = read.trajectory
    rates = simulator().truth
    evaluate = seconds(lambda: regressor()(t["q"], rates["der(q)"], rates["der(q,2)"]))
    preparing = seconds(lambda: rows_of(read, regressor()))
    rows = rows_of(read, regressor())
    fitting = seconds(lambda: identify(rows, nonnegative=False, test=[]))
    print(f"60 s at 250 Hz, {len(t)} rows, a CSV file of {size:.1f} MB; {len(rows)} rows fitted.\n")
    print("| step | time [ms] |\n|---|---:|")
    print(f"| reading the file | {1e3 * reading:.0f} |")
    print(f"| regressor alone, 15,000 rows of 3 x 13 | {1e3 * evaluate:.0f} |")
    print(f"| filters, regressor and rows | {1e3 * preparing:.0f} |")
    print(f"| fit, covariance, tests | {1e3 * fitting:.0f} |")
    algebra = preparing + fitting
    verdict = "reading is more" if reading > algebra else "the algebra is more"
    print(f"\nReading {1e3 * reading:.0f} ms, everything after it {1e3 * algebra:.0f} ms: {verdict}.\n")
    begin = time.perf_counter()
    done: list[int] = []
    found = repeat_identification(
        simulator(), regressor(), truth(), Sensors(effort_noise=NOISE), 200, SEED, progress=lambda k, n: done.append(k)
    )
    wall = time.perf_counter() - begin
    c = found.coverage
    print(f"200 seeds in parallel processes: {wall:.1f} s wall time, {len(done)} steps of progress.")
    print(f"Hits {min(c.hits)}..{max(c.hits)}, band {c.band[0]}..{c.band[1]}, pooled {100 * c.pooled:.2f} %.")
    return 0 if c.passed else 1


if __name__ == "__main__":
    sys.exit(main())
