"""Synthetic readings of problems/data/force_sensor: a force sensor at rest in 100 poses, whose bias drifts by 2 N.

Run as a module it writes the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy

import gtmodel as gt

FOLDER = Path(__file__).resolve().parents[2] / "problems/data/force_sensor"
SEED, POSES, DRIFT, PERIOD = 43, 100, 2.0, 6.0  # N over the recording; s from pose to pose
WAY, ARM = np.array([0.48, -0.6, 0.64]), 0.04  # direction of the drift; m, its moment over its force
MASS, CENTRE = 1.6, (0.012, -0.008, 0.095)


def text() -> str:
    """The file: time, quaternion with the scalar first, force and moment, without a header."""
    rng = np.random.default_rng(SEED)
    turns = scipy.spatial.transform.Rotation.random(POSES, rng=rng)
    sensor = gt.control.lead_through.SyntheticSensor(
        mass=MASS, centre=CENTRE, force_bias=(3.0, -1.0, 2.0), moment_bias=(0.1, 0.2, -0.3), force_noise=0.05,
        moment_noise=0.003,
    )  # fmt: skip
    f, m = sensor.readings_at_rest(turns.as_matrix(), rng)
    drift = np.linspace(-DRIFT, 0.0, POSES)[:, None] * WAY  # the bias of the sensor is that of the last pose
    rows = np.column_stack(
        [PERIOD * np.arange(POSES), turns.as_quat(scalar_first=True), f + drift, 1e3 * (m + ARM * drift)]
    )
    note = (
        f"# synthetic: seed {SEED}, noise 0.05 N and 0.003 N m, drift {DRIFT:g} N; tests/support/drifting_sensor.py\n"
    )
    digits = [1, *[7] * 4, *[4] * 3, *[2] * 3]
    return note + "\n".join(" ".join(f"{x:.{d}f}" for x, d in zip(row, digits, strict=True)) for row in rows) + "\n"


if __name__ == "__main__":
    (FOLDER / "poses.txt").write_text(text())
