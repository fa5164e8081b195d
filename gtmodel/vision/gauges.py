"""Motions of everything that pixels do not notice: by name, for the null space of a bundle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..geometry.rotations import matrices_of
from ..inference.bundle.undetermined import GaugeMotion

AXES = "xyz"
FIX = "fix a camera, or measure where a mark is"
LENGTH = "give one known length: between two marks, of a board, or between two cameras"


def similarity_motions(cameras: Sequence[str] = ("camera",), frames: Sequence[str] = (),
                       points: Sequence[str] = (), marks: Sequence[str] = ()) -> list[GaugeMotion]:  # fmt: skip
    """Seven motions of a whole scene, each with its remedy: along and about x, y and z, and growth by one factor.

    Names of groups of unknowns of `gt.inference.bundle`: cameras, whose poses take outer coordinates to their own;
    frames, boards or platforms, whose poses take their own coordinates to outer ones; points in outer coordinates;
    marks, points in coordinates of the frames. Of cameras and frames the first seven numbers are a pose: quaternion,
    scalar first, and translation.

    >>> for motion in gt.vision.similarity_motions(["camera"], points=["point"])[::3]:
    ...     print(f"{motion.words}: {motion.remedy}")
    all cameras and points move together along x: fix a camera, or measure where a mark is
    all cameras and points turn together about x: fix a camera, or measure where a mark is
    everything grows by one factor: give one known length: between two marks, of a board, or between two cameras
    """
    seen = "points" if points else "boards"

    def shift(axis: int, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        step = {}
        for name in cameras:
            step[name] = _still(values[name])
            step[name][:, 3:6] = -matrices_of(values[name])[:, :, axis]
        for name in frames:
            step[name] = _still(values[name])
            step[name][:, 3 + axis] = 1.0
        for name in points:
            step[name] = np.tile(np.eye(3)[axis], (len(values[name]), 1))
        return step

    def turn(axis: int, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        w, step = np.eye(3)[axis], {}
        for name in cameras:
            step[name] = _still(values[name])
            step[name][:, :3] = -w
        for name in frames:
            step[name] = _still(values[name])
            step[name][:, :3] = matrices_of(values[name])[:, axis, :]
            step[name][:, 3:6] = np.cross(w, values[name][:, 4:7])
        for name in points:
            step[name] = np.cross(w, values[name])
        return step

    def growth(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        step = {}
        for name in (*cameras, *frames):
            step[name] = _still(values[name])
            step[name][:, 3:6] = values[name][:, 4:7]
        for name in (*points, *marks):
            step[name] = values[name].copy()
        return step

    def along(axis: int) -> GaugeMotion:
        words = f"all cameras and {seen} move together along {AXES[axis]}"
        return GaugeMotion(words, FIX, lambda values: shift(axis, values))

    def about(axis: int) -> GaugeMotion:
        words = f"all cameras and {seen} turn together about {AXES[axis]}"
        return GaugeMotion(words, FIX, lambda values: turn(axis, values))

    scale = GaugeMotion("everything grows by one factor", LENGTH, growth)
    return [*(along(k) for k in range(3)), *(about(k) for k in range(3)), scale]


def _still(values: np.ndarray) -> np.ndarray:
    return np.zeros((len(values), values.shape[1] - 1))
