"""Processor time and memory of large logs: read, inspected, resampled, filtered; a gyro calibrated on many references.

python tests/bench/bench_large_logs.py [ROWS]      1e6 rows and 30 columns if left out
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import gtmodel as gt

COLUMNS, STEP, PART = 29, 1e-3, 20_000
MOST_CPU, MOST_GB = 60.0, 1.5  # goals for a million rows


def write(path: Path, rows: int) -> None:
    """Uneven times (jitter 5 %) and 29 noisy sines, synthetic, seed 1."""
    draw = np.random.default_rng(1)
    t = STEP * np.arange(rows) + draw.normal(0.0, 0.05 * STEP, rows)
    with path.open("w") as file:
        file.write("# synthetic: seed 1\ntime," + ",".join(f"c{k}" for k in range(COLUMNS)) + "\n")
        for begin in range(0, rows, PART):
            part = t[begin : begin + PART]
            sines = np.sin(np.outer(part, 0.5 + np.arange(COLUMNS)))
            np.savetxt(
                file, np.column_stack([part, sines + 0.01 * draw.normal(size=sines.shape)]), fmt="%.7g", delimiter=","
            )


def timed(stage: str, work: Callable[[], Any]) -> Any:
    begin = time.process_time()
    value = work()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"  {stage:<44}{time.process_time() - begin:8.1f} s{memory:8.2f} GB")
    return value


def logs(rows: int, folder: Path) -> None:
    path, columns = folder / "log.csv", {f"c{k}": gt.measurements.Column(f"c{k}", "m") for k in range(COLUMNS)}
    write(path, rows)
    print(f"a log of {rows:,} rows, {COLUMNS + 1} columns, {path.stat().st_size / 1e6:.0f} MB")
    begin = time.process_time()
    timed("inspect", lambda: gt.measurements.inspect(path))
    (session,) = timed("read", lambda: gt.measurements.read_log(path, columns, uneven=True))
    (even,) = timed("resample", lambda: gt.measurements.resample(session.trajectory, sample_time=STEP)).sessions
    low_pass, signals = gt.measurements.ZeroPhase(20.0), even.trajectory
    timed("low pass", lambda: [low_pass(signals[name], even.sample_time) for name in signals.names])
    cpu, memory = time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    word = "pass" if cpu <= MOST_CPU and memory <= MOST_GB else "FAIL"
    print(f"  {'sum; at most 60 s and 1.5 GB':<44}{cpu:8.1f} s{memory:8.2f} GB  {word}")


def gyro() -> None:
    print("calibration of a gyro, synthetic, seed 0; the time should grow as the number of references")
    for duration in (90.0, 180.0, 360.0):
        made = gt.filtering.synthetic_attitude(gt.filtering.SyntheticAttitude(duration=duration))
        readings, references = made.recording.gyro, made.recording.reference
        stamps = gt.filtering.sampled_instants(readings.time, 0.009963)
        body = Rotation.from_quat(references["quaternion"], scalar_first=True).inv()
        start = gt.filtering.RateCorrection(np.eye(3), np.zeros(3))
        calibrate = partial(
            gt.filtering.calibrate_gyro, stamps, np.radians(readings["rate"]), references.time, body, start
        )
        timed(f"{len(readings.time):,} readings, {len(references.time):,} references", calibrate)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        logs(int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000, Path(temporary))
    gyro()
