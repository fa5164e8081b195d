"""Synthetic poses read back from their own text, as a person would read the file."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Literal

from ...lang import Model
from ..measured.options import Measured, MeasuredSignal
from ..measured.poses import Poses
from ..measured.reading_file import read_poses
from .making import make, stated_noise
from .options import Synthetic

FILE, CARTS = "measurements.csv", "carts.csv"


def made_poses(robot: Model, synthetic: Synthetic, held_out: Path | str | None = None) -> Poses:
    """Poses that the robot's model reaches, where a robot with known errors stands there, and what a device says.

    robot: a Gantry-Tau of the library. held_out: a file of the same columns that no fit sees. Raises ArgumentError.
    """
    made = make(robot, synthetic)
    signals = {
        "q": MeasuredSignal("q", ["mm"] * 3 + (["deg"] * 3 if made.rotary else [])),
        "T": MeasuredSignal("T", "mm"),
    } | ({"e": MeasuredSignal("e", "1")} if made.turns else {})
    if synthetic.state_noise:
        stated = stated_noise(synthetic, made.rotary)
        signals = {n: replace(s, noise=stated[n]) for n, s in signals.items()}
    away = any([*synthetic.device_t, *synthetic.device_zyz])
    frame: Literal["robot", "device"] = "device" if away else "robot"
    measured = Measured(signals, orientation="e" if made.turns else None, frame=frame)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / FILE
        path.write_text(made.text, encoding="utf-8")
        found = read_poses(path, measured, held_out)
    files = {FILE: made.text} | ({CARTS: made.carts} if made.carts is not None else {})
    return replace(found, truth=made.robot, files=files)
