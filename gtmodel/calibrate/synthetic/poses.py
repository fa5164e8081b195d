"""Synthetic poses read back from their own text, as a person would read the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ...lang import Model
from ...results.disk import scratch
from ..measured.options import Measured, MeasuredSignal
from ..measured.poses import MeasuredPoses
from ..measured.reading_file import read_poses
from .making import make, stated_noise
from .options import Synthetic

FILE, CARTS = "measurements.csv", "carts.csv"


def made_poses(robot: Model, synthetic: Synthetic, held_out: Path | str | None = None) -> MeasuredPoses:
    """Synthetic poses: where a robot with known errors stands when it is commanded to a grid, as a device measures it.

    robot: a Gantry-Tau of the library. held_out: a file of the same columns that no fit sees. The result holds the text
    of the file and the robot with the errors. Raises ArgumentError.

    >>> grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[3, 3, 2], seed=1)
    >>> poses = gt.calibrate.made_poses(gt.robots.gantry_tau("l1_tape"), grid)
    >>> poses.measurements.values["T"].shape[1], list(poses.files)
    (3, ['measurements.csv'])
    """
    made = make(robot, synthetic)
    signals = {
        "q": MeasuredSignal("q", ["mm"] * 3 + (["deg"] * 3 if made.rotary else [])),
        "T": MeasuredSignal("T", "mm"),
    } | ({"e": MeasuredSignal("e", "1")} if made.turns else {})
    away = any([*synthetic.device_t, *synthetic.device_zyz])
    frame: Literal["robot", "device"] = "device" if away else "robot"
    measured = Measured(signals, orientation="e" if made.turns else None, frame=frame)
    with scratch() as place:
        path = place / FILE
        path.write_text(made.text, encoding="utf-8")
        poses = read_poses(path, measured, held_out)
    if synthetic.state_noise:
        stated = stated_noise(synthetic, made.rotary)
        m = replace(poses.measurements, noise={n: np.array(stated[n]) for n in signals})
        poses = replace(poses, measurements=m)
    files = {FILE: made.text} | ({CARTS: made.carts} if made.carts is not None else {})
    return replace(poses, truth=made.robot, files=files)
