"""What a calibration plan hands to the shop floor: poses in random order as CSV, and a RAPID program of them."""

from __future__ import annotations

import numpy as np

from ...motion.reference import robtargets

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
    axes = [f"q[{k}] [{'mm' if k < 3 else 'deg'}]" for k in range(q.shape[1])]
    turned = [f"e[{k}]" for k in range(T.shape[1] - 3)]
    lines = ["# commanded poses of a calibration plan; nothing here is measured"]
    lines += [f"# title: {title}"] if title else []
    lines.append(",".join(["pose", "purpose", *axes, *(f"T[{k}] [mm]" for k in range(3)), *turned]))
    for k, (t, c, p) in enumerate(zip(T, q, purpose, strict=True), 1):
        numbers = [*(1e3 * c[:3]), *np.degrees(c[3:]), *(1e3 * t[:3])]
        lines.append(",".join([str(k), p, *(f"{x:.4f}" for x in numbers), *(f"{x:.9f}" for x in t[3:])]))
    return "\n".join(lines) + "\n"


def rapid_program(T: Array, q: Array, title: str, settle: float) -> str:
    """A RAPID module that goes to each pose, stops, waits and counts. Text only: tested against no controller."""
    n = len(T)
    lines = [
        "MODULE GtCalibration",
        f"  ! {title or 'calibration poses'}",
        "  ! Written by gtmodel; tested against no controller. Check workspace, work object and tool first.",
        "  ! The robot is not calibrated yet: keep the speed low and a hand on the stop.",
        "  ! Positions in mm; external axes a, b, c are the carts in mm"
        + (", d, e, f the rotary axes in degrees." if q.shape[1] == 6 else "."),
        f"  CONST num GtCount := {n};",
        f"  CONST num GtSettle := {settle:g};",
        "  PERS num GtPose := 0;",
        f"  LOCAL CONST robtarget GtPoses{{{n}}} := [",
        *robtargets(T, q),
        "  ];",
        "  PROC GtMeasure(PERS tooldata tool, PERS wobjdata wobj)",
        "    FOR i FROM 1 TO GtCount DO",
        "      MoveJ GtPoses{i}, v200, fine, tool \\WObj:=wobj;",
        "      GtPose := i;",
        "      WaitTime \\InPos, GtSettle;",
        "    ENDFOR",
        "    GtPose := 0;",
        "  ENDPROC",
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"
