"""Poses as unknowns of a bundle."""

from __future__ import annotations

import numpy as np

from ..inference.bundle.unknown_group import UnknownGroup

POSE = ("qw", "qx", "qy", "qz", "x", "y", "z")
POSE_UNITS = ("rad", "rad", "rad", "m", "m", "m")


def pose_group(name: str, poses: np.ndarray, keys: tuple[str, ...] = (), *, local: bool = False,
               fixed: np.ndarray | None = None) -> UnknownGroup:  # fmt: skip
    """Poses (n, 7) as unknowns of a bundle."""
    return UnknownGroup(name, poses, POSE, keys=keys, turn=0, local=local, fixed=fixed, units=POSE_UNITS)
