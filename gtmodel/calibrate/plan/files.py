"""What a calibration plan hands to the shop floor: poses in random order as CSV, and a RAPID program of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...motion import rapid
from ...results.table import csv_text

Array = np.ndarray
FIT, HELD_OUT = "calibrate", "verify"


def in_order(poses: Array, held_out: Array, seed: int) -> tuple[Array, list[str]]:
    """All points (n, 3) in random order, which separates drift from geometry, and what each is for."""
    T = np.vstack([poses, held_out])
    purpose = [FIT] * len(poses) + [HELD_OUT] * len(held_out)
    order = np.random.default_rng(np.random.SeedSequence([seed, 1])).permutation(len(T))
    return T[order], [purpose[k] for k in order]


def poses_csv(T: Array, q: Array, purpose: list[str], title: str) -> str:
    """One row per pose, in the order in which they are measured."""
    carts, axes = 1e3 * q[:, :3], np.degrees(q[:, 3:])
    columns: dict[str, Any] = {f"q[{k}] [mm]": x for k, x in enumerate(carts.T)}
    columns |= {f"q[{k}] [deg]": x for k, x in enumerate(axes.T, 3)}
    columns |= {f"T[{k}] [mm]": x for k, x in enumerate(1e3 * T[:, :3].T)}
    turned = {f"e[{k}]": x for k, x in enumerate(T[:, 3:].T)}
    forms = dict.fromkeys(columns, ".4f") | dict.fromkeys(turned, ".9f")
    notes = ["commanded poses of a calibration plan; nothing here is measured", *([f"title: {title}"] if title else [])]
    return csv_text({"pose": range(1, len(T) + 1), "purpose": purpose} | columns | turned, forms, notes)


def rapid_program(T: Array, q: Array, title: str, settle: float) -> str:
    """A RAPID module that goes to each pose, stops, waits and counts. Text only: tested against no controller."""
    rotary = ", d, e, f the rotary axes in degrees" if q.shape[1] == 6 else ""
    return rapid.module(
        "GtCalibration",
        [
            title or "calibration poses",
            "Written by gtmodel; tested against no controller. Check workspace, work object and tool first.",
            "The robot is not calibrated yet: keep the speed low and a hand on the stop.",
            f"Positions in mm; external axes a, b, c are the carts in mm{rotary}.",
        ],
        [
            f"LOCAL CONST num GtCount := {len(T)};",
            f"LOCAL CONST num GtSettle := {rapid.number(settle)};",
            "PERS num GtPose := 0;",
        ],
        "GtPoses",
        rapid.robtargets(T, q),
        [
            "PROC GtMeasure(PERS tooldata tool, PERS wobjdata wobj)",
            "  FOR i FROM 1 TO GtCount DO",
            "    MoveJ GtPoses{i}, v200, fine, tool \\WObj:=wobj;",
            "    GtPose := i;",
            "    WaitTime \\InPos, GtSettle;",
            "  ENDFOR",
            "  GtPose := 0;",
            "ENDPROC",
        ],
    )
