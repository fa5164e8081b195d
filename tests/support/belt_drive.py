"""Synthetic log of problems/data/belt_drive_synthetic.csv: a belt drive that stands, and then moves under a known motor
torque and an unknown torque on the load.

`python -m tests.support.belt_drive` writes the file again.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.results.table import csv_text

PROBLEMS = Path(__file__).parents[2] / "problems"
FILE = PROBLEMS / "data" / "belt_drive_synthetic.csv"
STATES = ["motor", "load", "motor_rate", "load_rate"]
PERIOD, REST, ROWS, SEED = 0.002, 200, 800, 7  # s, rows at rest, all rows
STAND = {"motor": 0.3, "load": 0.3, "motor_rate": 0.0, "load_rate": 0.0}
TRUTH = {"encoder.deviation": 1e-3, "scale.deviation": 5e-4, "push.density": 1e-3}  # rad, rad, (N.m)2 s


def model() -> Any:
    """The model of the shipped problem."""
    spec = importlib.util.spec_from_file_location("belt_drive", PROBLEMS / "models" / "belt_drive.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.BeltDrive()


def system() -> gt.filtering.System:
    """The drive with its true noise."""
    noise = {"push": TRUTH["push.density"]}
    process = gt.filtering.ProcessModel(model(), noise, states=STATES, inputs=["torque"])
    sensors = [
        gt.filtering.Sensor(name, signal, deviation=TRUTH[f"{name}.deviation"])
        for name, signal in (("encoder", "motor"), ("scale", "load"))
    ]
    return gt.filtering.System(process, sensors)


def torque() -> gt.Trajectory:
    """Motor torque: none at rest, then a swept sine."""
    time = PERIOD * np.arange(ROWS)
    moving = np.maximum(0.0, time - PERIOD * (REST - 1))
    swept = 0.3 * np.sin(2 * np.pi * (2.0 * moving + 4.0 * moving**2))
    return gt.Trajectory(time, {"torque": swept}, {"torque": "N.m"})


def columns(seed: int = SEED) -> dict[str, np.ndarray]:
    """Columns of the file: time, torque, and both angles in degrees."""
    drive, known = system(), torque()
    time = known.time
    begin = gt.filtering.InitialState(STAND, dict.fromkeys(STATES, 0.0), time=float(time[REST - 1]))
    moving = gt.filtering.draw(drive, begin, time[REST:], seed=seed, inputs=known).log
    rng = np.random.default_rng([seed, 99])
    read = {}
    for name, signal in (("encoder", "motor"), ("scale", "load")):
        still = STAND[signal] + TRUTH[f"{name}.deviation"] * rng.standard_normal(REST)
        read[name] = np.degrees(np.concatenate([still, moving[name].values[:, 0]]))
    return {"time": time, "torque": known["torque"], **read}


def text(seed: int = SEED) -> str:
    """The file."""
    note = f"synthetic: a belt drive at rest for {PERIOD * REST:g} s, then moving; seed {seed}, noise {TRUTH} in SI"
    return csv_text(columns(seed), digits=8, notes=[note])


if __name__ == "__main__":
    FILE.write_text(text())
