"""Corners of many pictures as one table: camera, pose, mark, u, v, sigma."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ...results.refusal import ArgumentError
from .detect import detect
from .detection import Detection
from .targets import Target

COLUMNS = ("camera", "pose", "mark", "u", "v", "sigma")


class CornerRow(NamedTuple):
    """One corner in one picture: u, v and the standard deviation sigma of each [pixel]."""

    camera: str
    pose: str
    mark: str
    u: float
    v: float
    sigma: float


def detected_corners(
    pictures: Mapping[tuple[str, str], np.ndarray],
    target: Target,
    backgrounds: Mapping[str, np.ndarray] | None = None,
) -> tuple[list[CornerRow], dict[tuple[str, str], Detection]]:
    """Corners of all pictures in which the target was detected, and the detection of each picture.

    `pictures` by camera and pose; `backgrounds` by camera, of FiveSquares. The second value says of each picture why it
    has no corners.

    >>> from gtmodel.vision import detection, rendering
    >>> tool = detection.FiveSquares(side=0.04)
    >>> camera = lambda p: 1400 * p[:, :2] / (p[:, 2:] + 1.5) + [319.5, 239.5]
    >>> picture = rendering.rendered(tool.layers, camera, (640, 480))
    >>> rows, seen = detection.detected_corners({("left", "1"): picture, ("left", "2"): picture // 8}, tool)
    >>> len(rows), rows[0].mark, seen["left", "2"].status.name
    (20, '0.0', 'TOO_DARK')
    """
    rows, seen = list[CornerRow](), dict[tuple[str, str], Detection]()
    for (camera, pose), picture in pictures.items():
        d = detect(picture, target, None if backgrounds is None else backgrounds.get(camera))
        seen[camera, pose] = d
        rows += [CornerRow(camera, pose, mark, float(u), float(v), float(s))
                 for mark, (u, v), s in zip(d.marks, d.corners, d.sigma, strict=True)]  # fmt: skip
    return rows, seen


def corners_csv(rows: list[CornerRow], synthetic: str = "") -> str:
    """The table as text, to be read by a calibration of cameras.

    `synthetic`: what made the pictures, with seed and noise, for the first line; "" for real ones. Raises ArgumentError
    for an empty table.

    >>> row = gt.vision.detection.CornerRow("left", "1", "0.0", 244.42741, 94.16463, 0.05)
    >>> print(gt.vision.detection.corners_csv([row]), end="")
    camera,pose,mark,u,v,sigma
    left,1,0.0,244.42741,94.16463,0.05
    """
    if not rows:
        raise ArgumentError("there are no corners: in no picture was the target detected", "rows")
    head = [f"# synthetic: {synthetic}"] if synthetic else []
    lines = [f"{r.camera},{r.pose},{r.mark},{r.u:.5f},{r.v:.5f},{r.sigma:.4g}" for r in rows]
    return "\n".join([*head, ",".join(COLUMNS), *lines, ""])
